//! A long closed corridor along X: doglegs so that its ends do not see each other, pillars, ceiling lamps and walls
//! whose paint changes every few metres. Long and thin, it spans many chunks with few patches each.

use crate::draw::{Draw, Use};
use crate::glb::GlbBuilder;
use crate::masonry::{Fill, Masonry, RoomPaint};
use crate::material::{Material, MaterialId};
use crate::mesh::{Mesh, Placement};
use crate::{GenError, GenOptions, Glb, WorldKind};
use earthshine_world::{Rgb, Vec3};

const WALL_M: f32 = 0.3;
const WIDTH_M: f32 = 3.0;
const HEIGHT_M: f32 = 3.0;
/// Between one dogleg and the next, m.
const STRAIGHT_M: f32 = 40.0;
/// How far a dogleg steps aside, m.
const STEP_ASIDE_M: f32 = 4.0;
/// Length of wall with one paint, m.
const PAINTED_M: f32 = 5.0;
const LAMP_SPACING_M: f32 = 8.0;
const PILLAR_SPACING_M: f32 = 4.0;
const PILLAR_M: f32 = 0.4;

const PAINTS: u16 = 8;
const LAMPS: u16 = 3;
const CONCRETE: MaterialId = MaterialId(PAINTS);
const FLOOR: MaterialId = MaterialId(PAINTS + 1);
const CEILING: MaterialId = MaterialId(PAINTS + 2);

fn materials() -> Vec<Material> {
    let paints: [(&str, Rgb); PAINTS as usize + 3] = [
        ("white", Rgb::splat(0.8)),
        ("grey", Rgb::splat(0.4)),
        ("dark", Rgb::splat(0.12)),
        ("red", Rgb::new(0.6, 0.1, 0.08)),
        ("green", Rgb::new(0.15, 0.5, 0.15)),
        ("blue", Rgb::new(0.12, 0.2, 0.6)),
        ("yellow", Rgb::new(0.75, 0.6, 0.1)),
        ("rose", Rgb::new(0.7, 0.45, 0.45)),
        ("concrete", Rgb::splat(0.35)),
        ("floor", Rgb::new(0.3, 0.25, 0.2)),
        ("ceiling", Rgb::splat(0.7)),
    ];
    let mut list: Vec<Material> = paints.map(|(name, paint)| Material::reflecting(name, paint)).into();
    let lamps =
        [Rgb::new(1200.0, 1100.0, 950.0), Rgb::new(900.0, 1000.0, 1200.0), Rgb::new(800.0, 500.0, 200.0)];
    for (name, radiance) in ["neutral lamp", "cold lamp", "warm lamp"].into_iter().zip(lamps) {
        list.push(Material::emitting(name, Rgb::splat(0.5), radiance));
    }
    list
}

pub(crate) fn generate(options: &GenOptions) -> Result<Glb, GenError> {
    let mut builder = GlbBuilder::new(WorldKind::Corridor, options, &materials());
    let mut mesh = Mesh::default();
    masonry(options).build(&mut mesh);
    let mesh = builder.mesh("corridor", &mesh)?;
    builder.place("corridor", mesh, &Placement::at(Vec3::ZERO));
    builder.finish()
}

fn masonry(options: &GenOptions) -> Masonry {
    let draw = Draw::of_world(options.seed);
    let length = options.corridor_length_m;
    let mut masonry = Masonry::default();
    let straights = starts(length, STRAIGHT_M);
    // Doglegs overlap the next straight by the corridor's width; all walls first, then all air.
    let last = straights.len() - 1;
    let reach = |i: usize| if i < last { straights[i] + STRAIGHT_M + WIDTH_M } else { length };
    let aside = (0.0, STEP_ASIDE_M + WIDTH_M);
    for (i, &x) in straights.iter().enumerate() {
        wall(&mut masonry, (x, reach(i)), (lane(i), lane(i) + WIDTH_M));
        if i < last {
            wall(&mut masonry, (reach(i) - WIDTH_M, reach(i)), aside);
        }
    }
    for (i, &x) in straights.iter().enumerate() {
        let parts = starts(reach(i) - x, PAINTED_M);
        for (j, part) in parts.iter().enumerate() {
            let to = if j + 1 < parts.len() { x + part + PAINTED_M } else { reach(i) };
            hollow(
                &mut masonry,
                paint(draw, (i * 16 + j) as u32),
                (x + part, to),
                (lane(i), lane(i) + WIDTH_M),
            );
        }
        if i < last {
            hollow(&mut masonry, paint(draw, (i * 16 + 15) as u32), (reach(i) - WIDTH_M, reach(i)), aside);
        }
    }
    for (i, &x) in straights.iter().enumerate() {
        fit_out(&mut masonry, draw, i, (x, if i < last { x + STRAIGHT_M } else { length }));
    }
    masonry
}

fn wall(masonry: &mut Masonry, (x0, x1): (f32, f32), (z0, z1): (f32, f32)) {
    let (low, high) = (Vec3::new(x0, 0.0, z0) - WALL_M, Vec3::new(x1, HEIGHT_M, z1) + WALL_M);
    masonry.fill(low, high, Fill::Wall(CONCRETE));
}

/// Where a straight runs across, m.
fn lane(straight: usize) -> f32 {
    if straight.is_multiple_of(2) { 0.0 } else { STEP_ASIDE_M }
}

/// Starts of pieces of length `step` that cover `length`; the last one is at least half a piece.
fn starts(length: f32, step: f32) -> Vec<f32> {
    let pieces = (length / step).round().max(1.0) as u32;
    (0..pieces).map(|i| i as f32 * step).collect()
}

fn paint(draw: Draw, index: u32) -> RoomPaint {
    let walls = MaterialId(draw.below(Use::Paint, index, PAINTS.into()) as u16);
    RoomPaint { walls, floor: FLOOR, ceiling: CEILING }
}

fn hollow(masonry: &mut Masonry, paint: RoomPaint, (x0, x1): (f32, f32), (z0, z1): (f32, f32)) {
    masonry.fill(Vec3::new(x0, 0.0, z0), Vec3::new(x1, HEIGHT_M, z1), Fill::Room(paint));
}

/// Lamps under the ceiling, and pillars along the walls between them.
fn fit_out(masonry: &mut Masonry, draw: Draw, straight: usize, (from, to): (f32, f32)) {
    let z = lane(straight);
    let middle = z + WIDTH_M / 2.0;
    for (i, x) in starts(to - from, LAMP_SPACING_M).into_iter().enumerate() {
        let index = (straight * 8 + i) as u32;
        let x = from + x + LAMP_SPACING_M / 4.0;
        let lamp = MaterialId(CEILING.0 + 1 + draw.below(Use::RoomLamp, index, LAMPS.into()) as u16);
        let (low, high) =
            (Vec3::new(x, HEIGHT_M - 0.06, middle - 0.3), Vec3::new(x + 1.2, HEIGHT_M, middle + 0.3));
        masonry.fill(low, high, Fill::Trim(lamp));
    }
    for (i, x) in starts(to - from, PILLAR_SPACING_M).into_iter().enumerate() {
        let index = (straight * 16 + i) as u32;
        let x = from + x + draw.between(Use::Pillar, 2 * index, 0.0, PILLAR_SPACING_M - PILLAR_M - 0.1);
        // Clear of the doglegs at both ends, so that nothing hangs in their openings.
        if x < from + WIDTH_M + 0.1 || x + PILLAR_M > to - 0.1 {
            continue;
        }
        let side = if draw.chance(Use::Pillar, 2 * index + 1, 0.5) { z } else { z + WIDTH_M - PILLAR_M };
        let (low, high) = (Vec3::new(x, 0.0, side), Vec3::new(x + PILLAR_M, HEIGHT_M, side + PILLAR_M));
        masonry.fill(low, high, Fill::Trim(CONCRETE));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::oracle;

    #[test]
    fn it_is_closed_and_as_long_as_asked() {
        for length in [8.0, 41.0, 130.0, 160.0, 1000.0] {
            let options = GenOptions { corridor_length_m: length, ..GenOptions::default() };
            let mut mesh = Mesh::default();
            masonry(&options).build(&mut mesh);
            assert!(oracle::gap(&mesh) < 1e-2, "{length} m: open by {} m2", oracle::gap(&mesh));
            let size = mesh.bounds().size();
            assert!((size.x - length - 2.0 * WALL_M).abs() < 1e-2, "{size}");
            let inside = f64::from(length * WIDTH_M * HEIGHT_M);
            assert!(oracle::volume(&mesh) > 0.3 * inside);
        }
    }
}
