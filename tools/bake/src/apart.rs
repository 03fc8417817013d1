//! What emits in a voxel and direction, apart from what does not.
//!
//! A flame before a wall has a fiftieth of the wall's area in their voxel. One patch of both would glow all over with a
//! fiftieth of the flame's light: the wall behind it would light the room where the flame does not, what the flame lights
//! nearest would get half of it, and how much of the light is kept would hang on how the wall is seen. So the flame is a patch
//! of its own. It sends light; what arrives at the place is told by the other, which is what is seen there.
//!
//! Where nothing that does not emit is open (a ceiling hidden behind its lamp), or only a sliver that would get no patch, there
//! is nothing to tell apart.

use crate::exposure::Exposure;
use crate::patches::LAYER_ORDINALS;
use crate::sample::SurfaceSample;
use earthshine_world::{Direction, Rgb};

/// What the ordinal of a direction grows by for the patch of what emits there, where the rest has one of its own.
pub(crate) const EMITTER_ORDINALS: u8 = 6;

/// Chunks of more voxels along an edge have too few numbers for patches of emitters beside those of the rest.
pub(crate) const CHUNK_EDGE_MAX: u32 = 17;

/// What becomes of what emits beside what does not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Emitters {
    /// Patches of their own.
    Apart,
    /// Nothing: light that arrives at a flame says nothing of the wall behind it.
    LeftOut,
    /// They share in the patch.
    Mixed,
}

/// Chunk, direction, Morton code of the voxel, and what tells patches of one voxel and direction apart.
pub(crate) type SortKey = ([i32; 3], Direction, u32, u8);

/// One sample's share in one patch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Contribution {
    pub(crate) key: SortKey,
    pub(crate) sample: u32,
    pub(crate) weight: f32,
}

/// Whether a patch with that key is of what emits beside what does not.
pub(crate) fn is_apart(key: u64) -> bool {
    is_apart_ordinal(key as u8)
}

/// The same of its ordinal.
pub(crate) fn is_apart_ordinal(ordinal: u8) -> bool {
    ordinal % LAYER_ORDINALS >= EMITTER_ORDINALS
}

/// Gives keys of their own to `contributions`, sorted by key, of what emits beside what does not, or drops them. Patches below
/// `area_min` that do not emit are left out, so a rest of less is none.
pub(crate) fn part(
    contributions: &mut Vec<Contribution>,
    samples: &[SurfaceSample],
    emitters: Emitters,
    area_min: f32,
) {
    if emitters == Emitters::Mixed || !samples.iter().any(emits) {
        return;
    }
    let sample = |of: &Contribution| &samples[of.sample as usize];
    let place =
        |&Contribution { key: (chunk, direction, code, _), .. }: &Contribution| (chunk, direction, code);
    let is_rest = |of: &&Contribution| {
        let of = sample(of);
        matches!(of.exposure, Exposure::Open(_)) && !emits(of)
    };
    // Whether the rest of one layer gets a patch: added up as that patch's area is.
    let is_kept = |run: &[Contribution]| {
        let area: f64 = run.iter().filter(is_rest).map(|of| f64::from(of.weight)).sum();
        area as f32 >= area_min
    };
    for place in contributions.chunk_by_mut(|a, b| place(a) == place(b)) {
        let is_shared = place.iter().any(|of| emits(sample(of)));
        if is_shared && place.chunk_by(|a, b| a.key == b.key).any(is_kept) {
            place.iter_mut().filter(|of| emits(sample(of))).for_each(|of| of.key.3 += EMITTER_ORDINALS);
            place.sort_by_key(|of| (of.key, of.sample));
        }
    }
    if emitters == Emitters::LeftOut {
        contributions.retain(|of| !is_apart_ordinal(of.key.3));
    }
}

fn emits(sample: &SurfaceSample) -> bool {
    sample.emission != Rgb::ZERO
}
