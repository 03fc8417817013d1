//! `inspect verify`: every checksum, every row, reciprocity across chunks, energy across levels.

use crate::exit_code::FaultsFound;
use crate::output::out;
use crate::progress_bars;
use earthshine_bake::pyramid::check::check_energy;
use earthshine_tiles::{DirStore, TileStore, check_receivers, check_rows};
use earthshine_world::{Chunk, ChunkId, PatchId};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Pairs may differ by this share of the larger exchange: two f16 roundings.
const RECIPROCITY_TOLERANCE: f32 = 4e-3;
/// Faults that are printed one by one.
const LISTED_MAX: usize = 20;

/// Checks the whole world and fails when anything is wrong.
pub(crate) fn run(store: &DirStore, json: bool) -> anyhow::Result<()> {
    let ids: Vec<ChunkId> = store.manifest().index().chunks.iter().map(|chunk| chunk.id).collect();
    let bar = progress_bars::counted("verify", "tiles", ids.len() as u64, json);
    let read: Vec<Result<Chunk, String>> = ids
        .par_iter()
        .map(|&id| {
            let chunk = store.load(id).map_err(|error| error.to_string());
            bar.inc(1);
            chunk
        })
        .collect();
    bar.finish_and_clear();
    let mut faults = Vec::new();
    let mut chunks = BTreeMap::new();
    for result in read {
        match result {
            Ok(chunk) => drop(chunks.insert(chunk.id, chunk)),
            Err(fault) => faults.push(fault),
        }
    }
    for chunk in chunks.values() {
        faults.extend(check_rows(chunk).into_iter().map(|fault| format!("chunk {}: {fault}", chunk.id)));
        let of_receivers = check_receivers(chunk).into_iter();
        faults.extend(of_receivers.map(|fault| format!("chunk {}: receivers: {fault}", chunk.id)));
    }
    let not_mutual: Vec<String> =
        chunks.par_iter().flat_map_iter(|(_, chunk)| one_sided(chunk, &chunks)).collect();
    faults.extend(not_mutual);
    // A chunk that could not be read is a fault already; its parents' sums would only repeat it.
    if chunks.len() == ids.len() {
        faults.extend(check_energy(&chunks).into_iter().map(|fault| fault.to_string()));
    }
    report(&faults, chunks.len(), json)
}

fn report(faults: &[String], chunks: usize, json: bool) -> anyhow::Result<()> {
    if json {
        out!(
            "{}",
            serde_json::json!({"chunks": chunks, "faults": faults.len(), "first": faults.iter().take(LISTED_MAX).collect::<Vec<_>>()})
        );
    } else {
        for fault in faults.iter().take(LISTED_MAX) {
            out!("{fault}");
        }
        out!("{chunks} chunks, {} faults", faults.len());
    }
    if faults.is_empty() { Ok(()) } else { Err(FaultsFound { count: faults.len() }.into()) }
}

/// Rows of `chunk` whose exchange with a later patch differs from what that patch says.
fn one_sided(chunk: &Chunk, chunks: &BTreeMap<ChunkId, Chunk>) -> Vec<String> {
    let mut faults = Vec::new();
    for row in 0..chunk.rows.row_count() {
        let own = PatchId { chunk: chunk.id, local: row as u16 };
        for (column, share) in chunk.rows.row(row) {
            let other = chunk.rows.patch_id(column);
            let Some(other_chunk) = chunks.get(&other.chunk).filter(|_| other > own) else { continue };
            let there = chunk.patches[row].area * share;
            let back = share_of(other_chunk, other, own)
                .map_or(0.0, |share| other_chunk.patches[usize::from(other.local)].area * share);
            let allowed = RECIPROCITY_TOLERANCE * there.max(back) + 1e-7 * chunk.patches[row].area;
            if (there - back).abs() > allowed {
                faults.push(format!(
                    "{own:?} and {other:?} exchange {there:e} and {back:e} m2: not reciprocal"
                ));
            }
        }
    }
    faults
}

/// The share that `row`'s patch has for `target`, by bisection.
fn share_of(chunk: &Chunk, row: PatchId, target: PatchId) -> Option<f32> {
    let segment = chunk.rows.segments.binary_search(&target.chunk).ok()? as u16;
    let row = usize::from(row.local);
    let range = chunk.rows.row_starts[row] as usize..chunk.rows.row_starts[row + 1] as usize;
    let wanted = earthshine_world::Column { segment, local: target.local };
    let place = chunk.rows.columns[range.clone()].binary_search(&wanted).ok()?;
    Some(chunk.rows.shares[range.start + place])
}
