//! A graphics adapter as what a bake traces its rays on.

use anyhow::Context as _;
use earthshine_bake::{CasterError, Query, RayCaster, RayDevice};
use earthshine_gpu::rays::{DISPATCH_RAYS_MAX, GpuRays, NO_TRIANGLE, RayQuery};
use earthshine_gpu::{AdapterChoice, GpuDevice};
use earthshine_light::TreeLayout;
use std::sync::{Mutex, PoisonError};

/// An adapter that is open.
pub(crate) struct Adapter(GpuDevice);

impl Adapter {
    /// The adapter that is named like `name`; without a name the best there is.
    pub(crate) fn open(name: &str) -> anyhow::Result<Self> {
        let choice = AdapterChoice { name: name.to_owned(), allow_software: false };
        let device = GpuDevice::open(&choice)
            .context("--gpu needs a graphics adapter; without it rays are traced on the CPU")?;
        eprintln!("tracing rays on {}", device.name());
        Ok(Self(device))
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
    use earthshine_scene::{ImportOptions, Material, Scene, Texture, Wrap, load_bytes};
    use earthshine_tiles::{BakeParameters, DirStore, RowCodec, TileStore as _};
    use earthshine_world::{Chunk, Grid, LightRig, Vec3};
    use std::io::Write as _;
    use std::sync::atomic::{AtomicUsize, Ordering};

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

    /// What the shares of two bakes differ by, over all shares; of chunks with other columns the sums of rows.
    fn unlike(ours: &[Chunk], theirs: &[Chunk]) -> f64 {
        let (mut off, mut all) = (0.0, 0.0);
        assert_eq!(ours.len(), theirs.len());
        for (ours, theirs) in ours.iter().zip(theirs) {
            assert!((ours.id, &ours.patches) == (theirs.id, &theirs.patches), "other patches");
            let (part, whole) = if ours.rows.columns == theirs.rows.columns {
                difference(&ours.rows.shares, &theirs.rows.shares)
            } else {
                let sums = |chunk: &Chunk| -> Vec<f32> {
                    (0..chunk.patches.len()).map(|row| chunk.rows.row_sum(row)).collect()
                };
                difference(&sums(ours), &sums(theirs))
            };
            (off, all) = (off + part, all + whole);
        }
        off / all
    }

    /// Goal: a bake on a device is the CPU's but for what passes an edge. Method: both bakes of a scene; receivers in the
    /// air as well.
    fn compare(
        device: &dyn RayDevice,
        scene: &Scene,
        parameters: BakeParameters,
    ) -> (BakeSummary, Vec<Chunk>) {
        let (cpu, gpu) = (baked(None, scene, parameters), baked(Some(device), scene, parameters));
        assert_eq!((cpu.0.patches, cpu.0.receivers), (gpu.0.patches, gpu.0.receivers));
        assert!(cpu.0.rays > 0 && cpu.0.receiver_rays > 0);
        // Rows of 256 rays are off by some per cent of themselves; a device may pass a ray in thousands another way.
        let off = unlike(&gpu.1, &cpu.1);
        assert!(off <= 1e-3, "shares differ by {off}");
        let same = gpu.1.iter().zip(&cpu.1).filter(|(ours, theirs)| ours == theirs).count();
        assert!(same * 2 >= cpu.1.len(), "{same} of {} chunks are the same", cpu.1.len());
        gpu
    }

    #[test]
    fn a_cornell_box_is_baked_on_a_device_as_on_the_cpu() {
        let Some(adapter) = adapter_or_skip() else { return };
        let scene = generated(WorldKind::Cornell, 0.0);
        for parameters in [parameters(0.5, 0.0), parameters(0.7, 0.05)] {
            assert_eq!(compare(&adapter, &scene, parameters).0.device_failure, None);
        }
    }

    #[test]
    fn a_town_is_baked_on_a_device_as_on_the_cpu() {
        let Some(adapter) = adapter_or_skip() else { return };
        compare(&adapter, &generated(WorldKind::Town, 40.0), parameters(4.0, 0.0));
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
        let (open, _) = compare(&adapter, &under_a_grille(true), parameters);
        // Nobody sees through it.
        let (closed, _) = baked(Some(&adapter), &under_a_grille(false), parameters);
        let seen = |summary: &BakeSummary| summary.nonzeros as f64 / summary.patches as f64;
        assert!(seen(&closed) < 0.8 * seen(&open), "{} and {} patches seen", seen(&closed), seen(&open));
    }

    /// An adapter that is gone after so many batches.
    struct Breaking<'a>(&'a Adapter, usize);

    #[derive(Debug)]
    struct BreakingRays {
        rays: Box<dyn RayCaster>,
        device: GpuDevice,
        left: AtomicUsize,
    }

    impl RayDevice for Breaking<'_> {
        fn caster(&self, layout: &TreeLayout) -> Result<Box<dyn RayCaster>, CasterError> {
            let (rays, device) = (self.0.caster(layout)?, self.0.0.clone());
            Ok(Box::new(BreakingRays { rays, device, left: AtomicUsize::new(self.1) }))
        }
    }

    impl RayCaster for BreakingRays {
        fn first_triangles(&self, queries: &[Query]) -> Result<Vec<Option<u32>>, CasterError> {
            if self.left.fetch_sub(1, Ordering::Relaxed) == 0 {
                self.device.destroy();
            }
            self.rays.first_triangles(queries)
        }
    }

    /// Goal: a device that is lost in the middle of a bake costs nothing but time.
    #[test]
    fn a_bake_outlives_its_device() {
        for batches in [0, 2] {
            let Some(adapter) = adapter_or_skip() else { return };
            let scene = generated(WorldKind::Cornell, 0.0);
            let (summary, _) = compare(&Breaking(&adapter, batches), &scene, parameters(0.5, 0.0));
            assert!(summary.device_failure.is_some_and(|cause| cause.contains("destroyed")));
        }
    }

    #[test]
    fn an_adapter_that_is_asked_for_has_to_be_there() {
        let said = format!("{:#}", Adapter::open("no adapter has this name").map(drop).expect_err("nobody"));
        assert!(said.contains("--gpu") && said.contains("CPU"), "{said}");
    }
}
