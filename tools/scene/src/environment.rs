//! An environment map: the radiance of the whole sphere of directions, one value a texel.
//!
//! Equirectangular (latitude and longitude). A texel is one radiance over its solid angle: nothing is interpolated,
//! so that every integral over the map is a sum. The upper edge is +Y. The middle column looks along +X and columns
//! run from +X towards +Z, as three.js has it; a rotation turns the sky counter-clockwise seen from above.
//!
//! Not here: files (`environment_file`), the six lobes of the service (`sky_projection`), random
//! directions (the reference tracer has its own).

use earthshine_world::{Direction, Rgb, Vec3};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The radiance of every direction, cd/m2.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvironmentMap {
    width: u32,
    height: u32,
    /// Row by row from the upper left.
    radiance: Vec<Rgb>,
    rotation_rad: f64,
}

/// Texels that cannot be radiance.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EnvironmentError {
    /// Not one value a texel.
    #[error("{values} values for {width} x {height} texels")]
    Size {
        /// Texels across.
        width: u32,
        /// Texels down.
        height: u32,
        /// What was given.
        values: usize,
    },
    /// Less than no light.
    #[error("{count} pixels are negative, the first in column {column}, row {row}")]
    Negative {
        /// How many.
        count: u64,
        /// Of the first, from the left.
        column: u32,
        /// Of the first, from the top.
        row: u32,
    },
    /// Infinite, or not a number.
    #[error("{count} pixels are infinite or not a number, the first in column {column}, row {row}")]
    NotFinite {
        /// How many.
        count: u64,
        /// Of the first, from the left.
        column: u32,
        /// Of the first, from the top.
        row: u32,
    },
}

impl EnvironmentMap {
    /// From its texels, row by row from the upper left, turned by `rotation_rad`.
    ///
    /// # Errors
    /// [`EnvironmentError`]: another number of texels, negative ones, ones that are not finite.
    pub fn new(
        width: u32,
        height: u32,
        radiance: Vec<Rgb>,
        rotation_rad: f64,
    ) -> Result<Self, EnvironmentError> {
        let values = radiance.len();
        if values == 0 || values as u64 != u64::from(width) * u64::from(height) {
            return Err(EnvironmentError::Size { width, height, values });
        }
        let place = |index: usize| ((index % width as usize) as u32, (index / width as usize) as u32);
        let faults = |is_fault: fn(&Rgb) -> bool| {
            let first = radiance.iter().position(is_fault)?;
            Some((radiance.iter().filter(|texel| is_fault(texel)).count() as u64, place(first)))
        };
        if let Some((count, (column, row))) = faults(|texel| !texel.is_finite()) {
            return Err(EnvironmentError::NotFinite { count, column, row });
        }
        if let Some((count, (column, row))) = faults(|texel| texel.min_element() < 0.0) {
            return Err(EnvironmentError::Negative { count, column, row });
        }
        Ok(Self { width, height, radiance, rotation_rad: rotation_rad.rem_euclid(TAU) })
    }

    /// Texels across: all the way around.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Texels down: from +Y to -Y.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Radiance of one texel, cd/m2.
    ///
    /// # Panics
    /// If it is outside the map.
    #[must_use]
    pub fn texel(&self, column: u32, row: u32) -> Rgb {
        assert!(column < self.width && row < self.height, "({column}, {row}) is outside");
        self.radiance[row as usize * self.width as usize + column as usize]
    }

    /// Radiance along unit `direction`, cd/m2.
    #[must_use]
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        let (column, row) = self.texel_at(direction);
        self.texel(column, row)
    }

    /// Column and row of the texel that unit `direction` meets.
    #[must_use]
    pub fn texel_at(&self, direction: Vec3) -> (u32, u32) {
        let [x, y, z] = direction.as_dvec3().to_array();
        let around = (z.atan2(x) + self.rotation_rad) / TAU + 0.5;
        // The arc cosine of a float near one knows few angles; the arc tangent does not mind.
        let down = x.hypot(z).atan2(y) / PI;
        let index = |share: f64, count: u32| ((share * f64::from(count)) as u32).min(count - 1);
        (index(around.rem_euclid(1.0), self.width), index(down, self.height))
    }

    /// The direction at a place within a texel, uniform in solid angle over `place` in `[0, 1)^2`; unit.
    #[must_use]
    pub fn direction_in(&self, column: u32, row: u32, place: (f32, f32)) -> Vec3 {
        let [low, high] = self.polar(row).map(f64::cos);
        let cosine = low + (high - low) * f64::from(place.1);
        let radius = (1.0 - cosine * cosine).max(0.0).sqrt();
        let share = (f64::from(column) + f64::from(place.0)) / f64::from(self.width);
        let (sin, cos) = (TAU * (share - 0.5) - self.rotation_rad).sin_cos();
        DVec3::new(radius * cos, cosine, radius * sin).as_vec3().normalize_or(Vec3::Y)
    }

    /// Solid angle of each texel of a row, sr; over the whole map they sum to `4 pi`.
    #[must_use]
    pub fn solid_angle_sr(&self, row: u32) -> f64 {
        let [top, bottom] = self.polar(row);
        TAU / f64::from(self.width) * (top.cos() - bottom.cos())
    }

    /// Irradiance of a plane that faces each of the six directions with nothing in its way, lx.
    ///
    /// Exact: the cosine is integrated over each texel, half ones at the planes' horizons included.
    #[must_use]
    pub fn open_irradiance(&self) -> [DVec3; 6] {
        // Around the horizon the integral is a product of one over rows and one over columns.
        let columns: Vec<[f64; 4]> = (0..self.width).map(|column| self.around(column)).collect();
        let mut sums = [DVec3::ZERO; 6];
        let mut set = |direction: Direction, value: DVec3| sums[direction.index()] += value;
        const SIDES: [Direction; 4] = [Direction::PosX, Direction::PosZ, Direction::NegX, Direction::NegZ];
        for row in 0..self.height {
            let texels = &self.radiance[row as usize * self.width as usize..][..self.width as usize];
            let mut sides = [DVec3::ZERO; 4];
            let mut all = DVec3::ZERO;
            for (texel, weights) in texels.iter().zip(&columns) {
                let texel = texel.as_dvec3();
                all += texel;
                for (side, weight) in sides.iter_mut().zip(weights) {
                    *side += texel * *weight;
                }
            }
            let [top, bottom] = self.polar(row);
            let half_square = |angle: f64| 0.5 * angle.sin().powi(2);
            let [upper, lower] = [top, bottom].map(|angle| half_square(angle.min(FRAC_PI_2)));
            let step = TAU / f64::from(self.width);
            set(Direction::PosY, all * (step * (lower - upper)));
            let [upper, lower] = [top, bottom].map(|angle| half_square(angle.max(FRAC_PI_2)));
            set(Direction::NegY, all * (step * (upper - lower)));
            let square = |angle: f64| 0.5 * angle - 0.25 * (2.0 * angle).sin();
            for (direction, side) in SIDES.into_iter().zip(sides) {
                set(direction, side * (square(bottom) - square(top)));
            }
        }
        sums
    }

    /// Angles from +Y of a row's upper and lower edge, rad.
    fn polar(&self, row: u32) -> [f64; 2] {
        [row, row + 1].map(|edge| PI * f64::from(edge) / f64::from(self.height))
    }

    /// Integral of the cosine, where positive, to +X, +Z, -X and -Z over a column's azimuths.
    fn around(&self, column: u32) -> [f64; 4] {
        let azimuth = |edge: u32| TAU * (f64::from(edge) / f64::from(self.width) - 0.5) - self.rotation_rad;
        [0.0, 1.0, 2.0, 3.0].map(|quarter| {
            let [from, to] = [column, column + 1].map(|edge| azimuth(edge) - quarter * FRAC_PI_2);
            cosine_integral(to) - cosine_integral(from)
        })
    }
}

/// Integral of `max(0, cos)` from 0 to `angle`.
fn cosine_integral(angle: f64) -> f64 {
    let turns = ((angle + PI) / TAU).floor();
    2.0 * turns + (angle - turns * TAU).clamp(-FRAC_PI_2, FRAC_PI_2).sin()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(width: u32, height: u32, radiance: impl Fn(u32, u32) -> f32, rotation_deg: f64) -> EnvironmentMap {
        let texels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let texels = texels.map(|(column, row)| Rgb::splat(radiance(column, row))).collect();
        EnvironmentMap::new(width, height, texels, rotation_deg.to_radians()).expect("a map")
    }

    #[test]
    fn an_even_map_is_an_even_sky() {
        for (width, height, rotation) in [(1, 1, 0.0), (2, 1, 30.0), (7, 5, 77.0), (64, 32, 0.0)] {
            let even = map(width, height, |_, _| 3.0, rotation);
            for irradiance in even.open_irradiance() {
                assert!((irradiance.x - 3.0 * PI).abs() < 1e-9, "{width} x {height}: {irradiance}");
            }
            let whole: f64 = (0..height).map(|row| even.solid_angle_sr(row) * f64::from(width)).sum();
            assert!((whole - 2.0 * TAU).abs() < 1e-9);
        }
    }

    #[test]
    fn columns_run_from_plus_x_in_the_middle_towards_plus_z() {
        let numbered = map(8, 4, |column, row| (8 * row + column) as f32, 0.0);
        let level = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            numbered.radiance(DVec3::new(cos, 0.1, sin).as_vec3().normalize_or_zero()).x
        };
        assert_eq!([level(1.0), level(91.0), level(181.0), level(271.0)], [12.0, 14.0, 8.0, 10.0]);
        assert_eq!(numbered.radiance(Vec3::Y).x as u32 / 8, 0);
        assert_eq!(numbered.radiance(Vec3::NEG_Y).x as u32 / 8, 3);
        // A quarter turn counter-clockwise, seen from above: what was at +X is at -Z.
        let turned = map(8, 4, |column, row| (8 * row + column) as f32, 90.0);
        let at = |x: f32, z: f32| turned.radiance(Vec3::new(x, 0.1, z).normalize_or_zero()).x;
        assert_eq!(at(0.01, -1.0), 12.0);
    }

    #[test]
    fn directions_lead_back_to_their_texel() {
        let any = map(16, 8, |_, _| 1.0, 33.0);
        for row in 0..8 {
            for column in 0..16 {
                for place in [(0.01, 0.01), (0.5, 0.5), (0.99, 0.99)] {
                    let direction = any.direction_in(column, row, place);
                    assert!((direction.length() - 1.0).abs() < 1e-5);
                    assert_eq!(any.texel_at(direction), (column, row));
                }
            }
        }
    }

    #[test]
    fn a_lit_band_brings_what_its_integral_says() {
        // Rows 0 and 1 of 6: the cap within 60 degrees of +Y. Up: pi sin^2(60). Sideways, over the cap's half:
        // integral of sin^2 = 60 degrees / 2 - sin(120) / 4, times two.
        let cap = map(4, 6, |_, row| if row < 2 { 1.0 } else { 0.0 }, 45.0);
        let [x, _, up, down, _, z] = cap.open_irradiance().map(|irradiance| irradiance.x);
        assert!((up - PI * 0.75).abs() < 1e-9 && down.abs() < 1e-12, "{up} {down}");
        let side = 2.0 * (PI / 6.0 - 0.75f64.sqrt() / 4.0);
        assert!((x - side).abs() < 1e-9 && (z - side).abs() < 1e-9, "{x} {z} for {side}");
    }

    #[test]
    fn texels_that_cannot_be_are_counted_and_placed() {
        let new = |bad: f32| {
            let mut texels = vec![Rgb::ONE; 8];
            (texels[5].y, texels[6].z) = (bad, bad);
            EnvironmentMap::new(4, 2, texels, 0.0)
        };
        assert_eq!(new(-1.0), Err(EnvironmentError::Negative { count: 2, column: 1, row: 1 }));
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(new(bad), Err(EnvironmentError::NotFinite { count: 2, column: 1, row: 1 }));
        }
        assert!(new(0.0).is_ok());
        assert!(matches!(
            EnvironmentMap::new(4, 3, vec![Rgb::ONE; 8], 0.0),
            Err(EnvironmentError::Size { .. })
        ));
    }
}
