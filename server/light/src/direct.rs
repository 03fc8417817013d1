//! Direct irradiance of a patch: the mean over its sample points, each with its own shadow rays.
//!
//! Pure and single-threaded: the engine decides which patches, when, and on which thread.

use crate::arrival::{arrival, may_reach};
use crate::occluder_set::OccluderSet;
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Asked, Light, Rgb, SamplePoint, Vec3};

/// The golden ratio's turn: with radii in equal steps of area, the points form Vogel's spiral, which covers a disc
/// evenly with any number of points.
pub const GOLDEN_TURN: f32 = 0.618_034;

/// Mean irradiance from `lights` over `points`, lx, with shadows by `occluders`.
///
/// Points stand for equal shares of the patch, so this is the plain mean; none at all give zero.
/// A point is moved `epsilon_m` along its normal before it looks, and a lamp that sits on a surface is
/// asked for from `epsilon_m` short of it: the surface under either casts no shadow on itself.
/// Each point sees the sun at its own place on the sun's disc, the same for the same `seed`.
#[must_use]
pub fn direct_irradiance(
    occluders: &OccluderSet,
    lights: &[Light],
    points: &[SamplePoint],
    epsilon_m: f32,
    seed: u64,
) -> Rgb {
    irradiance_by_point(occluders, lights, points, epsilon_m, seed, |_, _| ())
}

/// Irradiance on a patch, lx: the mean over its sample points, and that on each of them; nothing where all have the same, or
/// where nobody wants it.
pub type LitPatch = (Rgb, Box<[Rgb]>);

/// [`direct_irradiance`], and what it is the mean of.
#[must_use]
pub fn direct_irradiance_on(
    occluders: &OccluderSet,
    lights: &[Light],
    points: &[SamplePoint],
    epsilon_m: f32,
    seed: u64,
) -> LitPatch {
    let mut on_points = vec![Rgb::ZERO; points.len()];
    let each = |point: usize, light: Rgb| on_points[point] += light;
    let mean = irradiance_by_point(occluders, lights, points, epsilon_m, seed, each);
    (mean, told_apart(&on_points))
}

/// The light on points where it is not all the same, else nothing.
#[must_use]
pub fn told_apart(on_points: &[Rgb]) -> Box<[Rgb]> {
    let are_alike = on_points.windows(2).all(|pair| pair[0] == pair[1]);
    if are_alike { Box::default() } else { on_points.into() }
}

/// The mean; `each` is told what every light brings to every point.
fn irradiance_by_point(
    occluders: &OccluderSet,
    lights: &[Light],
    points: &[SamplePoint],
    epsilon_m: f32,
    seed: u64,
    mut each: impl FnMut(usize, Rgb),
) -> Rgb {
    let Some(first) = points.first() else { return Rgb::ZERO };
    let start = (first.position, first.position);
    let (low, high) =
        points.iter().fold(start, |(low, high), point| (low.min(point.position), high.max(point.position)));
    let (centre, radius_m) = (0.5 * (low + high), 0.5 * low.distance(high));
    let mut sum = Rgb::ZERO;
    let reaching = lights.iter().enumerate().filter(|(_, light)| may_reach(light, centre, radius_m));
    for (light_index, light) in reaching {
        let shift = disc_shift(seed, light_index, first.position);
        for (point_index, point) in points.iter().enumerate() {
            let disc = disc_place(shift, point_index, points.len());
            let arriving = shadowed(occluders, light, point, epsilon_m, disc);
            each(point_index, arriving);
            sum += arriving;
        }
    }
    sum / points.len() as f32
}

/// A patch whose direct light is asked for.
#[derive(Debug, Clone, Copy)]
pub struct PatchPoints<'a> {
    /// Equal shares of it.
    pub points: &'a [SamplePoint],
    /// How far off its surface shadow rays begin, m.
    pub epsilon_m: f32,
    /// Of the places on the sun's disc.
    pub seed: u64,
}

impl PatchPoints<'_> {
    /// Where its walk over the disc of light `light_index` begins: share of the area within, and turn.
    #[must_use]
    pub fn disc_shift(&self, light_index: usize) -> (f32, f32) {
        self.points.first().map_or((0.0, 0.0), |first| disc_shift(self.seed, light_index, first.position))
    }
}

/// Light that somebody was asked for; who drops it wants it no more.
pub trait LightUnderWay: Send + std::fmt::Debug {
    /// How it stands: light of the patches asked for, in order, is given once. Never waits.
    fn look(&mut self) -> Asked<Vec<LitPatch>>;
}

/// Lights many patches at once, elsewhere than on the CPU, without being waited for.
pub trait DirectLight: Send + std::fmt::Debug {
    /// Fewer points times lamps are left to the CPU: they are not worth the way. As many as there can be where there is no
    /// device.
    fn rays_min(&self) -> usize;

    /// Takes over the light of `patches`, to be as [`direct_irradiance_on`] has it, to rounding; a shadow's edge may pass a
    /// point on the other side. That on single points is told only if it is wanted. It is of `occluders` as they are now,
    /// whatever becomes of them. `None` is a refusal: no room, or no device any more.
    ///
    /// What is asked for first comes first.
    fn begin(
        &mut self,
        occluders: &OccluderSet,
        lights: &[Light],
        patches: &[PatchPoints<'_>],
        wants_points: bool,
    ) -> Option<Box<dyn LightUnderWay>>;
}

fn shadowed(
    occluders: &OccluderSet,
    light: &Light,
    point: &SamplePoint,
    epsilon_m: f32,
    disc: (f32, f32),
) -> Rgb {
    let from = point.position + point.normal * epsilon_m;
    let Some(found) = arrival(light, point.position, point.normal, disc) else { return Rgb::ZERO };
    // A lamp nearer than the epsilon has nothing in between that could be told apart from it.
    let reach = (found.distance_m - 2.0 * epsilon_m).max(0.0);
    found.irradiance * occluders.transmittance(from, found.towards, reach)
}

/// Where a patch's walk over the disc begins; the place is in it so that neighbours differ under one seed.
fn disc_shift(seed: u64, light_index: usize, place: Vec3) -> (f32, f32) {
    let [x, y, z] = place.to_array().map(|component| u64::from(component.to_bits()));
    unit_pair(hash(seed ^ z, Purpose::SunDisc, x << 32 | y, light_index as u64))
}

/// Share of the disc's area within, and turn around its centre: where point `point_index` of `count` looks.
fn disc_place(shift: (f32, f32), point_index: usize, count: usize) -> (f32, f32) {
    // Patches have tens of points; the fraction stays exact enough far beyond that.
    let step = point_index as f32;
    ((step + shift.0) / count as f32, (shift.1 + step * GOLDEN_TURN).fract())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::occluders::Occluders;
    use earthshine_world::{ChunkCoord, ChunkId, OccluderMesh};
    use std::sync::Arc;

    const EPSILON_M: f32 = 1e-4;

    /// A plate at height 1 over x < 0, and the ground at height 0.
    fn half_plate(opacity: u8) -> OccluderSet {
        let quad = |x0: f32, x1: f32, y: f32| {
            let edge = 50.0;
            vec![
                Vec3::new(x0, y, -edge),
                Vec3::new(x0, y, edge),
                Vec3::new(x1, y, edge),
                Vec3::new(x1, y, -edge),
            ]
        };
        let mut vertices = quad(-50.0, 0.0, 1.0);
        vertices.extend(quad(-50.0, 50.0, 0.0));
        let mesh = OccluderMesh {
            vertices,
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
            surfaces: vec![[0, 0, 0, opacity], [0, 0, 0, opacity], [0, 0, 0, 255], [0, 0, 0, 255]],
        };
        let mut set = OccluderSet::new();
        set.insert(ChunkId::new(0, ChunkCoord::ZERO), Arc::new(Occluders::build(&mesh)));
        set
    }

    fn ground(x: f32) -> SamplePoint {
        SamplePoint { position: Vec3::new(x, 0.0, 0.1), normal: Vec3::Y }
    }

    fn sun(angular_diameter_rad: f32) -> Light {
        Light::Directional { direction: Vec3::NEG_Y, illuminance: Rgb::splat(10.0), angular_diameter_rad }
    }

    #[test]
    fn a_plate_shadows_what_is_under_it_and_the_ground_does_not_shadow_itself() {
        let points = [ground(-0.5), ground(0.5), ground(1.5), ground(-1.5)];
        let at = |i: usize| direct_irradiance(&half_plate(255), &[sun(0.0)], &points[i..=i], EPSILON_M, 1).x;
        assert_eq!([at(0), at(1), at(2), at(3)], [0.0, 10.0, 10.0, 0.0]);
        let mean = direct_irradiance(&half_plate(255), &[sun(0.0)], &points, EPSILON_M, 1);
        assert!((mean.x - 5.0).abs() < 1e-6);
    }

    #[test]
    fn lamps_out_of_reach_change_no_bit() {
        let lamp = |x: f32| Light::Point {
            position: Vec3::new(x, 2.0, 0.1),
            intensity: Rgb::splat(100.0),
            range_m: Some(3.0),
        };
        let points: Vec<SamplePoint> = (0..20).map(|x| ground(0.1 * x as f32)).collect();
        let lights: Vec<Light> = (-40..40).map(|x| lamp(0.25 * x as f32)).chain([sun(0.01)]).collect();
        let occluders = half_plate(100);
        let one_by_one: Rgb = lights
            .iter()
            .enumerate()
            .map(|(index, light)| {
                let shift = disc_shift(7, index, points[0].position);
                let places = points.iter().enumerate();
                places
                    .map(|(at, point)| {
                        shadowed(&occluders, light, point, EPSILON_M, disc_place(shift, at, points.len()))
                    })
                    .fold(Rgb::ZERO, |sum, light| sum + light)
            })
            .fold(Rgb::ZERO, |sum, light| sum + light);
        let (low, high) = (points[0].position, points[19].position);
        let (centre, radius_m) = (0.5 * (low + high), 0.5 * low.distance(high));
        let near = lights.iter().filter(|light| may_reach(light, centre, radius_m));
        assert!((10..60).contains(&near.count()));
        let found = direct_irradiance(&occluders, &lights, &points, EPSILON_M, 7) * points.len() as f32;
        assert!((found - one_by_one).abs().max_element() <= 1e-4 * one_by_one.max_element(), "{found}");
    }

    #[test]
    fn a_mask_lets_its_share_through() {
        let found = direct_irradiance(&half_plate(51), &[sun(0.0)], &[ground(-0.5)], EPSILON_M, 1);
        assert!((found.x - 8.0).abs() < 1e-5, "{found}");
    }

    #[test]
    fn lamps_are_shadowed_only_by_what_is_nearer() {
        let lamp = |y: f32| Light::Point {
            position: Vec3::new(-1.0, y, 0.1),
            intensity: Rgb::splat(4.0),
            range_m: None,
        };
        let found = |y: f32| direct_irradiance(&half_plate(255), &[lamp(y)], &[ground(-1.0)], EPSILON_M, 1).x;
        assert!((found(0.5) - 16.0).abs() < 1e-3);
        assert_eq!(found(2.0), 0.0);
        assert!((found(1.0) - 4.0).abs() < 1e-3, "a lamp on the plate is not shadowed by it");
    }

    #[test]
    fn what_differs_between_points_is_told_and_its_mean_is_the_patch_s() {
        let points = [ground(-0.5), ground(0.5), ground(1.5), ground(-1.5)];
        let (set, lights) = (half_plate(255), [sun(0.0), sun(0.0)]);
        let (mean, on_points) = direct_irradiance_on(&set, &lights, &points, EPSILON_M, 1);
        assert_eq!(mean, direct_irradiance(&set, &lights, &points, EPSILON_M, 1));
        let lit: Vec<f32> = on_points.iter().map(|light| (light.x * 10.0).round() / 10.0).collect();
        assert_eq!(lit, [0.0, 20.0, 20.0, 0.0]);
        let (mean, same) = direct_irradiance_on(&set, &lights, &points[1..3], EPSILON_M, 1);
        assert!(mean.x > 19.0 && same.is_empty());
    }

    #[test]
    fn nothing_gives_nothing_and_lights_add() {
        let set = OccluderSet::new();
        assert_eq!(direct_irradiance(&set, &[sun(0.0)], &[], EPSILON_M, 1), Rgb::ZERO);
        assert_eq!(direct_irradiance(&set, &[], &[ground(0.0)], EPSILON_M, 1), Rgb::ZERO);
        let two = direct_irradiance(&set, &[sun(0.0), sun(0.0)], &[ground(0.0)], EPSILON_M, 1);
        assert!((two.x - 20.0).abs() < 1e-5);
    }

    #[test]
    fn a_penumbra_is_the_visible_share_of_the_disc() {
        // Straight under the plate's edge half of the disc shows; at x the chord at tan(angle) = x cuts it.
        let diameter = 0.4f32;
        let radius = (0.5 * diameter).tan();
        let set = half_plate(255);
        let lit = |offset: f32, points: usize, seed: u64| {
            let points = vec![ground(offset * radius); points];
            direct_irradiance(&set, &[sun(diameter)], &points, EPSILON_M, seed).x / 10.0
        };
        const SEEDS: u64 = 16;
        let mut squares = 0.0;
        // From full shadow through the whole penumbra into the open.
        for step in -6..=6 {
            let offset = step as f32 * 0.2;
            // Share of a circle on one side of a chord at `offset` radii.
            let chord = offset.clamp(-1.0, 1.0);
            let share = 0.5 + (chord.asin() + chord * (1.0 - chord * chord).sqrt()) / std::f32::consts::PI;
            let found = lit(offset, 4096, 3);
            assert!((found - share).abs() < 0.01, "offset {offset}: {found} for {share}");
            squares += (0..SEEDS).map(|seed| (lit(offset, 16, seed) - share).powi(2)).sum::<f32>();
        }
        // With as few points as a patch has; random places on the disc would be off by some 0.09.
        let spread = (squares / (13 * SEEDS) as f32).sqrt();
        assert!(spread < 0.05, "{spread}");
        let once = direct_irradiance(&half_plate(255), &[sun(diameter)], &[ground(0.01)], EPSILON_M, 3);
        assert_eq!(
            once,
            direct_irradiance(&half_plate(255), &[sun(diameter)], &[ground(0.01)], EPSILON_M, 3)
        );
    }
}
