//! The local matrix: `H` of the resident patches, dense `f32`, one plane a colour channel.
//!
//! Row and column of a patch are its slot; rows and columns of free slots are zero. Patches enter and leave
//! in blocks ([`LocalMatrix::add_block`], [`LocalMatrix::remove_block`]): exact, O(q M^2) for `q` patches,
//! all of them in the same three passes over `H` (one for removals), and without allocating once warm. Not
//! the place for checks of what callers send: that is [`CpuBackend`](crate::CpuBackend).
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | the planes, who is where, products |
//! | `add.rs` | a block enters |
//! | `remove.rs` | a block leaves |
//! | `probe.rs` | the drift probe, the fresh solve |
//! | `block.rs` | what both share: scratch memory, the rank-q update |
//! | `capacitance.rs` | the small `f64` inverse, and who is refused |
//! | `truncated.rs` | the sources' update, for comparison |

mod add;
mod block;
mod capacitance;
mod probe;
mod remove;
#[cfg(test)]
mod tests;
mod truncated;

use crate::backend::Slot;
use crate::buffer::Buffer;
use crate::kernel::{ROW_GROUP, Scalar};
use crate::resident_rows::ResidentRows;
use crate::simd::InstructionSet;
use block::{Workspace, find_lit, row_products};
use earthshine_world::Rgb;

/// Columns of a tile.
const TILE: usize = <f32 as Scalar>::TILE;
/// Rows a task takes.
const BAND_ROWS: usize = 64;

/// Why there is no matrix of this capacity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum CapacityError {
    /// No slots.
    #[error("a local matrix needs at least one slot")]
    Zero,
    /// Above [`LocalMatrix::CAPACITY_MAX`].
    #[error("{0} slots are more than {max}, the most a local matrix may have", max = LocalMatrix::CAPACITY_MAX)]
    TooLarge(u32),
    /// The memory, 12 bytes a slot squared, cannot be had.
    #[error("no memory for the 12 bytes a slot squared of {0} slots; use fewer")]
    Memory(u32),
}

/// A patch that enters.
#[derive(Debug, Clone, Copy)]
pub struct Arrival<'a> {
    /// A free slot.
    pub slot: Slot,
    /// Diffuse reflectance.
    pub reflectance: Rgb,
    /// `F[new, j]`, itself and earlier patches of its block included. Free slots are passed over.
    pub row: &'a [(Slot, f32)],
    /// `F[i, new]`, earlier patches of its block included, itself not. Free slots are passed over.
    pub column: &'a [(Slot, f32)],
}

impl Arrival<'_> {
    /// A placeholder, for arrays.
    pub(crate) const NOBODY: Self = Self { slot: Slot(0), reflectance: Rgb::ZERO, row: &[], column: &[] };
}

/// `H`, what it was made from, and room to change it. `12 M^2` bytes and a little.
#[derive(Debug)]
pub struct LocalMatrix {
    capacity: usize,
    /// Numbers from one row to the next: an odd number of cache lines, or a column's lines would share a cache set.
    stride: usize,
    planes: [Buffer<f32>; 3],
    reflectance: Vec<Rgb>,
    taken: Vec<bool>,
    taken_count: usize,
    /// One past the highest taken slot: nothing beyond it is ever touched.
    extent: usize,
    rows: ResidentRows,
    workspace: Workspace,
    instructions: InstructionSet,
}

impl LocalMatrix {
    /// Most slots: a plane stays below 2 GiB, as on GPUs.
    pub const CAPACITY_MAX: u32 = 23_170;
    /// Most patches in a block.
    pub const BLOCK_MAX: usize = TILE;

    /// An empty matrix of `capacity` slots.
    ///
    /// # Errors
    /// [`CapacityError`].
    pub fn new(capacity: u32) -> Result<Self, CapacityError> {
        match capacity {
            0 => return Err(CapacityError::Zero),
            1..=Self::CAPACITY_MAX => {}
            _ => return Err(CapacityError::TooLarge(capacity)),
        }
        let slots = capacity as usize;
        let row_count = slots.next_multiple_of(ROW_GROUP);
        let stride = ((slots.next_multiple_of(TILE) / 16) | 1) * 16;
        let refused = |_| CapacityError::Memory(capacity);
        let plane = || Buffer::zeroed(row_count * stride).map_err(refused);
        Ok(Self {
            capacity: slots,
            stride,
            planes: [plane()?, plane()?, plane()?],
            reflectance: vec![Rgb::ZERO; slots],
            taken: vec![false; slots],
            taken_count: 0,
            extent: 0,
            rows: ResidentRows::new(slots),
            workspace: Workspace::new(row_count, stride).map_err(refused)?,
            instructions: InstructionSet::widest(),
        })
    }

    /// Number of slots.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Number of taken slots.
    #[must_use]
    pub fn taken_count(&self) -> usize {
        self.taken_count
    }

    /// Whether a patch holds `slot`; false beyond the capacity.
    #[must_use]
    pub fn is_taken(&self, slot: Slot) -> bool {
        self.taken.get(slot.0 as usize).copied().unwrap_or(false)
    }

    /// Taken slots, ascending.
    pub fn taken_slots(&self) -> impl Iterator<Item = Slot> + '_ {
        (0..self.extent).filter(|&slot| self.taken[slot]).map(|slot| Slot(slot as u32))
    }

    /// Reflectance of the patch in `slot`; black for a free slot.
    ///
    /// # Panics
    /// If the slot is beyond the capacity.
    #[must_use]
    pub fn reflectance(&self, slot: Slot) -> Rgb {
        self.reflectance[slot.0 as usize]
    }

    /// `H[receiver, sender]` of a channel (0, 1, 2).
    ///
    /// # Panics
    /// If a slot is beyond the capacity or the channel beyond 2.
    #[must_use]
    pub fn entry(&self, channel: usize, receiver: Slot, sender: Slot) -> f32 {
        assert!((sender.0 as usize) < self.capacity, "{sender:?}");
        self.planes[channel][receiver.0 as usize * self.stride + sender.0 as usize]
    }

    /// `F[receiver, sender]` for the taken slots that `receiver` sees. A sender may come twice; its shares add up.
    ///
    /// # Panics
    /// If the slot is beyond the capacity.
    pub fn form_factors(&self, receiver: Slot) -> impl Iterator<Item = (Slot, f32)> + '_ {
        self.rows.row(receiver.0 as usize).map(|(slot, share)| (Slot(slot as u32), share))
    }

    /// Numbers a vector must hold for [`Self::multiply`]; slots come first, the rest is zero.
    #[must_use]
    pub fn vector_len(&self) -> usize {
        self.stride
    }

    /// `out = H x` of one channel. Reads only columns where `x` is not zero, cache line by cache line;
    /// sums in `f32` lanes over at most 1,024 columns, in `f64` beyond.
    ///
    /// # Panics
    /// If the channel is beyond 2, `x` is shorter than [`Self::vector_len`], or `out` than the capacity.
    pub fn multiply(&mut self, channel: usize, x: &[f32], out: &mut [f32]) {
        let x = &x[..self.stride];
        let rows = self.active_rows();
        let Workspace { products, lit_runs, .. } = &mut self.workspace;
        find_lit(x, self.extent, lit_runs);
        let matrix = &self.planes[channel][..rows * self.stride];
        row_products(self.instructions, matrix, self.stride, x, lit_runs, &mut products[..rows]);
        out[self.extent..self.capacity].fill(0.0);
        for (out, &sum) in out.iter_mut().zip(&self.workspace.products[..self.extent]) {
            *out = sum as f32;
        }
    }

    /// Marks `slot` as taken or free.
    fn set_taken(&mut self, slot: usize, taken: bool) {
        if self.taken[slot] != taken {
            self.taken[slot] = taken;
            if taken {
                self.taken_count += 1;
                self.extent = self.extent.max(slot + 1);
            } else {
                self.taken_count -= 1;
                while self.extent > 0 && !self.taken[self.extent - 1] {
                    self.extent -= 1;
                }
            }
        }
    }
}
