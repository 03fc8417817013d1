//! `earthshine inspect`: what is in a world, a chunk or a row; and whether it is sound.

use crate::output::out;
mod explain;
mod verify;

use clap::{Args, Subcommand};
use earthshine_bake::LevelSummary;
use earthshine_bake::work_folder::WorkFolder;
use earthshine_tiles::{DirStore, Manifest, TileError};
use earthshine_world::ChunkId;
use glam::IVec3;
use std::path::{Path, PathBuf};

/// Arguments of `earthshine inspect`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine inspect town.world
  earthshine inspect town.world chunk 0,0,-1
  earthshine inspect town.world row 0,0,-1 17
  earthshine inspect town.world air 3,1,-2
  earthshine inspect town.world verify")]
pub(crate) struct InspectArguments {
    /// World folder.
    world: PathBuf,
    #[command(subcommand)]
    what: Option<What>,
    /// Print JSON.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Subcommand)]
enum What {
    /// The whole world in a few lines (the default).
    Summary,
    /// One chunk in words.
    Chunk {
        /// x,y,z in chunk edges of its level.
        #[arg(value_parser = coordinates, allow_hyphen_values = true)]
        chunk: IVec3,
        /// Level of the pyramid; 0 is the finest.
        #[arg(long, default_value_t = 0)]
        level: u8,
    },
    /// One row in words: where the light of a patch comes from.
    Row {
        /// x,y,z in chunk edges of its level.
        #[arg(value_parser = coordinates, allow_hyphen_values = true)]
        chunk: IVec3,
        /// Patch of that chunk.
        patch: u16,
        /// Level of the pyramid; 0 is the finest.
        #[arg(long, default_value_t = 0)]
        level: u8,
    },
    /// The receivers of one voxel: where the light in its air comes from.
    Air {
        /// x,y,z in voxels.
        #[arg(value_parser = coordinates, allow_hyphen_values = true)]
        voxel: IVec3,
    },
    /// Every checksum, every row invariant, reciprocity across chunks, energy across levels.
    Verify,
}

fn coordinates(text: &str) -> Result<IVec3, String> {
    let parts: Vec<i32> = text
        .split(',')
        .map(|part| part.trim().parse::<i32>().map_err(|error| format!("{part:?}: {error}")))
        .collect::<Result<_, _>>()?;
    <[i32; 3]>::try_from(parts)
        .map(IVec3::from)
        .map_err(|parts| format!("{} numbers, not x,y,z", parts.len()))
}

/// The world, or what became of it: a bake that was interrupted leaves none yet.
fn open(world: &Path) -> anyhow::Result<DirStore> {
    DirStore::open(world).map_err(|error| {
        let finished = WorkFolder::finished(world);
        if finished.is_empty() || !matches!(error, TileError::NotAWorld { .. }) {
            return error.into();
        }
        let stages: Vec<String> =
            finished.iter().map(|(stage, chunks)| format!("{stage} of {chunks} chunks")).collect();
        anyhow::Error::new(error).context(format!(
            "{}: its bake was interrupted or is under way, with {} done; the same `earthshine bake` goes on there",
            world.display(),
            stages.join(", ")
        ))
    })
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &InspectArguments) -> anyhow::Result<()> {
    let store = open(&arguments.world)?;
    match arguments.what.as_ref().unwrap_or(&What::Summary) {
        What::Summary => summary(store.manifest(), arguments.json),
        What::Chunk { chunk, level } => explain::chunk(&store, ChunkId::new(*level, *chunk), arguments.json),
        What::Row { chunk, patch, level } => {
            explain::row(&store, ChunkId::new(*level, *chunk), *patch, arguments.json)
        }
        What::Air { voxel } => explain::air(&store, *voxel, arguments.json),
        What::Verify => verify::run(&store, arguments.json),
    }
}

fn summary(manifest: &Manifest, json: bool) -> anyhow::Result<()> {
    let levels = LevelSummary::of(manifest);
    let LevelSummary { patches, nonzeros, chunks, bytes: finest_bytes, .. } =
        levels.first().copied().unwrap_or_default();
    let bytes: u64 = levels.iter().map(|level| level.bytes).sum();
    let receivers: u64 = manifest.chunks.iter().map(|chunk| u64::from(chunk.receiver_count)).sum();
    let size = manifest.bounds.size();
    let square_kilometres = f64::from(size.x) * f64::from(size.z) / 1e6;
    let per_km2 = bytes as f64 / square_kilometres.max(1e-12);
    let per_nonzero = finest_bytes as f64 / nonzeros.max(1) as f64;
    if json {
        let summary = serde_json::json!({
            "scene": manifest.scene, "chunks": chunks, "patches": patches, "nonzeros": nonzeros, "receivers": receivers,
            "world_bytes": bytes, "tile_bytes_per_nonzero": per_nonzero, "bytes_per_km2": per_km2,
            "levels": levels, "parameters": manifest.parameters, "bounds": manifest.bounds, "lights": manifest.lights.lights.len(),
        });
        out!("{summary}");
        return Ok(());
    }
    let grid = manifest.parameters.grid;
    out!("scene       {}", manifest.scene);
    out!("size        {:.1} x {:.1} x {:.1} m, from {:.1}", size.x, size.y, size.z, manifest.bounds.min);
    out!("grid        voxels of {} m, chunks of {} m", grid.voxel_edge_m, grid.chunk_edge_m());
    out!("chunks      {chunks}");
    out!("patches     {patches}");
    out!("receivers   {receivers}");
    out!("non-zeros   {nonzeros} ({:.0} a row)", nonzeros as f64 / patches.max(1) as f64);
    out!(
        "disk        {:.2} MB, {per_nonzero:.2} bytes a non-zero, {:.1} MB/km2",
        bytes as f64 / 1e6,
        per_km2 / 1e6
    );
    for level in levels.iter().skip(1) {
        out!(
            "level {:<5} voxels of {} m: {} chunks, {} patches, {} non-zeros, {:.2} MB",
            level.level,
            level.voxel_edge_m,
            level.chunks,
            level.patches,
            level.nonzeros,
            level.bytes as f64 / 1e6
        );
    }
    out!(
        "lights      {} and a sky of {:.0} cd/m2 upwards",
        manifest.lights.lights.len(),
        manifest.lights.sky.lobes[2]
    );
    out!("rays        {} a patch, seed {}", manifest.parameters.rays_per_patch, manifest.parameters.seed);
    Ok(())
}
