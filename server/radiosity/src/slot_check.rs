//! What backends ask of slots, light and interest before they touch anything: the same questions everywhere.

use crate::backend::{BackendError, Slot, Update};
use crate::local_matrix::LocalMatrix;
use earthshine_world::Rgb;

/// The index of `slot` among `capacity`.
///
/// # Errors
/// [`BackendError::SlotOutside`].
pub fn within(slot: Slot, capacity: u32) -> Result<usize, BackendError> {
    if slot.0 < capacity { Ok(slot.0 as usize) } else { Err(BackendError::SlotOutside(slot, capacity)) }
}

/// Whether every one of `slots` is taken.
///
/// # Errors
/// [`BackendError::SlotOutside`], [`BackendError::SlotFree`], the first.
pub fn all_taken(slots: &[Slot], capacity: u32, is_taken: impl Fn(Slot) -> bool) -> Result<(), BackendError> {
    slots.iter().try_for_each(|&slot| {
        within(slot, capacity)?;
        if is_taken(slot) { Ok(()) } else { Err(BackendError::SlotFree(slot)) }
    })
}

/// Whether there are as many values as slots.
///
/// # Errors
/// [`BackendError::Length`].
pub fn one_each(slots: &[Slot], actual: usize) -> Result<(), BackendError> {
    let expected = slots.len();
    if expected == actual { Ok(()) } else { Err(BackendError::Length { expected, actual }) }
}

/// Whether `values` are light: finite and not negative.
fn is_light(slots: &[Slot], values: &[Rgb]) -> Result<(), BackendError> {
    let is_sound = |value: &Rgb| value.is_finite() && value.min_element() >= 0.0;
    match slots.iter().zip(values).find(|(_, value)| !is_sound(value)) {
        Some((&slot, _)) => Err(BackendError::NotFinite(slot)),
        None => Ok(()),
    }
}

/// Whether these are sources for `slots`: one each, finite and not negative.
///
/// # Errors
/// [`BackendError::Length`], [`BackendError::NotFinite`].
pub fn are_sources(
    slots: &[Slot],
    direct_exitance: &[Rgb],
    outside_irradiance: &[Rgb],
) -> Result<(), BackendError> {
    let both = [direct_exitance, outside_irradiance];
    both.iter().try_for_each(|values| one_each(slots, values.len()))?;
    both.iter().try_for_each(|values| is_light(slots, values))
}

/// Whether `shares` of rows and `irradiance` are the sky's for `slots`.
///
/// # Errors
/// [`BackendError::Length`], [`BackendError::NotFinite`], [`BackendError::Share`].
pub fn is_sky(slots: &[Slot], shares: &[f32], irradiance: &[Rgb]) -> Result<(), BackendError> {
    one_each(slots, shares.len())?;
    one_each(slots, irradiance.len())?;
    is_light(slots, irradiance)?;
    match slots.iter().zip(shares).find(|(_, share)| !(0.0..=1.0).contains(*share)) {
        Some((&slot, &share)) => Err(BackendError::Share(slot, share)),
        None => Ok(()),
    }
}

/// `updates` in order, in runs of one kind, each a block of a matrix at most.
pub fn blocks_of(updates: &[Update]) -> impl Iterator<Item = &[Update]> {
    let same_kind = |a: &Update, b: &Update| std::mem::discriminant(a) == std::mem::discriminant(b);
    updates.chunk_by(same_kind).flat_map(|run| run.chunks(LocalMatrix::BLOCK_MAX))
}

/// The slots whose light is wanted; all of them at first.
#[derive(Debug, Clone, Default)]
pub struct Interest {
    wanted: Option<Vec<bool>>,
}

impl Interest {
    /// Changes it; `None` is all of `capacity`.
    ///
    /// # Errors
    /// [`BackendError::SlotOutside`]: it stays what it was.
    pub fn set(&mut self, slots: Option<&[Slot]>, capacity: u32) -> Result<(), BackendError> {
        let Some(slots) = slots else {
            self.wanted = None;
            return Ok(());
        };
        slots.iter().try_for_each(|&slot| within(slot, capacity).map(|_| ()))?;
        let wanted = self.wanted.get_or_insert_with(|| vec![false; capacity as usize]);
        wanted.fill(false);
        slots.iter().for_each(|slot| wanted[slot.0 as usize] = true);
        Ok(())
    }

    /// Whether `slot` is wanted.
    #[must_use]
    pub fn is_wanted(&self, slot: usize) -> bool {
        self.wanted.as_ref().is_none_or(|wanted| wanted[slot])
    }

    /// A mark a slot, if not all are wanted.
    #[must_use]
    pub fn marks(&self) -> Option<&[bool]> {
        self.wanted.as_deref()
    }
}
