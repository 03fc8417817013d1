//! The lookup against fields whose light at every point is known.

use super::*;
use crate::Layout;
use glam::UVec3;

const EDGE_M: f32 = 0.5;

fn layout() -> Layout {
    Layout { level: 0, origin: IVec3::new(-3, -2, 1), dims: UVec3::new(7, 6, 5), voxel_edge_m: EDGE_M }
}

type Put = fn(&mut Volume, IVec3, usize, Vec3, Vec3, u8) -> bool;

/// All six directions in every voxel, put by `put`, as `field` says at the voxel's centre.
fn filled_by(put: Put, field: impl Fn(Vec3, usize) -> Vec3) -> Volume {
    let mut volume = Volume::new(layout()).unwrap();
    for index in 0..layout().voxel_count() {
        let voxel = layout().voxel_of(index);
        let centre = (voxel.as_vec3() + 0.5) * EDGE_M;
        for direction in 0..6 {
            let light = field(centre, direction);
            assert!(put(&mut volume, voxel, direction, light, light * 0.25, 255));
        }
    }
    volume
}

/// Patches everywhere.
fn filled(field: impl Fn(Vec3, usize) -> Vec3) -> Volume {
    filled_by(Volume::set_patch, field)
}

/// Air everywhere.
fn aired(field: impl Fn(Vec3, usize) -> Vec3) -> Volume {
    filled_by(Volume::set_receiver, field)
}

fn normals() -> [Vec3; 5] {
    [Vec3::X, Vec3::NEG_Z, Vec3::ONE, Vec3::new(0.3, -0.9, 0.2), Vec3::new(-5.0, 2.0, 0.1)]
}

fn inside() -> Vec3 {
    Vec3::new(0.23, 0.31, 1.47)
}

#[test]
fn a_constant_field_is_read_exactly() {
    let volume = filled(|_, _| Vec3::new(1.0, 2.0, 3.0));
    for normal in normals() {
        let read = lookup(&[&volume], inside(), normal).unwrap();
        assert!((read.irradiance - Vec3::new(1.0, 2.0, 3.0)).length() < 1e-5);
        assert!((read.sky_irradiance * 4.0 - read.irradiance).length() < 1e-5);
        assert!((read.quality - 1.0).abs() < 1e-5);
    }
}

#[test]
fn a_linear_field_is_read_exactly_in_front_of_the_surface() {
    let at = |x: Vec3| Vec3::new(x.x, 2.0 * x.y - x.z, x.x + x.y + x.z) + 10.0;
    let volume = filled(|centre, _| at(centre));
    for normal in normals() {
        let read = lookup(&[&volume], inside(), normal).unwrap();
        let offset = NORMAL_OFFSET_VOXELS * EDGE_M * normal.normalize_or_zero();
        assert!((read.irradiance - at(inside() + offset)).length() < 1e-4);
    }
}

#[test]
fn directions_are_weighted_by_the_squares_of_the_normal() {
    let volume = filled(|_, direction| Vec3::splat(10f32.powi(direction as i32)));
    let normal = Vec3::new(0.6, 0.0, -0.8);
    let read = lookup(&[&volume], inside(), normal).unwrap();
    let expected = 0.36 * 1.0 + 0.64 * 1e5;
    assert!((read.irradiance.x - expected).abs() < 1.0, "{}", read.irradiance.x);
}

#[test]
fn voxels_without_a_patch_are_skipped() {
    // Up-facing patches only in one layer of voxels, as on a floor; bright x, dark elsewhere.
    let mut volume = Volume::new(layout()).unwrap();
    let floor = |x: i32, z: i32| IVec3::new(x, 0, z);
    for (x, z) in [(0, 2), (1, 2), (0, 3)] {
        volume.set_patch(floor(x, z), 2, Vec3::splat(x as f32 + 1.0), Vec3::ZERO, 128);
    }
    // Between the centres of (0, 2), (1, 2), (0, 3) and the absent (1, 3).
    let position = Vec3::new(1.0, 0.1, 3.0) * EDGE_M;
    let read = lookup(&[&volume], position, Vec3::Y).unwrap();
    assert!((read.irradiance.x - 4.0 / 3.0).abs() < 1e-5, "{}", read.irradiance.x);
    // A wall has no light here, and what a slanted normal misses the floor makes up for.
    assert_eq!(lookup(&[&volume], position, Vec3::X), None);
    let slanted = lookup(&[&volume], position - 0.05, Vec3::new(1.0, 1.0, 0.0)).unwrap();
    assert!((1.0..=2.0).contains(&slanted.irradiance.x));
}

/// Goal: at slanted normals air reads what an ambient cube cannot. Method: irradiance under a half-bright sky,
/// `1 + n_y`, is linear in the normal.
#[test]
fn air_under_a_sky_is_read_exactly_at_any_normal() {
    let at = |normal: Vec3| 10.0 + 6.0 * normal.y;
    let axis = |direction: usize| {
        let sign = if direction.is_multiple_of(2) { 1.0 } else { -1.0 };
        Vec3::AXES[direction / 2] * sign
    };
    let air = aired(|_, direction| Vec3::splat(at(axis(direction))));
    let cube = filled(|_, direction| Vec3::splat(at(axis(direction))));
    for normal in normals().map(|normal| normal.normalize_or(Vec3::X)) {
        let read = lookup(&[&air], inside(), normal).unwrap();
        assert!((read.irradiance.x - at(normal)).abs() < 1e-4, "{normal}: {}", read.irradiance.x);
        assert!((read.sky_irradiance.x * 4.0 - at(normal)).abs() < 1e-4);
    }
    let slanted = Vec3::new(1.0, 1.0, 0.0).normalize_or(Vec3::X);
    let patches = lookup(&[&cube], inside(), slanted).unwrap();
    assert!(patches.irradiance.x < at(slanted) - 1.0, "patches keep to the squares");
}

#[test]
fn a_lamp_does_not_darken_what_turns_away_from_it() {
    let air = aired(|_, direction| Vec3::splat(if direction == 2 { 10.0 } else { 1.0 }));
    for y in [0.0, -0.3, -0.5, -0.8, -1.0] {
        let normal = Vec3::new((1.0f32 - y * y).sqrt(), y, 0.0);
        let read = lookup(&[&air], inside(), normal).unwrap();
        assert!((0.75..=1.0 + 1e-5).contains(&read.irradiance.x), "{y}: {}", read.irradiance.x);
    }
}

/// A floor of patches, as bright as 1, under air as bright as 3, in all directions up and sideways.
fn floor_under_air() -> Volume {
    let mut volume = aired(|_, _| Vec3::splat(3.0));
    for index in 0..layout().voxel_count() {
        let voxel = layout().voxel_of(index);
        if voxel.y == 0 {
            volume.set_patch(voxel, 2, Vec3::ONE, Vec3::ZERO, 255);
        }
    }
    volume
}

#[test]
fn points_on_surfaces_read_surfaces_alone() {
    let volume = floor_under_air();
    // Wherever in its voxels the floor lies.
    for height in [0.0, 0.2, 0.5, 0.75, 0.999] {
        let position = Vec3::new(0.23, height * EDGE_M, 1.47);
        let read = lookup(&[&volume], position, Vec3::Y).unwrap();
        assert!((read.irradiance.x - 1.0).abs() < 1e-5, "{height}: {}", read.irradiance.x);
    }
    let above = lookup(&[&volume], Vec3::new(0.23, 2.0 * EDGE_M, 1.47), Vec3::Y).unwrap();
    assert!((above.irradiance.x - 3.0).abs() < 1e-5);
}

/// Goal: what moves before a wall reads the light there, not that of the wall's other side, which faces the same way
/// within the voxel. Method: dark patches whose plane is known, under bright air.
#[test]
fn points_off_a_plane_read_the_air() {
    let mut volume = floor_under_air();
    for (index, offset) in (0..layout().voxel_count()).map(|index| (index, plane::encode(0.4))) {
        volume.set_plane(layout().voxel_of(index), 2, offset);
    }
    let read = |height: f32, normal: Vec3| {
        lookup(&[&volume], Vec3::new(0.23, height * EDGE_M, 1.47), normal).unwrap().irradiance.x
    };
    assert!((read(0.4, Vec3::Y) - 1.0).abs() < 1e-5, "on it");
    assert!(read(0.4 - plane::AIR_FROM_VOXELS, Vec3::Y) > 2.8, "below it");
    assert!(read(0.4 + plane::AIR_FROM_VOXELS, Vec3::Y) > 2.8, "above it");
    // What slants by this much goes through a voxel from side to side.
    let slanted = Vec3::new(0.9, 1.0, 0.0);
    assert!(read(0.4 + plane::AIR_FROM_VOXELS, slanted) < 2.1, "{}", read(0.7, slanted));
}

/// Goal: a surface answers where there is no air, however far off it lies.
#[test]
fn points_without_air_read_the_surface_in_their_voxels() {
    let with_air = floor_under_air();
    let mut volume = with_air.without_air();
    for index in 0..layout().voxel_count() {
        volume.set_plane(layout().voxel_of(index), 2, plane::encode(0.0));
    }
    let read = lookup(&[&volume], Vec3::new(0.23, 0.9 * EDGE_M, 1.47), Vec3::Y).unwrap();
    assert!((read.irradiance.x - 1.0).abs() < 1e-5);
}

/// Goal: nothing that moves meets a step. Method: steps through the air and into the
/// floor, past a lone patch, and steps a quarter as long.
#[test]
fn light_has_no_steps_between_air_and_surfaces() {
    let mut volume = floor_under_air();
    volume.set_patch(IVec3::new(0, 1, 2), 2, Vec3::splat(9.0), Vec3::ZERO, 255);
    for normal in [Vec3::Y, Vec3::new(0.6, 0.8, 0.0), Vec3::new(-0.5, 0.1, 0.7)] {
        let largest = |steps: u32| {
            let read = |step: u32| {
                let along = step as f32 / steps as f32;
                let position = Vec3::new(-1.0, 1.2, 0.9).lerp(Vec3::new(1.2, -0.1, 1.9), along);
                lookup(&[&volume], position, normal).unwrap().irradiance.x
            };
            (0..steps).map(|step| (read(step + 1) - read(step)).abs()).fold(0.0, f32::max)
        };
        // A slope, however steep, shrinks with the step; a step does not.
        let (coarse, fine) = (largest(4000), largest(16_000));
        assert!(fine < 0.3 * coarse, "{normal}: {coarse}, then {fine}");
    }
}

/// Goal: a point reads the floor it stands on. Method: two floors in one column of voxels, one a step below the
/// other, both within what the upper one reads.
#[test]
fn points_read_the_surface_whose_plane_they_lie_in() {
    let mut volume = Volume::new(layout()).unwrap();
    for (x, z) in [(0, 2), (1, 2), (0, 3), (1, 3)] {
        for (y, light) in [(0, 1.0), (1, 5.0)] {
            volume.set_patch(IVec3::new(x, y, z), 2, Vec3::splat(light), Vec3::ZERO, 255);
        }
    }
    let read = |volume: &Volume, height: f32| {
        let position = Vec3::new(1.0, height, 3.0) * EDGE_M;
        lookup(&[volume], position, Vec3::Y).unwrap().irradiance.x
    };
    // Half-way between the layers in height, the upper floor just above.
    assert!((read(&volume, 0.75) - 3.0).abs() < 1e-5, "without planes it is a mean");
    for (x, z) in [(0, 2), (1, 2), (0, 3), (1, 3)] {
        for (y, offset) in [(0, 0.75), (1, 0.3)] {
            assert!(volume.set_plane(IVec3::new(x, y, z), 2, plane::encode(offset)));
        }
    }
    assert!((read(&volume, 0.75) - 1.0).abs() < 0.15, "{}", read(&volume, 0.75));
    assert!((read(&volume, 1.3) - 5.0).abs() < 0.15, "{}", read(&volume, 1.3));
    assert_eq!(volume.without_air(), volume, "planes stay with their surfaces");
}

#[test]
fn a_patch_keeps_its_place_against_a_receiver() {
    let mut volume = Volume::new(layout()).unwrap();
    let voxel = IVec3::new(0, 0, 2);
    volume.set_receiver(voxel, 2, Vec3::splat(5.0), Vec3::ZERO, 255);
    volume.set_patch(voxel, 2, Vec3::ONE, Vec3::ZERO, 255);
    volume.set_receiver(voxel, 2, Vec3::splat(7.0), Vec3::ZERO, 255);
    let light = volume.at(voxel).unwrap();
    assert_eq!((light.irradiance[2], light.air), (Vec3::ONE, 0));
}

#[test]
fn coarser_volumes_answer_where_finer_ones_cannot() {
    let fine = Volume::new(layout()).unwrap();
    let place = Layout { level: 1, voxel_edge_m: 2.0 * EDGE_M, ..layout() };
    let mut coarse = Volume::new(place).unwrap();
    coarse.set_patch(IVec3::new(0, 0, 1), 2, Vec3::splat(7.0), Vec3::ZERO, 255);
    let read = lookup(&[&fine, &coarse], inside(), Vec3::Y).unwrap();
    assert_eq!((read.level, read.irradiance.x), (1, 7.0));
    assert_eq!(lookup::<Volume>(&[], inside(), Vec3::Y), None);
}

#[test]
fn no_number_makes_it_panic_or_answer_with_nan() {
    let volume = filled(|_, _| Vec3::splat(f32::MAX / 64.0));
    let odd = [0.0, -0.0, 1e-45, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e9, 0.5, 1.75, -1.5];
    for x in odd {
        for y in odd {
            for z in odd {
                for v in [Vec3::new(x, y, z), Vec3::new(z, x, 1.5)] {
                    for (position, normal) in [(v, Vec3::Y), (inside(), v), (v, v)] {
                        if let Some(read) = lookup(&[&volume], position, normal) {
                            assert!(read.irradiance.is_finite(), "{position} {normal}");
                        }
                    }
                }
            }
        }
    }
}

/// A detail volume around the origin, eight of its voxels a voxel, and four voxels that it may be detail of.
fn detail_and_voxels() -> (Volume, Volume) {
    let fine = Layout { origin: IVec3::splat(-4), dims: UVec3::splat(8), voxel_edge_m: 0.25, level: 0 };
    let coarse = Layout { origin: IVec3::splat(-2), dims: UVec3::splat(4), voxel_edge_m: 0.5, level: 0 };
    let mut voxels = Volume::new(coarse).unwrap();
    for (y, z) in [(-1, -1), (-1, 0), (0, -1), (0, 0)] {
        voxels.set_patch(IVec3::new(0, y, z), 0, Vec3::splat(50.0), Vec3::ZERO, 255);
    }
    (Volume::new(fine).unwrap(), voxels)
}

/// Goal: a point reads its own surface where two share detail voxels and a direction. Method: a wall, and a parallel plate a
/// third of a detail voxel before it, as two layers; and a moulding that leans out of the same voxels.
#[test]
fn points_read_the_layer_whose_plane_they_lie_in() {
    let (empty, voxels) = detail_and_voxels();
    // Codes of an octahedron: (1, 0, 0), and (0.6, -0.8, 0) or a hair off it.
    let (square, leaning) = ([255, 128], [182, 55]);
    let code = |distance: f32| 1 + ((distance / 3f32.sqrt() + 0.5) * 254.0).round() as u8;
    let tilt = |[x, y]: [u8; 2], distance: f32| [x, y, code(distance)];
    let layer = |light: f32, tilt: [u8; 3]| {
        let mut volume = empty.clone();
        for (y, z) in [(-1, -1), (-1, 0), (0, -1), (0, 0)] {
            volume.set_patch(IVec3::new(0, y, z), 0, Vec3::splat(light), Vec3::ZERO, 255);
            volume.set_tilt(IVec3::new(0, y, z), 0, tilt);
        }
        volume
    };
    let wall = layer(1.0, tilt(square, -0.4));
    let plate = layer(9.0, tilt(square, -0.05));
    let moulding = layer(30.0, tilt(leaning, -0.25));
    let at = |offset: f32| Vec3::new((0.5 + offset) * 0.25, 0.02, -0.01);
    let read = |layers: &[&Volume], position: Vec3, normal: Vec3| {
        let volumes: Vec<&Volume> = layers.iter().copied().chain([&voxels]).collect();
        lookup(&volumes, position, normal).unwrap().irradiance.x
    };
    let both = [&wall, &plate];
    assert!((read(&both, at(-0.4), Vec3::X) - 1.0).abs() < 1.0, "{}", read(&both, at(-0.4), Vec3::X));
    assert!((read(&both, at(-0.05), Vec3::X) - 9.0).abs() < 1.0, "{}", read(&both, at(-0.05), Vec3::X));
    // Layers are in no order, and a second one does not make the voxel count twice.
    assert!((read(&[&plate, &wall], at(-0.4), Vec3::X) - read(&both, at(-0.4), Vec3::X)).abs() < 1e-5);
    assert_eq!(read(&[&wall, &wall], at(-0.4), Vec3::X), read(&[&wall], at(-0.4), Vec3::X));
    // A normal alone tells surfaces apart that cross.
    let crossing = [&wall, &moulding];
    let lean = Vec3::new(0.6, -0.8, 0.0);
    let on_moulding = Vec3::new(0.125, 0.0, 0.0) - 0.25 * 0.25 * lean;
    assert!(read(&crossing, on_moulding, lean) > 25.0, "{}", read(&crossing, on_moulding, lean));
    assert!(read(&crossing, at(-0.4), Vec3::X) < 3.0, "{}", read(&crossing, at(-0.4), Vec3::X));
}
