//! Direct light of a patch as a surface near by sees it.
//!
//! A patch has one exitance, so the edge of a shadow is smeared over a voxel. Far away nobody notices; what lies next to
//! it receives the sun's light where there is none. The patch's sample points know better: each has shadow rays of
//! its own. A *viewer* sees their mean, each by how much of its view it takes: the form factor of a small disc,
//! `cos cos / (pi r^2 + A)`, as if nothing stood between the two. How much of the view the patch takes as a whole is not
//! asked here; the viewer's row knows that, with all that stands between.

use earthshine_world::{Barrier, DetailVoxel, Grid, ReceiverPlace, Rgb, SamplePoint, Vec3};
use std::f32::consts::PI;

/// Most points that a viewer looks from.
const EYES_MAX: usize = 4;

/// Below this share of a viewer's row a patch is far enough for its mean: on Sponza 0.004 gives up a fifth of what the
/// median gains, and less than this hardly anything is left.
pub const NEAR_SHARE_MIN: f32 = 0.001;

/// How far off its surface a point is taken to lie when its detail voxel is looked for, in voxel edges, as in the bake.
const OFF_SURFACE: f32 = 1e-3;

/// Planes lean from their direction by less: the cosine of a diagonal is 0.58.
const AXIS_COSINE_MIN: f32 = 0.1;

/// Points whose normal differs from a plane's by more than this cosine, or that lie further off it than this share of a
/// detail voxel's edge, lie in another layer.
const ALIKE_COSINE: f32 = 0.9;
const IN_PLANE: f32 = 0.2;

/// How far before a barrier a viewer without points of its own looks from where its middle lies beyond it, in detail voxel edges.
const BEFORE_BARRIER: f32 = 0.05;

/// Of a patch: direct irradiance on its sample points, where they differ.
#[derive(Debug, Clone, Copy)]
pub struct NearPatch<'a> {
    /// Its sample points.
    pub points: &'a [SamplePoint],
    /// On each of them, lx.
    pub irradiance: &'a [Rgb],
}

/// A layer of the surfaces in a detail voxel, looking out.
#[derive(Debug, Clone)]
pub struct Viewer {
    eyes: Vec<SamplePoint>,
    /// Of each eye's part of the surface, m2.
    area: f32,
}

impl Viewer {
    /// What lies in layer and part `detail` of the patch at `place`, one of `per_edge` along an edge, of the patch's points `own`.
    #[must_use]
    pub fn new(
        place: &ReceiverPlace,
        detail: DetailVoxel,
        per_edge: u32,
        grid: &Grid,
        own: &[SamplePoint],
    ) -> Self {
        let edge_m = grid.voxel_edge_m / per_edge as f32;
        let voxel = detail.coord(place.voxel, per_edge);
        let low = place.voxel * per_edge.cast_signed();
        let (normal, distance) = (detail.plane.unit_normal(), detail.plane.middle_distance() * edge_m);
        let middle = (voxel.as_vec3() + 0.5) * edge_m;
        let is_inside = |point: &&SamplePoint| {
            let off_surface = point.normal * (OFF_SURFACE * grid.voxel_edge_m);
            let at = ((point.position + off_surface) / edge_m).floor().as_ivec3();
            at.clamp(low, low + (per_edge.cast_signed() - 1)) == voxel
        };
        let is_in_plane = |point: &&SamplePoint| {
            let off_plane = ((point.position - middle).dot(normal) - distance).abs();
            point.normal.dot(normal) > ALIKE_COSINE && off_plane < IN_PLANE * edge_m
        };
        let is_own_side = |point: &&SamplePoint| {
            let from_middle = (point.position - middle) / edge_m;
            let is_before = |barrier: &Barrier| {
                barrier.towards(place.direction).dot(from_middle) <= barrier.middle_distance()
            };
            detail.barriers.iter().flatten().all(is_before)
        };
        let inside = || own.iter().filter(is_inside).filter(is_in_plane).filter(is_own_side);
        let step = inside().count().div_ceil(EYES_MAX).max(1);
        let mut eyes: Vec<SamplePoint> = inside().step_by(step).copied().collect();
        if eyes.is_empty() {
            // Along the axis of the direction, which no barrier asks about.
            let axis = place.direction.vector();
            let in_plane = |position: Vec3| {
                let off = distance - (position - middle).dot(normal);
                position + axis * (off / normal.dot(axis).max(AXIS_COSINE_MIN))
            };
            let before = |position: Vec3, barrier: &Barrier| {
                let towards = barrier.towards(place.direction);
                let beyond = towards.dot((position - middle) / edge_m) - barrier.middle_distance();
                let step = towards * (beyond + BEFORE_BARRIER) * edge_m;
                if beyond > 0.0 { in_plane(position - step) } else { position }
            };
            // Twice: moving back from the second may cross the first.
            let both = || detail.barriers.iter().flatten();
            let position = both().chain(both()).fold(middle + normal * distance, before);
            eyes.push(SamplePoint { position, normal });
        }
        let area = edge_m * edge_m / eyes.len() as f32;
        Self { eyes, area }
    }

    /// Mean direct irradiance on what it sees of `patch`, lx; nothing where it faces none of the points.
    ///
    /// Costs an evaluation for each pair of an eye (four at most) and a point.
    #[must_use]
    pub fn sees(&self, patch: NearPatch<'_>) -> Option<Rgb> {
        let (mut sum, mut total) = (Rgb::ZERO, 0.0);
        for eye in &self.eyes {
            for (point, &irradiance) in patch.points.iter().zip(patch.irradiance) {
                let weight = self.weight(eye, point);
                sum += weight * irradiance;
                total += weight;
            }
        }
        (total > f32::MIN_POSITIVE).then(|| sum / total)
    }

    fn weight(&self, eye: &SamplePoint, point: &SamplePoint) -> f32 {
        let way: Vec3 = point.position - eye.position;
        let squared = way.length_squared();
        let facing = way.dot(eye.normal).max(0.0) * (-way.dot(point.normal)).max(0.0);
        if facing > 0.0 { facing / (squared * (PI * squared + self.area)) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::{Direction, SurfacePlane, VoxelCoord};
    use glam::IVec3;

    const GRID: Grid = Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 4 };

    fn wall() -> ReceiverPlace {
        ReceiverPlace::in_air(VoxelCoord::ZERO, Direction::PosX)
    }

    fn viewer(own: &[SamplePoint]) -> Viewer {
        let plane = SurfacePlane::new(Vec3::X, -0.5);
        Viewer::new(&wall(), DetailVoxel::new(IVec3::ZERO, 0, plane), 2, &GRID, own)
    }

    /// Points all over a floor of one square metre that begins at a wall at x = 0.
    fn floor() -> Vec<SamplePoint> {
        let middle = |i: usize| (i as f32 + 0.5) / 16.0;
        (0..256)
            .map(|i| SamplePoint {
                position: Vec3::new(middle(i % 16), 0.0, middle(i / 16)),
                normal: Vec3::Y,
            })
            .collect()
    }

    /// Goal: what lies at the wall's foot counts as much as the wall sees of it. Method: half of a floor is bright, that at the
    /// wall; which share of the view of a part of the wall that is, by the double integral of `cos cos / r^2` over both.
    #[test]
    fn a_wall_sees_most_of_what_lies_at_its_foot() {
        let eye = |i: usize| SamplePoint {
            position: Vec3::new(0.0, 0.125 + 0.25 * (i % 2) as f32, 0.125 + 0.25 * (i / 2) as f32),
            normal: Vec3::X,
        };
        let (eyes, points): (Vec<_>, _) = ((0..4).map(eye).collect(), floor());
        let near: Vec<Rgb> =
            points.iter().map(|point| Rgb::splat(if point.position.x < 0.5 { 1.0 } else { 0.0 })).collect();
        let seen = viewer(&eyes).sees(NearPatch { points: &points, irradiance: &near }).expect("it faces it");
        let middle = |i: u32, steps: u32| (f64::from(i) + 0.5) / f64::from(steps);
        let (mut of_half, mut of_all) = (0.0f64, 0.0f64);
        for i in 0..64 * 64 {
            let (x, z) = (middle(i % 64, 64), middle(i / 64, 64));
            for j in 0..16 * 16 {
                let (y, along) = (0.5 * middle(j % 16, 16), z - 0.5 * middle(j / 16, 16));
                let factor = x * y / (x * x + y * y + along * along).powi(2);
                of_all += factor;
                of_half += if x < 0.5 { factor } else { 0.0 };
            }
        }
        let expected = of_half / of_all;
        // The discs that eyes are taken for flatten what lies nearest.
        assert!((f64::from(seen.x) - expected).abs() < 0.05, "{} for {expected}", seen.x);
        assert!(seen.x > 0.6, "{}: more than the mean of a half", seen.x);
    }

    #[test]
    fn even_light_is_seen_as_it_is_and_what_turns_away_not_at_all() {
        let points = floor();
        let even = vec![Rgb::new(1.0, 2.0, 3.0); points.len()];
        let seen = viewer(&[]).sees(NearPatch { points: &points, irradiance: &even }).expect("it faces it");
        assert!((seen - even[0]).length() < 1e-5, "{seen}");
        let away: Vec<SamplePoint> =
            points.iter().map(|point| SamplePoint { normal: Vec3::NEG_Y, ..*point }).collect();
        assert!(viewer(&[]).sees(NearPatch { points: &away, irradiance: &even }).is_none());
        let itself = [SamplePoint { position: Vec3::new(0.0, 0.25, 0.25), normal: Vec3::X }];
        let light = [Rgb::ONE];
        assert!(viewer(&itself).sees(NearPatch { points: &itself, irradiance: &light }).is_none());
    }

    #[test]
    fn eyes_are_the_points_in_the_detail_voxel_or_its_middle() {
        let at = |y: f32, z: f32| SamplePoint { position: Vec3::new(0.0, y, z), normal: Vec3::X };
        let inside: Vec<SamplePoint> = (0..9).map(|i| at(0.05 * i as f32, 0.2)).collect();
        let own = [&inside[..], &[at(0.7, 0.2), at(0.2, 0.7)]].concat();
        let found = viewer(&own);
        assert!(
            (2..=EYES_MAX).contains(&found.eyes.len()) && found.eyes.iter().all(|eye| inside.contains(eye))
        );
        let middle = viewer(&own[9..]).eyes;
        let [middle] = middle[..] else { panic!("{middle:?}") };
        // Half a step of a plane's distance.
        assert!(middle.position.distance(at(0.25, 0.25).position) < 0.5 * 0.5 * 3f32.sqrt() / 254.0 + 1e-6);
        assert_eq!(middle.normal, Vec3::X);
    }

    #[test]
    fn eyes_lie_in_the_layer_s_own_plane() {
        let points = |x: f32, normal: Vec3| {
            (0..4).map(move |i| SamplePoint {
                position: Vec3::new(x, 0.1 + 0.1 * (i % 2) as f32, 0.1 + 0.1 * (i / 2) as f32),
                normal,
            })
        };
        let slanted = Vec3::new(0.6, 0.8, 0.0);
        let own: Vec<SamplePoint> =
            points(0.05, Vec3::X).chain(points(0.4, Vec3::X)).chain(points(0.05, slanted)).collect();
        // Two detail voxels along an edge of one metre.
        let layer = |plane| {
            let detail = DetailVoxel::new(IVec3::ZERO, 0, plane);
            Viewer::new(&wall(), detail, 2, &GRID, &own).eyes
        };
        assert_eq!(layer(SurfacePlane::new(Vec3::X, -0.4)), own[..4]);
        assert_eq!(layer(SurfacePlane::new(Vec3::X, 0.3)), own[4..8]);
        let found = layer(SurfacePlane::new(slanted, -0.4));
        assert!(!found.is_empty() && found.iter().all(|eye| own[8..].contains(eye)));
    }

    /// Goal: nothing of a wall's other side is looked from. Method: a surface whose points lie on both sides of a barrier, and
    /// one that has none before it, whose middle lies beyond.
    #[test]
    fn eyes_lie_before_the_layer_s_barriers() {
        let own: Vec<SamplePoint> = (0..8)
            .map(|i| SamplePoint { position: Vec3::new(0.0, 0.03 + 0.06 * i as f32, 0.25), normal: Vec3::X })
            .collect();
        let plane = SurfacePlane::new(Vec3::X, -0.5);
        let eyes = |towards: Vec3, distance: f32, own: &[SamplePoint]| {
            let barrier = Barrier::new(Direction::PosX, towards, distance);
            let detail = DetailVoxel { barriers: [barrier, None], ..DetailVoxel::new(IVec3::ZERO, 0, plane) };
            Viewer::new(&wall(), detail, 2, &GRID, own).eyes
        };
        // The middle is at y = 0.25, the barrier at 0.15: a fifth of an edge below it.
        let below = eyes(Vec3::Y, -0.2, &own);
        assert!(!below.is_empty() && below.iter().all(|eye| own[..2].contains(eye)), "{below:?}");
        let above = eyes(Vec3::NEG_Y, 0.2, &own);
        assert!(!above.is_empty() && above.iter().all(|eye| own[2..].contains(eye)), "{above:?}");
        let [only] = eyes(Vec3::Y, -0.2, &own[2..])[..] else { panic!("the middle stands for it") };
        assert!(only.position.y < 0.15 && only.position.y > 0.1, "{}", only.position);
        // On a slanted plane, and in a corner.
        let plane = SurfacePlane::new(Vec3::new(1.0, 1.0, 0.0).normalize_or(Vec3::X), 0.1);
        let barriers = [(Vec3::Y, -0.3), (Vec3::NEG_Z, 0.2)]
            .map(|(towards, distance)| Barrier::new(Direction::PosX, towards, distance));
        let detail = DetailVoxel { barriers, ..DetailVoxel::new(IVec3::ZERO, 0, plane) };
        let [only] = Viewer::new(&wall(), detail, 2, &GRID, &[]).eyes[..] else {
            panic!("one stands for it")
        };
        let from_middle = (only.position - 0.25) / 0.5;
        let off = from_middle.dot(plane.unit_normal()) - plane.middle_distance();
        assert!(off.abs() < 1e-4 && from_middle.y < -0.3 && from_middle.z > -0.2, "{from_middle}: {off}");
    }
}
