//! Fans on a device against their CPU twins: the rays that are made of them (`trace::RayFan::query`), and what these face
//! (`trace::ends::face_fans`), from all over a scene, with triangles that are left to the host and such without a back.
//!
//! A device's own sines are coarse, so the kernel has others: rays may differ in the last bits only. What they face is the
//! same but where such a ray passes an edge.

use crate::asked::{device_or_skip, fan_words, generated, sides};
use earthshine_gen::WorldKind;
use earthshine_gpu::ends::{Faced, GpuEnds};
use earthshine_scene::Scene;
use earthshine_trace::ends::{EndTriangle, FacedRays, face_fans};
use earthshine_trace::{RUN_UP_M, RayFan, SceneTracer};
use earthshine_world::random::{Purpose, hash, unit_f32, unit_pair};
use earthshine_world::{AxisWeights, Vec3};

/// By which a part of a unit direction may be off.
const DIRECTION_ROUNDING: f32 = 6e-7;
/// Of all rays, those that may face something else.
const ELSEWHERE_MAX: f64 = 2e-3;

/// What gets as far meets nothing.
const FAR_M: f32 = 1e6;

/// Fans in front of random triangles, on either side, of 0 to 40 rays, some of 512.
fn fans(scene: &Scene, count: u64) -> Vec<RayFan> {
    let one = |index: u64| {
        let draw = |part: u64| hash(23, Purpose::Simulation, index, part);
        let triangle = (draw(0) % scene.triangles.len().max(1) as u64) as usize;
        let [a, b, c] = scene.triangles[triangle];
        let (u, v) = unit_pair(draw(1));
        let position = a + (b - a) * (u * (1.0 - v)) + (c - a) * (u * v);
        let side = if draw(2) & 1 == 0 { 1.0 } else { -1.0 };
        let normal = scene.normal(triangle) * side;
        RayFan {
            origin: position + normal * 1e-3,
            normal,
            shift: unit_pair(draw(3)),
            first_pair: draw(4) as u32,
            ray_count: if index.is_multiple_of(50) { 512 } else { (draw(5) % 41) as u32 },
        }
    };
    (0..count).map(one).collect()
}

#[test]
fn fans_are_made_and_faced_as_on_the_cpu() {
    let Some(device) = device_or_skip() else { return };
    for (kind, near_m) in [(WorldKind::Cornell, 0.3), (WorldKind::Town, 4.0)] {
        let scene = generated(kind, 1, 60.0);
        let tracer = SceneTracer::new(&scene);
        let chance = |at: usize, part: u64| unit_f32(hash(29, Purpose::Simulation, at as u64, part));
        let triangle = |at: usize| {
            let weights = AxisWeights::Squared.of(scene.normal(at)).map(|(_, weight)| weight);
            let is_two_sided = chance(at, 0) < 0.3;
            EndTriangle { is_two_sided, ..EndTriangle::new(scene.normal(at), weights, chance(at, 1) < 0.1) }
        };
        let triangles: Vec<EndTriangle> = (0..scene.triangles.len()).map(triangle).collect();
        let sides = sides(&triangles);
        let mut ends = GpuEnds::new(&device, &tracer.layout(), &sides, 1 << 16).expect("trees that fit");
        for count in [0, 1, 63, 64, 65, 1500] {
            let fans = fans(&scene, count);
            let asked = fan_words(&fans);
            let made = ends.made(&asked).expect("a device that works");
            let expected: Vec<_> =
                fans.iter().flat_map(|fan| (0..fan.ray_count).map(|ray| fan.query(ray))).collect();
            assert_eq!(made.len(), expected.len());
            let mut off_most = 0.0f32;
            for (made, expected) in made.iter().zip(&expected) {
                let (origin, direction, from_m, to_m) = expected.as_asked();
                let off = (Vec3::from(made.direction) - direction).abs().max_element();
                off_most = off_most.max(off);
                assert!(off <= DIRECTION_ROUNDING, "{kind:?}: {made:?} for {expected:?}");
                let room = RUN_UP_M * off + f32::EPSILON * origin.abs().max_element();
                assert!((Vec3::from(made.origin) - origin).abs().max_element() <= room, "{made:?}");
                assert_eq!((made.distance_min_m, made.distance_max_m), (from_m, to_m));
            }
            let faced = ends.face(&asked, near_m).expect("a device that works");
            assert_eq!(faced, ends.face(&asked, near_m).expect("a device that works"), "the same again");
            let twin = face_fans(&tracer, &triangles, &fans, near_m);
            assert_eq!(faced.len(), twin.len());
            let (mut elsewhere, mut sums) = (0, [0; 3]);
            for (Faced { back, near, for_host, reach_m }, other) in faced.iter().zip(twin) {
                let FacedRays { back: b, near: n, for_host: h, reach_m: reach } = other;
                let is_same =
                    (reach_m.min(FAR_M) - reach.min(FAR_M)).abs() <= 1e-4 * (1.0 + reach.min(FAR_M));
                elsewhere += u32::from(!is_same);
                elsewhere += back.abs_diff(b) + near.abs_diff(n) + for_host.abs_diff(h);
                sums = [sums[0] + b, sums[1] + n, sums[2] + h];
            }
            let rays = expected.len();
            println!(
                "{kind:?}: {rays} rays, off by {off_most:.1e} at most; {sums:?} back, near, host's; {elsewhere} elsewhere"
            );
            assert!(f64::from(elsewhere) <= ELSEWHERE_MAX * rays as f64, "{kind:?}: {elsewhere} elsewhere");
            assert!(count < 1000 || sums.iter().all(|&sum| sum > 100), "{kind:?}: {sums:?}");
        }
    }
}
