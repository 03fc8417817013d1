//! Progressive shooting: what changed and has not been told yet is told, largest first.
//!
//! ```text
//! I_i = g_i + sum_j F_ij (B_j - r_j)          holds at any time: r is what B has not sent yet, signed
//! change of E by dE          r += dE
//! change of g by dg          I += dg, r += rho dg
//! shot of j                  dI_i = F_ij r_j, I += dI, r += rho dI, r_j = 0;  F_ij = A_j F_ji / A_i: row j is column j
//! patch p leaves             -(B_p - r_p) is shot;      patch p enters: I_p = sum_j F_pj (B_j - r_j), r_p = rho I_p
//! ```
//!
//! So light may go out as well as on, patches come and go, and nothing is approximated: with `r = 0` the light is the
//! matrix'. A frame shoots in a few rounds, so that light bounces within a frame. Who shoots is found by a histogram of
//! `|r| A` over its exponent and three bits, which a shader can repeat; within the last class it goes by slot.
//! Some rows are gathered afresh every frame, which takes away what rounding has left.

use super::flux::{Flux, Shooter};
use super::links::LinkRows;
use super::{Light, add_scaled, step_gather};
use rayon::prelude::*;

/// Rounds a frame, of equal budgets.
pub const ROUNDS: u32 = 4;
/// A patch shoots if `|r| A` exceeds this share of the mean power of all patches.
pub const UNSHOT_TOLERANCE: f32 = 1e-5;
/// Frames after the last change at which whatever is left stays unshot: from then on light is constant to the bit.
pub const SETTLE_FRAMES: u32 = 240;
/// Of a frame's budget: rows that are gathered afresh.
pub const REFRESH_SHARE: u64 = 32;
/// A fresh row that differs by less than this share of its light is left alone: that is rounding of the gather itself.
pub const REFRESH_TOLERANCE: f32 = 4e-6;
/// Patches a task takes.
const PATCHES_A_TASK: usize = 4096;
/// Classes of importance: sign, exponent and three bits of a positive `f32`.
pub const CLASSES: usize = 1 << 11;
/// What the remembered scale of light keeps a frame, so that light going out does not make everything important.
pub const SCALE_KEPT: f32 = 0.9;

/// What a frame shot.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ShotStats {
    /// Patches that shot, in all rounds.
    pub shooters: u32,
    /// Form factors that they shot over.
    pub links: u64,
    /// `sum A |r|` over `sum A B` after it: what light has not been told yet.
    pub unshot_share: f32,
}

/// What of each patch's exitance has not been sent, and the light on the way.
#[derive(Debug, Clone)]
pub struct Unshot {
    /// `r`, lm/m2.
    pub exitance: Vec<Light>,
    /// Flux that has arrived in this round.
    flux: Flux,
    /// Who shoots in this round.
    shooters: Vec<Shooter>,
    /// Importance of each patch in this round, 0 for those that need not shoot.
    importance: Vec<f32>,
    classes: Vec<u64>,
    /// Mean power of patches, remembered for a while.
    scale: f32,
    refresh_cursor: usize,
    quiet_frames: u32,
    /// Whether nothing that matters is left to shoot.
    pub is_settled: bool,
}

impl Unshot {
    /// Nothing on the way.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self {
            exitance: vec![[0.0; 4]; capacity],
            flux: Flux::new(capacity),
            shooters: Vec::new(),
            importance: vec![0.0; capacity],
            classes: vec![0; CLASSES],
            scale: 0.0,
            refresh_cursor: 0,
            quiet_frames: 0,
            is_settled: false,
        }
    }

    /// Something has changed.
    pub fn wake(&mut self) {
        self.is_settled = false;
        self.quiet_frames = 0;
    }

    /// The sources of a patch change.
    pub fn change(&mut self, reflectance: Light, slot: usize, exitance: Light, outside: Light) {
        for channel in 0..3 {
            self.exitance[slot][channel] += exitance[channel] + reflectance[channel] * outside[channel];
        }
        self.wake();
    }

    /// The patch in `slot` takes back what it has sent, `sent = B - r`; call it before its links are gone.
    pub fn leave(&mut self, links: &LinkRows, slot: usize, sent: &Light) {
        let flux = sent.map(|sent| -sent * links.area(slot));
        for link in links.row(slot) {
            add_scaled(&mut self.flux.arrived()[link.slot as usize], link.share, &flux);
        }
        self.exitance[slot] = [0.0; 4];
        self.flux.arrived()[slot] = [0.0; 4];
        self.wake();
    }

    /// Shoots for a frame. `direct` is `E`; `irradiance` is advanced.
    pub fn step(
        &mut self,
        links: &LinkRows,
        direct: &[Light],
        outside: &[Light],
        budget_links: u64,
        irradiance: &mut [Light],
    ) -> ShotStats {
        let mut stats = ShotStats::default();
        for _ in 0..ROUNDS {
            self.fold(links, irradiance);
            if !self.shoot(links, budget_links / u64::from(ROUNDS), &mut stats) {
                break;
            }
        }
        self.fold(links, irradiance);
        self.refresh(links, direct, outside, budget_links / REFRESH_SHARE, irradiance);
        let (power, unshot) = self.power(links, direct, irradiance);
        stats.unshot_share = if power > 0.0 { (unshot / power) as f32 } else { 0.0 };
        self.scale = (SCALE_KEPT * self.scale).max((power / links.taken_count().max(1) as f64) as f32);
        self.quiet_frames = self.quiet_frames.saturating_add(1);
        self.is_settled = stats.shooters == 0 || self.quiet_frames >= SETTLE_FRAMES;
        stats
    }

    /// Brings arrived flux into light and unshot exitance, and finds who matters.
    fn fold(&mut self, links: &LinkRows, irradiance: &mut [Light]) {
        let least = UNSHOT_TOLERANCE * self.scale;
        let tasks = irradiance
            .par_chunks_mut(PATCHES_A_TASK)
            .zip(self.exitance.par_chunks_mut(PATCHES_A_TASK))
            .zip(self.flux.arrived().par_chunks_mut(PATCHES_A_TASK))
            .zip(self.importance.par_chunks_mut(PATCHES_A_TASK))
            .enumerate();
        let classes = tasks.map(|(task, (((irradiance, unshot), arrived), importance))| {
            let mut classes = vec![0u64; CLASSES];
            for (at, importance) in importance.iter_mut().enumerate() {
                let slot = task * PATCHES_A_TASK + at;
                let (light, unshot) = (&mut irradiance[at], &mut unshot[at]);
                fold_patch(links, slot, std::mem::take(&mut arrived[at]), light, unshot);
                let most = unshot[0].abs().max(unshot[1].abs()).max(unshot[2].abs()) * links.area(slot);
                *importance = if most > least { most } else { 0.0 };
                if *importance > 0.0 {
                    classes[class_of(most)] += links.row(slot).len().max(1) as u64;
                }
            }
            classes
        });
        // Counts: their sums are the same in any order.
        let add = |mut sums: Vec<u64>, terms: Vec<u64>| {
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
            sums
        };
        self.classes = classes.reduce_with(add).unwrap_or_else(|| vec![0; CLASSES]);
    }

    /// The most important patches shoot until their links exceed `budget`. Returns whether any did.
    fn shoot(&mut self, links: &LinkRows, budget: u64, stats: &mut ShotStats) -> bool {
        let (mut last, mut above) = (CLASSES, 0u64);
        while last > 0 && above < budget.max(1) {
            last -= 1;
            above += self.classes[last];
        }
        if above == 0 {
            return false;
        }
        // What all classes above the last take is theirs; the last shares what remains by slot.
        let mut rest = budget.max(1).saturating_sub(above - self.classes[last]);
        let before = stats.links;
        self.shooters.clear();
        for slot in 0..links.capacity() {
            let importance = self.importance[slot];
            if importance == 0.0 || class_of(importance) < last {
                continue;
            }
            let count = links.row(slot).len().max(1) as u64;
            if class_of(importance) == last {
                if rest == 0 {
                    continue;
                }
                rest = rest.saturating_sub(count);
            }
            let area = links.area(slot);
            let flux = std::mem::take(&mut self.exitance[slot]).map(|unshot| unshot * area);
            self.shooters.push((slot as u32, flux));
            stats.shooters += 1;
            stats.links += count;
        }
        self.flux.send(links, &self.shooters, stats.links - before);
        true
    }

    /// Gathers a few rows afresh, from what has been sent.
    fn refresh(
        &mut self,
        links: &LinkRows,
        direct: &[Light],
        outside: &[Light],
        mut budget: u64,
        irradiance: &mut [Light],
    ) {
        for _ in 0..links.capacity() {
            let slot = self.refresh_cursor;
            self.refresh_cursor = (slot + 1) % links.capacity();
            if !links.is_taken(slot) {
                continue;
            }
            let mut fresh = outside[slot];
            for link in links.row(slot) {
                let other = link.slot as usize;
                let sent = sent(links, other, &direct[other], &irradiance[other], &self.exitance[other]);
                add_scaled(&mut fresh, link.share, &sent);
            }
            let reflectance = super::light(links.reflectance(slot));
            for channel in 0..3 {
                let gap = fresh[channel] - irradiance[slot][channel];
                if gap.abs() > REFRESH_TOLERANCE * fresh[channel].abs() {
                    irradiance[slot][channel] += gap;
                    self.exitance[slot][channel] += reflectance[channel] * gap;
                }
            }
            budget = budget.saturating_sub(links.row(slot).len().max(1) as u64);
            if budget == 0 {
                return;
            }
        }
    }

    /// `sum A B` and `sum A |r|`, largest channels, lm.
    fn power(&self, links: &LinkRows, direct: &[Light], irradiance: &[Light]) -> (f64, f64) {
        let of_task = |(task, exitance): (usize, &[Light])| {
            let (mut power, mut unshot) = (0.0f64, 0.0f64);
            for (at, exitance) in exitance.iter().enumerate() {
                let slot = task * PATCHES_A_TASK + at;
                let (area, reflectance) = (links.area(slot), super::light(links.reflectance(slot)));
                let largest = |value: &dyn Fn(usize) -> f32| value(0).max(value(1)).max(value(2)) * area;
                let leaving = |c: usize| (direct[slot][c] + reflectance[c] * irradiance[slot][c]).abs();
                power += f64::from(largest(&leaving));
                unshot += f64::from(largest(&|c| exitance[c].abs()));
            }
            (power, unshot)
        };
        let tasks: Vec<(f64, f64)> =
            self.exitance.par_chunks(PATCHES_A_TASK).enumerate().map(of_task).collect();
        tasks.into_iter().fold((0.0, 0.0), |sum, task| (sum.0 + task.0, sum.1 + task.1))
    }
}

/// Brings flux that has `arrived` at a patch into its light, and what it reflects of it into what it has to shoot.
fn fold_patch(links: &LinkRows, slot: usize, arrived: Light, irradiance: &mut Light, unshot: &mut Light) {
    let area = links.area(slot);
    if area > 0.0 && arrived != [0.0; 4] {
        let reflectance = super::light(links.reflectance(slot));
        for channel in 0..3 {
            let arrived = arrived[channel] / area;
            irradiance[channel] += arrived;
            unshot[channel] += reflectance[channel] * arrived;
        }
    }
}

/// `B - r` of a patch.
pub fn sent(links: &LinkRows, slot: usize, direct: &Light, irradiance: &Light, unshot: &Light) -> Light {
    let reflectance = super::light(links.reflectance(slot));
    std::array::from_fn(|c| direct[c] + reflectance[c] * irradiance[c] - unshot[c])
}

/// The histogram's class of a positive importance.
fn class_of(importance: f32) -> usize {
    (importance.to_bits() >> 20) as usize
}

/// What changing to shooting takes: one bounce of all rows, after which what has been sent is known exactly.
pub fn begin(links: &LinkRows, direct: &[Light], outside: &[Light], irradiance: &mut [Light]) -> Unshot {
    let mut unshot = Unshot::new(links.capacity());
    let none = [0.0; 4];
    let leaving: Vec<Light> = (0..links.capacity())
        .map(|slot| sent(links, slot, &direct[slot], &irradiance[slot], &none))
        .collect();
    let mut next = vec![none; links.capacity()];
    step_gather::bounce(links, &leaving, outside, &mut next);
    for slot in 0..links.capacity() {
        let reflectance = super::light(links.reflectance(slot));
        for channel in 0..3 {
            unshot.exitance[slot][channel] =
                reflectance[channel] * (next[slot][channel] - irradiance[slot][channel]);
        }
    }
    irradiance.copy_from_slice(&next);
    unshot
}
