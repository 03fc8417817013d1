//! What is in a room: a lamp under the ceiling, stairs, tables, chairs, beds, shelves.

use super::cell::{CellBuilder, Rank};
use super::house::House;
use super::indoors::{STAIRS_LENGTH_M, STAIRS_WIDTH_M};
use super::paint::Paint;
use super::prop::Prop;
use crate::draw::Use;
use crate::masonry::{Fill, Masonry};
use crate::mesh::Placement;
use earthshine_world::Vec3;

/// From walls to what stands along them, m: nothing may share a plane with a wall.
const GAP_M: f32 = 0.04;

/// The air of one room.
#[derive(Debug, Clone)]
pub(crate) struct Room {
    /// At the floor.
    pub(crate) low: Vec3,
    /// At the ceiling.
    pub(crate) high: Vec3,
    /// Among the rooms of its house: four times the storey, and up to three.
    pub(crate) number: u32,
    /// Stairs run along its +X wall, towards +Z on even storeys.
    pub(crate) has_stairs: bool,
}

/// A lamp under the ceiling of every third room or so.
pub(crate) fn lamp(house: &House, room: &Room, masonry: &mut Masonry) {
    if house.draw.chance(Use::RoomLamp, house.index(room.number), 0.35) {
        let middle = ((room.low + room.high) * 0.5).with_y(room.high.y);
        let reach = Vec3::new(0.2, 0.0, 0.2);
        masonry.fill(middle - reach - Vec3::Y * 0.06, middle + reach, Fill::Trim(Paint::RoomLamp.id()));
    }
}

/// Offers the furniture of one room.
pub(crate) fn furniture(house: &House, room: &Room, cell: &mut CellBuilder<'_>) {
    let storey = room.number / 4;
    if room.has_stairs {
        if storey + 1 < house.storeys {
            cell.offer(Rank::Fitting, Prop::Stairs, stairs(room, storey));
        }
        let foot = Vec3::new(room.low.x + 0.9, room.low.y, f32::midpoint(room.low.z, room.high.z));
        table_and_chairs(house, room, foot, cell);
    } else if house.draw.chance(Use::Furniture, house.index(room.number), 0.5) {
        let foot = ((room.low + room.high) * 0.5).with_y(room.low.y);
        table_and_chairs(house, room, foot, cell);
    } else {
        let corner = Vec3::new(room.high.x - 0.5 - GAP_M, room.low.y, room.high.z - 1.0 - GAP_M);
        cell.offer(Rank::Furniture, Prop::Bed, Placement::quarter_turned(corner, 2));
        let wall = Vec3::new(room.low.x + 0.15 + GAP_M, room.low.y, room.low.z + 0.45 + GAP_M);
        cell.offer(Rank::Furniture, Prop::Shelf, Placement::quarter_turned(wall, 1));
    }
}

fn stairs(room: &Room, storey: u32) -> Placement {
    let side = room.high.x - 0.02;
    if storey.is_multiple_of(2) {
        let foot = Vec3::new(side - STAIRS_WIDTH_M, room.low.y, room.high.z - 0.05 - STAIRS_LENGTH_M);
        Placement::at(foot)
    } else {
        Placement::quarter_turned(Vec3::new(side, room.low.y, room.low.z + 0.05 + STAIRS_LENGTH_M), 2)
    }
}

fn table_and_chairs(house: &House, room: &Room, foot: Vec3, cell: &mut CellBuilder<'_>) {
    cell.offer(Rank::Furniture, Prop::Table, Placement::at(foot));
    let ends = [(Vec3::new(0.0, 0.0, -0.78), 0.0f32), (Vec3::new(0.0, 0.0, 0.78), 1.0)];
    for (i, (aside, turned)) in ends.into_iter().enumerate() {
        let index = house.index(32 + room.number * 2 + i as u32);
        let turn = house.draw.between(Use::Furniture, index, -0.25, 0.25);
        let mut chair = Placement::turned(foot + aside, turn, 1.0);
        if turned > 0.0 {
            chair.rotation = Placement::quarter_turned(foot, 2).rotation * chair.rotation;
        }
        cell.offer(Rank::Furniture, Prop::Chair, chair);
    }
}
