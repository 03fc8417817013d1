//! A graphics adapter as what a bake traces its rays on.

use anyhow::Context as _;
use earthshine_bake::ends::{
    self, COUNTED_RAYS_MAX, CountedEnds, EndPlaces, EndTriangle, Run, RunEnds, RunSum,
};
use earthshine_bake::{CasterError, EndCounter, Query, RayDevice};
use earthshine_gpu::ends::{
    EndMap, EndPart, EndRun, EndSide, GpuEnds, KEY_ABSORBED, KEY_SKY, KEY_UNKNOWN, NO_KEY, RAY_PARTS,
    RUN_RAYS, SUM_ABSORBED, SUM_WHOLE,
};
use earthshine_gpu::rays::{DISPATCH_RAYS_MAX, RayQuery};
use earthshine_gpu::{AdapterChoice, GpuDevice};
use earthshine_light::TreeLayout;
use std::sync::{Mutex, PoisonError};

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
    fn counter(&self, layout: &TreeLayout, places: &EndPlaces) -> Result<Box<dyn EndCounter>, CasterError> {
        let sides: Vec<EndSide> = places.triangles.iter().map(side).collect();
        let voxels: Vec<([i32; 3], [u32; 6])> =
            places.voxels.iter().map(|voxel| (voxel.voxel.to_array(), voxel.patches)).collect();
        let EndPlaces { voxel_edge_m, off_surface_m, .. } = *places;
        let map = EndMap { sides: &sides, voxels: &voxels, voxel_edge_m, off_surface_m };
        let ends = GpuEnds::new(&self.0, layout, &map, COUNTED_RAYS_MAX).map_err(said)?;
        Ok(Box::new(Counter(Mutex::new(ends))))
    }
}

// What `trace` and the kernels call by names of their own is the same.
const _: () = assert!(RAY_PARTS == ends::RAY_PARTS && RUN_RAYS == ends::RUN_RAYS_MAX);
const _: () = assert!(NO_KEY == ends::NO_PATCH && KEY_UNKNOWN == ends::COUNTED_PATCHES_MAX);
const _: () = assert!(COUNTED_RAYS_MAX <= DISPATCH_RAYS_MAX);

/// Trees on a device and where rays end; threads take turns.
#[derive(Debug)]
struct Counter(Mutex<GpuEnds>);

impl EndCounter for Counter {
    fn count(&self, rays: &[Query], runs: &[Run]) -> Result<CountedEnds, CasterError> {
        let queries: Vec<RayQuery> = rays.iter().map(words).collect();
        let asked: Vec<EndRun> = runs.iter().map(run_words).collect();
        let mut ends = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let parts = ends.count(&queries, &asked).map_err(said)?;
        drop(ends);
        Ok(CountedEnds {
            runs: parts.runs.iter().map(|run| told(run)).collect(),
            read_bytes: parts.read_bytes,
        })
    }
}

fn side(triangle: &EndTriangle) -> EndSide {
    let EndTriangle { normal, parts, is_for_host } = *triangle;
    EndSide { normal: normal.to_array(), is_for_host: u32::from(is_for_host), parts, spare: 0 }
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
    use earthshine_bake::{BakeOptions, BakeSummary, Levels, MemoryLimit, Shard, Silent, bake_on};
    use earthshine_gen::{GenOptions, WorldKind};
    use earthshine_scene::{ImportOptions, Material, Scene, Texture, Wrap, load, load_bytes, scenes_dir};
    use earthshine_tiles::{BakeParameters, DirStore, RowCodec, TileStore as _};
    use earthshine_world::{Chunk, ChunkCoord, ChunkId, ChunkRows, Grid, LightRig, PatchId, Vec3};
    use std::collections::{BTreeMap, BTreeSet};
    use std::io::Write as _;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Rows that differ by less are the same: hundreds of shares summed in `f32`, where parts are summed exactly, ...
    const ROUNDING: f64 = 2e-5;
    /// ... and this part of their length: scales settle on steps of 1/1024, and rounding may bring each to the next.
    const STEPS: f64 = 2.5 / 1024.0;
    /// Of all rows, those that have to be the same: a ray in thousands may pass an edge the other way, and changes the rows
    /// of both its ends.
    const SAME_SHARE_MIN: f64 = 0.95;

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
            parameters,
            codec: RowCodec::Full,
            scene_name: "test".to_owned(),
            lights: LightRig::emission_only(),
            overwrite: false,
            levels: Levels::Exactly(1),
            shard: Shard::default(),
            memory: MemoryLimit::default(),
            discard_work: true,
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
        let mut parameters =
            BakeParameters { grid, rays_per_patch: 256, detail: 1, ..BakeParameters::default() };
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

    /// Goal: a bake on a device is the CPU's but for what passes an edge. Method: both bakes of a scene; rows of patches and
    /// of receivers. A row of `R` rays is off by up to `1 / sqrt(R)` itself; one ray that ends elsewhere is `1.4 / R`.
    fn compare(device: &dyn RayDevice, scene: &Scene, parameters: BakeParameters) -> BakeSummary {
        let (cpu, gpu) = (baked(None, scene, parameters), baked(Some(device), scene, parameters));
        assert_eq!((cpu.0.patches, cpu.0.receivers), (gpu.0.patches, gpu.0.receivers));
        assert!(cpu.0.rays > 0 && cpu.0.receiver_rays > 0);
        assert_eq!(cpu.1.len(), gpu.1.len());
        let (mut rows, mut same, mut sum) = (0, 0u32, 0.0);
        for (ours, theirs) in gpu.1.iter().zip(&cpu.1) {
            assert!((ours.id, &ours.patches) == (theirs.id, &theirs.patches), "other patches");
            assert!(ours.receivers.places == theirs.receivers.places, "other receivers");
            let receivers = (&ours.receivers.rows, &theirs.receivers.rows, parameters.receiver_rays);
            for (ours, theirs, rays) in [(&ours.rows, &theirs.rows, parameters.rays_per_patch), receivers] {
                let noise = 1.0 / f64::from(rays).sqrt();
                for row in 0..ours.row_count() {
                    let (ours, theirs) = (shares(ours, row), shares(theirs, row));
                    let apart = apart(&ours, &theirs);
                    assert!(apart <= noise, "row {row} is off by {apart}, its noise is {noise}");
                    (rows, sum) = (rows + 1, sum + apart / noise);
                    same += u32::from(apart < ROUNDING + STEPS * length(&theirs));
                }
            }
        }
        let (rays, back, bytes) = (gpu.0.device_rays, gpu.0.device_returned_rays, gpu.0.device_read_bytes);
        let said =
            format!("{same} of {rows} rows are the same; {rays} rays, {back} cast on the CPU, {bytes} bytes");
        writeln!(std::io::stderr(), "{said}").expect("standard error");
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
        let coarse = BakeParameters { rays_per_patch: 64, receiver_rays: 64, ..parameters(3.0, 0.0) };
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

    /// An adapter that is gone after so many batches.
    struct Breaking<'a>(&'a Adapter, usize);

    #[derive(Debug)]
    struct BreakingCounter {
        counter: Box<dyn EndCounter>,
        device: GpuDevice,
        left: AtomicUsize,
    }

    impl RayDevice for Breaking<'_> {
        fn counter(
            &self,
            layout: &TreeLayout,
            places: &EndPlaces,
        ) -> Result<Box<dyn EndCounter>, CasterError> {
            let (counter, device) = (self.0.counter(layout, places)?, self.0.0.clone());
            Ok(Box::new(BreakingCounter { counter, device, left: AtomicUsize::new(self.1) }))
        }
    }

    impl EndCounter for BreakingCounter {
        fn count(&self, rays: &[Query], runs: &[Run]) -> Result<CountedEnds, CasterError> {
            if self.left.fetch_sub(1, Ordering::Relaxed) == 0 {
                self.device.destroy();
            }
            self.counter.count(rays, runs)
        }
    }

    /// Goal: a device that is lost in the middle of a bake costs nothing but time.
    #[test]
    fn a_bake_outlives_its_device() {
        for batches in [0, 2] {
            let Some(adapter) = adapter_or_skip() else { return };
            let scene = generated(WorldKind::Cornell, 0.0);
            let summary = compare(&Breaking(&adapter, batches), &scene, parameters(0.5, 0.0));
            assert!(summary.device_failure.is_some_and(|cause| cause.contains("destroyed")));
        }
    }

    #[test]
    fn an_adapter_that_is_asked_for_has_to_be_there() {
        let said = format!("{:#}", Adapter::open("no adapter has this name").map(drop).expect_err("nobody"));
        assert!(said.contains("--gpu") && said.contains("CPU"), "{said}");
    }
}
