//! Light of a backend beside the light that is expected.

use crate::backend::{Backend, Slot};
use earthshine_world::Rgb;

/// The light of `slots`.
///
/// # Panics
/// If `backend` does not say.
pub fn read(backend: &mut dyn Backend, slots: &[Slot]) -> Vec<Rgb> {
    let mut light = vec![Rgb::NAN; slots.len()];
    backend.read_irradiance(slots, &mut light).expect("taken slots");
    light
}

/// The error of `light` as a share of what is `exact`, root mean square of both.
#[must_use]
pub fn rel_rmse(light: &[Rgb], exact: &[Rgb]) -> f64 {
    let gap: f64 = light.iter().zip(exact).map(|(a, b)| f64::from((*a - *b).length_squared())).sum();
    let norm: f64 = exact.iter().map(|b| f64::from(b.length_squared())).sum();
    if gap == 0.0 { 0.0 } else { (gap / norm).sqrt() }
}
