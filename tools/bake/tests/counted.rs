//! Goal: a bake whose rays end on a device is the CPU's, whatever becomes of the device. Method: the CPU twin of what a
//! device does, which fails when a test wants it to; real devices are held against the same in `tools/earthshine`.
//! Rows before they are balanced are compared in `counted_rows`.

use earthshine_bake::ends::{
    CountedEnds, EndCounter, EndPlaces, EndTriangle, FacedFans, FirstTriangles, Run, Traffic, count_ends,
    face_fans, first_triangles,
};
use earthshine_bake::{
    BakeOptions, BakeSummary, CasterError, Levels, Progress, Query, RayDevice, RayFan, Rays, SceneTracer,
    Silent, Stage, bake_on,
};
use earthshine_gen::{GenOptions, WorldKind};
use earthshine_light::TreeLayout;
use earthshine_scene::{ImportOptions, Scene, load_bytes};
use earthshine_tiles::{BakeParameters, DirStore, RowCodec, TileStore as _};
use earthshine_world::{Chunk, Grid, LightRig, Vec3};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

/// Of a share: hundreds of shares summed in `f32`, where parts are summed exactly.
const ROUNDING: f32 = 2e-5;
/// By which part of itself a balanced share may be off: the scales of both its ends settle on steps of 1/1024, and rounding
/// may bring each to the next.
const STEPS: f32 = 2.5 / 1024.0;

/// Stands for a device that answers so many questions.
#[derive(Debug, Clone)]
struct Twin {
    tracer: &'static SceneTracer<'static>,
    triangles: Vec<EndTriangle>,
    places: Arc<OnceLock<EndPlaces>>,
    asked: Arc<AtomicUsize>,
    answers_max: usize,
}

impl Twin {
    /// What it follows lives as long as the test.
    fn new(scene: &Scene, answers_max: usize) -> Self {
        let scene: &'static Scene = Box::leak(Box::new(scene.clone()));
        let tracer = Box::leak(Box::new(SceneTracer::new(scene)));
        Self { tracer, triangles: Vec::new(), places: Arc::default(), asked: Arc::default(), answers_max }
    }

    fn tire(&self) -> Result<Traffic, CasterError> {
        let is_tired = self.asked.fetch_add(1, Ordering::Relaxed) >= self.answers_max;
        let traffic = Traffic { sent_bytes: 2, read_bytes: 1 };
        if is_tired { Err(CasterError("it is tired".to_owned())) } else { Ok(traffic) }
    }
}

impl RayDevice for Twin {
    fn counter(
        &self,
        layout: &TreeLayout,
        triangles: &[EndTriangle],
    ) -> Result<Box<dyn EndCounter>, CasterError> {
        assert_eq!(layout.triangles.len(), triangles.len());
        Ok(Box::new(Self { triangles: triangles.to_vec(), ..self.clone() }))
    }
}

impl EndCounter for Twin {
    fn face(&self, fans: &[RayFan], near_m: f32) -> Result<FacedFans, CasterError> {
        let traffic = self.tire()?;
        Ok(FacedFans { fans: face_fans(self.tracer, &self.triangles, fans, near_m), traffic })
    }

    fn first(&self, rays: &[Query]) -> Result<FirstTriangles, CasterError> {
        let traffic = self.tire()?;
        Ok(FirstTriangles { triangles: first_triangles(self.tracer, rays), traffic })
    }

    fn settle(&self, places: &EndPlaces) -> Result<(), CasterError> {
        self.places.set(places.clone()).map_err(|_places| CasterError("it is settled".to_owned()))
    }

    fn count(&self, rays: &Rays, runs: &[Run]) -> Result<CountedEnds, CasterError> {
        let traffic = self.tire()?;
        let places = self.places.get().expect("given before");
        Ok(CountedEnds { runs: count_ends(self.tracer, places, &rays.queries(), runs), traffic })
    }
}

/// A device without room for trees.
struct Full;

impl RayDevice for Full {
    fn counter(
        &self,
        _layout: &TreeLayout,
        _triangles: &[EndTriangle],
    ) -> Result<Box<dyn EndCounter>, CasterError> {
        Err(CasterError("it is full".to_owned()))
    }
}

/// Notes what is said of the device.
#[derive(Default)]
struct Heard(Mutex<Vec<String>>);

impl Progress for Heard {
    fn begin(&self, _stage: Stage, _total: u64) {}
    fn advance(&self, _units: u64) {}
    fn device_failed(&self, cause: &str) {
        self.0.lock().expect("no holder panics").push(cause.to_owned());
    }
}

fn scene(kind: WorldKind) -> Scene {
    let options = GenOptions { town_size_m: 40.0, ..GenOptions::default() };
    let glb = earthshine_gen::generate(kind, &options, &|_, _| {}).expect("a scene");
    load_bytes(&glb.bytes, "test", &ImportOptions::default()).expect("an importable scene")
}

fn parameters(voxel_edge_m: f32) -> BakeParameters {
    let grid = Grid { voxel_edge_m, chunk_edge_voxels: 8 };
    BakeParameters {
        grid,
        rays_per_patch: 700,
        receiver_rays: 600,
        detail: 2,
        detail_rays: 600,
        ..BakeParameters::default()
    }
}

fn baked(
    device: Option<&dyn RayDevice>,
    scene: &Scene,
    parameters: BakeParameters,
    progress: &dyn Progress,
) -> (BakeSummary, Vec<Chunk>) {
    let folder = tempfile::tempdir().expect("a folder");
    baked_into(folder.path(), device, scene, parameters, progress)
}

fn baked_into(
    world: &Path,
    device: Option<&dyn RayDevice>,
    scene: &Scene,
    parameters: BakeParameters,
    progress: &dyn Progress,
) -> (BakeSummary, Vec<Chunk>) {
    let options = BakeOptions {
        codec: RowCodec::Full,
        levels: Levels::Exactly(1),
        ..BakeOptions::new("test", parameters, LightRig::emission_only())
    };
    let summary = bake_on(device, scene, world, &options, progress).expect("a good scene");
    let store = DirStore::open(world).expect("a world");
    let ids = store.manifest().index().chunks.into_iter().map(|chunk| chunk.id);
    (summary, ids.map(|id| store.load(id).expect("a good tile")).collect())
}

/// Asserts that both are the same but for rounding.
fn assert_same(ours: &[Chunk], theirs: &[Chunk]) {
    assert_eq!(ours.len(), theirs.len());
    for (ours, theirs) in ours.iter().zip(theirs) {
        assert!((ours.id, &ours.patches) == (theirs.id, &theirs.patches), "other patches");
        assert!(ours.receivers.places == theirs.receivers.places, "other receivers in {:?}", ours.id);
        for (ours, theirs) in [(&ours.rows, &theirs.rows), (&ours.receivers.rows, &theirs.receivers.rows)] {
            assert!(ours.columns == theirs.columns, "other columns");
            for (a, b) in ours.shares.iter().zip(&theirs.shares) {
                assert!((a - b).abs() <= ROUNDING + STEPS * b, "{a} for a share of {b}");
            }
        }
    }
}

#[test]
fn counted_rows_are_those_of_the_cpu() {
    let adaptive = |mut parameters: BakeParameters| {
        parameters.method.row_error = 0.02;
        parameters
    };
    for (kind, parameters) in [
        (WorldKind::Cornell, parameters(0.4)),
        (WorldKind::Cornell, adaptive(parameters(0.7))),
        (WorldKind::Town, parameters(4.0)),
    ] {
        let scene = scene(kind);
        let (cpu, rows) = baked(None, &scene, parameters, &Silent);
        let (summary, counted) = baked(Some(&Twin::new(&scene, usize::MAX)), &scene, parameters, &Silent);
        assert_same(&counted, &rows);
        let rays = |of: &BakeSummary| (of.rays, of.receiver_rays, of.detail_rays, of.exposure_rays);
        assert_eq!(rays(&cpu), rays(&summary), "{kind:?}");
        assert!(cpu.detail_receivers > 100 && summary.device_ray_share > 0.8, "{summary:?}");
        assert_eq!((cpu.device_rays, &summary.device_failure), (0, &None));
    }
}

/// Goal: what a device has found is kept and made stale as what the CPU has found. Method: a panel is moved; each bakes once
/// before and once after.
#[test]
fn an_edit_traces_the_same_with_a_device_as_without() {
    let with_panel = |at: f32| {
        let mut scene = scene(WorldKind::Cornell);
        let (low, size) = (scene.bounds().min, scene.bounds().size());
        let corner = |x: f32, z: f32| low + size * Vec3::new(x, 0.6, z);
        scene.triangles.push([corner(at, 0.4), corner(at, 0.6), corner(at + 0.2, 0.4)]);
        scene.texture_coordinates.push([[0.0; 2]; 3]);
        scene.material_of.push(0);
        scene
    };
    let (before, after) = (with_panel(0.2), with_panel(0.3));
    let parameters = BakeParameters { rays_per_patch: 64, detail_rays: 64, ..parameters(0.7) };
    let folder = tempfile::tempdir().expect("a folder");
    let [cpu, device] = ["cpu", "device"].map(|name| folder.path().join(name));
    let twin = |scene: &Scene| Twin::new(scene, usize::MAX);
    baked_into(&cpu, None, &before, parameters, &Silent);
    baked_into(&device, Some(&twin(&before)), &before, parameters, &Silent);
    let (expected, rows) = baked_into(&cpu, None, &after, parameters, &Silent);
    let (found, counted) = baked_into(&device, Some(&twin(&after)), &after, parameters, &Silent);
    assert_same(&counted, &rows);
    let rays = |of: &BakeSummary| (of.rays, of.receiver_rays, of.detail_rays);
    assert_eq!(rays(&found), rays(&expected));
    // Of a suspect point's own rays a device says but how far the farthest gets.
    assert!(found.exposure_rays >= expected.exposure_rays, "{found:?}");
    assert!(found.device_rays > 0 && found.exposure_rays > 0 && found.detail_rays > 0, "{found:?}");
    let whole = baked(None, &after, parameters, &Silent);
    assert_same(&counted, &whole.1);
    assert!(whole.0.detail_rays > found.detail_rays && whole.0.exposure_rays > found.exposure_rays);
}

/// Goal: a device that fails anywhere in a bake costs nothing but time, is asked no more, and this is said once.
#[test]
fn a_bake_outlives_its_device() {
    let (scene, parameters) = (scene(WorldKind::Cornell), parameters(0.4));
    let rows = baked(None, &scene, parameters, &Silent).1;
    let questions = Twin::new(&scene, usize::MAX);
    baked(Some(&questions), &scene, parameters, &Silent);
    let questions = questions.asked.load(Ordering::Relaxed);
    // In the middle of exposure, of rows, of detail.
    for answers in [0, 1, 3, questions / 2, questions * 3 / 4] {
        let (twin, heard) = (Twin::new(&scene, answers), Heard::default());
        let (summary, counted) = baked(Some(&twin), &scene, parameters, &heard);
        assert_same(&counted, &rows);
        assert_eq!(heard.0.into_inner().expect("no holder panics"), ["it is tired"]);
        assert_eq!(summary.device_failure.as_deref(), Some("it is tired"));
        assert_eq!(summary.device_read_bytes, answers as u64, "all answers count");
        // Of each chunk two questions at most are on their way.
        assert!(twin.asked.load(Ordering::Relaxed) <= answers + 2 * rows.len());
    }
    let heard = Heard::default();
    let (summary, counted) = baked(Some(&Full), &scene, parameters, &heard);
    assert_same(&counted, &rows);
    assert_eq!(heard.0.into_inner().expect("no holder panics"), ["it is full"]);
    assert_eq!((summary.device_failure.as_deref(), summary.device_rays), (Some("it is full"), 0));
}
