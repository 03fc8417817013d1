//! Goal: a bake whose rays end on a device is the CPU's, whatever becomes of the device. Method: the CPU twin of what a
//! device does, which fails when a test wants it to; real devices are held against the same in `tools/earthshine`.
//! Rows before they are balanced are compared in `counted_rows`.

use earthshine_bake::ends::{CountedEnds, EndCounter, EndPlaces, Run, count_ends};
use earthshine_bake::{
    BakeOptions, BakeSummary, CasterError, Levels, MemoryLimit, Progress, Query, RayDevice, SceneTracer,
    Shard, Silent, Stage, bake_on,
};
use earthshine_gen::{GenOptions, WorldKind};
use earthshine_light::TreeLayout;
use earthshine_scene::{ImportOptions, Scene, load_bytes};
use earthshine_tiles::{BakeParameters, DirStore, RowCodec, TileStore as _};
use earthshine_world::{Chunk, Grid, LightRig};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// Of a share: hundreds of shares summed in `f32`, where parts are summed exactly.
const ROUNDING: f32 = 2e-5;
/// By which part of itself a balanced share may be off: the scales of both its ends settle on steps of 1/1024, and rounding
/// may bring each to the next.
const STEPS: f32 = 2.5 / 1024.0;

/// Stands for a device that answers so many questions.
#[derive(Debug, Clone)]
struct Twin {
    tracer: &'static SceneTracer<'static>,
    places: Option<EndPlaces>,
    asked: Arc<AtomicUsize>,
    answers_max: usize,
}

impl Twin {
    /// What it follows lives as long as the test.
    fn new(scene: &Scene, answers_max: usize) -> Self {
        let scene: &'static Scene = Box::leak(Box::new(scene.clone()));
        let tracer = Box::leak(Box::new(SceneTracer::new(scene)));
        Self { tracer, places: None, asked: Arc::default(), answers_max }
    }
}

impl RayDevice for Twin {
    fn counter(&self, layout: &TreeLayout, places: &EndPlaces) -> Result<Box<dyn EndCounter>, CasterError> {
        assert_eq!(layout.triangles.len(), places.triangles.len());
        Ok(Box::new(Self { places: Some(places.clone()), ..self.clone() }))
    }
}

impl EndCounter for Twin {
    fn count(&self, rays: &[Query], runs: &[Run]) -> Result<CountedEnds, CasterError> {
        if self.asked.fetch_add(1, Ordering::Relaxed) >= self.answers_max {
            return Err(CasterError("it is tired".to_owned()));
        }
        let places = self.places.as_ref().expect("given at first");
        Ok(CountedEnds { runs: count_ends(self.tracer, places, rays, runs), read_bytes: 1 })
    }
}

/// A device without room for trees.
struct Full;

impl RayDevice for Full {
    fn counter(&self, _layout: &TreeLayout, _places: &EndPlaces) -> Result<Box<dyn EndCounter>, CasterError> {
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
    BakeParameters { grid, rays_per_patch: 700, receiver_rays: 600, detail: 1, ..BakeParameters::default() }
}

fn baked(
    device: Option<&dyn RayDevice>,
    scene: &Scene,
    parameters: BakeParameters,
    progress: &dyn Progress,
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
    let summary = bake_on(device, scene, folder.path(), &options, progress).expect("a good scene");
    let store = DirStore::open(folder.path()).expect("a world");
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
        assert_eq!((cpu.rays, cpu.receiver_rays), (summary.rays, summary.receiver_rays), "{kind:?}");
        assert!(summary.device_rays >= cpu.rays, "{} of {}", summary.device_rays, cpu.rays);
        assert_eq!((cpu.device_rays, &summary.device_failure), (0, &None));
    }
}

/// Goal: a device that fails anywhere in a bake costs nothing but time, is asked no more, and this is said once.
#[test]
fn a_bake_outlives_its_device() {
    let (scene, parameters) = (scene(WorldKind::Cornell), parameters(0.4));
    let rows = baked(None, &scene, parameters, &Silent).1;
    for answers in [0, 1, 3] {
        let (twin, heard) = (Twin::new(&scene, answers), Heard::default());
        let (summary, counted) = baked(Some(&twin), &scene, parameters, &heard);
        assert_same(&counted, &rows);
        assert_eq!(heard.0.into_inner().expect("no holder panics"), ["it is tired"]);
        assert_eq!(summary.device_failure.as_deref(), Some("it is tired"));
        assert_eq!(summary.device_read_bytes, answers as u64, "all answers count");
        assert!(twin.asked.load(Ordering::Relaxed) <= answers + rayon::current_num_threads());
    }
    let heard = Heard::default();
    let (summary, counted) = baked(Some(&Full), &scene, parameters, &heard);
    assert_same(&counted, &rows);
    assert_eq!(heard.0.into_inner().expect("no holder panics"), ["it is full"]);
    assert_eq!((summary.device_failure.as_deref(), summary.device_rays), (Some("it is full"), 0));
}
