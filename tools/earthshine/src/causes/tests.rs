//! Closed scenes whose errors have a known cause.

use super::{Cause, ExplainOptions, Explained, Explainer, rank};
use crate::volume_light;
use crate::whole_world::WholeWorld;
use earthshine_bake::{BakeOptions, Levels, Silent};
use earthshine_render::csv::ReferencePoint;
use earthshine_render::{ReferenceOptions, SceneTracer, irradiance_at_points};
use earthshine_scene::{Material, Scene};
use earthshine_tiles::{BakeParameters, RowCodec};
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Grid, LightRig, Rgb, Vec3};

fn material(reflectance: f32, radiance: f32) -> Material {
    Material { emitted_radiance: Rgb::splat(radiance), ..Material::grey("test", reflectance) }
}

/// Adds a parallelogram; its front is where `side x up` points.
fn quad(scene: &mut Scene, corner: Vec3, side: Vec3, up: Vec3, paint: Material) {
    let corners = [corner, corner + side, corner + side + up, corner + up];
    scene.materials.push(paint);
    for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
        scene.triangles.push([corners[a], corners[b], corners[c]]);
        scene.texture_coordinates.push([[0.0; 2]; 3]);
        scene.material_of.push(scene.materials.len() as u32 - 1);
    }
}

/// The inside of a box; `ceiling` emits.
fn room(scene: &mut Scene, low: Vec3, size: Vec3, radiance: f32) {
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    for (corner, side, up) in [(low, y, z), (low + x, z, y), (low, z, x), (low, x, y), (low + z, y, x)] {
        quad(scene, corner, side, up, material(0.5, 0.0));
    }
    quad(scene, low + y, x, z, material(0.5, radiance));
}

/// A grid of points on the floor at height `y`, `inset` from the edges of `low..high`.
fn floor_points([x0, z0]: [f32; 2], [x1, z1]: [f32; 2], y: f32, up: bool) -> Vec<(Vec3, Vec3)> {
    let normal = if up { Vec3::Y } else { Vec3::NEG_Y };
    (0..24)
        .map(|index| {
            let (u, v) = unit_pair(hash(11, Purpose::MeasurePoint, index, 0));
            (Vec3::new(x0 + (x1 - x0) * u, y, z0 + (z1 - z0) * v), normal)
        })
        .collect()
}

struct Outcome {
    explained: Vec<Explained>,
    /// Served light, as a reference without noise.
    served: Vec<ReferencePoint>,
}

/// Parameters for voxels of `voxel_edge_m`, without light in the air.
fn of_surfaces(voxel_edge_m: f32) -> BakeParameters {
    BakeParameters {
        receiver_reach_voxels: 0,
        grid: Grid { voxel_edge_m, chunk_edge_voxels: 16 },
        ..BakeParameters::default()
    }
}

fn baked(scene: &Scene, parameters: BakeParameters) -> WholeWorld {
    let folder = tempfile::tempdir().unwrap();
    let options = BakeOptions {
        codec: RowCodec::Full,
        levels: Levels::Exactly(1),
        ..BakeOptions::new("test", parameters, LightRig::emission_only())
    };
    earthshine_bake::bake(scene, folder.path(), &options, &Silent).unwrap();
    WholeWorld::load(folder.path()).unwrap()
}

fn explained(
    scene: &Scene,
    voxel_edge_m: f32,
    rays: u32,
    places: &[(Vec3, Vec3)],
    identical: bool,
) -> Outcome {
    let parameters = BakeParameters { rays_per_patch: rays, ..of_surfaces(voxel_edge_m) };
    explained_by(scene, parameters, places, identical)
}

fn explained_by(
    scene: &Scene,
    parameters: BakeParameters,
    places: &[(Vec3, Vec3)],
    identical: bool,
) -> Outcome {
    let rig = LightRig::emission_only();
    let world = baked(scene, parameters);
    let light = world.solve(&rig);
    let volumes = world.volumes(&light).unwrap();
    let tracer = SceneTracer::new(scene);
    let exact = ReferenceOptions { samples_max: 8192, target_error_rel: 0.0, ..ReferenceOptions::default() };
    let traced = irradiance_at_points(&tracer, &rig, places, &exact, &|| ());
    let point = |(position, normal): (Vec3, Vec3), irradiance: Rgb, standard_error: Rgb| ReferencePoint {
        position,
        normal,
        irradiance,
        standard_error,
    };
    let reference: Vec<_> = places
        .iter()
        .zip(&traced)
        .map(|(&place, found)| point(place, found.irradiance, found.standard_error))
        .collect();
    let served: Vec<_> = places
        .iter()
        .map(|&place| point(place, volume_light::at(&volumes, place.0, place.1).unwrap(), Rgb::ZERO))
        .collect();
    let explainer = Explainer::new(&world, &light, &volumes, &tracer, &rig, ExplainOptions::default());
    let explained = explainer.explain(if identical { &served } else { &reference }, &|| ()).unwrap();
    assert_eq!(explained.len(), places.len());
    for point in &explained {
        let sum = point.parts.total();
        assert!((sum - point.error()).abs() < 1e-4 * point.served.max(point.reference), "{point:?}");
    }
    Outcome { explained, served }
}

fn main_cause(outcome: &Outcome) -> Cause {
    let ranking = rank(&outcome.explained);
    let share = ranking.causes[0];
    assert!(share.squared_error_share > 0.6, "{:?}", ranking.causes);
    assert!((ranking.causes.iter().map(|c| c.squared_error_share).sum::<f64>() - 1.0).abs() < 1e-9);
    assert!((ranking.causes.iter().map(|c| c.part_of_squared_error).sum::<f64>() - 1.0).abs() < 1e-3);
    assert!((ranking.voxels.iter().map(|v| v.squared_error_share).sum::<f64>() - 1.0).abs() < 1e-9);
    assert!(ranking.points.windows(2).all(|p| p[0].squared_error_share >= p[1].squared_error_share));
    share.cause
}

/// Goal: what shares a detail voxel and a direction with something brighter keeps its own light. Method: a panel two
/// centimetres thick and four before a wall of a lit room, and the wall behind it, which face the same way in detail voxels
/// of 12.5 cm; a path tracer says what arrives at both.
#[test]
fn a_panel_and_the_dark_gap_behind_it() {
    const GAP_M: f32 = 0.04;
    const FRONT_M: f32 = 0.06;
    let mut scene = Scene::default();
    room(&mut scene, Vec3::ZERO, Vec3::splat(2.0), 100.0);
    let (up, across) = (Vec3::Y * 1.2, Vec3::Z * 1.2);
    quad(&mut scene, Vec3::new(FRONT_M, 0.4, 0.4), up, across, material(0.2, 0.0));
    quad(&mut scene, Vec3::new(GAP_M, 0.4, 0.4), across, up, material(0.2, 0.0));
    let places: Vec<(Vec3, Vec3)> = (0..16)
        .flat_map(|index| {
            let (u, v) = unit_pair(hash(7, Purpose::MeasurePoint, index, 0));
            [FRONT_M, 0.0].map(|x| (Vec3::new(x, 0.7 + 0.6 * u, 0.7 + 0.6 * v), Vec3::X))
        })
        .collect();
    let rig = LightRig::emission_only();
    let exact = ReferenceOptions { samples_max: 4096, target_error_rel: 0.0, ..ReferenceOptions::default() };
    let traced = irradiance_at_points(&SceneTracer::new(&scene), &rig, &places, &exact, &|| ());
    let world = baked(&scene, BakeParameters { detail: 4, ..of_surfaces(0.5) });
    let volumes = world.volumes(&world.solve(&rig)).unwrap();
    assert!(volumes.len() > 2, "layers: {} volumes", volumes.len());
    for (&(position, normal), expected) in places.iter().zip(&traced) {
        let (served, expected) =
            (volume_light::at(&volumes, position, normal).unwrap().x, expected.irradiance.x);
        let panel = 150.0;
        if position.x > 0.0 {
            assert!((served / expected - 1.0).abs() < 0.12, "panel {position}: {served} for {expected}");
            assert!(expected > 0.5 * panel);
        } else {
            assert!(expected < 0.02 * panel, "no gap: {expected}");
            assert!(served < 0.1 * panel, "gap {position}: {served} for {expected}");
        }
    }
}

#[test]
fn a_thin_wall_between_a_lit_and_a_dark_room() {
    let mut scene = Scene::default();
    let size = Vec3::new(1.98, 2.0, 2.0);
    room(&mut scene, Vec3::new(0.0, 0.0, 0.0), size, 100.0);
    room(&mut scene, Vec3::new(2.02, 0.0, 0.0), size, 1.0);
    // Within a voxel of the wall, in the dark room.
    let places = floor_points([2.05, 0.3], [2.3, 1.7], 0.0, true);
    let outcome = explained(&scene, 0.4, 512, &places, false);
    assert!(outcome.explained.iter().any(|point| point.served > 2.0 * point.reference), "the wall leaks");
    assert_eq!(main_cause(&outcome), Cause::ThinWall);
}

#[test]
fn rows_of_few_rays() {
    let mut scene = Scene::default();
    // Uneven light: one small bright ceiling panel's worth of wall, far from the floor's points.
    room(&mut scene, Vec3::ZERO, Vec3::splat(4.0), 100.0);
    let places = floor_points([0.8, 0.8], [3.2, 3.2], 0.0, true);
    assert_eq!(main_cause(&explained(&scene, 1.0, 8, &places, false)), Cause::TooFewRays);
}

#[test]
fn an_emitter_smaller_than_its_voxel() {
    let mut scene = Scene::default();
    room(&mut scene, Vec3::ZERO, Vec3::new(4.0, 0.5, 4.0), 0.0);
    // In the corner of a voxel of 1 m, a little above the floor.
    quad(&mut scene, Vec3::new(2.02, 0.01, 2.02), Vec3::Z * 0.2, Vec3::X * 0.2, material(0.5, 100.0));
    let places = floor_points([1.7, 1.7], [2.5, 2.5], 0.5, false);
    // Chunks so large have no numbers for patches of emitters apart: floor and lamp are one patch.
    let grid = Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 22 };
    let mixing = BakeParameters { grid, rays_per_patch: 4096, ..of_surfaces(1.0) };
    let outcome = explained_by(&scene, mixing, &places, false);
    let ranking = rank(&outcome.explained);
    let of = |cause: Cause| ranking.causes.iter().find(|share| share.cause == cause).unwrap();
    // Light above a small emitter changes within a voxel, and the emitter is smeared: both, and nothing else.
    let both = of(Cause::EmitterEdge).squared_error_share + of(Cause::VoxelDetail).squared_error_share;
    assert!(both > 0.8 && of(Cause::EmitterEdge).points > 0, "{:?}", ranking.causes);
}

#[test]
fn a_voxel_larger_than_the_detail() {
    let mut scene = Scene::default();
    // A wall that glows all over: light on the floor falls off within the first voxel.
    room(&mut scene, Vec3::ZERO, Vec3::new(4.0, 2.0, 4.0), 0.0);
    quad(&mut scene, Vec3::new(0.01, 0.0, 0.0), Vec3::Y * 2.0, Vec3::Z * 4.0, material(0.0, 100.0));
    let places = floor_points([0.05, 0.5], [1.0, 3.5], 0.0, true);
    assert_eq!(main_cause(&explained(&scene, 2.0, 4096, &places, false)), Cause::VoxelDetail);
}

/// The outside of a box.
fn block(scene: &mut Scene, low: Vec3, size: Vec3) {
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    for (corner, side, up) in
        [(low, z, y), (low + x, y, z), (low, x, z), (low + y, z, x), (low, y, x), (low + z, x, y)]
    {
        quad(scene, corner, side, up, material(0.5, 0.0));
    }
}

/// Goal: points under a block that were not left out are named where they darken the floor beside it. Method: a low block
/// that covers half of the floor's voxels around it, and a bake that leaves no point out.
#[test]
fn buried_points_that_were_left_in() {
    let mut scene = Scene::default();
    room(&mut scene, Vec3::ZERO, Vec3::new(4.0, 2.0, 4.0), 100.0);
    block(&mut scene, Vec3::new(1.5, 0.0, 1.5), Vec3::new(1.0, 0.1, 1.0));
    let places = floor_points([1.1, 1.6], [1.4, 2.4], 0.0, true);
    let keeping = BakeParameters { rays_per_patch: 1024, buried_rays: 0, ..of_surfaces(1.0) };
    let outcome = explained_by(&scene, keeping, &places, false);
    assert_eq!(main_cause(&outcome), Cause::HiddenPoints);
    let (served, reference, _) = means(&outcome);
    assert!(served < 0.9 * reference, "the floor is too dark: {served} lx for {reference}");
}

/// Goal: a direction without a patch near by is named where others stand in for it. Method: places on a floor that face a
/// bright wall far off; the floor's patches know what comes from above.
#[test]
fn a_direction_that_no_patch_near_by_has() {
    let mut scene = Scene::default();
    room(&mut scene, Vec3::ZERO, Vec3::new(4.0, 2.0, 4.0), 0.0);
    quad(&mut scene, Vec3::new(0.01, 0.0, 0.0), Vec3::Y * 2.0, Vec3::Z * 4.0, material(0.0, 100.0));
    let facing = Vec3::new(-0.9, 0.436, 0.0).normalize_or(Vec3::Y);
    let places = floor_points([1.5, 1.0], [2.5, 3.0], 0.0, true).into_iter().map(|(at, _)| (at, facing));
    let outcome = explained(&scene, 0.25, 1024, &places.collect::<Vec<_>>(), false);
    assert_eq!(main_cause(&outcome), Cause::LookupFallback);
    assert!(outcome.explained.iter().all(|point| point.served < point.reference));
}

/// Goal: where light in the air answers, its part of the error is named and the parts still add up. Method: a lamp above
/// places in mid-air that look up at it, slanted.
#[test]
fn light_in_the_air_that_is_too_coarse() {
    let mut scene = Scene::default();
    room(&mut scene, Vec3::ZERO, Vec3::new(4.0, 4.0, 4.0), 0.0);
    quad(&mut scene, Vec3::new(1.5, 3.9, 1.5), Vec3::X, Vec3::Z, material(0.5, 100.0));
    let facing = Vec3::new(0.4, 0.8, 0.45).normalize_or(Vec3::Y);
    let places = floor_points([1.2, 1.2], [2.8, 2.8], 2.9, true).into_iter().map(|(at, _)| (at, facing));
    let parameters = BakeParameters { rays_per_patch: 1024, receiver_reach_voxels: 4, ..of_surfaces(0.5) };
    let outcome = explained_by(&scene, parameters, &places.collect::<Vec<_>>(), false);
    assert!(outcome.explained.iter().all(|point| point.evidence.in_air));
    assert_eq!(main_cause(&outcome), Cause::Air);
}

/// A room lit by a lamp under its ceiling that touches a wall; a partition shades the other end.
fn lamp_and_partition() -> Scene {
    let mut scene = Scene::default();
    room(&mut scene, Vec3::ZERO, Vec3::new(4.0, 2.0, 4.0), 0.0);
    quad(&mut scene, Vec3::new(0.0, 1.98, 1.5), Vec3::X * 0.5, Vec3::Z, material(0.5, 100.0));
    let partition = Material { double_sided: true, ..material(0.5, 0.0) };
    quad(&mut scene, Vec3::new(3.2, 0.0, 0.0), Vec3::Z * 3.0, Vec3::Y * 2.0, partition);
    scene
}

/// Two dozen places that `at` spreads over a surface.
fn spread_over(at: impl Fn(f32, f32) -> Vec3, normal: Vec3) -> Vec<(Vec3, Vec3)> {
    let pair = |index| unit_pair(hash(13, Purpose::MeasurePoint, index, 0));
    (0..24).map(pair).map(|(u, v)| (at(u, v), normal)).collect()
}

/// Goal: a lamp that touches a wall is as right as others. Method: served light on the wall below it and on the ceiling
/// beside it, against the path tracer.
#[test]
fn a_lamp_that_touches_a_wall() {
    let scene = lamp_and_partition();
    let below = spread_over(|u, v| Vec3::new(0.0, 1.0 + 0.9 * u, 1.5 + v), Vec3::X);
    let beside = spread_over(|u, v| Vec3::new(0.05 + 0.4 * u, 2.0, 0.3 + v), Vec3::NEG_Y);
    let parameters = BakeParameters { detail: 2, ..of_surfaces(0.25) };
    let outcome = explained_by(&scene, parameters, &[below, beside].concat(), false);
    for (name, points) in [("below", &outcome.explained[..24]), ("beside", &outcome.explained[24..])] {
        let mut errors: Vec<f64> = points.iter().map(|p| (p.error() / p.reference).abs()).collect();
        errors.sort_by(f64::total_cmp);
        let sum = |of: fn(&Explained) -> f64| points.iter().map(of).sum::<f64>();
        let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
        let bias = sum(|p| p.served) / sum(|p| p.reference) - 1.0;
        assert!(median < 0.06 && bias.abs() < 0.06 && worst < 0.5, "{name}: {median} {worst} {bias:+}");
    }
}

/// Goal: little light leaks into a corner behind a partition. Method: what is served there too much, as a share of what lies
/// on the floor before the partition, by the path tracer.
#[test]
fn a_dark_corner_behind_a_partition() {
    let scene = lamp_and_partition();
    let dark = spread_over(|u, v| Vec3::new(3.25 + 0.7 * u, 0.0, 0.05 + 0.5 * v), Vec3::Y);
    let lit = spread_over(|u, v| Vec3::new(2.5 + 0.6 * u, 0.0, 0.05 + 0.5 * v), Vec3::Y);
    let parameters = BakeParameters { detail: 2, ..of_surfaces(0.25) };
    let outcome = explained_by(&scene, parameters, &[dark, lit].concat(), false);
    let (dark, lit) = outcome.explained.split_at(24);
    let mean = |points: &[Explained], of: fn(&Explained) -> f64| points.iter().map(of).sum::<f64>() / 24.0;
    let (leaked, before) = (mean(dark, |p| p.error().abs()), mean(lit, |p| p.reference));
    let reference = mean(dark, |p| p.reference);
    assert!(leaked < 0.05 * before, "{leaked} lx leak to {reference}, {before} before the partition");
}

#[test]
fn a_reference_that_is_the_service_has_no_error() {
    let mut scene = Scene::default();
    room(&mut scene, Vec3::ZERO, Vec3::splat(2.0), 10.0);
    let places = floor_points([0.2, 0.2], [1.8, 1.8], 0.0, true);
    let outcome = explained(&scene, 0.5, 64, &places, true);
    let ranking = rank(&outcome.explained);
    assert!(ranking.causes.iter().all(|cause| cause.points == 0 && cause.squared_error_share == 0.0));
    assert!(ranking.points.iter().all(|point| point.relative_error == 0.0));
    assert_eq!(outcome.served.len(), ranking.points.len());
}

/// Two rooms, one on the other: a sheet at height `y` between a glowing ceiling and a dark floor.
fn sheeted_room(y: f32) -> Scene {
    let mut scene = Scene::default();
    room(&mut scene, Vec3::ZERO, Vec3::new(4.0, 2.0, 4.0), 100.0);
    let sheet = Material { double_sided: true, ..material(0.5, 0.0) };
    for strip in 0..4 {
        quad(&mut scene, Vec3::new(strip as f32, y, 0.0), Vec3::Z * 4.0, Vec3::X, sheet.clone());
    }
    scene
}

/// Points on the whole half of each strip, from above or from below.
fn on_the_sheet(y: f32, up: bool) -> Vec<(Vec3, Vec3)> {
    let strips = (0..4).map(|strip| strip as f32);
    strips.flat_map(|x| floor_points([x + 0.1, 0.5], [x + 0.4, 3.5], y, up)).collect()
}

fn means(outcome: &Outcome) -> (f64, f64, f64) {
    let points = &outcome.explained;
    let mean = |of: fn(&Explained) -> f64| points.iter().map(of).sum::<f64>() / points.len() as f64;
    (mean(|p| p.served), mean(|p| p.reference), mean(|p| p.error().abs()))
}

/// Goal: nothing leaks through a sheet within a voxel, and each side has light of its own. Method: below the sheet no
/// path finds light; above it the path tracer tells. What is there nonetheless comes from the walls, whose patches lie
/// on both sides of the sheet: a hundredth.
#[test]
fn a_double_sided_sheet_keeps_its_sides_apart() {
    // In the middle of a voxel of 0.25 m.
    let scene = sheeted_room(1.1);
    let (above, reference, error) = means(&explained(&scene, 0.25, 512, &on_the_sheet(1.1, true), false));
    assert!(above > 100.0 && error < 0.03 * reference, "{above} lx for {reference}, {error} off");
    for places in [on_the_sheet(1.1, false), floor_points([0.3, 0.3], [3.7, 3.7], 0.0, true)] {
        let (below, reference, _) = means(&explained(&scene, 0.25, 512, &places, false));
        assert!(reference < 1e-6 && below < 0.02 * above, "{below} lx leak, {above} above");
    }
}

/// Goal: light passes the holes of a mask and nothing else. Method: strips of leaf, each a hole from its middle on by the
/// alpha of its corners; both sides and the floor below, against the path tracer.
#[test]
fn a_leaf_lets_light_through_its_holes() {
    let mut scene = sheeted_room(1.1);
    let mut colours = vec![Scene::WHITE_CORNERS; scene.triangles.len()];
    for (triangle, corners) in scene.triangles.iter().enumerate() {
        let material = &mut scene.materials[scene.material_of[triangle] as usize];
        if material.double_sided {
            material.alpha_cutoff = Some(0.5);
            let low = corners.iter().map(|corner| corner.x).fold(f32::MAX, f32::min);
            for (colour, corner) in colours[triangle].iter_mut().zip(corners) {
                colour[3] = if corner.x > low { 0 } else { u16::MAX };
            }
        }
    }
    scene.corner_colours = Some(colours);
    let of = |places: &[(Vec3, Vec3)]| means(&explained(&scene, 0.25, 512, places, false));
    let above = of(&on_the_sheet(1.1, true));
    let under = of(&on_the_sheet(1.1, false));
    let floor = of(&floor_points([0.3, 0.3], [3.7, 3.7], 0.0, true));
    for (name, (served, reference, error)) in [("above", above), ("under", under), ("floor", floor)] {
        assert!(reference > 5.0, "{name}: light comes through, {reference} lx");
        assert!(error < 0.08 * reference, "{name}: {served} lx for {reference}, {error} off");
    }
    assert!(above.0 > 2.0 * under.0, "{} above, {} under", above.0, under.0);
}
