//! Which patches' direct light may change when shadow casters come or go: those with a shadow ray that can meet their box.
//!
//! Conservative: a patch is a ball, casters are their box. What is let pass is not traced again, so a wrong "no" here would be
//! an old shadow for ever; the test holds it against traced rays.

use crate::direct::ShadowCasters;
use earthshine_light::may_reach;
use earthshine_world::{Bounds, Light, Vec3};

/// Pairs of a change and a light that are looked at for each patch; beyond that all count as touched.
const PAIRS_MAX: usize = 128;

/// How far a patch's points lie from its centroid at most, in voxel edges: both are in one voxel, and its diagonal is 1.73.
const RADIUS_VOXELS: f32 = 1.75;

/// Changes of shadow casters, and the lights whose rays may meet them.
#[derive(Debug)]
pub(crate) struct ShadowReach<'a> {
    /// Nothing: there is too much to tell apart.
    pairs: Option<Vec<(Bounds, &'a Light)>>,
    radius_m: f32,
}

impl<'a> ShadowReach<'a> {
    /// Of what changed in `casters` after `generation`, for patches of voxels of `voxel_edge_m` under `lights`.
    pub(crate) fn of(
        casters: &ShadowCasters,
        generation: u64,
        lights: &'a [Light],
        voxel_edge_m: f32,
    ) -> Self {
        let radius_m = RADIUS_VOXELS * voxel_edge_m;
        let mut pairs = Vec::new();
        let Some(changes) = casters.changes_since(generation) else { return Self { pairs: None, radius_m } };
        for bounds in changes {
            // Casters between a lamp and what it lights are within the lamp's range and cone.
            pairs
                .extend(lights.iter().filter(|light| lights_up(light, bounds)).map(|light| (*bounds, light)));
            if pairs.len() > PAIRS_MAX {
                return Self { pairs: None, radius_m };
            }
        }
        Self { pairs: Some(pairs), radius_m }
    }

    /// Whether a shadow ray of the patch around `centre` may meet any of it.
    pub(crate) fn touches(&self, centre: Vec3) -> bool {
        let Some(pairs) = &self.pairs else { return true };
        pairs.iter().any(|(bounds, light)| may_meet(light, centre, self.radius_m, bounds))
    }
}

/// Where a lamp is and how far it reaches; nothing for the sun.
fn lamp(light: &Light) -> Option<(Vec3, f32)> {
    match *light {
        Light::Directional { .. } => None,
        Light::Point { position, range_m, .. } | Light::Spot { position, range_m, .. } => {
            Some((position, range_m.unwrap_or(f32::INFINITY)))
        }
    }
}

fn lights_up(light: &Light, bounds: &Bounds) -> bool {
    lamp(light).is_none_or(|(position, range_m)| bounds.distance(position) <= range_m)
        && may_reach(light, bounds.centre(), 0.5 * bounds.size().length())
}

/// How many of `lights` can reach a patch around `centre`.
pub(crate) fn light_count(lights: &[Light], centre: Vec3, voxel_edge_m: f32) -> usize {
    lights.iter().filter(|light| may_reach(light, centre, RADIUS_VOXELS * voxel_edge_m)).count()
}

/// Whether a ray from the ball of `radius_m` around `centre` to `light` can meet `bounds`.
fn may_meet(light: &Light, centre: Vec3, radius_m: f32, bounds: &Bounds) -> bool {
    match *light {
        Light::Directional { direction, angular_diameter_rad, .. } => {
            // The sun's rays spread: at the far end of the box by the tangent of its half angle.
            let spread = (0.5 * angular_diameter_rad).tan();
            let farthest_m = bounds.centre().distance(centre) + bounds.size().length();
            let is_wide = !(0.0..=1.0).contains(&spread);
            is_wide || meets(centre, -direction, f32::INFINITY, bounds, radius_m + spread * farthest_m)
        }
        Light::Point { position, .. } | Light::Spot { position, .. } => {
            may_reach(light, centre, radius_m) && meets(centre, position - centre, 1.0, bounds, radius_m)
        }
    }
}

/// Whether `from + t way`, `t` in `0..=end`, meets `bounds` grown by `margin_m`.
fn meets(from: Vec3, way: Vec3, end: f32, bounds: &Bounds, margin_m: f32) -> bool {
    let (mut first, mut last) = (0.0f32, end);
    for axis in 0..3 {
        let (low, high) =
            (bounds.min[axis] - margin_m - from[axis], bounds.max[axis] + margin_m - from[axis]);
        if way[axis].abs() < 1e-12 {
            if low > 0.0 || high < 0.0 {
                return false;
            }
            continue;
        }
        let (a, b) = (low / way[axis], high / way[axis]);
        first = first.max(a.min(b));
        last = last.min(a.max(b));
    }
    first <= last
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_light::{OccluderSet, Occluders, direct_irradiance};
    use earthshine_world::random::{Purpose, hash, unit_f32};
    use earthshine_world::{ChunkCoord, ChunkId, OccluderMesh, Rgb, SamplePoint};
    use std::sync::Arc;

    fn number(seed: u64, at: u64) -> f32 {
        unit_f32(hash(seed, Purpose::WorldShape, at, 0)) * 2.0 - 1.0
    }

    fn vector(seed: u64, at: u64) -> Vec3 {
        Vec3::new(number(seed, at), number(seed, at + 1), number(seed, at + 2))
    }

    fn light(seed: u64) -> Light {
        let (position, intensity) = (vector(seed, 10) * 20.0, Rgb::splat(1e4));
        let direction = vector(seed, 20).normalize_or(Vec3::Y);
        let range_m = seed.is_multiple_of(2).then_some(25.0);
        match seed % 3 {
            0 => Light::Directional { direction, illuminance: intensity, angular_diameter_rad: 0.3 },
            1 => Light::Point { position, intensity, range_m },
            _ => {
                let (inner_cone_rad, outer_cone_rad) = (0.5, 1.4);
                Light::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m }
            }
        }
    }

    /// Goal: whose light changes with a caster is never passed over, and not everybody is told. Method: random lights, patches of
    /// 16 points and plates; light with and without the plate, traced.
    #[test]
    fn no_change_of_light_is_passed_over() {
        let (mut changed, mut told) = (0u32, 0u32);
        const CASES: u64 = 3000;
        for seed in 0..CASES {
            let light = light(seed);
            let centre = vector(seed, 30) * 20.0;
            let point = |k: u64| SamplePoint {
                position: centre + vector(seed, 100 + 6 * k),
                normal: vector(seed, 103 + 6 * k).normalize_or(Vec3::Y),
            };
            let points: Vec<_> = (0..16).map(point).collect();
            let share = number(seed, 40).abs();
            let along = match lamp(&light) {
                Some((position, _)) => centre.lerp(position, share),
                None => centre + vector(seed, 20).normalize_or(Vec3::Y) * (-30.0 * share),
            };
            let middle = along + vector(seed, 43) * 12.0;
            let vertices: Vec<Vec3> = (0..3).map(|k| middle + vector(seed, 50 + 3 * k) * 6.0).collect();
            let mesh = OccluderMesh { vertices, triangles: vec![[0, 1, 2]], surfaces: vec![[0, 0, 0, 255]] };
            let occluders = Arc::new(Occluders::build(&mesh));
            let bounds = occluders.bounds();
            let mut with = OccluderSet::new();
            with.insert(ChunkId::new(0, ChunkCoord::ZERO), occluders);
            let lit = |set: &OccluderSet| direct_irradiance(set, &[light], &points, 1e-3, seed);
            let has_changed = lit(&with) != lit(&OccluderSet::new());
            let is_told = lights_up(&light, &bounds) && may_meet(&light, centre, RADIUS_VOXELS, &bounds);
            assert!(is_told || !has_changed, "case {seed}: {light:?} {centre} {bounds:?}");
            changed += u32::from(has_changed);
            told += u32::from(is_told);
        }
        assert!(changed > 80 && u64::from(told) < CASES * 3 / 4, "{changed} changed, {told} told");
    }

    /// Goal: a street of lamps without range costs what shines on a patch. Method: lamps 25 m apart and 10 m up, cones of 1.1 rad
    /// that end 19.6 m from their feet on the ground.
    #[test]
    fn lamps_count_where_their_cones_are() {
        let lamp = |x: i32| Light::Spot {
            position: Vec3::new(25.0 * x as f32, 10.0, 0.0),
            direction: Vec3::NEG_Y,
            intensity: Rgb::ONE,
            inner_cone_rad: 0.5,
            outer_cone_rad: 1.1,
            range_m: None,
        };
        let street: Vec<Light> = (-10..=10).map(lamp).collect();
        let count = |x: f32, y: f32| light_count(&street, Vec3::new(x, y, 0.0), 0.1);
        assert_eq!([count(0.0, 0.0), count(12.5, 0.0), count(0.0, 9.0), count(12.5, 20.0)], [1, 2, 1, 0]);
        assert_eq!(light_count(&street, Vec3::new(0.0, 9.5, 0.0), 4.0), 1, "within its patch's ball");
    }

    #[test]
    fn a_long_absence_counts_as_touched() {
        let mut casters = ShadowCasters::new(1, 0, 1.0);
        let mesh = OccluderMesh {
            vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            surfaces: vec![[0, 0, 0, 255]],
        };
        let occluders = Arc::new(Occluders::build(&mesh));
        let away = Vec3::new(500.0, 0.0, 0.0);
        let lamp = [Light::Point { position: away, intensity: Rgb::ONE, range_m: Some(9.0) }];
        for x in 0..1000 {
            casters.insert(ChunkId::new(0, ChunkCoord::new(x, 0, 0)), Arc::clone(&occluders));
        }
        let touches = |generation| ShadowReach::of(&casters, generation, &lamp, 1.0).touches(away);
        assert_eq!([touches(1000), touches(900), touches(3)], [false, false, true]);
    }
}
