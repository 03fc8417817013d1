//! The stages of a bake, run in order.

use crate::builder::Builder;
use crate::checkpoint::Checkpoints;
use crate::emit::{Emitter, occluders_by_chunk};
use crate::estimator::Estimator;
use crate::exposure::Exposure;
use crate::progress::{Progress, Stage};
use crate::pyramid::{self, Levels};
use crate::receivers::ReceiverBake;
use crate::rows::{RawRow, RowCaster};
use crate::sample::SurfaceSample;
use crate::summary::LevelSummary;
use crate::tile_files::TileFiles;
use crate::{BakeError, BakeSummary, identity, reciprocity};
use earthshine_scene::Scene;
use earthshine_tiles::{BakeParameters, ChunkEntry, EncodeOptions, Manifest, RowCodec, format};
use earthshine_trace::SceneTracer;
use earthshine_world::{Grid, LightRig};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// What to bake and how, besides the scene.
#[derive(Debug, Clone)]
pub struct BakeOptions {
    /// Everything the bytes depend on.
    pub parameters: BakeParameters,
    /// How rows are stored.
    pub codec: RowCodec,
    /// For the manifest: where the scene came from.
    pub scene_name: String,
    /// The lights that go into the manifest.
    pub lights: LightRig,
    /// Replace a world of another scene or other parameters.
    pub overwrite: bool,
    /// Coarse levels on top of level 0.
    pub levels: Levels,
}

/// Bakes `scene` into the folder `world`.
///
/// A world that is whole and of the same hash is left alone; if only its levels are not those wanted, they alone are
/// made. An interrupted bake goes on where it stopped.
///
/// # Errors
/// [`BakeError`]; the world is then as it was, plus checkpoints.
pub fn bake(
    scene: &Scene,
    world: &Path,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<BakeSummary, BakeError> {
    let started = Instant::now();
    let parameters = &options.parameters;
    check(parameters)?;
    let world_hash = identity::world_hash(scene, parameters);
    let mut summary = BakeSummary { triangles: scene.triangles.len() as u64, ..BakeSummary::default() };
    if let Some(manifest) = finished_before(world, world_hash, options)? {
        return relevelled(manifest, world, options, summary, progress);
    }
    check_size(scene, parameters)?;
    std::fs::create_dir_all(world).map_err(BakeError::io(world))?;
    let mut clock = StageClock { summary: &mut summary, since: Instant::now() };

    progress.begin(Stage::Tree, scene.triangles.len() as u64);
    let tracer = SceneTracer::new(scene);
    clock.end(Stage::Tree);
    let builder = Builder { tracer: &tracer, parameters };
    let mut samples = builder.samples(progress);
    clock.summary.samples = samples.len() as u64;
    clock.end(Stage::Sample);
    clock.summary.exposure_rays = builder.expose(&mut samples, progress);
    let is_buried = |sample: &&SurfaceSample| sample.exposure == Exposure::Buried;
    clock.summary.buried_samples = samples.iter().filter(is_buried).count() as u64;
    let set = builder.patches(&samples);
    clock.end(Stage::Exposure);
    if set.is_empty() {
        return Err(BakeError::NoPatches { voxel_edge_m: parameters.grid.voxel_edge_m });
    }
    let checkpoints = Checkpoints::open(world, world_hash)?;
    let caster = RowCaster { tracer: &tracer, samples: &samples, set: &set, parameters };
    let mut rows = traced(caster, &checkpoints, clock.summary, progress)?;
    clock.end(Stage::Rows);
    progress.begin(Stage::Reciprocity, rows.len() as u64);
    let areas: Vec<f32> = set.patches.iter().map(|p| p.patch.area).collect();
    clock.summary.balance = reciprocity::enforce(&mut rows, &areas);
    clock.end(Stage::Reciprocity);
    let receivers = ReceiverBake { caster }.run(&checkpoints, clock.summary, progress)?;
    clock.end(Stage::Receivers);
    let occluders = occluders_by_chunk(scene, parameters.grid);
    let emitter = Emitter {
        samples: &samples,
        set: &set,
        rows: &rows,
        receivers: &receivers,
        occluders: &occluders,
        parameters,
    };
    let files = TileFiles { world, encoding: encoding(world_hash, options) };
    let mut chunks = written(&emitter, &files, world_hash, progress)?;
    clock.end(Stage::Tiles);
    pyramid::build(&mut chunks, &files, parameters, options.levels, progress)?;
    let manifest = manifest(scene, world_hash, options, chunks);
    manifest.save(world)?;
    remove_unlisted(world, &manifest)?;
    Checkpoints::clear(world)?;
    clock.end(Stage::Pyramid);
    let absorbed: f64 = rows.iter().map(|row| f64::from(row.absorbed)).sum();
    summary.absorbed_share_mean = absorbed / rows.len() as f64;
    count(&mut summary, &manifest, started);
    Ok(summary)
}

struct StageClock<'a> {
    summary: &'a mut BakeSummary,
    since: Instant,
}

impl StageClock<'_> {
    fn end(&mut self, stage: Stage) {
        self.summary.spent(stage, self.since.elapsed().as_secs_f64());
        self.since = Instant::now();
    }
}

fn check(parameters: &BakeParameters) -> Result<(), BakeError> {
    let edge = parameters.grid.voxel_edge_m;
    if !(edge.is_finite() && edge > 1e-4) {
        let (name, cause) = ("voxel edge", "must be a length above 0.0001 m");
        return Err(BakeError::Parameter { name, value: edge.to_string(), cause });
    }
    let chunk = parameters.grid.chunk_edge_voxels;
    if !(1..=Grid::CHUNK_EDGE_VOXELS_MAX).contains(&chunk) {
        let (name, cause) = ("chunk edge", "must be 1 to 22 voxels");
        return Err(BakeError::Parameter { name, value: chunk.to_string(), cause });
    }
    let (points, samples) = (parameters.points_per_patch, parameters.samples_per_voxel_face);
    if points == 0 || samples == 0 {
        let (name, cause) = ("points per patch and samples per voxel face", "must be 1 or more");
        return Err(BakeError::Parameter { name, value: format!("{points} and {samples}"), cause });
    }
    let rays = parameters.rays_per_patch;
    if !(1..=1 << 20).contains(&rays) {
        let (name, cause) = ("rays per patch", "must be 1 to 1,048,576");
        return Err(BakeError::Parameter { name, value: rays.to_string(), cause });
    }
    if let Some((name, cause)) = parameters.method.fault() {
        return Err(BakeError::Parameter { name, value: format!("{:?}", parameters.method), cause });
    }
    check_receivers(parameters)
}

fn check_receivers(parameters: &BakeParameters) -> Result<(), BakeError> {
    let bounded = [
        ("receivers", parameters.receiver_reach_voxels, 0..=8, "must be 0 to 8 voxels"),
        ("rays of receivers", parameters.receiver_rays, 64..=1 << 16, "must be 64 to 65,536"),
        ("columns of receivers", parameters.receiver_columns, 4..=1 << 12, "must be 4 to 4,096"),
    ];
    match bounded.into_iter().find(|(_, value, range, _)| !range.contains(value)) {
        None => Ok(()),
        Some((name, value, _, cause)) => Err(BakeError::Parameter { name, value: value.to_string(), cause }),
    }
}

/// Most samples of a bake: about 10 GiB.
const SAMPLES_MAX: f64 = 1e8;

/// Refuses a voxel edge that would fill the memory before anything is allocated.
fn check_size(scene: &Scene, parameters: &BakeParameters) -> Result<(), BakeError> {
    let edge = f64::from(parameters.grid.voxel_edge_m);
    let samples = 2.0 * scene.surface_area() / (edge * edge) * f64::from(parameters.samples_per_voxel_face);
    if samples <= SAMPLES_MAX {
        return Ok(());
    }
    let suggested_m = (edge * (samples / SAMPLES_MAX).sqrt() * 1.1) as f32;
    Err(BakeError::TooFine {
        voxel_edge_m: parameters.grid.voxel_edge_m,
        samples: samples as u64,
        suggested_m,
    })
}

/// The manifest of `world` if its level 0 is this bake's. A world that is another one is only replaced when asked.
fn finished_before(
    world: &Path,
    world_hash: u64,
    options: &BakeOptions,
) -> Result<Option<Manifest>, BakeError> {
    if !world.join(Manifest::FILE_NAME).is_file() {
        return Ok(None);
    }
    let manifest = match Manifest::load(world) {
        Ok(manifest) => manifest,
        Err(_) if options.overwrite => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    if manifest.world_hash != world_hash {
        return if options.overwrite {
            Ok(None)
        } else {
            Err(BakeError::OtherWorld { path: world.to_owned(), scene: manifest.scene })
        };
    }
    let is_whole =
        manifest.chunks.iter().filter(|chunk| chunk.level == 0).all(|chunk| is_there(world, chunk));
    Ok((is_whole && manifest.lights == options.lights).then_some(manifest))
}

fn is_there(world: &Path, chunk: &ChunkEntry) -> bool {
    std::fs::metadata(world.join(&chunk.file)).is_ok_and(|file| file.len() == chunk.tile_bytes)
}

/// A finished world with the levels that are wanted; they are made afresh unless it has just these, whole.
fn relevelled(
    mut manifest: Manifest,
    world: &Path,
    options: &BakeOptions,
    mut summary: BakeSummary,
    progress: &dyn Progress,
) -> Result<BakeSummary, BakeError> {
    let started = Instant::now();
    let is_whole = manifest.chunks.iter().all(|chunk| is_there(world, chunk));
    summary.up_to_date = is_whole && options.levels.are(&pyramid::patch_counts(&manifest.chunks));
    if !summary.up_to_date {
        manifest.chunks.retain(|chunk| chunk.level == 0);
        let files = TileFiles { world, encoding: encoding(manifest.world_hash, options) };
        pyramid::build(&mut manifest.chunks, &files, &options.parameters, options.levels, progress)?;
        manifest.save(world)?;
        remove_unlisted(world, &manifest)?;
        summary.spent(Stage::Pyramid, started.elapsed().as_secs_f64());
    }
    count(&mut summary, &manifest, started);
    Ok(summary)
}

fn encoding(world_hash: u64, options: &BakeOptions) -> EncodeOptions {
    EncodeOptions { codec: options.codec, ..EncodeOptions::new(world_hash) }
}

fn traced(
    caster: RowCaster<'_>,
    checkpoints: &Checkpoints,
    summary: &mut BakeSummary,
    progress: &dyn Progress,
) -> Result<Vec<RawRow>, BakeError> {
    let estimator = Estimator::new(caster)?;
    let set = caster.set;
    // What a row takes where its error decides is not known before.
    let rays = u64::from(caster.parameters.rays_per_patch);
    progress.begin(Stage::Rows, set.len() as u64 * rays);
    let started = Instant::now();
    let (cast, resumed) = (AtomicU64::new(0), AtomicU64::new(0));
    let chunks: Vec<_> = set.chunks.iter().collect();
    let by_chunk: Vec<Vec<RawRow>> = chunks
        .par_iter()
        .map(|(coord, range)| {
            if let Some(rows) = checkpoints.load(**coord, range.len(), set.len()) {
                resumed.fetch_add(1, Ordering::Relaxed);
                progress.advance(rays * range.len() as u64);
                return Ok(rows);
            }
            let rows: Vec<RawRow> = Range::clone(range)
                .into_par_iter()
                .map(|patch| {
                    let row = estimator.row(patch);
                    progress.advance(rays);
                    row
                })
                .collect();
            let spent = rows.iter().map(|row| u64::from(row.rays)).sum();
            cast.fetch_add(spent, Ordering::Relaxed);
            checkpoints.save(**coord, &rows)?;
            Ok(rows)
        })
        .collect::<Result<_, BakeError>>()?;
    summary.rays = cast.into_inner();
    summary.resumed_chunks = resumed.into_inner();
    let core_seconds = started.elapsed().as_secs_f64() * rayon::current_num_threads() as f64;
    summary.mrays_s_core = summary.rays as f64 / core_seconds.max(1e-9) / 1e6;
    Ok(by_chunk.into_iter().flatten().collect())
}

fn written(
    emitter: &Emitter<'_>,
    files: &TileFiles<'_>,
    world_hash: u64,
    progress: &dyn Progress,
) -> Result<Vec<ChunkEntry>, BakeError> {
    let coords = emitter.chunk_coords();
    progress.begin(Stage::Tiles, coords.len() as u64);
    coords
        .par_iter()
        .map(|&coord| {
            let entry = files.put(&emitter.chunk(coord)?, world_hash)?;
            progress.advance(1);
            Ok(entry)
        })
        .collect()
}

fn manifest(scene: &Scene, world_hash: u64, options: &BakeOptions, chunks: Vec<ChunkEntry>) -> Manifest {
    Manifest {
        format_version: format::VERSION,
        world_hash,
        scene: options.scene_name.clone(),
        parameters: options.parameters,
        bounds: scene.bounds(),
        lights: options.lights.clone(),
        chunks,
    }
}

/// Removes tiles that the manifest does not name: those of the world that this one replaced. Readers that have
/// them mapped keep them until they let go.
fn remove_unlisted(world: &Path, manifest: &Manifest) -> Result<(), BakeError> {
    let listed: BTreeSet<PathBuf> = manifest.chunks.iter().map(|chunk| world.join(&chunk.file)).collect();
    // Folders of levels that this world no longer has are looked into too.
    let folders: BTreeSet<&Path> = listed.iter().filter_map(|path| path.parent()?.parent()).collect();
    for level in folders.into_iter().map(entries).collect::<Result<Vec<_>, _>>()?.concat() {
        for path in entries(&level)? {
            if path.extension().is_some_and(|extension| extension == "tile") && !listed.contains(&path) {
                std::fs::remove_file(&path).map_err(BakeError::io(&path))?;
            }
        }
    }
    Ok(())
}

/// What lies in `folder`; nothing if it is none.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, BakeError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    std::fs::read_dir(folder)
        .and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect())
        .map_err(BakeError::io(folder))
}

fn count(summary: &mut BakeSummary, manifest: &Manifest, started: Instant) {
    summary.levels = LevelSummary::of(manifest);
    if let Some(finest) = summary.levels.first() {
        (summary.patches, summary.nonzeros) = (finest.patches, finest.nonzeros);
        summary.chunks = finest.chunks;
        summary.tile_bytes_per_nonzero = finest.bytes as f64 / finest.nonzeros.max(1) as f64;
    }
    summary.world_bytes = summary.levels.iter().map(|level| level.bytes).sum();
    summary.receivers = manifest.chunks.iter().map(|c| u64::from(c.receiver_count)).sum();
    summary.receiver_nonzeros = manifest.chunks.iter().map(|c| c.receiver_nonzero_count).sum();
    let size = manifest.bounds.size().as_dvec3();
    summary.bytes_per_km2 = summary.world_bytes as f64 / (size.x * size.z).max(1e-9) * 1e6;
    summary.seconds = started.elapsed().as_secs_f64();
    let core_seconds = summary.seconds.max(1e-9) * rayon::current_num_threads() as f64;
    summary.mrays_s_core_whole = (summary.rays + summary.exposure_rays) as f64 / core_seconds / 1e6;
    summary.patches_s = summary.patches as f64 / summary.seconds.max(1e-9);
}
