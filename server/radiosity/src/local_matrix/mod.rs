//! The local matrix: all bounces between the resident patches, dense `f32`, one plane a colour channel.
//!
//! What is kept is not `H` but the **exchange matrix** `G = A H` (`A` the patches' areas): `G[i][j]` is the flux that
//! arrives at `i`, all bounces included, for each unit of exitance of `j`. By reciprocity `A_i F_ij = A_j F_ji` it is
//! symmetric, so half of it is stored and half of the work is done: `6 M^2` bytes and a little.
//!
//! Row and column of a patch are its slot; rows and columns of free slots are zero. Patches enter and leave in blocks
//! ([`LocalMatrix::add_block`], [`LocalMatrix::remove_block`]): exact, O(q M^2) for `q` patches, all of them in the
//! same two passes over `G` (one for removals), and without allocating once warm. Not the place for checks of what
//! callers send: that is [`CpuBackend`](crate::CpuBackend).
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | the planes, who is where |
//! | `add.rs` | a block enters |
//! | `remove.rs` | a block leaves |
//! | `product.rs` | the light of a frame: lit columns times rows of interest |
//! | `repair.rs` | Newton-Schulz, a stripe of columns at a time |
//! | `probe.rs` | the drift probe, the fresh solve |
//! | `workspace.rs` | what these share: scratch memory, the rank-q update |
//! | `capacitance.rs` | the small `f64` inverse, and who is refused |
//! | `truncated.rs` | the sources' update, for comparison |

mod add;
pub mod capacitance;
mod halved;
mod probe;
mod product;
mod remove;
mod repair;
#[cfg(test)]
mod tests;
mod truncated;
mod workspace;

use crate::backend::{HeldBytes, Slot};
use crate::buffer::Buffer;
use crate::exchange::{BLOCK, TILE_EDGE, entry_at, stripe_at};
use crate::resident_rows::ResidentRows;
use crate::simd::InstructionSet;
use earthshine_world::Rgb;
use workspace::Workspace;

/// Why there is no matrix of this capacity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum CapacityError {
    /// No slots.
    #[error("a local matrix needs at least one slot")]
    Zero,
    /// Above [`LocalMatrix::CAPACITY_MAX`].
    #[error("{0} slots are more than {max}, the most a local matrix may have", max = LocalMatrix::CAPACITY_MAX)]
    TooLarge(u32),
    /// The memory cannot be had.
    #[error("no memory for a local matrix of {slots} slots, {bytes} bytes; use fewer slots")]
    Memory {
        /// Slots asked for.
        slots: u32,
        /// Bytes that they take.
        bytes: u64,
    },
}

/// A patch that enters.
#[derive(Debug, Clone, Copy)]
pub struct Arrival<'a> {
    /// A free slot.
    pub slot: Slot,
    /// Diffuse reflectance.
    pub reflectance: Rgb,
    /// Area, m2, above zero.
    pub area: f32,
    /// `F[new, j]`, itself and earlier patches of its block included. Free slots are passed over. What the others see
    /// of it follows by reciprocity.
    pub row: &'a [(Slot, f32)],
}

impl Arrival<'_> {
    /// A placeholder, for arrays.
    pub(crate) const NOBODY: Self = Self { slot: Slot(0), reflectance: Rgb::ZERO, area: 1.0, row: &[] };

    /// `A_new F[new, j]`, m2.
    fn exchange(&self) -> impl Iterator<Item = (usize, f32)> + Clone + '_ {
        self.row.iter().map(|&(slot, share)| (slot.0 as usize, self.area * share))
    }
}

/// `G = A H`, what it was made from, and room to change it. `6 M^2` bytes and a little.
#[derive(Debug)]
pub struct LocalMatrix {
    capacity: usize,
    /// Lower triangles.
    planes: [Buffer<f32>; 3],
    reflectance: Vec<Rgb>,
    /// Areas, m2; 0 in free slots.
    areas: Vec<f32>,
    taken: Vec<bool>,
    taken_count: usize,
    /// One past the highest taken slot: no stripe beyond it is ever touched.
    extent: usize,
    rows: ResidentRows,
    /// Next slot whose column is to be refined.
    repair_from: usize,
    workspace: Workspace,
    instructions: InstructionSet,
}

impl LocalMatrix {
    /// Most slots: a whole plane of so many would stay below 2 GiB, as on GPUs.
    pub const CAPACITY_MAX: u32 = 23_170;
    /// Most patches in a block.
    pub const BLOCK_MAX: usize = BLOCK;

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
        let stripes = slots.div_ceil(TILE_EDGE);
        let refused = |_| CapacityError::Memory { slots: capacity, bytes: Self::bytes(capacity) };
        let plane = || Buffer::zeroed(stripe_at(stripes)).map_err(refused);
        Ok(Self {
            capacity: slots,
            planes: [plane()?, plane()?, plane()?],
            reflectance: vec![Rgb::ZERO; slots],
            areas: vec![0.0; stripes * TILE_EDGE],
            taken: vec![false; slots],
            taken_count: 0,
            extent: 0,
            rows: ResidentRows::new(slots),
            repair_from: 0,
            workspace: Workspace::new(stripes).map_err(refused)?,
            instructions: InstructionSet::widest(),
        })
    }

    /// Bytes that the planes of a matrix of `capacity` slots take.
    #[must_use]
    pub fn bytes(capacity: u32) -> u64 {
        let stripes = u64::from(capacity).div_ceil(TILE_EDGE as u64);
        3 * 4 * stripes * (stripes + 1) / 2 * (TILE_EDGE * TILE_EDGE) as u64
    }

    /// What it holds.
    #[must_use]
    pub fn held_bytes(&self) -> HeldBytes {
        let planes: usize = self.planes.iter().map(|plane| size_of_val(&**plane)).sum();
        HeldBytes { matrix: (planes + self.workspace.bytes()) as u64, rows: self.rows.bytes() as u64 }
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

    /// Area of the patch in `slot`, m2; zero for a free slot.
    ///
    /// # Panics
    /// If the slot is beyond the capacity.
    #[must_use]
    pub fn area(&self, slot: Slot) -> f32 {
        self.areas[slot.0 as usize]
    }

    /// `H[receiver, sender]` of a channel (0, 1, 2); zero where a slot is free.
    ///
    /// # Panics
    /// If a slot is beyond the capacity or the channel beyond 2.
    #[must_use]
    pub fn entry(&self, channel: usize, receiver: Slot, sender: Slot) -> f32 {
        let (receiver, sender) = (receiver.0 as usize, sender.0 as usize);
        assert!(receiver.max(sender) < self.capacity, "{receiver}, {sender}");
        if self.taken[receiver] {
            self.planes[channel][entry_at(receiver, sender)] / self.areas[receiver]
        } else {
            0.0
        }
    }

    /// `F[receiver, sender]` for the taken slots that `receiver` sees. A sender may come twice; its shares add up.
    ///
    /// # Panics
    /// If the slot is beyond the capacity.
    pub fn form_factors(&self, receiver: Slot) -> impl Iterator<Item = (Slot, f32)> + '_ {
        self.rows.row(receiver.0 as usize).map(|(slot, share)| (Slot(slot as u32), share))
    }

    /// Stripes that can hold anything.
    fn stripes(&self) -> usize {
        self.extent.div_ceil(TILE_EDGE)
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
                self.shrink();
            }
        }
    }

    /// Brings `extent` down to the highest taken slot.
    fn shrink(&mut self) {
        while self.extent > 0 && !self.taken[self.extent - 1] {
            self.extent -= 1;
        }
    }
}
