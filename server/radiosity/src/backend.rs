//! What the engine asks of whoever computes: the [`Backend`] trait and the plain data it speaks.
//!
//! Operation level, batched, object-safe, no buffers in sight: the engine calls it a handful of times a tick, so a virtual
//! call costs nothing.
//!
//! What is asked of a device takes a while to be known, and a tick waits for nothing. So light, refusals, drift and audits
//! are **told**: at once by who knows at once, as the CPU does, or in a later tick. Calls that wait, for those who need to
//! know now, are [`read_irradiance`](Backend::read_irradiance) and [`drift`](Backend::drift).

use crate::slot_check;
use crate::solver::{SettingsError, SolverSettings};
use crate::tables::TableError;
use earthshine_world::Rgb;

/// Where a resident patch sits: row and column of the local matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Slot(pub u32);

/// One change of the resident set.
#[derive(Debug, Clone, PartialEq)]
pub enum Update {
    /// A patch enters a free slot.
    Add {
        /// Where.
        slot: Slot,
        /// Its diffuse reflectance, 0..=0.98 a channel.
        reflectance: Rgb,
        /// Its area, m2, above zero.
        area: f32,
        /// `F[new, j]` for slots `j` that are taken when this update's turn comes, itself included if it sees itself.
        row: Vec<(Slot, f32)>,
        /// `F[i, new]` for the same slots, itself left out: `area F[new, i] / A_i` within [`RECIPROCITY_TOLERANCE`].
        /// Where they differ the row counts.
        column: Vec<(Slot, f32)>,
    },
    /// A patch leaves.
    Remove {
        /// From where.
        slot: Slot,
    },
}

/// What became of a batch of updates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ApplyStats {
    /// Patches that entered; with those of whom it is not known yet whether they did ([`Backend::take_refused`]).
    pub added: u32,
    /// Patches that left.
    pub removed: u32,
    /// Patches refused at once because their pivot `1 - c s` lay below [`MIN_PIVOT`]: their slots stay free.
    pub weak_pivots: u32,
}

/// What the last [`Backend::step`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StepStats {
    /// Columns that carried light.
    pub lit_columns: u32,
    /// Whether anything had changed since the step before; if not, the light is the same to the bit.
    pub recomputed: bool,
}

/// Smallest pivot `1 - c s` of an add; below it the closed loop would amplify rounding.
pub const MIN_PIVOT: f32 = 0.05;

/// How much `A_i F_ij` and `A_j F_ji` may differ, as a share of the larger.
pub const RECIPROCITY_TOLERANCE: f64 = 1e-3;

/// How far a repair has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Repaired {
    /// Patches whose columns this call refined.
    pub columns: u32,
    /// Whether the round is complete: every patch that was resident throughout has had its turn.
    pub is_complete: bool,
}

/// Main memory that a backend holds, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HeldBytes {
    /// Dense planes, and the scratch of their updates.
    pub matrix: u64,
    /// Form factors between residents, by row.
    pub rows: u64,
}

/// Owns the local matrix and the light on it, and advances both.
///
/// A backend holds up to [`capacity`](Self::capacity) resident patches, each in a [`Slot`]. `H[i][j]`
/// gathers for receiver `i`, all bounces included, reflectance of `i` not:
/// `irradiance = H (direct_exitance + reflectance * outside) + outside`, once a colour channel, where
/// `outside` is the irradiance that comes from beyond the resident set (far patches and the sky).
///
/// Calls come from one thread, in program order. Every implementation passes the same conformance
/// suite; [`CpuBackend`](crate::CpuBackend) is the reference.
pub trait Backend: Send {
    /// Slots this backend was built for (M). Constant for its lifetime.
    fn capacity(&self) -> u32;

    /// Adds and removes patches, in order; exact, O(M^2) each, cheaper in blocks.
    ///
    /// A patch whose pivot is weak is refused, as if it had not come: its slot is free when this returns, or it looks taken
    /// until [`take_refused`](Self::take_refused) says otherwise. Nothing is ever told of its light.
    ///
    /// # Errors
    /// [`BackendError::SlotTaken`], [`BackendError::SlotFree`], [`BackendError::SlotOutside`],
    /// [`BackendError::Share`], [`BackendError::RowSum`], [`BackendError::Area`], [`BackendError::NotFinite`],
    /// [`BackendError::NotReciprocal`]: after an error nothing of the batch has been applied.
    fn apply(&mut self, updates: &[Update]) -> Result<ApplyStats, BackendError>;

    /// Whether a patch holds `slot`, as far as was told.
    fn is_taken(&self, slot: Slot) -> bool;

    /// Appends to `refused` the slots whose patch turned out to have a weak pivot; they are free from now on. Of a patch
    /// that was removed meanwhile, or whose slot has another patch, nothing is said. Does not wait: who refuses somebody
    /// late knows of it from the [`take_news`](Self::take_news) on that tells the light of the step that follows. The default
    /// is for those who refuse at once.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`]: `refused` is as it was.
    fn take_refused(&mut self, refused: &mut Vec<Slot>) -> Result<(), BackendError> {
        let _ = refused;
        Ok(())
    }

    /// Whether so much of what was asked is under way that another [`step`](Self::step) would wait, and updates would pile
    /// up: better to ask again in the next tick. Never on the CPU.
    fn is_behind(&self) -> bool {
        false
    }

    /// Main memory that it holds. The default, for what lives elsewhere, is none.
    fn held_bytes(&self) -> HeldBytes {
        HeldBytes::default()
    }

    /// Removes all patches. The default does so one by one; whoever can forgets them at once.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], never on the CPU.
    fn clear(&mut self) -> Result<(), BackendError> {
        let taken = (0..self.capacity()).map(Slot).filter(|&slot| self.is_taken(slot));
        let leaving: Vec<Update> = taken.map(|slot| Update::Remove { slot }).collect();
        self.apply(&leaving).map(drop)
    }

    /// Sets, for each slot, direct exitance (lm/m2) and the irradiance from outside the resident set (lx).
    ///
    /// # Errors
    /// [`BackendError::SlotFree`], [`BackendError::Length`], [`BackendError::NotFinite`].
    fn set_sources(
        &mut self,
        slots: &[Slot],
        direct_exitance: &[Rgb],
        outside_irradiance: &[Rgb],
    ) -> Result<(), BackendError>;

    /// Says what of the outside comes straight from the sky, for each slot: the share of its row, 0..=1, and the irradiance
    /// (lx), at most the outside irradiance of the last [`set_sources`](Self::set_sources), which comes first.
    ///
    /// Light is the same with and without, but for noise: a backend that draws makes the sky an outcome of its own, beside
    /// what is far. The default, for backends that do not draw, only checks.
    ///
    /// # Errors
    /// [`BackendError::SlotFree`], [`BackendError::Length`], [`BackendError::NotFinite`], [`BackendError::Share`].
    fn set_sky(
        &mut self,
        slots: &[Slot],
        sky_shares: &[f32],
        sky_irradiance: &[Rgb],
    ) -> Result<(), BackendError> {
        slot_check::is_sky(slots, sky_shares, sky_irradiance)?;
        slot_check::all_taken(slots, self.capacity(), |slot| self.is_taken(slot))
    }

    /// Names slots by urgency, most urgent first: work that a step cannot do for all is done in this order, and for those
    /// not named after them. A backend without such work, as the default, has no use for it.
    ///
    /// # Errors
    /// [`BackendError::SlotOutside`]: the order stays what it was.
    fn set_order(&mut self, slots: &[Slot]) -> Result<(), BackendError> {
        slots.iter().try_for_each(|&slot| slot_check::within(slot, self.capacity()).map(|_| ()))
    }

    /// Names the slots whose light is wanted from now on; `None`, the default, is all.
    ///
    /// A step evaluates at least these. What it leaves out keeps the irradiance of an earlier step, zero if there was
    /// none, and [`is_current`](Self::is_current) tells. A slot that is wanted and not current is evaluated by the next
    /// step even if nothing else has changed. Interest is in slots, taken or not, and stays when patches come and go.
    /// A backend may evaluate everything always: so does this default.
    ///
    /// # Errors
    /// [`BackendError::SlotOutside`]: the interest stays what it was.
    fn set_interest(&mut self, slots: Option<&[Slot]>) -> Result<(), BackendError> {
        let slots = slots.unwrap_or_default();
        slots.iter().try_for_each(|&slot| slot_check::within(slot, self.capacity()).map(|_| ()))
    }

    /// Whether the irradiance of `slot` is that of the last step, not of an earlier one.
    fn is_current(&self, slot: Slot) -> bool {
        self.is_taken(slot)
    }

    /// Advances the light by one frame, for the slots of interest.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], never on the CPU.
    fn step(&mut self) -> Result<StepStats, BackendError>;

    /// Copies the irradiance (lx) of `slots` into `out`, in the order asked.
    ///
    /// # Errors
    /// [`BackendError::Length`] if the slices differ in length; [`BackendError::SlotFree`].
    fn read_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError>;

    /// Whether [`read_irradiance`](Self::read_irradiance) has nothing to wait for.
    fn reads_at_once(&self) -> bool {
        true
    }

    /// Has [`take_news`](Self::take_news) tell of all slots once a step has evaluated them, as if nothing had been told yet.
    /// False where that cannot be: who wants all light reads it.
    fn tell_afresh(&mut self) -> bool {
        false
    }

    /// As [`read_irradiance`](Self::read_irradiance), of the last step before the first call, but does not wait: false as
    /// long as the light is not here, and `out` is as it was; who asks again then asks for the same slots. The default reads
    /// at once.
    ///
    /// # Errors
    /// As [`read_irradiance`](Self::read_irradiance): nothing is under way then.
    fn poll_irradiance(&mut self, slots: &[Slot], out: &mut [Rgb]) -> Result<bool, BackendError> {
        self.read_irradiance(slots, out).map(|()| true)
    }

    /// Appends to `news` the slots, all taken, whose irradiance (lx) is another than what this method said of them last, and
    /// that irradiance. A patch that has come since is news once a step has evaluated it, even if it is dark. A slot may be
    /// there twice: the later entry counts.
    ///
    /// Beside [`read_irradiance`](Self::read_irradiance), which is exact and waits, this is for every frame. What is told
    /// is whole, the light of one step and never parts of two; it may be behind by a few steps, and
    /// [`is_settled`](Self::is_settled) is false while more is on its way; and it may leave out changes that are too small to
    /// be published, but never their sum. The default tells of every slot, news or not.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::NotANumber`]: `news` is as it was.
    fn take_news(&mut self, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        let slots: Vec<Slot> = (0..self.capacity()).map(Slot).filter(|&slot| self.is_taken(slot)).collect();
        let mut light = vec![Rgb::ZERO; slots.len()];
        self.read_irradiance(&slots, &mut light)?;
        news.extend(slots.into_iter().zip(light));
        Ok(())
    }

    /// Writes the row of `H` of a taken slot, colours and all, to `row`. O(M).
    ///
    /// # Errors
    /// [`BackendError::NoRows`] where the matrix is not at hand, as by default; [`BackendError::SlotFree`],
    /// [`BackendError::SlotOutside`].
    fn read_row(&mut self, slot: Slot, row: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        let _ = (slot, row);
        Err(BackendError::NoRows)
    }

    /// Whether another step without any change would leave the light as it is, to the bit, and no news of it is on its way
    /// or waits to be taken ([`take_news`](Self::take_news)). A matrix settles in one step; methods that go on by themselves have to be stepped
    /// until then.
    fn is_settled(&self) -> bool {
        true
    }

    /// Chooses how light is advanced from now on, without a jump: the light goes on from where it is. Returns whether this
    /// backend has a choice; the default has none and goes on as before.
    ///
    /// # Errors
    /// [`BackendError::Settings`], [`BackendError::OutOfMemory`]: the choice stays what it was.
    fn set_solver(&mut self, settings: &SolverSettings) -> Result<bool, BackendError> {
        settings.validate().map_err(BackendError::Settings)?;
        Ok(false)
    }

    /// Keeps a matrix beside the method in use, to be asked by [`audit`](Self::audit). Returns whether it can.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`].
    fn set_audited(&mut self, is_audited: bool) -> Result<bool, BackendError> {
        let _ = is_audited;
        Ok(false)
    }

    /// Relative RMSE of the light against the matrix' for the same sources, both as they were when the audit began; nothing
    /// where the light is the matrix' own, where there is none, as long as it is being made, or while the answer is on its
    /// way: then [`is_audit_coming`](Self::is_audit_coming), and the next call tells it or looks again.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    fn audit(&mut self) -> Result<Option<f32>, BackendError> {
        Ok(None)
    }

    /// Whether an [`audit`](Self::audit) was begun and has not been told. Never on the CPU.
    fn is_audit_coming(&self) -> bool {
        false
    }

    /// Relative size of `x -> H x - F (x + R H x)` for a random `x` of `seed`: how far rounding has
    /// carried `H` from the matrix it stands for. O(M^2). Waits where a device has to say.
    fn drift(&mut self, seed: u64) -> f32;

    /// As [`drift`](Self::drift), of the matrix at the first call, but does not wait: nothing as long as it is not known.
    /// Whoever asks again hears of the probe that is under way, whatever the seed. The default knows at once.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`]: no probe is under way then.
    fn poll_drift(&mut self, seed: u64) -> Result<Option<f32>, BackendError> {
        Ok(Some(self.drift(seed)))
    }

    /// Brings `H` back towards the matrix it stands for, a few columns a call: bounded work for the frame path. A round
    /// of calls, until [`Repaired::is_complete`], about squares a drift below 0.1, down to rounding; for more there is
    /// [`resolve`](Self::resolve), which is also the default of this. O(M^2) a column.
    ///
    /// # Errors
    /// As [`resolve`](Self::resolve).
    fn repair(&mut self, columns_max: u32) -> Result<Repaired, BackendError> {
        let _ = columns_max;
        self.resolve().map(|()| Repaired { columns: self.capacity(), is_complete: true })
    }

    /// Solves `H` afresh from the resident rows: what drift there was is gone. O(M^3): rare, off the frame path where it
    /// can be.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`]: `H` is as it was, and goes on being of use. A lost device elsewhere.
    fn resolve(&mut self) -> Result<(), BackendError>;
}

/// Why a backend refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BackendError {
    /// An add to a slot that is in use.
    #[error("slot {0:?} is taken")]
    SlotTaken(Slot),
    /// A removal from, or a source for, a slot that nothing holds.
    #[error("slot {0:?} is free")]
    SlotFree(Slot),
    /// A slot at or beyond the capacity.
    #[error("slot {0:?} is beyond the capacity of {1}")]
    SlotOutside(Slot, u32),
    /// A form factor that is negative, above one, or not a number.
    #[error("form factor {1} of slot {0:?} is not a share")]
    Share(Slot, f32),
    /// A row whose form factors sum to more than one: it would make light of nothing.
    #[error(
        "the row of slot {slot:?} sums to {sum}, more than one: the tile it comes from is broken; verify the world"
    )]
    RowSum {
        /// Whose.
        slot: Slot,
        /// What its shares sum to.
        sum: f64,
    },
    /// An area that is not above zero, or not a number.
    #[error("area {1} m2 of slot {0:?} is not above zero and finite")]
    Area(Slot, f32),
    /// A row and a column that contradict each other: what two patches exchange is the same both ways.
    #[error("slots {slot:?} and {other:?} exchange {forth} m2 one way and {back} m2 the other")]
    NotReciprocal {
        /// The new patch.
        slot: Slot,
        /// Whom it sees, or who sees it.
        other: Slot,
        /// `A_new F[new, other]`, m2.
        forth: f64,
        /// `A_other F[other, new]`, m2.
        back: f64,
    },
    /// Memory that cannot be had.
    #[error("no memory for {bytes} bytes, for a local matrix of {slots} slots; use fewer slots")]
    OutOfMemory {
        /// Slots of the matrix.
        slots: u32,
        /// Bytes asked for.
        bytes: u64,
    },
    /// The device that holds the matrix is gone: everything on it is lost, nothing of it was published. Build a new
    /// backend and fill it again.
    #[error("the device is lost: {cause}")]
    DeviceLost {
        /// What the driver said.
        cause: String,
    },
    /// Light or reflectance that is not a number.
    #[error("light of slot {0:?} is negative or not finite")]
    NotFinite(Slot),
    /// Light that has become no number: the backend is of no more use.
    #[error("the light of slot {0:?} is not a number: the backend has to be made anew")]
    NotANumber(Slot),
    /// Rows of the multibounce matrix where none can be read.
    #[error(
        "this backend shows no rows of the matrix to draw from: compute on the CPU, or draw from rows of form factors"
    )]
    NoRows,
    /// Settings of a solver that cannot be.
    #[error(transparent)]
    Settings(SettingsError),
    /// A row that no table can be made of.
    #[error(transparent)]
    Table(TableError),
    /// Slices that should be of one length are not.
    #[error("{expected} values expected, {actual} given")]
    Length {
        /// How many slots.
        expected: usize,
        /// How many values.
        actual: usize,
    },
}
