//! The same world lit as a whole: every chunk in memory, one sparse solve, no streaming and no local matrix.
//!
//! It reads tiles and direct light through the packages that own them, and shares nothing with the engine: neither
//! residency nor the split of rows nor the matrix. Light in the air is left out.

use earthshine_light::{NEAR_SHARE_MIN, NearPatch, OccluderSet, Occluders, Viewer, direct_irradiance_on};
use earthshine_radiosity::gather::{GatherLimits, Sources, SparseRows, gather};
use earthshine_tiles::{BakeParameters, DirStore, TileStore};
use earthshine_volume::{Layout, Volume};
use earthshine_world::{Chunk, ChunkId, Grid, LightRig, Patch, Rgb, VoxelCoord};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// Where shadow rays start, in voxel edges off their surface: what the engine documents.
const RAY_EPSILON_VOXELS: f32 = 1e-3;
const LIMITS: GatherLimits = GatherLimits { tolerance: 1e-7, iterations_max: 2000 };

/// A patch by place: what a volume can say of it.
pub type PatchPlace = ([i32; 3], usize);

/// A layer of detail by place: its detail voxel and direction, and which of those there.
pub type LayerPlace = (PatchPlace, u8);

/// All chunks of a world.
#[derive(Debug)]
pub struct SolvedWorld {
    grid: Grid,
    /// Detail voxels along a voxel's edge.
    detail: u32,
    /// The lights that came with the world.
    pub lights: LightRig,
    chunks: Vec<Chunk>,
    /// Number of the first patch of each chunk.
    first: BTreeMap<ChunkId, usize>,
    occluders: OccluderSet,
}

/// Light on every patch, in the order of [`SolvedWorld::patches`].
#[derive(Debug, Clone)]
pub struct Solution {
    /// lx.
    pub irradiance: Vec<Rgb>,
    /// The part of it that comes straight from the sky, lx.
    pub sky_irradiance: Vec<Rgb>,
}

impl SolvedWorld {
    /// Reads the world in the folder `world`.
    ///
    /// # Panics
    /// If any of it cannot be read.
    #[must_use]
    pub fn load(world: &Path) -> Self {
        let store = DirStore::open(world).expect("a world");
        let manifest = store.manifest();
        let finest = manifest.chunks.iter().filter(|entry| entry.level == 0);
        let chunks: Vec<Chunk> = finest.map(|entry| store.load(entry.id()).expect("a sound tile")).collect();
        let mut occluders = OccluderSet::new();
        let mut first = BTreeMap::new();
        let mut count = 0;
        for chunk in &chunks {
            occluders.insert(chunk.id, Arc::new(Occluders::build(&chunk.occluders)));
            first.insert(chunk.id, count);
            count += chunk.patches.len();
        }
        let (BakeParameters { grid, detail, .. }, lights) = (manifest.parameters, manifest.lights.clone());
        Self { grid, detail, lights, chunks, first, occluders }
    }

    /// Every chunk, ascending by id.
    #[must_use]
    pub fn chunks(&self) -> &[Chunk] {
        &self.chunks
    }

    /// Every patch, chunk by chunk.
    pub fn patches(&self) -> impl Iterator<Item = &Patch> {
        self.chunks.iter().flat_map(|chunk| &chunk.patches)
    }

    /// The patches of which a volume tells the light, with their numbers among all: see [`Chunk::is_told`].
    pub fn told(&self) -> impl Iterator<Item = (usize, &Patch)> {
        let is_told =
            self.chunks.iter().flat_map(|chunk| (0..chunk.patches.len()).map(|local| chunk.is_told(local)));
        self.patches().enumerate().zip(is_told).filter_map(|(patch, is_told)| is_told.then_some(patch))
    }

    /// Everywhere a patch is.
    #[must_use]
    pub fn places(&self) -> Vec<PatchPlace> {
        self.patches().map(place_of).collect()
    }

    /// Light of `rig`, all bounces.
    #[must_use]
    pub fn solve(&self, rig: &LightRig) -> Solution {
        self.solve_with(rig, &vec![true; self.patches().count()])
    }

    /// Light of `rig` as if `present` were all the patches there are, and the rest neither sent light nor
    /// uncovered any sky. Patches whose light is not [told](Self::told) are of the rest: nobody says whether they are there.
    #[must_use]
    pub fn solve_among(&self, rig: &LightRig, present: &BTreeSet<PatchPlace>) -> Solution {
        let mut is_present = vec![false; self.patches().count()];
        self.told().for_each(|(index, patch)| is_present[index] = present.contains(&place_of(patch)));
        self.solve_with(rig, &is_present)
    }

    /// Light of `rig` among the patches that are there.
    ///
    /// # Panics
    /// If the world's rows are no sparse matrix.
    fn solve_with(&self, rig: &LightRig, is_present: &[bool]) -> Solution {
        let rows = self.rows_among(is_present);
        let sky_irradiance: Vec<Rgb> = self
            .chunks
            .iter()
            .flat_map(|chunk| &chunk.rows.sky_shares)
            .map(|shares| rig.sky.irradiance(shares))
            .collect();
        let reflectance: Vec<Rgb> = self.patches().map(|patch| patch.reflectance).collect();
        let direct_exitance = self.direct_exitance(rig);
        let sources = Sources {
            direct_exitance: &direct_exitance,
            reflectance: &reflectance,
            outside_irradiance: &sky_irradiance,
        };
        let mut irradiance = vec![Rgb::ZERO; is_present.len()];
        let report = gather(&rows, sources, &mut irradiance, LIMITS);
        assert!(report.converged, "{report:?}");
        Solution { irradiance, sky_irradiance }
    }

    /// Share of each patch's row that does not lead to a patch outside of `present`: least and most, as nobody says
    /// whether a patch is there whose light is not [told](Self::told).
    #[must_use]
    pub fn known_shares(&self, present: &BTreeSet<PatchPlace>) -> Vec<[f32; 2]> {
        let mut is_present: Vec<Option<bool>> = vec![None; self.patches().count()];
        self.told().for_each(|(index, patch)| is_present[index] = Some(present.contains(&place_of(patch))));
        self.entries()
            .map(|row| {
                let (mut far, mut untold) = (0.0, 0.0);
                for (column, share) in row {
                    match is_present[column] {
                        Some(true) => {}
                        Some(false) => far += f64::from(share),
                        None => untold += f64::from(share),
                    }
                }
                [1.0 - far - untold, 1.0 - far].map(|known| known as f32)
            })
            .collect()
    }

    /// The volume that a client would hold of `solution`.
    ///
    /// # Panics
    /// If the world has no patches, or is larger than a volume.
    #[must_use]
    pub fn volume(&self, solution: &Solution) -> Volume {
        let voxels = || self.patches().map(|patch| patch.voxel);
        let low = voxels().reduce(VoxelCoord::min).expect("a patch");
        let high = voxels().reduce(VoxelCoord::max).expect("a patch");
        let layout = Layout {
            level: 0,
            origin: low,
            dims: (high - low + 1).as_uvec3(),
            voxel_edge_m: self.grid.voxel_edge_m,
        };
        let mut volume = Volume::new(layout).expect("a small world");
        for (index, patch) in self.told() {
            let (all, sky) = (solution.irradiance[index], solution.sky_irradiance[index]);
            volume.set_patch(patch.voxel, patch.direction.index(), all, sky, u8::MAX);
            let plane = earthshine_volume::plane::encode(patch.plane_offset(self.grid.voxel_edge_m));
            volume.set_plane(patch.voxel, patch.direction.index(), plane);
        }
        volume
    }

    /// Light on every layer of every detail voxel, lx: one gather over what leaves the patches under the world's own lights.
    #[must_use]
    pub fn details(&self, solution: &Solution) -> BTreeMap<LayerPlace, Rgb> {
        let direct = self.direct_light(&self.lights);
        let leaving = |(index, patch): (usize, &Patch)| {
            direct[index].0 + patch.reflectance * solution.irradiance[index]
        };
        let exitance: Vec<Rgb> = self.patches().enumerate().map(leaving).collect();
        let patches: Vec<(&Chunk, &Patch)> = self
            .chunks
            .iter()
            .flat_map(|chunk| chunk.patches.iter().map(move |patch| (chunk, patch)))
            .collect();
        let mut details = BTreeMap::new();
        for chunk in &self.chunks {
            let rows = &chunk.receivers.rows;
            let told = chunk.patches.iter().enumerate().filter(|&(local, _)| chunk.is_told(local));
            let own: BTreeMap<PatchPlace, &Patch> = told.map(|(_, patch)| (place_of(patch), patch)).collect();
            for (row, place) in chunk.receivers.places.iter().enumerate() {
                let Some(detail) = place.detail else { continue };
                let of = chunk.points_of(own[&(place.voxel.to_array(), place.direction.index())]);
                let viewer = Viewer::new(place, detail, self.detail, &self.grid, of);
                let sky = self.lights.sky.irradiance(&rows.sky_shares[row]);
                let gathered = rows.row(row).map(|(column, share)| {
                    let id = rows.patch_id(column);
                    let index = self.first[&id.chunk] + usize::from(id.local);
                    let (chunk, patch) = patches[index];
                    let near = NearPatch { points: chunk.points_of(patch), irradiance: &direct[index].1 };
                    let mean = near.irradiance.iter().sum::<Rgb>() / near.points.len() as f32;
                    let seen = viewer.sees(near).filter(|_| share >= NEAR_SHARE_MIN).unwrap_or(mean);
                    (exitance[index] + patch.reflectance * (seen - mean)) * share
                });
                let coord = detail.coord(place.voxel, self.detail);
                let at = ((coord.to_array(), place.direction.index()), detail.layer);
                details.insert(at, sky + gathered.sum::<Rgb>());
            }
        }
        details
    }

    /// `rho * E_direct + emission` of every patch, lm/m2.
    fn direct_exitance(&self, rig: &LightRig) -> Vec<Rgb> {
        self.direct_light(rig).into_iter().map(|(exitance, _)| exitance).collect()
    }

    /// The same, and `E_direct` on the points of each patch where it differs between them.
    fn direct_light(&self, rig: &LightRig) -> Vec<(Rgb, Box<[Rgb]>)> {
        let epsilon_m = RAY_EPSILON_VOXELS * self.grid.voxel_edge_m;
        let of = |chunk: &Chunk, patch: &Patch| {
            let points = chunk.points_of(patch);
            let (arriving, on_points) =
                direct_irradiance_on(&self.occluders, &rig.lights, points, epsilon_m, 1);
            (patch.reflectance * arriving + patch.emission * rig.emission_scale, on_points)
        };
        self.chunks.iter().flat_map(|chunk| chunk.patches.iter().map(move |patch| of(chunk, patch))).collect()
    }

    /// Rows of all patches over one numbering.
    fn entries(&self) -> impl Iterator<Item = impl Iterator<Item = (usize, f32)>> {
        self.chunks.iter().flat_map(move |chunk| {
            (0..chunk.rows.row_count()).map(move |row| {
                chunk.rows.row(row).map(move |(column, share)| {
                    let id = chunk.rows.patch_id(column);
                    (self.first[&id.chunk] + usize::from(id.local), share)
                })
            })
        })
    }

    fn rows_among(&self, is_present: &[bool]) -> SparseRows {
        let (mut starts, mut columns, mut shares) = (vec![0], Vec::new(), Vec::new());
        for row in self.entries() {
            for (column, share) in row.filter(|&(column, _)| is_present[column]) {
                columns.push(u32::try_from(column).expect("a small world"));
                shares.push(share);
            }
            starts.push(columns.len());
        }
        SparseRows::new(starts, columns, shares).expect("rows that the reader let through")
    }
}

/// Where `patch` is.
#[must_use]
pub fn place_of(patch: &Patch) -> PatchPlace {
    (patch.voxel.to_array(), patch.direction.index())
}
