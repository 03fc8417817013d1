//! A closed room full of contacts: legs, feet, boards, books, a kerb and skirting of a few centimetres. What stands on what
//! is darker there than any voxel knows, which is what screen-space refinement is for. A large lamp on the ceiling
//! keeps the rest of the light soft. The seed chooses paints and books, never the furniture.

use crate::draw::{Draw, Use};
use crate::glb::GlbBuilder;
use crate::masonry::{Fill, Masonry, RoomPaint};
use crate::material::{Material, MaterialId};
use crate::mesh::{Mesh, Placement};
use crate::{GenError, GenOptions, Glb, WorldKind};
use earthshine_world::{Rgb, Vec3};

/// Inside, m, centred on the Y axis with its floor at y = 0.
const ROOM: Vec3 = Vec3::new(4.0, 2.6, 3.2);
/// Thickness of the walls, m.
const WALL_M: f32 = 0.2;
const BOOKS_A_BOARD: u32 = 14;

const PLASTER: MaterialId = MaterialId(0);
const BOARDS: MaterialId = MaterialId(1);
const WOOD: MaterialId = MaterialId(2);
const WHITE: MaterialId = MaterialId(3);
const LAMP: MaterialId = MaterialId(8);
const PAINTS: [MaterialId; 4] = [MaterialId(4), MaterialId(5), MaterialId(6), MaterialId(7)];

fn materials() -> Vec<Material> {
    let paints = [
        ("plaster", Rgb::splat(0.75)),
        ("boards", Rgb::new(0.45, 0.32, 0.22)),
        ("wood", Rgb::new(0.6, 0.42, 0.25)),
        ("white", Rgb::splat(0.82)),
        ("brick", Rgb::new(0.55, 0.2, 0.15)),
        ("ochre", Rgb::new(0.65, 0.45, 0.15)),
        ("sage", Rgb::new(0.35, 0.5, 0.3)),
        ("blue", Rgb::new(0.2, 0.35, 0.6)),
    ];
    let mut list: Vec<Material> = paints.map(|(name, paint)| Material::reflecting(name, paint)).into();
    list.push(Material::emitting("lamp", Rgb::splat(0.5), Rgb::new(1000.0, 920.0, 800.0)));
    list
}

pub(crate) fn generate(options: &GenOptions) -> Result<Glb, GenError> {
    let mut builder = GlbBuilder::new(WorldKind::Study, options, &materials());
    let mut mesh = Mesh::default();
    masonry(options.seed).build(&mut mesh);
    let mesh = builder.mesh("study", &mesh)?;
    builder.place("study", mesh, &Placement::at(Vec3::ZERO));
    builder.finish()
}

/// A box that keeps its material, from its lowest corner and its size. Whole millimetres: what meets shares its planes to the bit.
fn block(masonry: &mut Masonry, corner: Vec3, size: Vec3, material: MaterialId) {
    let whole = |place: Vec3| (place * 1000.0).round() / 1000.0;
    masonry.fill(whole(corner), whole(corner + size), Fill::Trim(material));
}

fn masonry(seed: u64) -> Masonry {
    let draw = Draw::of_world(seed);
    let mut masonry = Masonry::default();
    let (low, high) =
        (Vec3::new(-ROOM.x / 2.0, 0.0, -ROOM.z / 2.0), Vec3::new(ROOM.x / 2.0, ROOM.y, ROOM.z / 2.0));
    masonry.fill(low - WALL_M, high + WALL_M, Fill::Wall(PLASTER));
    masonry.fill(low, high, Fill::Room(RoomPaint { walls: PLASTER, floor: BOARDS, ceiling: WHITE }));
    skirting(&mut masonry, low, high);
    // A kerb: the floor of one corner lies higher.
    block(&mut masonry, low, Vec3::new(1.3, 0.12, 1.1), WHITE);
    on_legs(&mut masonry, Vec3::new(0.1, 0.0, -0.7), Vec3::new(1.2, 0.75, 0.7), 0.03, 0.05);
    for (x, z) in [(0.3, 0.2), (0.85, 0.35)] {
        on_legs(&mut masonry, Vec3::new(x, 0.0, z), Vec3::new(0.35, 0.45, 0.35), 0.03, 0.035);
    }
    // A cupboard, six centimetres above the floor.
    on_legs(&mut masonry, Vec3::new(1.5, 0.0, -0.5), Vec3::new(0.45, 0.9, 1.0), 0.84, 0.04);
    for (at, (size, x)) in [(0.3, 0.2), (0.26, 0.23), (0.22, 0.21)].into_iter().enumerate() {
        let lying = Vec3::new(x, 0.75 + 0.04 * at as f32, -0.55);
        block(
            &mut masonry,
            lying,
            Vec3::new(size, 0.04, 0.8 * size),
            draw.pick(Use::Goods, at as u32, &PAINTS),
        );
    }
    for (board, y) in [1.15f32, 1.5, 1.85].into_iter().enumerate() {
        shelf(&mut masonry, draw, board as u32, Vec3::new(-0.5, y, low.z));
    }
    let (lamp, reach) = (Vec3::Y * ROOM.y, Vec3::new(0.6, 0.0, 0.4));
    masonry.fill(lamp - reach - Vec3::Y * 0.04, lamp + reach, Fill::Trim(LAMP));
    masonry
}

/// Along all walls, 8 cm high and 1.5 cm thick.
fn skirting(masonry: &mut Masonry, low: Vec3, high: Vec3) {
    const THICK_M: f32 = 0.015;
    const HIGH_M: f32 = 0.08;
    let size = high - low;
    for x in [low.x, high.x - THICK_M] {
        block(masonry, Vec3::new(x, 0.0, low.z), Vec3::new(THICK_M, HIGH_M, size.z), WHITE);
    }
    for z in [low.z, high.z - THICK_M] {
        block(masonry, Vec3::new(low.x, 0.0, z), Vec3::new(size.x, HIGH_M, THICK_M), WHITE);
    }
}

/// A board `thick_m` thick on four legs `leg_m` wide: `size` from `corner`, all in all.
fn on_legs(masonry: &mut Masonry, corner: Vec3, size: Vec3, thick_m: f32, leg_m: f32) {
    let leg = Vec3::new(leg_m, size.y - thick_m, leg_m);
    for x in [0.0, size.x - leg_m] {
        for z in [0.0, size.z - leg_m] {
            block(masonry, corner + Vec3::new(x, 0.0, z), leg, WOOD);
        }
    }
    block(masonry, corner + Vec3::Y * leg.y, Vec3::new(size.x, thick_m, size.z), WOOD);
}

/// A board on the wall behind `corner`, and books of all sizes on it, some missing.
fn shelf(masonry: &mut Masonry, draw: Draw, board: u32, corner: Vec3) {
    const SIZE: Vec3 = Vec3::new(1.6, 0.025, 0.24);
    block(masonry, corner, SIZE, WOOD);
    let mut x = 0.05;
    for book in board * BOOKS_A_BOARD..(board + 1) * BOOKS_A_BOARD {
        let size = Vec3::new(
            draw.between(Use::Goods, 16 + book, 0.03, 0.09),
            draw.pick(Use::Goods, 64 + book, &[0.18, 0.22, 0.25, 0.29]),
            draw.pick(Use::Goods, 128 + book, &[0.13, 0.17, 0.2]),
        );
        if x + size.x <= SIZE.x - 0.05 && draw.chance(Use::Goods, 192 + book, 0.85) {
            let stands = corner + Vec3::new(x, SIZE.y, 0.0);
            block(masonry, stands, size, draw.pick(Use::Paint, book, &PAINTS));
        }
        x += size.x + 0.01;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::oracle;

    #[test]
    fn the_room_is_closed_and_full_of_thin_things() {
        for seed in [1, 7] {
            let mut mesh = Mesh::default();
            masonry(seed).build(&mut mesh);
            assert!(oracle::gap(&mesh) < 1e-4, "{}", oracle::gap(&mesh));
            let size = mesh.bounds().size();
            let shell = f64::from(size.x * size.y * size.z - ROOM.x * ROOM.y * ROOM.z);
            let inside = oracle::volume(&mesh) - shell;
            assert!(inside > 0.6 && inside < 1.2, "{inside} m3 of furniture");
            let books: u64 =
                PAINTS.iter().filter_map(|paint| Some(mesh.surfaces.get(paint)?.triangles())).sum();
            assert!(books > 200, "{books} triangles of books");
            assert!(mesh.surfaces[&LAMP].positions.iter().all(|p| p.y > 2.5));
        }
    }
}
