//! An environment map as the six lobes that the service understands.
//!
//! With lobes `l`, radiance along `d` is `sum_a d_a^2 l_a` over the lobes faced, and a plane that faces axis `b` with
//! nothing in its way receives `E_b = pi/2 l_b + pi/8 * (the four lobes beside b)`, a 6 x 6 system. Written in sums
//! and differences of opposite sides, `S = E_b + E_-b` and `D = E_b - E_-b`, it falls apart:
//!
//! ```text
//! T = (sum of all E) / pi              sum of the six lobes
//! l_b + l_-b = 4 S / pi - T
//! l_b - l_-b = 2 D / pi
//! ```
//!
//! So the irradiance of the six axis planes is met exactly. Where a map is narrower than the lobes (a sun, a window),
//! some of them come out negative; then the nearest irradiances are taken that lobes of zero and more can bring with
//! the same `T`, so that the six planes together receive what they did. Both the share that was clamped and the
//! error of the light in other directions are told.

use crate::EnvironmentMap;
use earthshine_world::{Direction, Sky};
use glam::DVec3;
use std::f64::consts::PI;

/// What became of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyProjection {
    /// The lobes.
    pub sky: Sky,
    /// Negative lobes taken away, as a share of the sum of all (by luminance); 0 where none was negative.
    pub clamped_share: f64,
    /// Largest error of the luminance on the six axis planes, as a share of the mean of all planes.
    pub axes_error_rel: f64,
    /// Root mean square over planes facing all ways of the error of the luminance, as a share of their mean.
    pub error_rel: f64,
}

/// Linear RGB of Rec. 709 to luminance.
const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Steps towards the nearest lobes; each leaves three quarters of the way at most.
const STEPS: usize = 200;
/// Planes that the error is measured on.
const PLANES: usize = 128;
/// Most cells of the grid that light on those planes is summed from.
const CELLS: (u32, u32) = (64, 32);

/// Projects `map` on the six lobes.
#[must_use]
pub fn project(map: &EnvironmentMap) -> SkyProjection {
    let irradiances = map.open_irradiance();
    let mut lobes = [DVec3::ZERO; 6];
    let mut clamped = DVec3::ZERO;
    for channel in 0..3 {
        let wanted = irradiances.map(|irradiance| irradiance[channel]);
        let exact = exact_lobes(&wanted);
        clamped[channel] = exact.iter().map(|lobe| (-lobe).max(0.0)).sum();
        let kept = if clamped[channel] > 0.0 { nearest_lobes(exact, &wanted) } else { exact };
        for (lobe, kept) in lobes.iter_mut().zip(kept) {
            lobe[channel] = kept;
        }
    }
    let sky = Sky { lobes: lobes.map(|lobe| lobe.as_vec3()) };
    let total: DVec3 = lobes.iter().sum();
    let share = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 0.0 };
    let mean = total.dot(LUMINANCE) * PI / 6.0;
    let axes_error = Direction::ALL.map(|direction| {
        let found = sky.open_irradiance(direction).as_dvec3();
        (found - irradiances[direction.index()]).dot(LUMINANCE).abs()
    });
    SkyProjection {
        sky,
        clamped_share: share(clamped.dot(LUMINANCE), total.dot(LUMINANCE)),
        axes_error_rel: share(axes_error.into_iter().fold(0.0, f64::max), mean),
        error_rel: error_on_planes(map, &sky),
    }
}

/// The lobes that bring `wanted` to the six axis planes, of either sign.
fn exact_lobes(wanted: &[f64; 6]) -> [f64; 6] {
    let total = wanted.iter().sum::<f64>() / PI;
    let mut lobes = [0.0; 6];
    for axis in 0..3 {
        let (ahead, behind) = (wanted[2 * axis], wanted[2 * axis + 1]);
        let sum = 4.0 * (ahead + behind) / PI - total;
        let difference = 2.0 * (ahead - behind) / PI;
        lobes[2 * axis] = 0.5 * (sum + difference);
        lobes[2 * axis + 1] = 0.5 * (sum - difference);
    }
    // Of an even sky rounding may leave a hair below zero.
    let hair = 1e-12 * total;
    lobes.map(|lobe| if lobe.abs() < hair { 0.0 } else { lobe })
}

/// What `lobes` bring to the six axis planes.
fn irradiances(lobes: &[f64; 6]) -> [f64; 6] {
    let total: f64 = lobes.iter().sum();
    std::array::from_fn(|plane| {
        let beside = total - lobes[plane] - lobes[plane ^ 1];
        0.5 * PI * lobes[plane] + 0.125 * PI * beside
    })
}

/// Among lobes of zero and more with the sum of `exact`, those whose irradiances are nearest to `wanted`.
///
/// Projected gradient: within a fixed sum the system's eigenvalues lie between `pi/4` and `pi/2`, so a step of
/// `4 / pi^2` shortens the way to the one minimum by a quarter at least.
fn nearest_lobes(exact: [f64; 6], wanted: &[f64; 6]) -> [f64; 6] {
    let total: f64 = exact.iter().sum();
    let mut lobes = on_simplex(exact, total);
    for _ in 0..STEPS {
        let found = irradiances(&lobes);
        // The system is symmetric: its transpose is itself.
        let slope = irradiances(&std::array::from_fn(|plane| found[plane] - wanted[plane]));
        let step = 4.0 / (PI * PI);
        lobes = on_simplex(std::array::from_fn(|lobe| lobes[lobe] - step * slope[lobe]), total);
    }
    lobes
}

/// The point nearest to `values` with no part below zero and the sum `total`.
fn on_simplex(values: [f64; 6], total: f64) -> [f64; 6] {
    let mut sorted = values;
    sorted.sort_by(|a, b| b.total_cmp(a));
    let mut sum = 0.0;
    let mut excess = 0.0;
    for (index, value) in sorted.into_iter().enumerate() {
        sum += value;
        let shared = (sum - total) / (index + 1) as f64;
        if value > shared {
            excess = shared;
        }
    }
    values.map(|value| (value - excess).max(0.0))
}

/// A patch of sky, small against a lobe.
struct Cell {
    towards: DVec3,
    solid_angle_sr: f64,
    /// Luminance of the map times the solid angle.
    flux: f64,
}

fn cells(map: &EnvironmentMap) -> Vec<Cell> {
    let (wide, high) = (CELLS.0.min(map.width()), CELLS.1.min(map.height()));
    let empty = || Cell { towards: DVec3::ZERO, solid_angle_sr: 0.0, flux: 0.0 };
    let mut cells: Vec<Cell> = (0..wide * high).map(|_| empty()).collect();
    for row in 0..map.height() {
        let solid_angle_sr = map.solid_angle_sr(row);
        let first = u64::from(row) * u64::from(high) / u64::from(map.height()) * u64::from(wide);
        for column in 0..map.width() {
            let place = first + u64::from(column) * u64::from(wide) / u64::from(map.width());
            let cell = &mut cells[place as usize];
            cell.towards += map.direction_in(column, row, (0.5, 0.5)).as_dvec3() * solid_angle_sr;
            cell.solid_angle_sr += solid_angle_sr;
            cell.flux += map.texel(column, row).as_dvec3().dot(LUMINANCE) * solid_angle_sr;
        }
    }
    cells.iter_mut().for_each(|cell| cell.towards = cell.towards.normalize_or(DVec3::Y));
    cells
}

fn error_on_planes(map: &EnvironmentMap, sky: &Sky) -> f64 {
    let cells = cells(map);
    let of_sky = |cell: &Cell| sky.radiance(cell.towards.as_vec3()).as_dvec3().dot(LUMINANCE);
    let projected: Vec<f64> = cells.iter().map(|cell| of_sky(cell) * cell.solid_angle_sr).collect();
    let (mut squares, mut sum) = (0.0, 0.0);
    for plane in 0..PLANES {
        let normal = fibonacci(plane);
        let (mut right, mut found) = (0.0, 0.0);
        for (cell, projected) in cells.iter().zip(&projected) {
            let cosine = normal.dot(cell.towards).max(0.0);
            right += cell.flux * cosine;
            found += projected * cosine;
        }
        squares += (found - right).powi(2);
        sum += right;
    }
    let mean = sum / PLANES as f64;
    if mean > 0.0 { (squares / PLANES as f64).sqrt() / mean } else { 0.0 }
}

/// The directions of a Fibonacci spiral: even over the sphere.
fn fibonacci(index: usize) -> DVec3 {
    let y = 1.0 - (2.0 * index as f64 + 1.0) / PLANES as f64;
    let radius = (1.0 - y * y).sqrt();
    let (sin, cos) = (index as f64 * PI * (3.0 - 5f64.sqrt())).sin_cos();
    DVec3::new(radius * cos, y, radius * sin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::{Rgb, Vec3};

    fn map(width: u32, height: u32, radiance: impl Fn(Vec3) -> Rgb) -> EnvironmentMap {
        let even = EnvironmentMap::new(width, height, vec![Rgb::ONE; (width * height) as usize], 0.0);
        let even = even.expect("a map");
        let places = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let texel = |(column, row)| radiance(even.direction_in(column, row, (0.5, 0.5)));
        EnvironmentMap::new(width, height, places.map(texel).collect(), 0.0).expect("a map")
    }

    #[test]
    fn a_constant_map_is_a_constant_sky() {
        let radiance = Rgb::new(1.0, 20.0, 300.0);
        let found = project(&map(32, 16, |_| radiance));
        for lobe in found.sky.lobes {
            assert!((lobe - radiance).length() < 1e-4, "{lobe}");
        }
        assert_eq!(found.clamped_share, 0.0);
        assert!(found.error_rel < 1e-6 && found.axes_error_rel < 1e-6, "{found:?}");
    }

    #[test]
    fn what_the_lobes_can_hold_comes_back() {
        let sky = Sky { lobes: [1.0, 2.0, 4.0, 0.5, 3.0, 0.25].map(|lobe| Rgb::new(lobe, 2.0 * lobe, 1.0)) };
        let found = project(&map(256, 128, |direction| sky.radiance(direction)));
        for (found, sent) in found.sky.lobes.iter().zip(sky.lobes) {
            assert!((*found - sent).length() < 2e-3 * sent.length(), "{found} for {sent}");
        }
        assert_eq!(found.clamped_share, 0.0);
        assert!(found.error_rel < 1e-3 && found.axes_error_rel < 1e-5, "{found:?}");
    }

    #[test]
    fn a_smooth_sky_is_exact_on_the_axes_and_close_between() {
        let found = project(&map(128, 64, |d| Rgb::splat(1.0 + 0.6 * d.y + 0.3 * d.x)));
        assert_eq!(found.clamped_share, 0.0);
        assert!(found.axes_error_rel < 1e-6 && found.error_rel < 0.02, "{found:?}");
    }

    /// Light above, none below, by hand: of the exact lobes the one below is -1/2 in a sum of 3. Without it the
    /// nearest are 19/11 above and 7/22 at the sides.
    #[test]
    fn a_sky_over_black_ground_is_clamped_as_worked_out() {
        let found = project(&map(64, 32, |d| if d.y > 0.0 { Rgb::ONE } else { Rgb::ZERO }));
        assert!((found.clamped_share - 1.0 / 6.0).abs() < 1e-9, "{found:?}");
        for (lobe, expected) in found.sky.lobes.iter().zip([7.0 / 22.0, 7.0 / 22.0, 19.0 / 11.0, 0.0]) {
            assert!((lobe.x - expected).abs() < 1e-5, "{found:?}");
        }
        // Most is off where nothing should come from: below, pi * 7/44 of a mean of pi / 2.
        assert!((found.axes_error_rel - 7.0 / 22.0).abs() < 1e-5, "{found:?}");
        assert!((0.05..0.2).contains(&found.error_rel), "{found:?}");
    }

    #[test]
    fn a_narrow_light_is_clamped_keeps_its_sum_and_says_so() {
        let map = map(128, 64, |d| if d.y > 0.99 { Rgb::splat(1e4) } else { Rgb::ZERO });
        let found = project(&map);
        let wanted: f64 = map.open_irradiance().iter().map(|irradiance| irradiance.x).sum();
        let kept: f32 = Direction::ALL.iter().map(|&d| found.sky.open_irradiance(d).x).sum();
        assert!((f64::from(kept) / wanted - 1.0).abs() < 1e-5, "{kept} for {wanted}");
        assert!(found.sky.lobes.iter().all(|lobe| lobe.min_element() >= 0.0));
        assert!(found.clamped_share > 1.0 && found.error_rel > 0.2, "{found:?}");
        // By hand: of all skies with this sum, the zenith lobe alone is nearest.
        assert!(found.sky.lobes[2].x > 0.0 && found.sky.lobes[3].x < 1e-3 * found.sky.lobes[2].x);
    }

    #[test]
    fn clamped_lobes_are_the_nearest_of_all() {
        // Against every sky on a lattice of the same sum.
        let wanted = [3.0, 0.1, 1.0, 0.2, 0.3, 0.1];
        let exact = exact_lobes(&wanted);
        let brought = irradiances(&exact);
        assert!(brought.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12), "{brought:?}");
        assert!(exact.iter().any(|lobe| *lobe < 0.0));
        let total: f64 = exact.iter().sum();
        let distance = |lobes: &[f64; 6]| -> f64 {
            irradiances(lobes).iter().zip(wanted).map(|(found, wanted)| (found - wanted).powi(2)).sum()
        };
        let best = distance(&nearest_lobes(exact, &wanted));
        const PARTS: usize = 12;
        let mut parts = [0; 6];
        for code in 0..(PARTS + 1).pow(5) {
            let mut rest = code;
            for part in &mut parts[..5] {
                *part = rest % (PARTS + 1);
                rest /= PARTS + 1;
            }
            let sum: usize = parts[..5].iter().sum();
            if sum <= PARTS {
                parts[5] = PARTS - sum;
                let lobes = parts.map(|part| total * part as f64 / PARTS as f64);
                assert!(distance(&lobes) >= best - 1e-12, "{lobes:?}");
            }
        }
    }

    #[test]
    fn a_black_map_is_a_black_sky() {
        let found = project(&map(4, 2, |_| Rgb::ZERO));
        assert_eq!(
            found,
            SkyProjection { sky: Sky::default(), clamped_share: 0.0, axes_error_rel: 0.0, error_rel: 0.0 }
        );
    }
}
