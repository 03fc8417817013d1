//! The lookup on a floor that goes on behind a wall, and whose light differs there.

use super::*;
use crate::Layout;
use crate::barrier::{BARRIER_ANGLES, BARRIER_REACH_VOXELS, BARRIER_STEPS, Barrier};
use glam::{UVec3, Vec2};
use std::f32::consts::TAU;

/// On one side and the other.
const LIGHT: [f32; 2] = [1.0, 9.0];

/// Where the floor lies in its detail voxels, in edges from their middle, and its tilt: up.
const FLOOR: f32 = -0.2;
const UP: [u8; 3] = [128, 255, 98];

/// A wall on a floor, in voxels of 1 m across x and z.
#[derive(Clone, Copy)]
struct Wall {
    /// From the first side to the second.
    towards: Vec2,
    /// Of its middle, along `towards`.
    place: f32,
    thickness: f32,
}

impl Wall {
    /// How far in front of the wall's face, on `side`, a point of the floor lies; negative in the wall and behind it.
    fn before(&self, side: usize, at: Vec2) -> f32 {
        let along = at.dot(self.towards) - self.place;
        [-along, along][side] - 0.5 * self.thickness
    }

    /// What ends the layer on `side` in the voxel with its low corner at `low`.
    fn barrier(&self, side: usize, low: Vec2) -> Barrier {
        let distance = self.before(side, low + 0.5);
        if distance.abs() > BARRIER_REACH_VOXELS {
            return [0; 2];
        }
        let towards = [self.towards, -self.towards][side];
        // Of what faces y: from z towards x.
        let turn = (towards.x.atan2(towards.y) / TAU).rem_euclid(1.0);
        let angle = (turn * f32::from(BARRIER_ANGLES)).round() as u8 % BARRIER_ANGLES;
        let share = 0.5 + 0.5 * distance / BARRIER_REACH_VOXELS;
        [angle + 1, (share * f32::from(BARRIER_STEPS)).round() as u8]
    }

    /// The floor on both sides as two volumes of detail, over voxels of twice the edge without any of it. Which side is the
    /// first layer where both are is a matter of chance.
    fn volumes(&self, has_barriers: bool) -> Vec<Volume> {
        let layout = Layout { level: 0, origin: IVec3::splat(-8), dims: UVec3::splat(16), voxel_edge_m: 1.0 };
        let voxels = Layout { origin: IVec3::splat(-4), dims: UVec3::splat(8), voxel_edge_m: 2.0, ..layout };
        let mut layers = [Volume::new(layout).unwrap(), Volume::new(layout).unwrap()];
        for (x, z) in (-8..8).flat_map(|x| (-8..8).map(move |z| (x, z))) {
            let low = IVec3::new(x, 0, z).as_vec3();
            let low = Vec2::new(low.x, low.z);
            let corners = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
            let has = |side: usize| corners.iter().any(|&corner| self.before(side, low + corner) > 0.02);
            let mut sides: Vec<usize> = [0, 1].into_iter().filter(|&side| has(side)).collect();
            if (x + z) % 2 == 0 {
                sides.reverse();
            }
            for (layer, side) in layers.iter_mut().zip(sides) {
                let voxel = IVec3::new(x, 0, z);
                layer.set_patch(voxel, 2, Vec3::splat(LIGHT[side]), Vec3::ZERO, 255);
                layer.set_tilt(voxel, 2, UP);
                if has_barriers {
                    layer.set_barriers(voxel, 2, [[0; 2], self.barrier(side, low)]);
                }
            }
        }
        layers.into_iter().chain([Volume::new(voxels).unwrap()]).collect()
    }

    /// The floor's point `before` the wall on `side`, `along` it.
    fn foot(&self, side: usize, before: f32, along: f32) -> Vec3 {
        let off = before + 0.5 * self.thickness;
        let at = self.towards * (self.place + [-off, off][side]) + self.towards.perp() * along;
        Vec3::new(at.x, 0.5 + FLOOR, at.y)
    }
}

/// Walls of `thickness` along an axis and across, at many places of their voxels.
fn walls(thickness: f32) -> impl Iterator<Item = Wall> {
    let turns = [0.0, 0.25, 0.5, 0.08, 0.37, 0.81];
    turns.into_iter().flat_map(move |turn| {
        let towards = Vec2::from_angle(turn * TAU);
        (0..21).map(move |step| Wall { towards, place: 0.05 * step as f32, thickness })
    })
}

fn read(volumes: &[Volume], at: Vec3) -> f32 {
    lookup(volumes, at, Vec3::Y).expect("there is light").irradiance.x
}

/// Largest relative error of points `before` walls of `thickness`, at both sides and all along them.
fn largest_error(thickness: f32, before: f32, has_barriers: bool) -> f32 {
    let of = |wall: Wall| {
        let volumes = wall.volumes(has_barriers);
        let feet = (0..2).flat_map(|side| (0..8).map(move |step| (side, 0.23 * step as f32 - 0.9)));
        feet.map(|(side, along)| (read(&volumes, wall.foot(side, before, along)) / LIGHT[side] - 1.0).abs())
            .fold(0.0, f32::max)
    };
    walls(thickness).map(of).fold(0.0, f32::max)
}

/// Goal: what is before a wall reads its own side's light, wherever the borders of detail voxels lie. Method: walls of all
/// thicknesses, from a sheet to half a detail voxel, a ninth as bright on one side as on the other; points as near to them as
/// codes of barriers can tell (a sheet's two sides lie in one plane), and farther out.
#[test]
fn points_before_a_wall_read_their_own_side() {
    for (thickness, before) in [(0.0, 0.15), (0.05, 0.1), (0.1, 0.06), (0.2, 0.0), (0.5, 0.0), (0.0, 0.4)] {
        let found = largest_error(thickness, before, true);
        assert!(found < 0.01, "{thickness} thick, {before} before it: {found}");
        let without = largest_error(thickness, before, false);
        assert!(without > 0.5, "{thickness} thick, {before} before it: {without} without barriers");
    }
}

/// Goal: a barrier makes no step and no hole. Method: a walk through a wall, in two lengths of steps: light goes from the one side's
/// to the other's and is never less or more than they.
#[test]
fn a_walk_through_a_wall_meets_no_step_and_no_hole() {
    for thickness in [0.0, 0.3, 1.2] {
        let wall = Wall { towards: Vec2::from_angle(0.4), place: 0.35, thickness };
        let volumes = wall.volumes(true);
        let largest = |steps: u32| {
            let at = |step: u32| {
                let along = step as f32 / steps as f32 * (thickness + 2.0) - 1.0;
                let light = read(&volumes, wall.foot(1, along - thickness, 0.2));
                assert!((0.999 * LIGHT[0]..=1.001 * LIGHT[1]).contains(&light), "{along}: {light}");
                light
            };
            assert!((at(0) - LIGHT[0]).abs() < 0.01 && (at(steps) - LIGHT[1]).abs() < 0.01);
            (0..steps).map(|step| (at(step + 1) - at(step)).abs()).fold(0.0, f32::max)
        };
        let (coarse, fine) = (largest(4000), largest(16_000));
        assert!(fine < 0.3 * coarse, "{thickness}: {coarse}, then {fine}");
    }
}

/// Goal: a barrier leaves no point without light: where nothing else is, what lies beyond it answers as it would without. Method:
/// one side alone, and points on the other.
#[test]
fn beyond_all_barriers_the_nearest_answers() {
    let wall = Wall { towards: Vec2::X, place: 0.3, thickness: 0.1 };
    let volumes: Vec<Volume> = wall
        .volumes(true)
        .into_iter()
        .map(|mut volume| {
            let far_side: Vec<IVec3> =
                volume.iter().filter(|(_, light)| light.irradiance[2].x > 5.0).map(|(at, _)| at).collect();
            for voxel in far_side {
                let index = volume.layout().index_of(voxel).expect("inside");
                volume.set(index, &VoxelLight::EMPTY);
            }
            volume
        })
        .collect();
    for before in [0.0, 0.05, 0.3, 0.6] {
        let light = read(&volumes, wall.foot(1, before, 0.4));
        assert!((light - LIGHT[0]).abs() < 1e-4, "{before}: {light}");
    }
}

/// Goal: a barrier ends a surface's light in its own direction only, and goes where its light goes.
#[test]
fn barriers_stay_with_their_surface() {
    let wall = Wall { towards: Vec2::X, place: 0.3, thickness: 0.1 };
    let volumes = wall.volumes(true);
    assert!(volumes.iter().all(|volume| volume.without_air() == *volume));
    let mut light = *volumes[0].at(IVec3::ZERO).expect("it is lit");
    assert_ne!(light.barriers[2], barrier::NONE);
    light.set(2, Vec3::ONE, Vec3::ZERO, 255);
    assert_eq!(light.barriers, VoxelLight::EMPTY.barriers);
}
