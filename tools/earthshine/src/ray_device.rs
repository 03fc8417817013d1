//! A graphics adapter as what a bake traces its rays on.

use earthshine_bake::{CasterError, Query, RayCaster, RayDevice};
use earthshine_gpu::rays::{DISPATCH_RAYS_MAX, GpuRays, NO_TRIANGLE, RayQuery};
use earthshine_gpu::{AdapterChoice, GpuDevice, GpuError};
use earthshine_light::TreeLayout;
use std::sync::{Mutex, PoisonError};

/// An adapter that is open.
pub(crate) struct Adapter(GpuDevice);

impl Adapter {
    /// The adapter that is named like `name`; without a name the best there is, or none, which is said on standard error:
    /// without a graphics adapter rays are traced on the CPU.
    pub(crate) fn open(name: &str) -> Result<Option<Self>, GpuError> {
        let choice = AdapterChoice { name: name.to_owned(), allow_software: false };
        match GpuDevice::open(&choice) {
            Ok(device) => {
                eprintln!("tracing rays on {}", device.name());
                Ok(Some(Self(device)))
            }
            Err(error) if name.is_empty() => {
                eprintln!("warning: {error}; tracing rays on the CPU");
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }
}

impl RayDevice for Adapter {
    fn caster(&self, layout: &TreeLayout) -> Result<Box<dyn RayCaster>, CasterError> {
        let rays = GpuRays::new(&self.0, layout, DISPATCH_RAYS_MAX).map_err(said)?;
        Ok(Box::new(Rays(Mutex::new(rays))))
    }
}

/// Trees on a device; threads take turns.
#[derive(Debug)]
struct Rays(Mutex<GpuRays>);

impl RayCaster for Rays {
    fn first_triangles(&self, queries: &[Query]) -> Result<Vec<Option<u32>>, CasterError> {
        let words: Vec<RayQuery> = queries.iter().map(words).collect();
        let hits = self.0.lock().unwrap_or_else(PoisonError::into_inner).closest(&words).map_err(said)?;
        Ok(hits.into_iter().map(|hit| (hit.triangle != NO_TRIANGLE).then_some(hit.triangle)).collect())
    }
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
    use earthshine_scene::{ImportOptions, Scene, load_bytes};
    use earthshine_tiles::{BakeParameters, DirStore, RowCodec, TileStore as _};
    use earthshine_world::{Chunk, Grid, LightRig};
    use std::io::Write as _;

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

    /// The sum of what the rows of both differ by, over the sum of their shares.
    fn difference(ours: &[f32], theirs: &[f32]) -> (f64, f64) {
        assert_eq!(ours.len(), theirs.len());
        let off = ours.iter().zip(theirs).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
        (off, theirs.iter().map(|&share| f64::from(share)).sum())
    }

    /// Goal: a bake on a device is the CPU's but for what passes an edge. Method: both bakes of a scene with rows of a fixed
    /// number of rays, and with rows until an error is met; receivers in the air as well.
    fn compare(device: &dyn RayDevice, kind: WorldKind, size_m: f32, voxel_edge_m: f32, row_error: f32) {
        let options = GenOptions { town_size_m: size_m, ..GenOptions::default() };
        let glb = earthshine_gen::generate(kind, &options, &|_, _| {}).expect("a scene");
        let scene = load_bytes(&glb.bytes, "test", &ImportOptions::default()).expect("an importable scene");
        let grid = Grid { voxel_edge_m, chunk_edge_voxels: 16 };
        let mut parameters =
            BakeParameters { grid, rays_per_patch: 256, detail: 1, ..BakeParameters::default() };
        parameters.method.row_error = row_error;
        let (cpu, gpu) = (baked(None, &scene, parameters), baked(Some(device), &scene, parameters));
        assert_eq!((cpu.0.patches, cpu.0.receivers), (gpu.0.patches, gpu.0.receivers));
        assert!(cpu.0.rays > 0 && cpu.0.receiver_rays > 0);
        let (mut off, mut all, mut same) = (0.0, 0.0, 0);
        for (ours, theirs) in gpu.1.iter().zip(&cpu.1) {
            assert_eq!((ours.id, &ours.patches), (theirs.id, &theirs.patches));
            same += usize::from(ours == theirs);
            if ours.rows.columns == theirs.rows.columns {
                let (part, whole) = difference(&ours.rows.shares, &theirs.rows.shares);
                (off, all) = (off + part, all + whole);
            } else {
                let sums = |chunk: &Chunk| -> Vec<f32> {
                    (0..chunk.patches.len()).map(|row| chunk.rows.row_sum(row)).collect()
                };
                let (part, whole) = difference(&sums(ours), &sums(theirs));
                (off, all) = (off + part, all + whole);
            }
        }
        // Rows of 256 rays are off by some per cent of themselves; a device may pass a ray in thousands another way.
        assert!(off <= 1e-3 * all, "{kind:?}: shares differ by {off} of {all}");
        assert!(same * 2 >= cpu.1.len(), "{kind:?}: {same} of {} chunks are the same", cpu.1.len());
    }

    #[test]
    fn a_cornell_box_is_baked_on_a_device_as_on_the_cpu() {
        let Some(adapter) = adapter_or_skip() else { return };
        compare(&adapter, WorldKind::Cornell, 0.0, 0.5, 0.0);
        compare(&adapter, WorldKind::Cornell, 0.0, 0.7, 0.05);
    }

    #[test]
    fn a_town_is_baked_on_a_device_as_on_the_cpu() {
        let Some(adapter) = adapter_or_skip() else { return };
        compare(&adapter, WorldKind::Town, 40.0, 4.0, 0.0);
    }

    #[test]
    fn an_adapter_that_is_named_has_to_be_there() {
        assert!(Adapter::open("no adapter has this name").is_err());
    }
}
