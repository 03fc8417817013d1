//! A closed room larger than the matrix: who is resident, and seeded updates that change it.
//!
//! It keeps its own record of what the backend should hold, so that the fresh solve it compares with owes
//! nothing to the code under test.

use super::ClosedBox;
use crate::backend::{Slot, Update};
use crate::dense::{DenseError, DenseMatrix};
use crate::local_matrix::LocalMatrix;
use crate::multibounce::multibounce;
use earthshine_world::Rgb;
use earthshine_world::random::{Purpose, hash, unit_f32};

/// Patches of a room, some of them in slots.
#[derive(Debug, Clone)]
pub struct Streamed {
    room: ClosedBox,
    /// Patch of each slot.
    resident: Vec<Option<usize>>,
    /// Patches without a slot.
    outside: Vec<usize>,
    seed: u64,
    drawn: u64,
}

/// How far a matrix is from the fresh solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatrixError {
    /// Relative RMSE of irradiance from a random source, all channels.
    pub irradiance_rel: f64,
    /// Relative Frobenius distance of `H`, all channels.
    pub frobenius_rel: f64,
}

impl Streamed {
    /// Nobody resident in `slot_count` slots.
    #[must_use]
    pub fn new(room: ClosedBox, slot_count: usize, seed: u64) -> Self {
        let outside = (0..room.len()).collect();
        Self { room, resident: vec![None; slot_count], outside, seed, drawn: 0 }
    }

    /// The room.
    #[must_use]
    pub fn room(&self) -> &ClosedBox {
        &self.room
    }

    /// The room's patch in `slot`.
    #[must_use]
    pub fn patch(&self, slot: Slot) -> Option<usize> {
        self.resident.get(slot.0 as usize).copied().flatten()
    }

    /// Taken slots, ascending.
    #[must_use]
    pub fn taken(&self) -> Vec<Slot> {
        self.slots_where(true)
    }

    /// Free slots, ascending.
    #[must_use]
    pub fn free(&self) -> Vec<Slot> {
        self.slots_where(false)
    }

    fn slots_where(&self, taken: bool) -> Vec<Slot> {
        let slots = self.resident.iter().enumerate();
        slots.filter(|(_, patch)| patch.is_some() == taken).map(|(slot, _)| Slot(slot as u32)).collect()
    }

    /// A seeded number below `bound`.
    fn draw(&mut self, bound: usize) -> usize {
        self.drawn += 1;
        (hash(self.seed, Purpose::Simulation, self.drawn, 1) % bound.max(1) as u64) as usize
    }

    /// Seeded patches leave; fewer than `count` if fewer are resident.
    pub fn leave(&mut self, count: usize) -> Vec<Update> {
        let mut taken = self.taken();
        let mut updates = Vec::with_capacity(count);
        for _ in 0..count.min(taken.len()) {
            let at = self.draw(taken.len());
            let slot = taken.swap_remove(at);
            self.outside.extend(self.resident[slot.0 as usize].take());
            updates.push(Update::Remove { slot });
        }
        updates
    }

    /// Seeded patches enter seeded free slots; fewer than `count` if slots or patches run out.
    pub fn enter(&mut self, count: usize) -> Vec<Update> {
        let mut free = self.free();
        let mut updates = Vec::with_capacity(count);
        for _ in 0..count.min(free.len()).min(self.outside.len()) {
            let (at, who) = (self.draw(free.len()), self.draw(self.outside.len()));
            let (slot, patch) = (free.swap_remove(at), self.outside.swap_remove(who));
            updates.push(self.add(slot, patch));
        }
        updates
    }

    fn add(&mut self, slot: Slot, patch: usize) -> Update {
        let (mut row, mut column) = (Vec::new(), Vec::new());
        for (at, other) in self.resident.iter().enumerate() {
            if let Some(other) = *other {
                let (forth, back) =
                    (self.room.form_factor(patch, other), self.room.form_factor(other, patch));
                if forth > 0.0 {
                    row.push((Slot(at as u32), forth));
                    column.push((Slot(at as u32), back));
                }
            }
        }
        self.resident[slot.0 as usize] = Some(patch);
        let (reflectance, area) = (self.room.reflectance(patch), self.room.area(patch));
        Update::Add { slot, reflectance, area, row, column }
    }

    /// `H` of one channel by a fresh `f64` solve, residents in the order of their slots.
    ///
    /// # Errors
    /// [`DenseError`].
    pub fn solved(&self, channel: usize) -> Result<DenseMatrix, DenseError> {
        let patches: Vec<usize> = self.resident.iter().copied().flatten().collect();
        let form_factor = |i: usize, j: usize| f64::from(self.room.form_factor(patches[i], patches[j]));
        let form_factors = DenseMatrix::from_fn(patches.len(), patches.len(), form_factor)?;
        let reflectance = |&patch: &usize| f64::from(self.room.reflectance(patch)[channel]);
        multibounce(&form_factors, &patches.iter().map(reflectance).collect::<Vec<_>>())
    }

    /// How far `matrix` is from fresh solves.
    ///
    /// # Errors
    /// [`DenseError`].
    pub fn error_of(&self, matrix: &LocalMatrix) -> Result<MatrixError, DenseError> {
        let slots = self.taken();
        let (mut gap, mut norm) = ([0.0f64; 2], [0.0f64; 2]);
        for channel in 0..3 {
            let solved = self.solved(channel)?;
            for (i, &receiver) in slots.iter().enumerate() {
                let (mut wrong, mut right) = (0.0, 0.0);
                for (&sender, &truth) in slots.iter().zip(solved.row(i)) {
                    let source = f64::from(self.source(sender)[channel]);
                    let entry = f64::from(matrix.entry(channel, receiver, sender));
                    wrong += (entry - truth) * source;
                    right += truth * source;
                    gap[1] += (entry - truth) * (entry - truth);
                    norm[1] += truth * truth;
                }
                gap[0] += wrong * wrong;
                norm[0] += right * right;
            }
        }
        let relative = |which: usize| if gap[which] == 0.0 { 0.0 } else { (gap[which] / norm[which]).sqrt() };
        Ok(MatrixError { irradiance_rel: relative(0), frobenius_rel: relative(1) })
    }

    /// A seeded exitance for `slot`, 0..1 lm/m2 a channel.
    #[must_use]
    pub fn source(&self, slot: Slot) -> Rgb {
        let channel = |c: u64| unit_f32(hash(self.seed, Purpose::Simulation, u64::from(slot.0), 2 + c));
        Rgb::new(channel(0), channel(1), channel(2))
    }
}
