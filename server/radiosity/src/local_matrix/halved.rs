//! Planes of 16-bit floats, for comparison only: what a device would keep that stores half of the bytes.
//!
//! Numbers are rounded to the 11 bits that such floats have, whatever their range, so what is measured is the best that
//! they could do; a device would have to scale them.

use super::LocalMatrix;

/// The nearest number of 11 significant bits, ties to even.
fn to_half(value: f32) -> f32 {
    let bits = value.to_bits();
    let is_odd = bits >> 13 & 1;
    f32::from_bits(bits.wrapping_add(0xFFF + is_odd) & !0x1FFF)
}

impl LocalMatrix {
    /// Rounds all planes.
    pub fn round_to_half(&mut self) {
        for plane in &mut self.planes {
            plane.iter_mut().for_each(|number| *number = to_half(*number));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eleven_bits_are_kept_and_ties_go_to_even() {
        let unit = 1.0 / 1024.0;
        for (value, rounded) in [
            (0.0, 0.0),
            (1.0 + unit, 1.0 + unit),
            (1.0 + 0.5 * unit, 1.0),
            (1.0 + 1.5 * unit, 1.0 + 2.0 * unit),
            (-(1.0 + 0.6 * unit), -(1.0 + unit)),
            (1e-30, to_half(1e-30)),
        ] {
            assert_eq!(to_half(value), rounded, "{value}");
            assert_eq!(to_half(rounded), rounded);
            assert!((to_half(value) - value).abs() <= value.abs() / 2048.0);
        }
    }
}
