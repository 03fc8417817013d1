//! Props of streets, squares and roofs.

use super::paint::Paint;
use super::prop::{Prop, boxes, feet};
use crate::draw::{Draw, Use};
use crate::mesh::Mesh;
use crate::solids::{octahedron, taper};
use earthshine_world::Vec3;

/// Where a lamp of its own would hang below the head of [`Prop::Lamp`], m.
pub(crate) const LAMP_LIGHT: Vec3 = Vec3::new(0.6, 4.0, 0.0);

pub(crate) fn lamp() -> Mesh {
    let mut mesh = boxes(&[
        (Paint::Iron, [-0.04, 4.33, -0.04], [0.7, 4.41, 0.04]),
        (Paint::Iron, [0.42, 4.25, -0.18], [0.78, 4.35, 0.18]),
        (Paint::StreetLamp, [0.45, 4.19, -0.15], [0.75, 4.25, 0.15]),
    ]);
    taper(&mut mesh, Paint::Iron.id(), Vec3::new(0.0, -0.05, 0.0), 4.5, 0.09, 0.06);
    taper(&mut mesh, Paint::Iron.id(), Vec3::new(0.0, -0.07, 0.0), 0.42, 0.16, 0.12);
    mesh
}

pub(crate) fn bench() -> Mesh {
    boxes(&[
        (Paint::Iron, [-0.7, -0.02, -0.2], [-0.62, 0.4, 0.2]),
        (Paint::Iron, [0.62, -0.02, -0.2], [0.7, 0.4, 0.2]),
        (Paint::Wood, [-0.85, 0.4, -0.22], [0.85, 0.45, -0.03]),
        (Paint::Wood, [-0.85, 0.4, 0.03], [0.85, 0.45, 0.22]),
        (Paint::Iron, [-0.7, 0.35, -0.2], [0.7, 0.4, 0.2]),
        (Paint::Wood, [-0.85, 0.5, -0.22], [0.85, 0.62, -0.17]),
        (Paint::Wood, [-0.85, 0.7, -0.22], [0.85, 0.82, -0.17]),
        (Paint::Iron, [-0.7, 0.45, -0.22], [-0.62, 0.82, -0.18]),
        (Paint::Iron, [0.62, 0.45, -0.22], [0.7, 0.82, -0.18]),
    ])
}

pub(crate) fn car(variant: u8) -> Mesh {
    let body =
        [Paint::CarRed, Paint::CarBlue, Paint::CarWhite, Paint::CarGreen][usize::from(variant % Prop::CARS)];
    let mut parts = vec![
        (body, [-0.85, 0.3, -2.1], [0.85, 0.82, 2.1]),
        (Paint::Glass, [-0.75, 0.82, -1.5], [0.75, 1.3, 0.9]),
        (body, [-0.78, 1.3, -1.4], [0.78, 1.38, 0.8]),
        (Paint::Iron, [-0.87, 0.38, 2.1], [0.87, 0.5, 2.16]),
        (Paint::Iron, [-0.87, 0.38, -2.16], [0.87, 0.5, -2.1]),
    ];
    for (x, z) in [(-0.88, -1.65), (0.66, -1.65), (-0.88, 1.05), (0.66, 1.05)] {
        parts.push((Paint::Iron, [x, -0.02, z], [x + 0.22, 0.6, z + 0.6]));
    }
    boxes(&parts)
}

pub(crate) fn stall(variant: u8, goods: u32, draw: Draw) -> Mesh {
    let kind = usize::from(variant % Prop::STALLS);
    let canvas = [Paint::CanvasRed, Paint::CanvasBlue, Paint::CanvasYellow][kind];
    let fruit = [Paint::FruitOrange, Paint::FruitGreen, Paint::FruitRed];
    let mut parts = feet(Paint::Wood, 1.15, 0.65, 0.08, 2.3).to_vec();
    parts.extend([
        (Paint::Wood, [-1.13, 0.8, -0.1], [1.13, 0.86, 0.8]),
        (Paint::Wood, [-1.05, -0.01, 0.0], [1.05, 0.8, 0.55]),
        (canvas, [-1.25, 2.3, -0.75], [1.25, 2.36, 0.95]),
        (canvas, [-1.25, 2.12, 0.91], [1.25, 2.3, 0.95]),
    ]);
    let mut mesh = boxes(&parts);
    for i in 0..goods {
        let (column, row, layer) = (i % 12, i / 12 % 4, i / 48);
        let jitter = draw.between(Use::Goods, u32::from(variant) << 8 | i, 0.0, 0.02);
        let place = Vec3::new(
            -0.95 + 0.17 * column as f32 + jitter,
            0.92 + 0.13 * layer as f32 - jitter / 4.0,
            0.1 + 0.16 * row as f32 + jitter,
        );
        octahedron(&mut mesh, fruit[(kind + column as usize / 4) % 3].id(), place, 0.075);
    }
    mesh
}

pub(crate) fn fountain() -> Mesh {
    let mut mesh = Mesh::default();
    let step = |mesh: &mut Mesh, paint: Paint, y: f32, height: f32, lower: f32, upper: f32| {
        taper(mesh, paint.id(), Vec3::Y * y, height, lower, upper);
    };
    step(&mut mesh, Paint::Stone, -0.05, 0.25, 2.2, 2.2);
    step(&mut mesh, Paint::Stone, 0.1, 0.5, 1.8, 1.7);
    step(&mut mesh, Paint::Water, 0.55, 0.1, 1.5, 1.5);
    step(&mut mesh, Paint::Stone, 0.5, 1.1, 0.3, 0.2);
    step(&mut mesh, Paint::Stone, 1.55, 0.2, 0.3, 0.8);
    step(&mut mesh, Paint::Stone, 1.7, 0.6, 0.15, 0.0);
    mesh
}

/// Rows and columns of one square metre of stones, and of tiles.
const SETTS_ON_EDGE: u32 = 5;
const TILES_ON_EDGE: u32 = 4;

pub(crate) fn setts(variant: u8, draw: Draw) -> Mesh {
    let paint = [Paint::Sett, Paint::Paving][usize::from(variant % Prop::SETTS)];
    let pitch = 1.0 / SETTS_ON_EDGE as f32;
    let stone = |i: u32| {
        let (x, z) = ((i % SETTS_ON_EDGE) as f32 * pitch - 0.49, (i / SETTS_ON_EDGE) as f32 * pitch - 0.49);
        let top = draw.between(Use::Stone, u32::from(variant) << 8 | i, 0.015, 0.035);
        (paint, [x, -0.02, z], [x + pitch - 0.02, top, z + pitch - 0.02])
    };
    boxes(&(0..SETTS_ON_EDGE * SETTS_ON_EDGE).map(stone).collect::<Vec<_>>())
}

pub(crate) fn tiles(roof: u8) -> Mesh {
    let paint = Paint::ROOFS[usize::from(roof) % Paint::ROOFS.len()];
    let pitch = 1.0 / TILES_ON_EDGE as f32;
    let tile = |i: u32| {
        let (x, z) = ((i % TILES_ON_EDGE) as f32 * pitch - 0.49, (i / TILES_ON_EDGE) as f32 * pitch - 0.49);
        (paint, [x, -0.02, z], [x + pitch - 0.02, 0.025, z + pitch - 0.02])
    };
    boxes(&(0..TILES_ON_EDGE * TILES_ON_EDGE).map(tile).collect::<Vec<_>>())
}
