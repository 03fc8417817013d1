//! One level of a whole world in memory, solved at once: what `bench accuracy`, `render` and `compare` hold the service against.
//!
//! Not the service: no streaming, no local matrix. Fit for worlds of some hundred thousand patches.

use crate::cluster_light;
use anyhow::Context as _;
use earthshine_light::{
    NEAR_SHARE_MIN, NearPatch, OccluderSet, Occluders, Viewer, direct_irradiance, direct_irradiance_on,
};
use earthshine_radiosity::gather::{GatherLimits, Sources, SparseRows, gather};
use earthshine_tiles::{DirStore, Manifest, PatchBuilder, TileStore};
use earthshine_volume::{Layout, Volume, plane};
use earthshine_world::{
    Barrier, Chunk, ChunkId, ChunkRows, Grid, LightRig, OccluderMesh, Patch, PatchId, ReceiverPlace, Rgb, Sky,
};
use glam::IVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Arc;

/// A solve ends at this relative change, or after bounces whose light is below it even at reflectance 0.98.
pub(crate) const LIMITS: GatherLimits = GatherLimits { tolerance: 1e-6, iterations_max: 600 };

/// Every chunk of one level of a world.
pub(crate) struct WholeWorld {
    pub(crate) manifest: Manifest,
    level: u8,
    /// Of this level.
    pub(crate) grid: Grid,
    chunks: Vec<Chunk>,
    pub(crate) rows: SparseRows,
    /// Number of the first patch of each chunk.
    first: BTreeMap<ChunkId, u32>,
    occluders: OccluderSet,
}

/// Light on every patch, in the order of the chunks.
pub(crate) struct WholeLight {
    pub(crate) irradiance: Vec<Rgb>,
    pub(crate) sky_irradiance: Vec<Rgb>,
    pub(crate) direct_exitance: Vec<Rgb>,
    /// Direct irradiance on the sample points of patches where it differs between them, lx; nothing of others.
    pub(crate) near: Vec<Box<[Rgb]>>,
    /// Of the lights that it was solved for.
    pub(crate) sky: Sky,
}

/// What sun, lamps and emission make of every patch before any bounce, in the order of the chunks.
pub(crate) struct DirectLight {
    /// `rho * E_direct + emission`, lm/m2.
    pub(crate) exitance: Vec<Rgb>,
    /// `E_direct` on the sample points where it differs between them, lx; nothing of others, and where there is no detail.
    pub(crate) on_points: Vec<Box<[Rgb]>>,
}

impl WholeWorld {
    /// Reads and checks every tile of level 0.
    pub(crate) fn load(world: &Path) -> anyhow::Result<Self> {
        Self::load_level(world, 0)
    }

    /// Reads and checks every tile of `level`.
    pub(crate) fn load_level(world: &Path, level: u8) -> anyhow::Result<Self> {
        let store = DirStore::open(world)?;
        let manifest = store.manifest().clone();
        let all = manifest.index().chunks;
        let ids: Vec<ChunkId> = all.iter().map(|chunk| chunk.id).filter(|id| id.level == level).collect();
        let chunks: Vec<Chunk> = ids.par_iter().map(|&id| store.load(id)).collect::<Result<_, _>>()?;
        let mut occluders = OccluderSet::new();
        for (id, built) in
            chunks.par_iter().map(|chunk| (chunk.id, Occluders::build(&chunk.occluders))).collect::<Vec<_>>()
        {
            occluders.insert(id, Arc::new(built));
        }
        let first = first_patches(&chunks);
        let rows = global_rows(&chunks, &first)?;
        let grid = manifest.parameters.grid.at_level(level);
        Ok(Self { manifest, level, grid, chunks, rows, first, occluders })
    }

    /// Every patch, chunk by chunk: the order of rows and of light.
    pub(crate) fn patches(&self) -> impl Iterator<Item = &Patch> {
        self.chunks.iter().flat_map(|chunk| &chunk.patches)
    }

    /// What comes to each patch straight from the sky of `rig`, lx.
    pub(crate) fn sky_irradiance(&self, rig: &LightRig) -> Vec<Rgb> {
        let shares = self.chunks.iter().flat_map(|chunk| &chunk.rows.sky_shares);
        shares.map(|shares| rig.sky.irradiance(shares)).collect()
    }

    /// Every chunk, in the order of [`WholeLight`].
    pub(crate) fn chunks(&self) -> &[Chunk] {
        &self.chunks
    }

    /// Solves the light of `rig`, all bounces.
    pub(crate) fn solve(&self, rig: &LightRig) -> WholeLight {
        let DirectLight { exitance, on_points } = self.direct_light(rig);
        WholeLight { near: on_points, ..self.solve_exitance(exitance, rig) }
    }

    /// Solves the light of `direct_exitance` and the sky of `rig`, all bounces.
    pub(crate) fn solve_exitance(&self, direct_exitance: Vec<Rgb>, rig: &LightRig) -> WholeLight {
        self.solve_rows(&self.rows, direct_exitance, rig)
    }

    /// The same over other `rows` of the same patches.
    pub(crate) fn solve_rows(
        &self,
        rows: &SparseRows,
        direct_exitance: Vec<Rgb>,
        rig: &LightRig,
    ) -> WholeLight {
        let reflectance: Vec<Rgb> = self.patches().map(|patch| patch.reflectance).collect();
        let sky_irradiance = self.sky_irradiance(rig);
        let mut irradiance = vec![Rgb::ZERO; reflectance.len()];
        let sources = Sources {
            direct_exitance: &direct_exitance,
            outside_irradiance: &sky_irradiance,
            reflectance: &reflectance,
        };
        gather(rows, sources, &mut irradiance, LIMITS);
        WholeLight { irradiance, sky_irradiance, direct_exitance, near: Vec::new(), sky: rig.sky }
    }

    /// What sun and lamps make of every patch.
    ///
    /// Casters of coarse levels are displaced: there rays start that far off.
    pub(crate) fn direct_light(&self, rig: &LightRig) -> DirectLight {
        let epsilon = self.grid.voxel_edge_m * OccluderMesh::displacement_voxels(self.level).max(1e-3);
        let seed = self.manifest.parameters.seed;
        let keeps_points = self.has_detail();
        let lit: Vec<(Rgb, Box<[Rgb]>)> = self
            .chunks
            .par_iter()
            .flat_map_iter(|chunk| {
                chunk.patches.iter().map(move |patch| {
                    let points = chunk.points_of(patch);
                    let occluders = &self.occluders;
                    let (arriving, on_points) = if keeps_points {
                        direct_irradiance_on(occluders, &rig.lights, points, epsilon, seed)
                    } else {
                        (direct_irradiance(occluders, &rig.lights, points, epsilon, seed), Box::default())
                    };
                    (patch.reflectance * arriving + patch.emission * rig.emission_scale, on_points)
                })
            })
            .collect();
        let (exitance, on_points) = lit.into_iter().unzip();
        DirectLight { exitance, on_points }
    }

    fn has_detail(&self) -> bool {
        self.manifest.parameters.detail > 1 && self.level == 0
    }

    /// The volumes of this level that a client would hold if all of the world were resident: detail, where the world has
    /// some, and voxels.
    pub(crate) fn volumes(&self, light: &WholeLight) -> anyhow::Result<Vec<Volume>> {
        let voxels = || {
            self.chunks.iter().flat_map(|chunk| {
                let patches = chunk.patches.iter().map(|patch| patch.voxel);
                patches.chain(chunk.receivers.places.iter().map(|place| place.voxel))
            })
        };
        let low = voxels().reduce(IVec3::min).context("the world has no patches")?;
        let high = voxels().reduce(IVec3::max).context("the world has no patches")?;
        let edge = self.grid.voxel_edge_m;
        let layout = Layout { level: 0, origin: low, dims: (high - low + 1).as_uvec3(), voxel_edge_m: edge };
        let mut volume = Volume::new(layout)?;
        if self.manifest.parameters.method.builder == PatchBuilder::Clustered {
            cluster_light::fill(&mut volume, &self.chunks, light);
            return Ok(vec![volume]);
        }
        let told =
            self.chunks.iter().flat_map(|chunk| (0..chunk.patches.len()).map(|local| chunk.is_told(local)));
        for ((index, patch), _) in self.patches().enumerate().zip(told).filter(|&(_, is_told)| is_told) {
            let (all, sky) = (light.irradiance[index], light.sky_irradiance[index]);
            volume.set_patch(patch.voxel, patch.direction.index(), all, sky, u8::MAX);
            let plane = plane::encode(patch.plane_offset(edge));
            volume.set_plane(patch.voxel, patch.direction.index(), plane);
        }
        let mut details = self.detail_volumes(layout)?;
        let exitance = self.exitance(light);
        for chunk in &self.chunks {
            for (place, (all, sky)) in
                chunk.receivers.places.iter().zip(self.received(chunk, light, &exitance)?)
            {
                let direction = place.direction.index();
                let Some(part) = place.detail else {
                    volume.set_receiver(place.voxel, direction, all, sky, u8::MAX);
                    continue;
                };
                if let Some(detail) = details.get_mut(usize::from(part.layer)) {
                    let coord = part.coord(place.voxel, self.manifest.parameters.detail);
                    detail.set_patch(coord, direction, all, sky, u8::MAX);
                    detail.set_tilt(coord, direction, part.plane.code());
                    detail.set_barriers(coord, direction, Barrier::codes(part.barriers));
                }
            }
        }
        Ok(details.into_iter().chain([volume]).collect())
    }

    /// An empty volume of the detail voxels in the voxels of `layout` for each layer; none where the level has no detail.
    fn detail_volumes(&self, layout: Layout) -> anyhow::Result<Vec<Volume>> {
        if !self.has_detail() {
            return Ok(Vec::new());
        }
        let detail = self.manifest.parameters.detail;
        let voxel_edge_m = layout.voxel_edge_m / detail as f32;
        let origin = layout.origin * detail.cast_signed();
        let empty = Volume::new(Layout { origin, dims: layout.dims * detail, voxel_edge_m, ..layout })?;
        let parts =
            self.chunks.iter().flat_map(|chunk| &chunk.receivers.places).filter_map(|place| place.detail);
        let layers = parts.map(|part| usize::from(part.layer) + 1).max().unwrap_or(1);
        Ok(vec![empty; layers])
    }

    /// What leaves each patch, `B = E + rho I`, lm/m2.
    pub(crate) fn exitance(&self, light: &WholeLight) -> Vec<Rgb> {
        let leaving = |(index, patch): (usize, &Patch)| {
            light.direct_exitance[index] + patch.reflectance * light.irradiance[index]
        };
        self.patches().enumerate().map(leaving).collect()
    }

    /// All irradiance on each receiver of `chunk`, and the sky's part of it, lx: one gather over `exitance`.
    fn received(
        &self,
        chunk: &Chunk,
        light: &WholeLight,
        exitance: &[Rgb],
    ) -> anyhow::Result<Vec<(Rgb, Rgb)>> {
        let rows = &chunk.receivers.rows;
        let bases = segment_bases(rows, &self.first)?;
        let told = chunk.patches.iter().enumerate().filter(|&(local, _)| chunk.is_told(local));
        let own: HashMap<_, &Patch> =
            told.map(|(_, patch)| ((patch.voxel, patch.direction), patch)).collect();
        let viewer = |place: &ReceiverPlace| {
            let own = own.get(&(place.voxel, place.direction))?;
            let per_edge = self.manifest.parameters.detail;
            Some(Viewer::new(place, place.detail?, per_edge, &self.grid, chunk.points_of(own)))
        };
        let of_row = |row: usize| {
            let sky = light.sky.irradiance(&rows.sky_shares[row]);
            let viewer = viewer(&chunk.receivers.places[row]);
            let gathered = rows.row(row).map(|(column, share)| {
                let patch = (bases[usize::from(column.segment)] + u32::from(column.local)) as usize;
                let excess =
                    viewer.as_ref().filter(|_| share >= NEAR_SHARE_MIN).map_or(Rgb::ZERO, |viewer| {
                        self.excess(viewer, rows.patch_id(column), light.near.get(patch).map(AsRef::as_ref))
                    });
                (exitance[patch] + excess) * share
            });
            (sky + gathered.sum::<Rgb>(), sky)
        };
        Ok((0..rows.row_count()).into_par_iter().map(of_row).collect())
    }

    /// By how much what `viewer` sees of `patch` is brighter than the whole of it, lm/m2, where direct light is `on_points`.
    fn excess(&self, viewer: &Viewer, patch: PatchId, on_points: Option<&[Rgb]>) -> Rgb {
        let Some(irradiance) = on_points.filter(|light| !light.is_empty()) else { return Rgb::ZERO };
        let Ok(at) = self.chunks.binary_search_by_key(&patch.chunk, |chunk| chunk.id) else {
            return Rgb::ZERO;
        };
        let (chunk, local) = (&self.chunks[at], usize::from(patch.local));
        let Some(patch) = chunk.patches.get(local) else { return Rgb::ZERO };
        let mean = irradiance.iter().sum::<Rgb>() / irradiance.len() as f32;
        let seen = viewer.sees(NearPatch { points: chunk.points_of(patch), irradiance });
        seen.map_or(Rgb::ZERO, |seen| patch.reflectance * (seen - mean))
    }
}

fn first_patches(chunks: &[Chunk]) -> BTreeMap<ChunkId, u32> {
    let mut count = 0u32;
    let first = |chunk: &Chunk| {
        let first = count;
        count += chunk.patches.len() as u32;
        (chunk.id, first)
    };
    chunks.iter().map(first).collect()
}

/// Numbers of the first patches of the chunks that `rows` point into.
fn segment_bases(rows: &ChunkRows, first: &BTreeMap<ChunkId, u32>) -> anyhow::Result<Vec<u32>> {
    let base =
        |id: &ChunkId| first.get(id).copied().with_context(|| format!("chunk {id} is not in the manifest"));
    rows.segments.iter().map(base).collect()
}

/// Rows of all chunks over one numbering.
fn global_rows(chunks: &[Chunk], first: &BTreeMap<ChunkId, u32>) -> anyhow::Result<SparseRows> {
    let count: usize = chunks.iter().map(|chunk| chunk.patches.len()).sum();
    let nonzeros = chunks.iter().map(|chunk| chunk.rows.columns.len()).sum();
    let mut starts = Vec::with_capacity(count + 1);
    let (mut columns, mut shares) = (Vec::with_capacity(nonzeros), Vec::with_capacity(nonzeros));
    starts.push(0);
    for chunk in chunks {
        let bases = segment_bases(&chunk.rows, first)?;
        for row in 0..chunk.rows.row_count() {
            for (column, share) in chunk.rows.row(row) {
                columns.push(bases[usize::from(column.segment)] + u32::from(column.local));
                shares.push(share);
            }
            starts.push(columns.len());
        }
    }
    Ok(SparseRows::new(starts, columns, shares)?)
}

impl WholeWorld {
    /// Largest relative error of exitance over all patches of a closed, uniform, emitting box: there `B = E / (1 - rho)`.
    pub(crate) fn furnace_error(&self, light: &WholeLight) -> f32 {
        self.patches()
            .zip(light.direct_exitance.iter().zip(&light.irradiance))
            // Patches on the outside of the box emit nothing and see nothing.
            .filter(|(_, (own, _))| own.max_element() > 0.0)
            .map(|(patch, (&own, &irradiance))| {
                let expected = own / (Rgb::ONE - patch.reflectance);
                let exitance = own + patch.reflectance * irradiance;
                ((exitance - expected) / expected).abs().max_element()
            })
            .fold(0.0, f32::max)
    }
}
