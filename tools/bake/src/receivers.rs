//! Receivers in empty air, for objects that move.
//!
//! Voxels near patches get a row for each direction on which they have no patch. All rows of a voxel share one set of
//! rays over the sphere, cast from one place in its open part: a hit counts for each direction that its ray faces, by
//! the cosine. Nothing reflects there, so no row is balanced against another; a row sums to one as it is traced.
//!
//! Air inside of something is left out: most of its rays end on sides without patches. Long rows are thinned
//! (`thin`): a far patch that one ray found stands for its neighbours just as well.

use crate::estimator::emits;
use crate::receiver_places::{Candidate, Voxel, candidate};
use crate::rows::{RawRow, RowCaster, patch_key};
use earthshine_trace::hemisphere::spread_pair;
use earthshine_world::random::{Purpose, hash, unit_f32, unit_pair};
use earthshine_world::{Direction, ReceiverPlace, Vec3, VoxelCoord};

/// Air from which more than this share of the rays end on sides without patches is inside of something.
const ABSORBED_SHARE_MAX: f32 = 0.5;
/// Rays after which a clear case of that is decided, and what is clear.
pub(crate) const FIRST_RAYS: u32 = 64;
const CLEARLY_ABSORBED: f32 = 0.8;

/// One receiver and its row.
#[derive(Debug, Clone, PartialEq)]
pub struct BakeReceiver {
    /// Where.
    pub place: ReceiverPlace,
    /// Its row; columns are indices into the whole [`PatchSet`](crate::patches::PatchSet).
    pub row: RawRow,
}

/// Traces the receivers of voxels.
#[derive(Debug, Clone, Copy)]
pub struct ReceiverBake<'a> {
    /// Casts the rays, against the patches that columns are; may begin on the chunk's.
    pub caster: RowCaster<'a>,
}

impl ReceiverBake<'_> {
    /// Where the rays of `voxel` begin.
    pub(crate) fn candidate(&self, voxel: &Voxel) -> Candidate {
        candidate(&self.caster, voxel)
    }

    /// Six rows; empty ones where there is a patch, and everywhere if the voxel is inside of something. How many rays
    /// that took.
    pub(crate) fn rows(&self, candidate: &Candidate) -> ([RawRow; 6], u64) {
        let mut rows: [RawRow; 6] = Default::default();
        let (mut weights, mut absorbed, mut first_absorbed) = ([0.0f32; 6], 0.0f32, 0.0);
        for (index, direction) in (0..).zip(self.directions(candidate.voxel)) {
            let end = self.caster.end(candidate.place, direction);
            absorbed += end.absorbed_share();
            for axis in 0..3 {
                let facing = Direction::of_component(axis, direction[axis]).index();
                if candidate.taken >> facing & 1 == 0 {
                    let weight = direction[axis].abs();
                    weights[facing] += weight;
                    rows[facing].add(&end, direction, weight);
                }
            }
            if index + 1 == FIRST_RAYS {
                first_absorbed = absorbed;
                if is_clearly_inside(absorbed) {
                    break;
                }
            }
        }
        match self.inside(first_absorbed, absorbed) {
            Some(rays) => (Default::default(), rays),
            None => {
                let rays = u64::from(self.caster.parameters.receiver_rays);
                (self.finished(rows, weights, candidate.voxel), rays)
            }
        }
    }

    /// The directions of the rays of `voxel`, in order.
    pub(crate) fn directions(&self, voxel: VoxelCoord) -> impl Iterator<Item = Vec3> + use<> {
        let parameters = self.caster.parameters;
        let shift = unit_pair(hash(parameters.seed, Purpose::ReceiverRay, patch_key(voxel, 0), 0));
        (0..parameters.receiver_rays).map(move |index| sphere_direction(index, shift))
    }

    /// The rays that it takes to tell air that is inside of something, of which the first and all so far have so much
    /// absorbed; `None` outside.
    pub(crate) fn inside(&self, first_absorbed: f32, absorbed: f32) -> Option<u64> {
        let rays = self.caster.parameters.receiver_rays;
        if is_clearly_inside(first_absorbed) {
            return Some(u64::from(FIRST_RAYS));
        }
        (absorbed > ABSORBED_SHARE_MAX * rays as f32).then_some(u64::from(rays))
    }

    /// `rows` of `voxel`, whose rays weigh `weights`, as shares, and thinned.
    pub(crate) fn finished(
        &self,
        mut rows: [RawRow; 6],
        weights: [f32; 6],
        voxel: VoxelCoord,
    ) -> [RawRow; 6] {
        let key = patch_key(voxel, 0);
        for (direction, row) in rows.iter_mut().enumerate() {
            row.merge();
            row.scale(1.0 / weights[direction].max(f32::MIN_POSITIVE));
            let draw =
                unit_f32(hash(self.caster.parameters.seed, Purpose::ReceiverRay, key, 1 + direction as u64));
            let glows = |patch: u32| emits(self.caster.set, patch as usize);
            thin(&mut row.entries, self.caster.parameters.receiver_columns as usize, draw, glows);
        }
        rows
    }
}

fn is_clearly_inside(first_absorbed: f32) -> bool {
    first_absorbed > CLEARLY_ABSORBED * FIRST_RAYS as f32
}

/// Direction `index` of a set that covers the sphere evenly.
fn sphere_direction(index: u32, (shift_u, shift_v): (f32, f32)) -> Vec3 {
    let (u, v) = spread_pair(index, shift_u, shift_v);
    let z = 1.0 - 2.0 * u;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (v * std::f32::consts::TAU).sin_cos();
    Vec3::new(radius * cos, radius * sin, z).normalize_or(Vec3::Z)
}

/// The rows that say anything, with their places.
pub(crate) fn placed(voxels: &[Voxel], rows: Vec<RawRow>) -> Vec<BakeReceiver> {
    let places = voxels
        .iter()
        .flat_map(|voxel| Direction::ALL.map(|direction| ReceiverPlace::in_air(voxel.at, direction)));
    let says = |row: &RawRow| !row.entries.is_empty() || row.sky.iter().any(|&share| share > 0.0);
    places.zip(rows).filter(|(_, row)| says(row)).map(|(place, row)| BakeReceiver { place, row }).collect()
}

/// Leaves at most about `columns_max` of the ascending `entries`, so that the shares of what glows, and those of all else,
/// still add up to the same each: a lamp outshines what it lights, and its share must not hang on who is drawn.
///
/// What glows has half of the columns, or what others leave. Shares above a threshold stay as they are. Of the others, evenly
/// spread along the order of patches (which is one of space), some are drawn with chances as their shares, and each gets the
/// threshold: systematic sampling, so that no light is expected to be lost or gained.
pub(crate) fn thin(
    entries: &mut Vec<(u32, f32)>,
    columns_max: usize,
    draw: f32,
    glows: impl Fn(u32) -> bool,
) {
    if entries.len() <= columns_max {
        return;
    }
    let of = |is_glowing: bool| -> Vec<f32> {
        entries.iter().filter(|entry| glows(entry.0) == is_glowing).map(|entry| entry.1).collect()
    };
    let (mut others, mut glowing) = (of(false), of(true));
    let room = glowing.len().min((columns_max / 2).max(columns_max.saturating_sub(others.len())));
    let thresholds = [threshold(&mut others, columns_max - room), threshold(&mut glowing, room)];
    let mut due = [draw; 2];
    entries.retain_mut(|(patch, share)| {
        let group = usize::from(glows(*patch));
        let (threshold, due) = (thresholds[group], &mut due[group]);
        if *share >= threshold {
            return true;
        }
        *due -= *share / threshold;
        if *due > 0.0 {
            return false;
        }
        *due += 1.0;
        *share = threshold;
        true
    });
}

/// The share at which `room` columns are left: those at or above it, and what is below it in units of it. 0 where all have room.
fn threshold(shares: &mut [f32], room: usize) -> f32 {
    if shares.len() <= room {
        return 0.0;
    }
    shares.sort_unstable_by(|a, b| b.total_cmp(a));
    let mut rest: f64 = shares.iter().map(|&share| f64::from(share)).sum();
    for (larger, &share) in shares.iter().enumerate().take(room) {
        let threshold = rest / (room - larger) as f64;
        if f64::from(share) <= threshold {
            return threshold as f32;
        }
        rest -= f64::from(share);
    }
    f32::MIN_POSITIVE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_cover_the_sphere_evenly() {
        let mut sums = [0.0f32; 6];
        for index in 0..512 {
            let direction = sphere_direction(index, (0.3, 0.8));
            assert!((direction.length() - 1.0).abs() < 1e-5);
            for axis in 0..3 {
                sums[Direction::of_component(axis, direction[axis]).index()] += direction[axis].abs();
            }
        }
        // A half sphere's mean cosine is a half.
        assert!(sums.iter().all(|sum| (sum / 128.0 - 1.0).abs() < 0.01), "{sums:?}");
    }

    #[test]
    fn thinned_rows_keep_their_sum_their_large_shares_and_what_glows() {
        let row: Vec<(u32, f32)> = (0..400u32).map(|i| (i, if i == 7 { 0.3 } else { 0.7 / 399.0 })).collect();
        let mut sums = vec![0.0f64; 400];
        let turns = 997;
        for turn in 0..turns {
            let mut thinned = row.clone();
            thin(&mut thinned, 32, (turn as f32 + 0.5) / turns as f32, |patch| patch == 100);
            assert!((30..=33).contains(&thinned.len()), "{}", thinned.len());
            assert!(thinned.contains(&(7, 0.3)) && thinned.contains(&(100, 0.7 / 399.0)));
            let sum: f32 = thinned.iter().map(|entry| entry.1).sum();
            assert!((sum - 1.0).abs() < 0.03, "{sum}");
            thinned.iter().for_each(|&(patch, share)| sums[patch as usize] += f64::from(share));
        }
        for (patch, share) in row {
            let mean = sums[patch as usize] / f64::from(turns);
            assert!((mean / f64::from(share) - 1.0).abs() < 0.05, "{patch}: {mean} for {share}");
        }
    }

    /// Goal: a lamp of many patches is as bright in every row. Method: forty of its patches in a row of two hundred, whose others
    /// take any share between none and all; its share of the thinned row, by many draws.
    #[test]
    fn what_glows_keeps_its_share_whoever_is_drawn() {
        let glows = |patch: u32| patch.is_multiple_of(5);
        let row: Vec<(u32, f32)> = (0..200u32).map(|i| (i, (1.0 + (i % 7) as f32) / 800.0)).collect();
        let of_lamp = |row: &[(u32, f32)]| -> f32 { row.iter().filter(|e| glows(e.0)).map(|e| e.1).sum() };
        for columns in [4, 24, 79, 120] {
            for turn in 0..50 {
                let mut thinned = row.clone();
                thin(&mut thinned, columns, (turn as f32 + 0.5) / 50.0, glows);
                assert!(thinned.len() <= columns + 2, "{} of {columns}", thinned.len());
                let largest = thinned.iter().filter(|e| glows(e.0)).map(|e| e.1).fold(0.0, f32::max);
                let (is, was) = (of_lamp(&thinned), of_lamp(&row));
                assert!((is - was).abs() <= 1e-3 * was, "{is} for {was} of {columns}, largest {largest}");
            }
        }
    }

    #[test]
    fn short_rows_stay() {
        let mut row = vec![(1, 0.5), (2, 0.25)];
        thin(&mut row, 2, 0.5, |_| false);
        assert_eq!(row, [(1, 0.5), (2, 0.25)]);
    }
}
