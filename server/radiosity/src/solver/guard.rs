//! No light that is not a number leaves a solver: every slot is looked at in debug builds, some a step in others.

use super::Light;
use super::links::LinkRows;
use crate::backend::{BackendError, Slot};

/// Slots that a step looks at; all have their turn.
pub(crate) const SLOTS_A_STEP: usize = 64;

/// Looks for light that is not finite, from slot `cursor` on, and moves `cursor`.
///
/// # Errors
/// [`BackendError::NotANumber`]: the backend is of no more use.
pub(crate) fn check(links: &LinkRows, light: &[Light], cursor: &mut usize) -> Result<(), BackendError> {
    let most = if cfg!(debug_assertions) { light.len() } else { SLOTS_A_STEP.min(light.len()) };
    for _ in 0..most {
        let slot = *cursor;
        *cursor = (slot + 1) % light.len();
        if links.is_taken(slot) && !light[slot].iter().all(|channel| channel.is_finite()) {
            return Err(BackendError::NotANumber(Slot(slot as u32)));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::Rgb;

    #[test]
    fn light_that_is_no_number_is_found_in_its_turn() {
        let mut links = LinkRows::new(300);
        (0..300).for_each(|slot| links.add(slot, 1.0, Rgb::ZERO, std::iter::empty()));
        let mut light = vec![[1.0; 4]; 300];
        light[170][2] = f32::NAN;
        let mut cursor = 0;
        let steps = (0..300usize.div_ceil(SLOTS_A_STEP)).map(|_| check(&links, &light, &mut cursor));
        assert!(steps.filter_map(Result::err).any(|error| error == BackendError::NotANumber(Slot(170))));
    }
}
