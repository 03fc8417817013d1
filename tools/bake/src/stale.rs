//! Why chunks were traced again: the report of an incremental bake.

use crate::progress::Stage;
use crate::work_folder::Stale;
use earthshine_tiles::{ChunkEntry, Manifest};
use std::collections::{BTreeMap, BTreeSet};

/// Why one stage of one chunk was done again.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct StaleStage {
    /// Chunk of level 0.
    pub chunk: [i32; 3],
    /// Lower-case name of the stage.
    pub stage: &'static str,
    /// In a sentence.
    pub why: String,
}

/// What an incremental bake did again, and what came of it.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct StaleReport {
    /// Chunks that were traced, in any stage.
    pub traced_chunks: u64,
    /// Tiles of all levels that are others than before; all of them in a first bake.
    pub changed_tiles: u64,
    /// Tiles of all levels that stayed.
    pub kept_tiles: u64,
    /// Chunks of level 0 whose tile changed, ascending; empty in a first bake.
    pub changed_chunks: Vec<[i32; 3]>,
    /// What was traced and why, ascending by chunk; empty in a first bake.
    pub stages: Vec<StaleStage>,
    #[serde(skip)]
    traced: BTreeMap<[i32; 3], Vec<(Stage, Stale)>>,
}

impl StaleReport {
    /// Notes that `stage` of `chunk` was traced because of `stale`.
    pub(crate) fn note(&mut self, chunk: [i32; 3], stage: Stage, stale: Option<Stale>) {
        if let Some(stale) = stale {
            self.traced.entry(chunk).or_default().push((stage, stale));
            self.traced_chunks = self.traced.len() as u64;
        }
    }

    /// Says what changed since the world's manifest was `old`.
    pub(crate) fn compare_tiles(&mut self, old: &Manifest, new: &Manifest) {
        let files = |manifest: &Manifest| -> BTreeSet<String> {
            manifest.chunks.iter().map(|chunk| chunk.file.clone()).collect()
        };
        let (before, after) = (files(old), files(new));
        self.kept_tiles = before.intersection(&after).count() as u64;
        self.changed_tiles = before.symmetric_difference(&after).count() as u64;
        let has_changed = |chunk: &&ChunkEntry| !before.contains(&chunk.file) || !after.contains(&chunk.file);
        let finest = old.chunks.iter().chain(&new.chunks).filter(|chunk| chunk.level == 0);
        let changed: BTreeSet<[i32; 3]> = finest.filter(has_changed).map(|chunk| chunk.coord).collect();
        self.changed_chunks = changed.into_iter().collect();
        for (chunk, stages) in &self.traced {
            for (stage, stale) in stages {
                let (chunk, stage) = (*chunk, stage.name());
                self.stages.push(StaleStage { chunk, stage, why: sentence(*stale) });
            }
        }
    }
}

fn sentence(stale: Stale) -> String {
    match stale {
        Stale::Absent => "nothing was kept of it".to_owned(),
        Stale::Parameters => "lamps, the share of emitters, or the extent of the scene changed".to_owned(),
        Stale::Own => "its own surfaces changed".to_owned(),
        Stale::Part { renewed, of, at: [x, y, z] } => {
            format!("what {renewed} of {of} can see changed around {x}, {y}, {z} m")
        }
        Stale::Seen { changed, of, at: [x, y, z] } => {
            format!("its rays cross {of} cells, of which {changed} changed, one around {x}, {y}, {z} m")
        }
    }
}
