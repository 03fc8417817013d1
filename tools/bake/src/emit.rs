//! Chunks to tiles: rows in local numbers, sample points, receivers, occluders; the manifest last.

use crate::BakeError;
use crate::clip::{Polygon, clip_to_cells};
use crate::patches::PatchSet;
use crate::receivers::BakeReceiver;
use crate::rows::RawRow;
use crate::sample::SurfaceSample;
use crate::surfaces::ChunkSurfaces;
use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;
use earthshine_world::{Chunk, ChunkId, ChunkRows, Column, Grid, OccluderMesh, Receivers, SamplePoint, Vec3};
use glam::IVec3;

/// Makes the chunks of a world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Emitter<'a> {
    /// All patches.
    pub(crate) set: &'a PatchSet,
    /// Of the bake.
    pub(crate) parameters: &'a BakeParameters,
}

/// Everything a chunk is made of.
#[derive(Debug)]
pub(crate) struct Parts<'a> {
    /// With patches in the order of the set.
    pub(crate) surfaces: &'a ChunkSurfaces<'a>,
    /// One a patch, balanced.
    pub(crate) rows: &'a [RawRow],
    /// Ascending by place.
    pub(crate) receivers: &'a [BakeReceiver],
    pub(crate) occluders: OccluderMesh,
}

impl Emitter<'_> {
    /// The chunk at `coord`.
    ///
    /// # Errors
    /// More patches than a tile can number.
    pub(crate) fn chunk(&self, coord: [i32; 3], parts: Parts<'_>) -> Result<Chunk, BakeError> {
        let ChunkSurfaces { samples, patches: sources, .. } = parts.surfaces;
        if sources.len() > Chunk::PATCHES_MAX {
            return Err(BakeError::TooManyPatches {
                chunk: coord,
                patches: sources.len(),
                max: Chunk::PATCHES_MAX,
            });
        }
        let (mut patches, mut points) = (Vec::with_capacity(sources.len()), Vec::new());
        for source in sources.iter() {
            let chosen =
                source.representative_samples(self.parameters.points_per_patch, self.parameters.seed);
            let mut patch = source.patch;
            patch.point_first = points.len() as u32;
            patch.point_count = chosen.len() as u32;
            patches.push(patch);
            points.extend(chosen.iter().map(|&sample| {
                let SurfaceSample { position, normal, .. } = samples[sample as usize];
                SamplePoint { position, normal }
            }));
        }
        let receiver_rows: Vec<&RawRow> = parts.receivers.iter().map(|receiver| &receiver.row).collect();
        let places = parts.receivers.iter().map(|receiver| receiver.place).collect();
        Ok(Chunk {
            id: ChunkId::new(0, IVec3::from(coord)),
            patches,
            points,
            rows: self.local_rows(parts.rows),
            receivers: if parts.receivers.is_empty() {
                Receivers::default()
            } else {
                Receivers { places, rows: self.local_rows(&receiver_rows) }
            },
            occluders: parts.occluders,
        })
    }

    /// `rows` with columns as (segment, local).
    fn local_rows<R: std::borrow::Borrow<RawRow>>(&self, rows: &[R]) -> ChunkRows {
        let chunk_of = |patch: u32| self.grid().chunk_of(self.set.patches[patch as usize].patch.voxel);
        let mut targets: Vec<[i32; 3]> = Vec::new();
        for row in rows {
            // Entries are ascending by patch and patches by chunk: only changes need a look.
            let mut last = None;
            for &(patch, _) in &row.borrow().entries {
                let chunk = chunk_of(patch).to_array();
                if last != Some(chunk) {
                    targets.push(chunk);
                    last = Some(chunk);
                }
            }
        }
        targets.sort_unstable();
        targets.dedup();
        let mut local = ChunkRows {
            segments: targets.iter().map(|&chunk| ChunkId::new(0, IVec3::from(chunk))).collect(),
            row_starts: vec![0],
            ..ChunkRows::default()
        };
        for row in rows {
            self.push_row(&mut local, &targets, row.borrow());
        }
        local
    }

    fn push_row(&self, local: &mut ChunkRows, targets: &[[i32; 3]], row: &RawRow) {
        let (mut segment, mut owned) = (0u16, 0..0u32);
        for &(patch, share) in &row.entries {
            if !owned.contains(&patch) {
                let chunk = self.grid().chunk_of(self.set.patches[patch as usize].patch.voxel).to_array();
                segment = targets.binary_search(&chunk).expect("every target was collected") as u16;
                owned = self.set.chunks[&chunk].clone();
            }
            local.columns.push(Column { segment, local: (patch - owned.start) as u16 });
            local.shares.push(share);
        }
        local.row_starts.push(local.columns.len() as u32);
        local.sky_shares.push(row.sky);
        local.absorbed_shares.push(row.absorbed);
    }

    fn grid(&self) -> Grid {
        self.parameters.grid
    }
}

/// The shadow casters of `chunk`: `triangles`, which hold all that touch it, cut at its faces.
pub(crate) fn occluders(scene: &Scene, triangles: &[u32], grid: Grid, chunk: [i32; 3]) -> OccluderMesh {
    let mut mesh = OccluderMesh::default();
    let cell = IVec3::from(chunk);
    for &triangle in triangles {
        let surface = mean_surface(scene, triangle as usize);
        if surface[3] == 0 {
            continue;
        }
        let corners = scene.triangles[triangle as usize];
        clip_to_cells(corners, grid.chunk_edge_m(), (cell, cell), |_, polygon| {
            add_polygon(&mut mesh, polygon, surface);
        });
    }
    mesh
}

fn add_polygon(mesh: &mut OccluderMesh, polygon: &Polygon, surface: [u8; 4]) {
    for corners in polygon.fan() {
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(corners);
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.surfaces.push(surface);
    }
}

/// Mean reflectance and opacity over a few places of a triangle.
fn mean_surface(scene: &Scene, triangle: usize) -> [u8; 4] {
    const PLACES: [(f32, f32); 4] = [(1.0 / 3.0, 1.0 / 3.0), (0.6, 0.2), (0.2, 0.6), (0.2, 0.2)];
    let (mut reflectance, mut solid) = (Vec3::ZERO, 0.0);
    for (u, v) in PLACES {
        let surface = scene.surface(triangle, u, v, true);
        reflectance += surface.reflectance;
        solid += f32::from(u8::from(!surface.is_hole));
    }
    let byte = |value: f32| (value / PLACES.len() as f32 * 255.0).round().clamp(0.0, 255.0) as u8;
    [byte(reflectance.x), byte(reflectance.y), byte(reflectance.z), byte(solid)]
}
