//! A graphics adapter as what a bake traces its rays on.

use crate::end_words::{side, voxel};
use anyhow::Context as _;
use earthshine_bake::ends::{
    self, COUNTED_RAYS_MAX, CountedEnds, EndPlaces, EndTriangle, FacedFans, FacedRays, FirstTriangles, Run,
    RunEnds, RunSum, Traffic,
};
use earthshine_bake::{CasterError, EndCounter, Query, RayDevice, RayFan, Rays};
use earthshine_gpu::ends::{
    self as ends_of_gpu, AskedRays, EndMap, EndPart, EndRun, EndSide, Faced, GpuEnds, KEY_ABSORBED, KEY_SKY,
    KEY_UNKNOWN, MapVoxel, NO_KEY, RAY_PARTS, RUN_RAYS, RunParts, SUM_ABSORBED, SUM_WHOLE,
};
use earthshine_gpu::rays::{DISPATCH_RAYS_MAX, NO_TRIANGLE, RayHit, RayQuery};
use earthshine_gpu::{AdapterChoice, GpuDevice};
use earthshine_light::TreeLayout;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// An adapter that is open.
pub(crate) struct Adapter(GpuDevice);

impl Adapter {
    /// The adapter that is named like `name`; without a name the best there is.
    pub(crate) fn open(name: &str) -> anyhow::Result<Self> {
        let choice = AdapterChoice { name: name.to_owned(), ..AdapterChoice::default() };
        let device = GpuDevice::open(&choice)
            .context("--gpu needs a graphics adapter; without it rays are traced on the CPU")?;
        eprintln!("tracing rays on {}", device.name());
        Ok(Self(device))
    }

    /// As the driver names it.
    pub(crate) fn name(&self) -> &str {
        self.0.name()
    }
}

impl RayDevice for Adapter {
    fn counter(
        &self,
        layout: &TreeLayout,
        triangles: &[EndTriangle],
    ) -> Result<Box<dyn EndCounter>, CasterError> {
        let sides: Vec<EndSide> = triangles.iter().map(side).collect();
        let first = GpuEnds::new(&self.0, layout, &sides, COUNTED_RAYS_MAX).map_err(said)?;
        // A device with room for one question alone is kept waiting, and traces nevertheless.
        let others = (1..ROOMS_MAX).map_while(|_| first.beside().ok()).collect::<Vec<GpuEnds>>();
        let rooms = std::iter::once(first).chain(others).map(Mutex::new).collect();
        Ok(Box::new(Counter { rooms, turn: AtomicUsize::new(0) }))
    }
}

// What `trace` and the kernels call by names of their own is the same.
const _: () = assert!(RAY_PARTS == ends::RAY_PARTS && RUN_RAYS == ends::RUN_RAYS_MAX);
const _: () = assert!(NO_KEY == ends::NO_PATCH && KEY_UNKNOWN == ends::COUNTED_PATCHES_MAX);
const _: () = assert!(COUNTED_RAYS_MAX <= DISPATCH_RAYS_MAX);

/// Most questions that the device has at once: while it works on one, the other comes and goes.
const ROOMS_MAX: usize = 2;

/// Trees on a device and where rays end, with room for [`ROOMS_MAX`] questions of 128 MiB each; threads take turns.
#[derive(Debug)]
struct Counter {
    /// One at least.
    rooms: Vec<Mutex<GpuEnds>>,
    /// Where one waits when there is no room.
    turn: AtomicUsize,
}

impl Counter {
    /// Room for a question.
    fn room(&self) -> MutexGuard<'_, GpuEnds> {
        self.rooms.iter().find_map(|room| room.try_lock().ok()).unwrap_or_else(|| {
            let turn = self.turn.fetch_add(1, Ordering::Relaxed) % self.rooms.len();
            self.rooms[turn].lock().unwrap_or_else(PoisonError::into_inner)
        })
    }
}

impl EndCounter for Counter {
    fn face(&self, fans: &[RayFan], near_m: f32) -> Result<FacedFans, CasterError> {
        // Words are made where there is room: so many threads as may wait for it keep none.
        let mut room = self.room();
        let asked: Vec<ends_of_gpu::RayFan> = fans.iter().map(fan_words).collect();
        let faced = room.face(&asked, near_m).map_err(said)?;
        let told = |faced: &Faced| {
            let Faced { back, near, for_host, reach_m } = *faced;
            FacedRays { back, near, for_host, reach_m }
        };
        let traffic = Traffic {
            sent_bytes: size_of_val(&asked[..]) as u64,
            read_bytes: (faced.len() * size_of::<[u32; 2]>()) as u64,
        };
        Ok(FacedFans { fans: faced.iter().map(told).collect(), traffic })
    }

    fn first(&self, rays: &[Query]) -> Result<FirstTriangles, CasterError> {
        let mut room = self.room();
        let queries: Vec<RayQuery> = rays.iter().map(words).collect();
        let hits = room.first(&queries).map_err(said)?;
        let traffic = Traffic {
            sent_bytes: size_of_val(&queries[..]) as u64,
            read_bytes: size_of_val(&hits[..]) as u64,
        };
        let named = |hit: &RayHit| (hit.triangle != NO_TRIANGLE).then_some(hit.triangle);
        Ok(FirstTriangles { triangles: hits.iter().map(named).collect(), traffic })
    }

    fn settle(&self, places: &EndPlaces) -> Result<(), CasterError> {
        let sides: Vec<EndSide> = places.triangles.iter().map(side).collect();
        let voxels: Vec<MapVoxel> = places.voxels.iter().map(voxel).collect();
        let EndPlaces { voxel_edge_m, off_surface_m, .. } = *places;
        let map = EndMap { sides: &sides, voxels: &voxels, voxel_edge_m, off_surface_m };
        let locked = |room| Mutex::lock(room).unwrap_or_else(PoisonError::into_inner);
        let mut rooms: Vec<MutexGuard<'_, GpuEnds>> = self.rooms.iter().map(locked).collect();
        let (first, others) = rooms.split_first_mut().expect("a counter has room for one question");
        first.settle(&map).map_err(said)?;
        others.iter_mut().for_each(|other| other.settle_as(first));
        Ok(())
    }

    fn count(&self, rays: &Rays, runs: &[Run]) -> Result<CountedEnds, CasterError> {
        let mut room = self.room();
        let asked: Vec<EndRun> = runs.iter().map(run_words).collect();
        let parts = match rays {
            Rays::Made(rays) => {
                let queries: Vec<RayQuery> = rays.iter().map(words).collect();
                room.count(AskedRays::Made(&queries), &asked)
            }
            Rays::Fans(fans) => {
                let fans: Vec<ends_of_gpu::RayFan> = fans.iter().map(fan_words).collect();
                room.count(AskedRays::Fans(&fans), &asked)
            }
        };
        let RunParts { runs, sent_bytes, read_bytes } = parts.map_err(said)?;
        let runs = runs.iter().map(|run| told(run)).collect();
        Ok(CountedEnds { runs, traffic: Traffic { sent_bytes, read_bytes } })
    }
}

fn fan_words(fan: &RayFan) -> ends_of_gpu::RayFan {
    let RayFan { origin, normal, shift, first_pair, ray_count } = *fan;
    ends_of_gpu::RayFan {
        origin: origin.to_array(),
        normal: normal.to_array(),
        shift: shift.into(),
        first_pair,
        ray_count,
        ..ends_of_gpu::RayFan::default()
    }
}

fn run_words(run: &Run) -> EndRun {
    let sum = match run.sum {
        RunSum::Whole => SUM_WHOLE,
        RunSum::Facing(direction) => direction.index() as u32,
        RunSum::Absorbed => SUM_ABSORBED,
    };
    EndRun { first_ray: run.first_ray, ray_count: run.ray_count, sum }
}

/// What a device lists of a run, in order.
fn told(parts: &[EndPart]) -> RunEnds {
    let mut ends = RunEnds::default();
    for &EndPart { key, parts } in parts {
        match key {
            0..KEY_UNKNOWN => ends.patches.push((key, parts)),
            KEY_ABSORBED => ends.absorbed = parts,
            KEY_SKY..KEY_ABSORBED => ends.sky[(key - KEY_SKY) as usize] = parts,
            _ => ends.unknown.push(key - KEY_UNKNOWN),
        }
    }
    ends.patches.sort_unstable();
    ends.unknown.sort_unstable();
    ends
}

/// A ray as the device reads it.
pub(crate) fn words(query: &Query) -> RayQuery {
    let (origin, direction, distance_min_m, distance_max_m) = query.as_asked();
    RayQuery { origin: origin.to_array(), distance_min_m, direction: direction.to_array(), distance_max_m }
}

fn said(error: impl std::fmt::Display) -> CasterError {
    CasterError(error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_bake::{BakeOptions, BakeSummary, Levels, Silent, bake_on};
    use earthshine_gen::{GenOptions, WorldKind};
    use earthshine_scene::{ImportOptions, Material, Scene, Texture, Wrap, load, load_bytes, scenes_dir};
    use earthshine_tiles::{BakeParameters, DirStore, RowCodec, TileStore as _};
    use earthshine_world::{Chunk, ChunkCoord, ChunkId, ChunkRows, Grid, LightRig, PatchId, Vec3};
    use std::collections::{BTreeMap, BTreeSet};
    use std::io::Write as _;

    /// Rows that differ by less are the same: hundreds of shares summed in `f32`, where parts are summed exactly, ...
    const ROUNDING: f64 = 2e-5;
    /// ... and this part of their length: scales settle on steps of 1/1024, and rounding may bring each to the next.
    const STEPS: f64 = 2.5 / 1024.0;
    /// Of all rows, those that have to be the same: a ray in thousands may pass an edge the other way.
    const SAME_SHARE_MIN: f64 = 0.95;
    /// Patches and places that are others, and rows that are off by more than their noise, of all rows: a point whose ray
    /// passes an edge may be of another class, and changes its patch and the parts of detail beside it.
    const ELSEWHERE_MAX: f64 = 5e-3;

    /// Any adapter, or none with the reason printed; none is a failure where CI says so.
    fn adapter_or_skip() -> Option<Adapter> {
        match GpuDevice::open(&AdapterChoice { allow_software: true, ..AdapterChoice::default() }) {
            Ok(device) => Some(Adapter(device)),
            Err(error) => {
                assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "{error}");
                writeln!(std::io::stderr(), "SKIPPED a bake on a device: {error}").expect("standard error");
                None
            }
        }
    }

    fn baked(
        device: Option<&dyn RayDevice>,
        scene: &Scene,
        parameters: BakeParameters,
    ) -> (BakeSummary, Vec<Chunk>) {
        let folder = tempfile::tempdir().expect("a folder");
        let options = BakeOptions {
            codec: RowCodec::Full,
            levels: Levels::Exactly(1),
            discard_work: true,
            ..BakeOptions::new("test", parameters, LightRig::emission_only())
        };
        let summary = bake_on(device, scene, folder.path(), &options, &Silent).expect("a good scene");
        let store = DirStore::open(folder.path()).expect("a world");
        let ids = store.manifest().index().chunks.into_iter().map(|chunk| chunk.id);
        (summary, ids.map(|id| store.load(id).expect("a good tile")).collect())
    }

    fn generated(kind: WorldKind, size_m: f32) -> Scene {
        let options = GenOptions { town_size_m: size_m, ..GenOptions::default() };
        let glb = earthshine_gen::generate(kind, &options, &|_, _| {}).expect("a scene");
        load_bytes(&glb.bytes, "test", &ImportOptions::default()).expect("an importable scene")
    }

    fn parameters(voxel_edge_m: f32, row_error: f32) -> BakeParameters {
        let grid = Grid { voxel_edge_m, chunk_edge_voxels: 16 };
        let (rays_per_patch, detail, detail_rays) = (256, 2, 256);
        let mut parameters =
            BakeParameters { grid, rays_per_patch, detail, detail_rays, ..BakeParameters::default() };
        parameters.method.row_error = row_error;
        parameters
    }

    /// The shares of a row: of patches, of the sky, absorbed.
    fn shares(rows: &ChunkRows, row: usize) -> BTreeMap<PatchId, f32> {
        let named = |local: u16| PatchId { chunk: ChunkId::new(u8::MAX, ChunkCoord::ZERO), local };
        let of_patches = rows.row(row).map(|(column, share)| (rows.patch_id(column), share));
        let sky = (0..).zip(rows.sky_shares[row]).map(|(lobe, share)| (named(lobe), share));
        of_patches.chain(sky).chain([(named(6), rows.absorbed_shares[row])]).collect()
    }

    fn length(row: &BTreeMap<PatchId, f32>) -> f64 {
        row.values().map(|&share| f64::from(share).powi(2)).sum::<f64>().sqrt()
    }

    /// Length of what two rows differ by.
    fn apart(ours: &BTreeMap<PatchId, f32>, theirs: &BTreeMap<PatchId, f32>) -> f64 {
        let of = |row: &BTreeMap<PatchId, f32>, of: &PatchId| f64::from(row.get(of).copied().unwrap_or(0.0));
        let all: BTreeSet<&PatchId> = ours.keys().chain(theirs.keys()).collect();
        all.into_iter().map(|patch| (of(ours, patch) - of(theirs, patch)).powi(2)).sum::<f64>().sqrt()
    }

    /// Goal: a bake on a device is the CPU's but for what passes an edge. Method: both bakes of a scene; rows of patches, of
    /// receivers and of detail. A row of `R` rays is off by up to `1 / sqrt(R)` itself; one ray that ends elsewhere is `1.4 / R`.
    fn compare(device: &dyn RayDevice, scene: &Scene, parameters: BakeParameters) -> BakeSummary {
        let (cpu, gpu) = (baked(None, scene, parameters), baked(Some(device), scene, parameters));
        let off = |ours: u64, theirs: u64| ours.abs_diff(theirs) as f64 / theirs.max(1) as f64;
        let buried = (gpu.0.buried_samples, cpu.0.buried_samples);
        assert!(gpu.0.samples == cpu.0.samples && off(buried.0, buried.1) <= 1e-3, "{buried:?} buried");
        assert!(off(gpu.0.patches, cpu.0.patches) <= 1e-3 && off(gpu.0.receivers, cpu.0.receivers) <= 1e-3);
        assert!(cpu.0.rays > 0 && cpu.0.receiver_rays > 0);
        assert_eq!(cpu.1.len(), gpu.1.len());
        let (mut rows, mut same, mut sum, mut elsewhere) = (0, 0u32, 0.0, 0usize);
        for (ours, theirs) in gpu.1.iter().zip(&cpu.1) {
            assert_eq!((ours.id, ours.patches.len()), (theirs.id, theirs.patches.len()));
            elsewhere += ours.patches.iter().zip(&theirs.patches).filter(|(a, b)| a != b).count();
            let places = |chunk: &Chunk| -> BTreeMap<_, _> {
                chunk
                    .receivers
                    .places
                    .iter()
                    .zip(0..)
                    .map(|(place, row)| (place.order(), (*place, row)))
                    .collect()
            };
            let (own, others) = (places(ours), places(theirs));
            elsewhere += others.iter().filter(|(at, of)| own.get(*at).map(|own| own.0) != Some(of.0)).count();
            let in_both = own.iter().filter_map(|(at, own)| {
                let other = others.get(at)?;
                (own.0 == other.0).then_some((own.1, other.1))
            });
            let receivers: Vec<(usize, usize)> = in_both.collect();
            let patches: Vec<(usize, usize)> = (0..ours.patches.len()).map(|row| (row, row)).collect();
            let fewest = parameters.receiver_rays.min(parameters.detail_rays);
            for (pairs, ours, theirs, rays) in [
                (patches, &ours.rows, &theirs.rows, parameters.rays_per_patch),
                (receivers, &ours.receivers.rows, &theirs.receivers.rows, fewest),
            ] {
                let noise = 1.0 / f64::from(rays).sqrt();
                for (own, other) in pairs {
                    let (ours, theirs) = (shares(ours, own), shares(theirs, other));
                    let apart = apart(&ours, &theirs);
                    elsewhere += usize::from(apart > noise);
                    (rows, sum) = (rows + 1, sum + apart / noise);
                    same += u32::from(apart < ROUNDING + STEPS * length(&theirs));
                }
            }
        }
        let BakeSummary { device_rays: rays, device_returned_rays: back, .. } = gpu.0;
        let (up, down) = (gpu.0.device_sent_bytes, gpu.0.device_read_bytes);
        let share = gpu.0.device_ray_share;
        let said = format!(
            "{same} of {rows} rows are the same, {elsewhere} patches, places or rows are others; {rays} rays, {back} of no use, {share:.3} of all, {up} bytes up, {down} down"
        );
        writeln!(std::io::stderr(), "{said}").expect("standard error");
        assert!(
            elsewhere as f64 <= ELSEWHERE_MAX * f64::from(rows),
            "{elsewhere} patches, places or rows differ"
        );
        assert!(sum <= 0.01 * f64::from(rows), "rows are off by {sum} times their noise, {rows} in all");
        assert!(f64::from(same) >= SAME_SHARE_MIN * f64::from(rows), "{same} of {rows} rows are the same");
        gpu.0
    }

    #[test]
    fn a_cornell_box_is_baked_on_a_device_as_on_the_cpu() {
        let Some(adapter) = adapter_or_skip() else { return };
        let scene = generated(WorldKind::Cornell, 0.0);
        for parameters in [parameters(0.5, 0.0), parameters(0.7, 0.05)] {
            assert_eq!(compare(&adapter, &scene, parameters).device_failure, None);
        }
    }

    #[test]
    fn a_town_is_baked_on_a_device_as_on_the_cpu() {
        let Some(adapter) = adapter_or_skip() else { return };
        compare(&adapter, &generated(WorldKind::Town, 40.0), parameters(4.0, 0.0));
    }

    #[test]
    fn a_shared_scene_is_baked_on_a_device_as_on_the_cpu() {
        let Some(adapter) = adapter_or_skip() else { return };
        let Some(folder) = scenes_dir() else {
            writeln!(std::io::stderr(), "SKIPPED: no shared scenes beside the project")
                .expect("standard error");
            return;
        };
        let scene = load(&folder.join("sponza.glb"), &ImportOptions::default()).expect("a good file");
        let few = BakeParameters { rays_per_patch: 64, receiver_rays: 64, ..parameters(3.0, 0.0) };
        let coarse = BakeParameters { detail_rays: 64, ..few };
        compare(&adapter, &scene, coarse);
    }

    /// A Cornell box with a ceiling at half its height that is cut into squares, every other one a hole if it `has_holes`.
    fn under_a_grille(has_holes: bool) -> Scene {
        let mut scene = generated(WorldKind::Cornell, 0.0);
        let (low, high) = (scene.bounds().min, scene.bounds().max);
        let corner = |x: f32, z: f32| {
            Vec3::new(low.x + x * (high.x - low.x), 0.5 * (low.y + high.y), low.z + z * (high.z - low.z))
        };
        for corners in [[(0.0, 0.0), (0.0, 1.0), (1.0, 1.0)], [(0.0, 0.0), (1.0, 1.0), (1.0, 0.0)]] {
            scene.triangles.push(corners.map(|(x, z)| corner(x, z)));
            scene.texture_coordinates.push(corners.map(|(x, z)| [x, z]));
            scene.material_of.push(scene.materials.len() as u32);
        }
        let texels =
            (0..64).map(|at| [200, 200, 200, if (at / 8 + at) % 2 == 0 { 255 } else { 0 }]).collect();
        scene.materials.push(Material {
            base_colour_texture: Some(scene.textures.len()),
            alpha_cutoff: has_holes.then_some(0.5),
            double_sided: true,
            ..scene.materials[0].clone()
        });
        scene.textures.push(Texture {
            width: 8,
            height: 8,
            texels,
            wrap: [Wrap::ClampToEdge; 2],
            nearest: true,
            transform: Texture::IDENTITY,
        });
        scene
    }

    /// Goal: rays go through the holes of alpha masks, and are stopped beside them, with a device as without.
    #[test]
    fn a_grille_is_baked_on_a_device_as_on_the_cpu() {
        let Some(adapter) = adapter_or_skip() else { return };
        let parameters = parameters(0.5, 0.0);
        let open = compare(&adapter, &under_a_grille(true), parameters);
        assert!(open.device_returned_rays * 10 > open.device_rays, "the grille is the CPU's business");
        // Nobody sees through it.
        let (closed, _) = baked(Some(&adapter), &under_a_grille(false), parameters);
        let seen = |summary: &BakeSummary| summary.nonzeros as f64 / summary.patches as f64;
        assert!(seen(&closed) < 0.8 * seen(&open), "{} and {} patches seen", seen(&closed), seen(&open));
    }

    /// Gone after so many batches: of rows alone, or of anything.
    struct Breaking<'a> {
        adapter: &'a Adapter,
        batches: usize,
        only_rows: bool,
    }

    #[derive(Debug)]
    struct BreakingCounter {
        counter: Box<dyn EndCounter>,
        device: GpuDevice,
        left: AtomicUsize,
        only_rows: bool,
    }

    impl RayDevice for Breaking<'_> {
        fn counter(
            &self,
            layout: &TreeLayout,
            triangles: &[EndTriangle],
        ) -> Result<Box<dyn EndCounter>, CasterError> {
            let Self { adapter, batches, only_rows } = *self;
            let (counter, device) = (adapter.counter(layout, triangles)?, adapter.0.clone());
            Ok(Box::new(BreakingCounter { counter, device, left: AtomicUsize::new(batches), only_rows }))
        }
    }

    impl BreakingCounter {
        fn wear(&self, is_row: bool) {
            let counts = is_row || !self.only_rows;
            if counts && self.left.fetch_sub(1, Ordering::Relaxed) == 0 {
                self.device.destroy();
            }
        }
    }

    impl EndCounter for BreakingCounter {
        fn face(&self, fans: &[RayFan], near_m: f32) -> Result<FacedFans, CasterError> {
            self.wear(false);
            self.counter.face(fans, near_m)
        }

        fn first(&self, rays: &[Query]) -> Result<FirstTriangles, CasterError> {
            self.wear(false);
            self.counter.first(rays)
        }

        fn settle(&self, places: &EndPlaces) -> Result<(), CasterError> {
            self.counter.settle(places)
        }

        fn count(&self, rays: &Rays, runs: &[Run]) -> Result<CountedEnds, CasterError> {
            self.wear(true);
            self.counter.count(rays, runs)
        }
    }

    /// Goal: a device that is lost in the middle of a bake costs nothing but time.
    #[test]
    fn a_bake_outlives_its_device() {
        for (batches, only_rows) in [(0, false), (2, false), (5, false), (0, true), (1, true)] {
            let Some(adapter) = adapter_or_skip() else { return };
            let scene = generated(WorldKind::Cornell, 0.0);
            let breaking = Breaking { adapter: &adapter, batches, only_rows };
            let summary = compare(&breaking, &scene, parameters(0.5, 0.0));
            assert!(summary.device_failure.is_some_and(|cause| cause.contains("destroyed")));
        }
    }

    #[test]
    fn an_adapter_that_is_asked_for_has_to_be_there() {
        let said = format!("{:#}", Adapter::open("no adapter has this name").map(drop).expect_err("nobody"));
        assert!(said.contains("--gpu") && said.contains("CPU"), "{said}");
    }
}
