//! The stages of a bake, run in order, each chunk by chunk.
//!
//! Between two stages every chunk has finished the first: rows need to know all patches. What a chunk's part of a
//! stage depends on and comes to is in the work folder ([`crate::work_folder`]); a stage begins with what is there.

use crate::balance::{RowStore, Scaling};
use crate::builder::{Builder, Surfaces};
use crate::cells::Cells;
use crate::content::SceneContent;
use crate::detail_stage::{self, has_detail};
use crate::emit::{Emitter, Parts, occluders};
use crate::emitted;
use crate::end_places::{end_places, end_triangles};
use crate::finished_world::{Before, before, remove_unlisted};
use crate::memory::{self, MemoryLimit, Trees};
use crate::offload::Offload;
use crate::overlap::ChunkTriangles;
use crate::parameters_check::check;
use crate::patches::PatchSet;
use crate::progress::{Progress, Stage};
use crate::pyramid::{self, Levels};
use crate::receivers::placed;
use crate::row_files;
use crate::rows::RawRow;
use crate::shard::{Shard, for_all, visits};
use crate::states::States;
use crate::surfaces::{SurfaceSource, is_streamed};
use crate::tile_files::{TileFiles, is_there};
use crate::tracing::{self, ReceiverVoxels};
use crate::work_folder::{Kind, WorkFolder};
use crate::{BakeError, BakeSummary, identity};
use earthshine_scene::Scene;
use earthshine_tiles::{BakeParameters, ChunkEntry, EncodeOptions, Manifest, RowCodec, format};
use earthshine_trace::{RayDevice, SceneTracer};
use earthshine_world::{ChunkId, LightRig, Rgb};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// Of each chunk, what its surfaces come from: equal contents, equal number.
type Identities = BTreeMap<[i32; 3], u64>;

/// What to bake and how, besides the scene.
#[derive(Debug, Clone)]
pub struct BakeOptions {
    /// Everything the bytes depend on.
    pub parameters: BakeParameters,
    /// How rows are stored.
    pub codec: RowCodec,
    /// For the manifest: where the scene came from. A world of the same name and parameters is brought up to date.
    pub scene_name: String,
    /// The lights that go into the manifest.
    pub lights: LightRig,
    /// Replace a world of another scene or other parameters.
    pub overwrite: bool,
    /// Coarse levels on top of level 0.
    pub levels: Levels,
    /// Which of several processes this is.
    pub shard: Shard,
    /// What it may take.
    pub memory: MemoryLimit,
    /// Remove the work folder once the world is whole: an edit is then baked from scratch.
    pub discard_work: bool,
}

impl BakeOptions {
    /// A bake by `parameters` by one process, with rows in half precision and as many levels as suit the world.
    #[must_use]
    pub fn new(scene_name: &str, parameters: BakeParameters, lights: LightRig) -> Self {
        Self {
            parameters,
            codec: RowCodec::Half,
            scene_name: scene_name.to_owned(),
            lights,
            overwrite: false,
            levels: Levels::Auto,
            shard: Shard::default(),
            memory: MemoryLimit::default(),
            discard_work: false,
        }
    }
}

/// Bakes `scene` into the folder `world`.
///
/// A world that is whole and of the same contents is left alone; if only its levels are not those wanted, they alone
/// are made. An interrupted bake goes on where it stopped; after an edit only what can have changed is traced.
///
/// # Errors
/// [`BakeError`]; the world is then as it was, plus the work folder.
pub fn bake(
    scene: &Scene,
    world: &Path,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<BakeSummary, BakeError> {
    bake_on(None, scene, world, options, progress)
}

/// As [`bake`], with the rays of exposure, rows, receivers and detail traced on `device`, if there is one, and their ends
/// counted there; of paths from points that look buried, and of what emitters cast towards detail, a device says what they
/// meet first. What is baked is the same but for rounding and rays that pass an edge within it. When the device fails,
/// `progress` hears of it and the CPU traces the rest.
///
/// # Errors
/// [`BakeError`]; the world is then as it was, plus the work folder.
pub fn bake_on(
    device: Option<&dyn RayDevice>,
    scene: &Scene,
    world: &Path,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<BakeSummary, BakeError> {
    let started = Instant::now();
    let parameters = &options.parameters;
    check(parameters)?;
    let world_hash = identity::world_hash(parameters);
    let content_hash = identity::content_hash(scene, parameters);
    let mut summary = BakeSummary { triangles: scene.triangles.len() as u64, ..BakeSummary::default() };
    let before = before(world, world_hash, content_hash, options)?;
    std::fs::create_dir_all(world).map_err(BakeError::io(world))?;
    let work = WorkFolder::open(world)?;
    let encoding = EncodeOptions { codec: options.codec, ..EncodeOptions::new(world_hash) };
    let files = TileFiles { world, encoding, work: &work, content_hash };
    let manifest = match before {
        Before::Same(manifest) => relevelled(manifest, &files, options, &mut summary, progress)?,
        Before::Nothing | Before::Other(_) => {
            let mut run =
                Run { scene, options, files: &files, summary: &mut summary, progress, since: Instant::now() };
            let chunks = run.all(device)?;
            let manifest = Manifest {
                format_version: format::VERSION,
                world_hash,
                content_hash,
                scene: options.scene_name.clone(),
                parameters: *parameters,
                bounds: scene.bounds(),
                lights: options.lights.clone(),
                chunks,
            };
            manifest.save(world)?;
            if let Before::Other(old) = &before {
                summary.stale.compare_tiles(old, &manifest);
            }
            manifest
        }
    };
    // Other processes may still be reading.
    if options.shard.count == 1 {
        remove_unlisted(world, &manifest)?;
        WorkFolder::clear(world, options.discard_work)?;
    }
    summary.count(&manifest, started);
    Ok(summary)
}

/// A finished world with the levels that are wanted; they are made afresh unless it has just these, whole.
fn relevelled(
    mut manifest: Manifest,
    files: &TileFiles<'_>,
    options: &BakeOptions,
    summary: &mut BakeSummary,
    progress: &dyn Progress,
) -> Result<Manifest, BakeError> {
    let started = Instant::now();
    let is_whole = manifest.chunks.iter().all(|chunk| is_there(files.world, chunk));
    summary.up_to_date = is_whole && options.levels.are(&pyramid::patch_counts(&manifest.chunks));
    if !summary.up_to_date {
        manifest.chunks.retain(|chunk| chunk.level == 0);
        let (levels, shard) = (options.levels, options.shard);
        pyramid::build(&mut manifest.chunks, files, &options.parameters, levels, shard, progress)?;
        manifest.save(files.world)?;
        summary.spent(Stage::Pyramid, started.elapsed().as_secs_f64());
    }
    Ok(manifest)
}

/// A bake under way.
pub(crate) struct Run<'a> {
    scene: &'a Scene,
    pub(crate) options: &'a BakeOptions,
    pub(crate) files: &'a TileFiles<'a>,
    pub(crate) summary: &'a mut BakeSummary,
    pub(crate) progress: &'a dyn Progress,
    /// When the stage began.
    since: Instant,
}

/// What all stages after the first know.
pub(crate) struct Known<'a> {
    pub(crate) source: &'a SurfaceSource<'a>,
    pub(crate) tracer: &'a SceneTracer<'a>,
    /// The device that counts ends of rays, if there is one.
    pub(crate) offload: &'a Offload<'a>,
    pub(crate) set: &'a PatchSet,
    /// By chunk: changes with its surfaces.
    pub(crate) identities: BTreeMap<[i32; 3], u64>,
    /// What rays can see, patches among it.
    pub(crate) cells: Cells,
    /// The state that these are, and those before.
    pub(crate) states: States<'a>,
    /// Hash of what holds for all chunks.
    pub(crate) key: u64,
}

impl<'a> Run<'a> {
    pub(crate) fn parameters(&self) -> &'a BakeParameters {
        &self.options.parameters
    }

    pub(crate) fn end(&mut self, stage: Stage) {
        self.summary.spent(stage, self.since.elapsed().as_secs_f64());
        self.since = Instant::now();
    }

    /// All stages; the entries of all tiles.
    fn all(&mut self, device: Option<&dyn RayDevice>) -> Result<Vec<ChunkEntry>, BakeError> {
        let (scene, parameters, files) = (self.scene, self.parameters(), self.files);
        let edge_m = parameters.grid.voxel_edge_m;
        memory::check_fineness(scene, parameters, is_streamed(&parameters.method))?;
        self.progress.begin(Stage::Tree, scene.triangles.len() as u64);
        let content = SceneContent::new(scene);
        let cells = Cells::of(scene, &content, parameters.grid);
        let estimated = memory::estimated_patches(scene, parameters, is_streamed(&parameters.method));
        let limit = self.options.memory;
        let (trees, of_scene) = limit.trees(scene, &cells, estimated);
        limit.check(of_scene, "the scene and its trees", edge_m)?;
        let triangles = ChunkTriangles::new(scene, parameters.grid);
        limit.check(of_scene + estimated, "the scene and about as many patches as it has", edge_m)?;
        let tracer = match trees {
            Trees::One => SceneTracer::new(scene),
            Trees::OfMeshes => SceneTracer::of_meshes(scene),
        };
        self.summary.tree_bytes = tracer.tree_bytes() as u64;
        self.end(Stage::Tree);
        let builder = Builder { tracer: &tracer, parameters };
        let whole = self.whole(&builder);
        let mut key = self.common_key(&cells);
        key = xxh3_64(bytemuck::bytes_of(&[key, content.lamps]));
        let (triangles, content, work) = (&triangles, &content, files.work);
        let offload = Offload::new(device, &tracer, || end_triangles(scene, parameters), self.progress);
        let source = SurfaceSource { builder, offload: &offload, triangles, content, work, key, whole };
        let (set, identities, cells, mut named) = self.surfaces(&source, cells)?;
        if set.is_empty() {
            return Err(BakeError::NoPatches { voxel_edge_m: edge_m });
        }
        let of_patches = memory::of_patches(set.len() as u64, self.summary.chunk_samples_max);
        let needed = of_scene + of_patches + set.buried().bytes();
        limit.check(needed, "the scene and its patches", edge_m)?;
        // What emitters see is asked last of all, and known to be too much before rows take their time.
        let of_emitters = if has_detail(parameters) { emitted::bytes(scene, &set, parameters) } else { 0 };
        self.summary.memory_estimate_bytes = needed + of_emitters;
        limit.check(needed + of_emitters, "the scene and what its emitters see", edge_m)?;
        let (key, states) = (self.common_key(&cells), States::begin(work, &cells)?);
        offload.settle(|| end_places(scene, &set, parameters));
        let (source, tracer, set, offload) = (&source, &tracer, &set, &offload);
        let known = Known { source, tracer, offload, set, identities, cells, states, key };
        let rows = tracing::rows(self, &known)?;
        let receivers = tracing::receivers(self, &known)?;
        detail_stage::trace(self, &known)?;
        offload.book(self.summary);
        let (scaling, balance) = rows.balance(&self.visits(set), self.progress)?;
        self.summary.balance = balance;
        self.end(Stage::Reciprocity);
        let mut chunks = self.tiles(&known, &rows, &scaling, &receivers)?;
        self.end(Stage::Tiles);
        let (levels, shard) = (self.options.levels, self.options.shard);
        pyramid::build(&mut chunks, files, parameters, levels, shard, self.progress)?;
        named.extend(known.states.named());
        // Other processes may still ask for others.
        if shard.count == 1 {
            work.keep_states(&named)?;
        }
        self.end(Stage::Pyramid);
        Ok(chunks)
    }

    /// All surfaces at once, for methods that need them so.
    fn whole(&mut self, builder: &Builder<'_>) -> Option<Surfaces> {
        if is_streamed(&self.parameters().method) {
            return None;
        }
        let mut samples = builder.samples(self.progress);
        self.summary.samples = samples.len() as u64;
        self.summary.exposure_rays = builder.expose(&mut samples, self.progress);
        let is_buried = |exposure| exposure == crate::exposure::Exposure::Buried;
        self.summary.buried_samples =
            samples.iter().filter(|sample| is_buried(sample.exposure)).count() as u64;
        let set = builder.patches(&samples);
        Some(Surfaces { samples, set })
    }

    /// Hash of what holds for all chunks. Where the whole world is needed at once, all of it does.
    fn common_key(&self, cells: &Cells) -> u64 {
        let content = if is_streamed(&self.parameters().method) { 0 } else { self.files.content_hash };
        let parameters = self.parameters().content_hash();
        xxh3_64(bytemuck::bytes_of(&[u64::from(identity::RECIPE), parameters, content, cells.frame()]))
    }

    pub(crate) fn visits(&self, set: &PatchSet) -> Vec<Vec<usize>> {
        let coords: Vec<[i32; 3]> = set.chunks.keys().copied().collect();
        visits(self.options.shard, &coords)
    }

    /// The first stage: exposures and patches. Returns all patches, the cells with them, and the states that files name.
    fn surfaces(
        &mut self,
        source: &SurfaceSource<'_>,
        mut cells: Cells,
    ) -> Result<(PatchSet, Identities, Cells, BTreeSet<u64>), BakeError> {
        if let Some(Surfaces { set, .. }) = &source.whole {
            self.end(Stage::Exposure);
            let identities = set.chunks.keys().map(|&chunk| (chunk, self.files.content_hash)).collect();
            return Ok((set.without_samples(), identities, cells, BTreeSet::new()));
        }
        let states = States::begin(self.files.work, &cells)?;
        let coords = source.triangles.coords();
        let total: u64 = coords.iter().map(|&chunk| source.triangles.of(chunk).len() as u64).sum();
        self.progress.begin(Stage::Exposure, total);
        let mut records = for_all(&visits(self.options.shard, &coords), |number| {
            let record = source.record(coords[number], &cells, &states)?;
            self.progress.advance(source.triangles.of(coords[number]).len() as u64);
            Ok((coords[number], record))
        })?;
        records.sort_by_key(|record| record.0);
        let mut identities = BTreeMap::new();
        for (chunk, record) in &records {
            let summary = &mut *self.summary;
            summary.samples += record.samples;
            summary.chunk_samples_max = summary.chunk_samples_max.max(record.samples);
            summary.buried_samples += record.buried;
            summary.exposure_rays += record.rays;
            summary.stale.note(*chunk, Stage::Exposure, record.stale);
            identities.insert(*chunk, record.identity);
        }
        let pieces = records.iter_mut().flat_map(|(_, record)| std::mem::take(&mut record.pieces)).collect();
        let parts = records.into_iter().map(|(chunk, record)| (chunk, record.patches, record.hidden));
        let set = PatchSet::assemble(parts, self.parameters()).with_buried(pieces);
        for source in &set.patches {
            let emits = u64::from(source.patch.emission != Rgb::ZERO);
            cells.add_at(source.patch.voxel, xxh3_64(bytemuck::bytes_of(&[source.key, emits])));
        }
        for piece in set.hidden().samples() {
            let place = (piece.position.to_array(), u32::from(piece.left_out));
            let mut hash = Xxh3Default::new();
            hash.update(bytemuck::bytes_of(&place.0));
            hash.update(&place.1.to_le_bytes());
            cells.add_at(piece.voxel, hash.digest());
        }
        for piece in set.buried().pieces() {
            let traced = source.content.traced(piece.side as usize / 2);
            let hash = xxh3_64(bytemuck::bytes_of(&[traced, u64::from(piece.side % 2)]));
            cells.add_at(piece.voxel.into(), hash);
        }
        self.end(Stage::Exposure);
        Ok((set, identities, cells, states.named()))
    }

    /// The last stage before the pyramid: every chunk becomes a tile.
    fn tiles(
        &mut self,
        known: &Known<'_>,
        rows: &RowStore<'_>,
        scaling: &Scaling,
        air: &ReceiverVoxels,
    ) -> Result<Vec<ChunkEntry>, BakeError> {
        let grid = self.parameters().grid;
        let mut coords: BTreeSet<[i32; 3]> = known.set.chunks.keys().chain(air.keys()).copied().collect();
        coords.extend(known.source.triangles.coords());
        let coords: Vec<[i32; 3]> = coords.into_iter().collect();
        self.progress.begin(Stage::Tiles, coords.len() as u64);
        let emitter = Emitter { set: known.set, parameters: self.parameters() };
        let closing = Mutex::new(Closing::default());
        let entries = for_all(&visits(self.options.shard, &coords), |number| {
            let chunk = coords[number];
            self.progress.advance(1);
            if let Some(entry) = self.files.finished(ChunkId::new(0, chunk.into())) {
                return Ok(Some(entry));
            }
            let occluders = occluders(self.scene, known.source.triangles.of(chunk), grid, chunk);
            let (rows, deficits) = rows.balanced(chunk, scaling)?;
            closing.lock().expect("no holder panics").add(&rows, &deficits);
            let mut receivers = match air.get(&chunk) {
                None => Vec::new(),
                Some(voxels) => {
                    let (_, payload) = self
                        .files
                        .work
                        .read(Kind::Receivers, 0, chunk)
                        .ok_or(BakeError::WorkChanged { chunk })?;
                    let (rows, _) = row_files::decode(&payload, voxels.len() * 6, known.set, &grid)
                        .ok_or(BakeError::WorkChanged { chunk })?;
                    placed(voxels, rows)
                }
            };
            receivers.extend(detail_stage::read(self, known, chunk)?);
            receivers.sort_by_key(|receiver| receiver.place.order());
            if rows.is_empty() && receivers.is_empty() && occluders.triangles.is_empty() {
                return Ok(None);
            }
            let surfaces = known.source.of(chunk, known.set)?;
            let parts = Parts { surfaces: &surfaces, rows: &rows, receivers: &receivers, occluders };
            Ok(Some(self.files.put(&emitter.chunk(chunk, parts)?, self.files.content_hash)?))
        })?;
        closing.into_inner().expect("no holder panics").book(self.summary);
        let mut entries: Vec<ChunkEntry> = entries.into_iter().flatten().collect();
        entries.sort_by_key(ChunkEntry::id);
        Ok(entries)
    }
}

/// How far balanced rows were from one.
#[derive(Default)]
struct Closing {
    rows: u64,
    absorbed: f64,
    deficits: f64,
    deficit_max: f32,
}

impl Closing {
    fn add(&mut self, rows: &[RawRow], deficits: &[f32]) {
        self.rows += rows.len() as u64;
        self.absorbed += rows.iter().map(|row| f64::from(row.absorbed)).sum::<f64>();
        self.deficits += deficits.iter().map(|&deficit| f64::from(deficit)).sum::<f64>();
        self.deficit_max = deficits.iter().copied().fold(self.deficit_max, f32::max);
    }

    fn book(self, summary: &mut BakeSummary) {
        let rows = self.rows.max(1) as f64;
        summary.absorbed_share_mean = self.absorbed / rows;
        summary.balance.deficit_mean = (self.deficits / rows) as f32;
        summary.balance.deficit_max = self.deficit_max;
    }
}
