//! Two closed rooms joined by a doorway in a wall of real thickness; a lamp hangs in one, the other lives on what
//! comes through. The seed chooses paints and furniture, never the rooms.

use crate::draw::{Draw, Use};
use crate::glb::GlbBuilder;
use crate::masonry::{Fill, Masonry, RoomPaint};
use crate::material::{Material, MaterialId};
use crate::mesh::{Mesh, Placement};
use crate::{GenError, GenOptions, Glb, WorldKind};
use earthshine_world::{Rgb, Vec3};

/// Inside of one room, m: the first spans x in [-5.15, -0.15], the second mirrors it.
const ROOM: Vec3 = Vec3::new(5.0, 3.0, 4.0);
/// Half the wall between the rooms, and the thickness of the outer walls, m.
const WALL_M: f32 = 0.15;
/// Of the doorway, m.
const DOOR_WIDTH_M: f32 = 1.0;
const DOOR_HEIGHT_M: f32 = 2.1;
const FURNITURE: u32 = 3;

/// Diffuse wall paints, the lamp last.
fn materials() -> Vec<Material> {
    let paints = [
        ("plaster", Rgb::splat(0.75)),
        ("ochre", Rgb::new(0.65, 0.45, 0.15)),
        ("brick", Rgb::new(0.55, 0.2, 0.15)),
        ("sage", Rgb::new(0.35, 0.5, 0.3)),
        ("blue", Rgb::new(0.2, 0.35, 0.6)),
        ("boards", Rgb::new(0.45, 0.3, 0.2)),
        ("white", Rgb::splat(0.85)),
    ];
    let mut list: Vec<Material> = paints.map(|(name, paint)| Material::reflecting(name, paint)).into();
    list.push(Material::emitting("lamp", Rgb::splat(0.5), Rgb::new(1000.0, 900.0, 750.0)));
    list
}

const BOARDS: MaterialId = MaterialId(5);
const WHITE: MaterialId = MaterialId(6);
const LAMP: MaterialId = MaterialId(7);
const PAINTS: [MaterialId; 5] = [MaterialId(0), MaterialId(1), MaterialId(2), MaterialId(3), MaterialId(4)];

pub(crate) fn generate(options: &GenOptions) -> Result<Glb, GenError> {
    let mut builder = GlbBuilder::new(WorldKind::TwoRooms, options, &materials());
    let mut mesh = Mesh::default();
    masonry(options.seed).build(&mut mesh);
    let mesh = builder.mesh("two rooms", &mesh)?;
    builder.place("two rooms", mesh, &Placement::at(Vec3::ZERO));
    builder.finish()
}

fn masonry(seed: u64) -> Masonry {
    let draw = Draw::of_world(seed);
    let mut masonry = Masonry::default();
    let half = ROOM.z / 2.0;
    let end = WALL_M + ROOM.x;
    let outer = Vec3::new(end, ROOM.y, half) + 2.0 * WALL_M;
    masonry.fill(Vec3::new(-outer.x, -2.0 * WALL_M, -outer.z), outer, Fill::Wall(WHITE));
    for (room, (from, to)) in [(-end, -WALL_M), (WALL_M, end)].into_iter().enumerate() {
        let walls = draw.pick(Use::Paint, room as u32, &PAINTS);
        let paint = RoomPaint { walls, floor: BOARDS, ceiling: WHITE };
        masonry.fill(Vec3::new(from, 0.0, -half), Vec3::new(to, ROOM.y, half), Fill::Room(paint));
        furnish(&mut masonry, draw, room as u32, (from, to));
    }
    let door = Vec3::new(WALL_M, 0.0, DOOR_WIDTH_M / 2.0);
    masonry.fill(-door, door + Vec3::Y * DOOR_HEIGHT_M, Fill::Opening);
    let (lamp, reach) = (Vec3::new(-end / 2.0, ROOM.y, 0.0), Vec3::new(0.5, 0.0, 0.5));
    masonry.fill(lamp - reach - Vec3::Y * 0.05, lamp + reach, Fill::Trim(LAMP));
    masonry
}

/// Blocks on the floor along the far wall, clear of the doorway and of each other.
fn furnish(masonry: &mut Masonry, draw: Draw, room: u32, (from, to): (f32, f32)) {
    let back = -ROOM.z / 2.0;
    for piece in 0..FURNITURE {
        let index = room * FURNITURE + piece;
        let start = from + 0.4 + (to - from - 0.8) * piece as f32 / FURNITURE as f32;
        let size = Vec3::new(
            draw.between(Use::Furniture, 3 * index, 0.4, 1.1),
            draw.between(Use::Furniture, 3 * index + 1, 0.4, 1.8),
            draw.between(Use::Furniture, 3 * index + 2, 0.3, 0.9),
        );
        let corner = Vec3::new(start, 0.0, back);
        let material = draw.pick(Use::Paint, 16 + index, &PAINTS);
        masonry.fill(corner, corner + size, Fill::Trim(material));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::oracle;

    #[test]
    fn the_rooms_are_closed_and_the_lamp_is_in_the_first() {
        let mut mesh = Mesh::default();
        masonry(7).build(&mut mesh);
        assert!(oracle::gap(&mesh) < 1e-4, "{}", oracle::gap(&mesh));
        let size = mesh.bounds().size();
        let rooms = 2.0 * 5.0 * 3.0 * 4.0 + 0.3 * 1.0 * 2.1;
        let solid = oracle::volume(&mesh);
        let shell = f64::from(size.x * size.y * size.z) - rooms;
        assert!(solid > shell && solid < shell + 12.0, "{solid} m3 of {shell}");
        assert!(mesh.surfaces[&LAMP].positions.iter().all(|p| p.x < 0.0 && p.y >= 2.9));
    }
}
