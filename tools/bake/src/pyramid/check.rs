//! Whether a coarse level is what the finer one says: the energy check of `inspect verify` and of the bake's tests.
//!
//! Per coarse patch against its children, each sum weighted by area: area; reflectance and emission; sky by lobe,
//! absorbed, and what leads to patches. It reads chunks and knows nothing of how they were merged.

use earthshine_world::lineage::CoarsePlaces;
use earthshine_world::{Chunk, ChunkId, PatchId};
use std::collections::BTreeMap;

/// Relative difference that two roundings to the stored precision may leave.
pub const ENERGY_TOLERANCE: f64 = 2e-3;
/// Absolute difference of shares: steered rounding keeps a row's sum this close.
const SHARE_TOLERANCE: f64 = 5e-4;

/// What is compared, in the order of [`Sums`].
const NAMES: [&str; 15] = [
    "area",
    "reflected red",
    "reflected green",
    "reflected blue",
    "emitted red",
    "emitted green",
    "emitted blue",
    "sky +X",
    "sky -X",
    "sky +Y",
    "sky -Y",
    "sky +Z",
    "sky -Z",
    "absorbed",
    "seen of patches",
];

type Sums = [f64; 15];

/// A coarse patch that is not the merge of its children.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{patch:?}: {what} is {found:.6e}, its children add up to {expected:.6e}")]
pub struct EnergyFault {
    /// Which.
    pub patch: PatchId,
    /// Which sum, weighted by area.
    pub what: &'static str,
    /// Of the coarse patch.
    pub found: f64,
    /// Of its children.
    pub expected: f64,
}

/// Breaches at every patch of `chunks` that is not of level 0, and fine patches without a parent where the next
/// level exists. At most one a patch.
#[must_use]
pub fn check_energy(chunks: &BTreeMap<ChunkId, Chunk>) -> Vec<EnergyFault> {
    let levels: Vec<u8> = {
        let mut levels: Vec<u8> = chunks.keys().map(|id| id.level).collect();
        levels.dedup();
        levels
    };
    let mut faults = Vec::new();
    for &level in levels.iter().filter(|&&level| level > 0) {
        // Of parents that are missing, by a number that none has.
        let mut expected: BTreeMap<(ChunkId, u32), Sums> = BTreeMap::new();
        for chunk in chunks.values().filter(|chunk| chunk.id.level == level - 1) {
            let parent = chunks.get(&chunk.id.parent());
            let places = CoarsePlaces::new(parent.iter().flat_map(|parent| &parent.patches));
            for (local, patch) in chunk.patches.iter().enumerate() {
                let key = (chunk.id.parent(), places.parent(patch).unwrap_or(u32::MAX));
                let sums = expected.entry(key).or_insert([0.0; 15]);
                sums.iter_mut().zip(sums_of(chunk, local)).for_each(|(sum, own)| *sum += own);
            }
        }
        for chunk in chunks.values().filter(|chunk| chunk.id.level == level) {
            for local in 0..chunk.patches.len() {
                let expected = expected.remove(&(chunk.id, local as u32)).unwrap_or([0.0; 15]);
                let id = PatchId { chunk: chunk.id, local: local as u16 };
                faults.extend(difference(id, &sums_of(chunk, local), &expected));
            }
        }
        for ((chunk, _), sums) in expected {
            let patch = PatchId { chunk, local: u16::MAX };
            faults.push(EnergyFault {
                patch,
                what: "area of a patch that is missing",
                found: 0.0,
                expected: sums[0],
            });
        }
    }
    faults
}

fn difference(patch: PatchId, found: &Sums, expected: &Sums) -> Option<EnergyFault> {
    let area = expected[0];
    (0..NAMES.len()).find_map(|at| {
        let is_share = at >= 7;
        let allowed = ENERGY_TOLERANCE * found[at].abs().max(expected[at].abs())
            + if is_share { SHARE_TOLERANCE * area } else { 0.0 };
        // A sum that is not a number is a fault too.
        let fits = (found[at] - expected[at]).abs() <= allowed;
        let (what, found, expected) = (NAMES[at], found[at], expected[at]);
        (!fits).then_some(EnergyFault { patch, what, found, expected })
    })
}

fn sums_of(chunk: &Chunk, local: usize) -> Sums {
    let patch = &chunk.patches[local];
    let area = f64::from(patch.area);
    let [r, g, b] = patch.reflectance.to_array();
    let [er, eg, eb] = patch.emission.to_array();
    let sky = chunk.rows.sky_shares[local];
    let seen: f64 = chunk.rows.row(local).map(|(_, share)| f64::from(share)).sum();
    let absorbed = chunk.rows.absorbed_shares[local];
    let tail = [sky[0], sky[1], sky[2], sky[3], sky[4], sky[5], absorbed];
    let mut sums = [0.0; 15];
    sums[0] = area;
    for (sum, value) in sums[1..].iter_mut().zip([r, g, b, er, eg, eb].into_iter().chain(tail)) {
        *sum = area * f64::from(value);
    }
    sums[14] = area * seen;
    sums
}
