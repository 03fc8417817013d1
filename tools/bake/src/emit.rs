//! Chunks to tiles: rows in local numbers, sample points, receivers, occluders; the manifest last.

use crate::BakeError;
use crate::clip::{Polygon, clip_to_grid};
use crate::patches::PatchSet;
use crate::receivers::ReceiverSet;
use crate::rows::RawRow;
use crate::sample::SurfaceSample;
use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;
use earthshine_world::{Chunk, ChunkId, ChunkRows, Column, Grid, OccluderMesh, Receivers, SamplePoint, Vec3};
use glam::IVec3;
use std::collections::BTreeMap;

/// Everything a chunk is made of.
#[derive(Debug)]
pub struct Emitter<'a> {
    /// Where samples came from.
    pub samples: &'a [SurfaceSample],
    /// All patches.
    pub set: &'a PatchSet,
    /// One a patch, balanced.
    pub rows: &'a [RawRow],
    /// All receivers.
    pub receivers: &'a ReceiverSet,
    /// Occluders by chunk.
    pub occluders: &'a BTreeMap<[i32; 3], OccluderMesh>,
    /// Of the bake.
    pub parameters: &'a BakeParameters,
}

impl Emitter<'_> {
    /// Every chunk that has patches, receivers or occluders, ascending.
    #[must_use]
    pub fn chunk_coords(&self) -> Vec<[i32; 3]> {
        let keys = self.set.chunks.keys().chain(self.receivers.keys()).chain(self.occluders.keys());
        let mut coords: Vec<_> = keys.copied().collect();
        coords.sort_unstable();
        coords.dedup();
        coords
    }

    /// The chunk at `coord`.
    ///
    /// # Errors
    /// More patches than a tile can number.
    pub fn chunk(&self, coord: [i32; 3]) -> Result<Chunk, BakeError> {
        let range = self.set.chunks.get(&coord).cloned().unwrap_or(0..0);
        if range.len() > Chunk::PATCHES_MAX {
            return Err(BakeError::TooManyPatches {
                chunk: coord,
                patches: range.len(),
                max: Chunk::PATCHES_MAX,
            });
        }
        let (mut patches, mut points) = (Vec::with_capacity(range.len()), Vec::new());
        for source in &self.set.patches[range.start as usize..range.end as usize] {
            let chosen =
                source.representative_samples(self.parameters.points_per_patch, self.parameters.seed);
            let mut patch = source.patch;
            patch.point_first = points.len() as u32;
            patch.point_count = chosen.len() as u32;
            patches.push(patch);
            points.extend(chosen.iter().map(|&sample| {
                let SurfaceSample { position, normal, .. } = self.samples[sample as usize];
                SamplePoint { position, normal }
            }));
        }
        Ok(Chunk {
            id: ChunkId::new(0, IVec3::from(coord)),
            patches,
            points,
            rows: self.local_rows(&self.rows[range.start as usize..range.end as usize]),
            receivers: self.receivers_of(coord),
            occluders: self.occluders.get(&coord).cloned().unwrap_or_default(),
        })
    }

    fn receivers_of(&self, coord: [i32; 3]) -> Receivers {
        let Some(receivers) = self.receivers.get(&coord) else { return Receivers::default() };
        let rows: Vec<&RawRow> = receivers.iter().map(|receiver| &receiver.row).collect();
        let places = receivers.iter().map(|receiver| receiver.place).collect();
        Receivers { places, rows: self.local_rows(&rows) }
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

/// Cuts all triangles at chunk faces: each chunk holds just the shadow casters inside it.
#[must_use]
pub fn occluders_by_chunk(scene: &Scene, grid: Grid) -> BTreeMap<[i32; 3], OccluderMesh> {
    let mut meshes: BTreeMap<[i32; 3], OccluderMesh> = BTreeMap::new();
    for (index, &corners) in scene.triangles.iter().enumerate() {
        let surface = mean_surface(scene, index);
        if surface[3] == 0 {
            continue;
        }
        clip_to_grid(corners, grid.chunk_edge_m(), |chunk, polygon| {
            add_polygon(meshes.entry(chunk.to_array()).or_default(), polygon, surface);
        });
    }
    meshes
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
