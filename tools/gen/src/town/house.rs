//! Houses: outer walls 30 cm thick, storeys, two or three rooms each, doors and windows that let light in.
//!
//! Each wall has three bays: a window in the middle of each, the front door in one, partitions between them. So
//! openings never meet walls. Roofs are in `roof`, what stands in the rooms in `furnish`.

use super::cell::{BLOCK_HIGH_M, BLOCK_LOW_M, CellBuilder, Rank};
use super::furnish::{self, Room};
use super::indoors::{STAIRS_WIDTH_M, STOREY_RISE_M, WINDOW_HEIGHT_M, WINDOW_WIDTH_M};
use super::paint::Paint;
use super::prop::Prop;
use super::roof;
use super::street::{LAWN_M, tree};
use crate::draw::{Draw, Use};
use crate::masonry::{Fill, Masonry, RoomPaint};
use crate::mesh::Placement;
use earthshine_world::Vec3;

const LOTS: u32 = 4;
const WALL_M: f32 = 0.3;
const PARTITION_M: f32 = 0.2;
/// Floor of the lowest storey, above the road, m.
const GROUND_FLOOR_M: f32 = 0.3;
const FOUNDATION_M: f32 = -0.4;
/// From floor to ceiling, m; the slab between storeys is the rest of [`STOREY_RISE_M`].
const ROOM_HEIGHT_M: f32 = 2.8;
const DOOR_WIDTH_M: f32 = 0.9;
const DOOR_HEIGHT_M: f32 = 2.05;
const SILL_M: f32 = 0.9;
const BAYS: u32 = 3;
/// From the pavement to the wall, m.
const SETBACK_M: std::ops::Range<f32> = 0.5..0.9;
const SIDE_M: std::ops::Range<f32> = 8.0..9.6;

/// One house of a block.
#[derive(Debug, Clone)]
pub(crate) struct House {
    /// 0 to 3: -X or +X half of the block, then -Z or +Z.
    pub(crate) lot: u32,
    /// Outer faces of the walls, y = 0, m.
    pub(crate) low: Vec3,
    pub(crate) high: Vec3,
    pub(crate) storeys: u32,
    pub(crate) facade: Paint,
    pub(crate) draw: Draw,
}

/// Four houses, and a tree in the garden between them.
pub(crate) fn build_all(cell: &mut CellBuilder<'_>) {
    for lot in 0..LOTS {
        House::plan(cell.draw, lot).build(cell);
    }
    let middle = f32::midpoint(BLOCK_LOW_M, BLOCK_HIGH_M);
    tree(cell, Vec3::new(middle, LAWN_M, middle), 8, (1.1, 1.3));
}

impl House {
    pub(crate) fn plan(draw: Draw, lot: u32) -> Self {
        let size = |k: u32, range: &std::ops::Range<f32>| {
            draw.between(Use::HouseSize, lot << 3 | k, range.start, range.end)
        };
        let span = |upper: bool, k: u32| {
            let (setback, side) = (size(k, &SETBACK_M), size(k + 1, &SIDE_M));
            let start = if upper { BLOCK_HIGH_M - setback - side } else { BLOCK_LOW_M + setback };
            (start, start + side)
        };
        let (x, z) = (span(lot & 1 == 1, 0), span(lot & 2 == 2, 2));
        Self {
            lot,
            low: Vec3::new(x.0, 0.0, z.0),
            high: Vec3::new(x.1, 0.0, z.1),
            storeys: draw.pick(Use::HouseShape, lot << 3, &[1, 2, 2, 2, 3]),
            facade: draw.pick(Use::Paint, lot, &Paint::FACADES),
            draw,
        }
    }

    /// A number for choices about part `part` (below 256) of this house.
    pub(crate) fn index(&self, part: u32) -> u32 {
        self.lot << 8 | part
    }

    /// Top of the slab over the highest storey, m.
    pub(crate) fn top(&self) -> f32 {
        floor(self.storeys)
    }

    pub(crate) fn build(&self, cell: &mut CellBuilder<'_>) {
        let mut masonry = Masonry::default();
        let (low, high) = (self.low.with_y(FOUNDATION_M), self.high.with_y(self.top()));
        masonry.fill(low, high, Fill::Wall(self.facade.id()));
        let roof = roof::plan(self);
        roof.build_flat_parts(self, &mut masonry);
        for storey in 0..self.storeys {
            let plan = Storey::plan(self, storey);
            plan.hollow(self, &mut masonry);
            for room in &plan.rooms {
                furnish::lamp(self, room, &mut masonry);
                furnish::furniture(self, room, cell);
            }
            self.windows(&plan, &mut masonry, cell);
        }
        self.doorstep(&mut masonry);
        masonry.build(&mut cell.mesh);
        roof.build(self, cell);
    }

    /// The side with the front door, as 0 to 3 for -X, -Z, +X, +Z: always towards a street.
    fn front(&self) -> u32 {
        if self.draw.chance(Use::HouseShape, self.lot << 3 | 1, 0.5) {
            2 * (self.lot & 1)
        } else {
            1 + (self.lot & 2)
        }
    }

    /// A box in the outer wall of `side`, centred on bay `bay`, `width` wide, from `y.0` to `y.1`, as thick as the
    /// wall and reaching `out` beyond it.
    fn in_wall(&self, side: u32, bay: u32, width: f32, y: (f32, f32), out: f32) -> (Vec3, Vec3) {
        let (low, high) = self.inside();
        let along = if side.is_multiple_of(2) { 2 } else { 0 };
        let across = 2 - along;
        let middle = bay_line(low[along], high[along], bay as f32 + 0.5);
        let (mut min, mut max) = (Vec3::splat(y.0), Vec3::splat(y.1));
        (min[along], max[along]) = (middle - width / 2.0, middle + width / 2.0);
        (min[across], max[across]) = if side < 2 {
            (self.low[across] - out, low[across])
        } else {
            (high[across], self.high[across] + out)
        };
        (min, max)
    }

    /// Inner faces of the outer walls.
    fn inside(&self) -> (Vec3, Vec3) {
        (self.low + Vec3::new(WALL_M, 0.0, WALL_M), self.high - Vec3::new(WALL_M, 0.0, WALL_M))
    }

    fn windows(&self, plan: &Storey, masonry: &mut Masonry, cell: &mut CellBuilder<'_>) {
        for (side, bay) in (0..4).flat_map(|side| (0..BAYS).map(move |bay| (side, bay))) {
            if plan.number == 0 && (side, bay) == (self.front(), 1) {
                let y = (plan.floor, plan.floor + DOOR_HEIGHT_M);
                let (min, max) = self.in_wall(side, bay, DOOR_WIDTH_M + 0.1, y, 0.0);
                masonry.fill(min, max, Fill::Opening);
                continue;
            }
            if self.draw.chance(Use::RoomShape, self.index(64 + plan.number * 16 + side * 4 + bay), 0.15) {
                continue;
            }
            let y = (plan.floor + SILL_M, plan.floor + SILL_M + WINDOW_HEIGHT_M);
            let (min, max) = self.in_wall(side, bay, WINDOW_WIDTH_M, y, 0.0);
            masonry.fill(min, max, Fill::Opening);
            let frame = Placement::quarter_turned((min + max) * 0.5, (side + 1) % 2);
            cell.offer(Rank::Fitting, Prop::WindowFrame, frame);
        }
    }

    /// Outside the front door, from the foundation to halfway up to the floor.
    fn doorstep(&self, masonry: &mut Masonry) {
        let side = self.front();
        let (mut min, mut max) = self.in_wall(side, 1, 1.5, (FOUNDATION_M, 0.24), 0.45);
        let across = if side.is_multiple_of(2) { 0 } else { 2 };
        if side < 2 {
            max[across] = self.low[across];
        } else {
            min[across] = self.high[across];
        }
        masonry.fill(min, max, Fill::Trim(Paint::Stone.id()));
    }
}

/// Floor of a storey, m. Heights come from here and from [`ceiling`] only: two sums for one height differ in the
/// last bit, and masonry makes a sliver of that.
fn floor(storey: u32) -> f32 {
    GROUND_FLOOR_M + STOREY_RISE_M * storey as f32
}

fn ceiling(storey: u32) -> f32 {
    floor(storey) + ROOM_HEIGHT_M
}

/// Position of `bays` bays from `low` of the way to `high`.
fn bay_line(low: f32, high: f32, bays: f32) -> f32 {
    low + (high - low) * bays / BAYS as f32
}

/// Plan of one storey.
struct Storey {
    number: u32,
    floor: f32,
    rooms: Vec<Room>,
    /// Middle of the partition across X.
    partition: f32,
    /// Middle of the partition across Z, in the +X part.
    second: Option<f32>,
}

impl Storey {
    fn plan(house: &House, number: u32) -> Self {
        let (low, high) = house.inside();
        let floor = floor(number);
        let draw = |k: u32| house.index(number * 8 + k);
        // The same on all storeys, so that stairs meet their holes.
        let line = 1 + house.draw.below(Use::RoomShape, house.index(255), 2);
        let partition = bay_line(low.x, high.x, line as f32);
        let second = house
            .draw
            .chance(Use::RoomShape, draw(1), 0.6)
            .then(|| bay_line(low.z, high.z, (1 + house.draw.below(Use::RoomShape, draw(2), 2)) as f32));
        let half = PARTITION_M / 2.0;
        let mut spans = vec![((low.x, partition - half), (low.z, high.z))];
        match second {
            None => spans.push(((partition + half, high.x), (low.z, high.z))),
            Some(z) => {
                spans.push(((partition + half, high.x), (low.z, z - half)));
                spans.push(((partition + half, high.x), (z + half, high.z)));
            }
        }
        let rooms = (0u32..).zip(spans).map(|(i, ((x0, x1), (z0, z1)))| Room {
            low: Vec3::new(x0, floor, z0),
            high: Vec3::new(x1, ceiling(number), z1),
            number: number * 4 + i,
            has_stairs: i == 0,
        });
        let rooms = rooms.collect();
        Self { number, floor, rooms, partition, second }
    }

    /// Rooms, the doors between them, and the hole over the stairs from the storey below.
    fn hollow(&self, house: &House, masonry: &mut Masonry) {
        for room in &self.rooms {
            let pick = |k: u32, paints: &[Paint]| {
                house.draw.pick(Use::RoomPaint, house.index(room.number * 4 + k), paints)
            };
            let paint = RoomPaint {
                walls: pick(0, &Paint::WALLS).id(),
                floor: pick(1, &Paint::FLOORS).id(),
                ceiling: Paint::Ceiling.id(),
            };
            masonry.fill(room.low, room.high, Fill::Room(paint));
        }
        let (low, high) = house.inside();
        let (half, door) = (PARTITION_M / 2.0, DOOR_WIDTH_M / 2.0);
        let top = self.floor + DOOR_HEIGHT_M;
        let middle = bay_line(low.z, high.z, 1.5);
        let min = Vec3::new(self.partition - half, self.floor, middle - door);
        masonry.fill(min, Vec3::new(self.partition + half, top, middle + door), Fill::Opening);
        if let Some(z) = self.second {
            let x = f32::midpoint(self.partition + half, high.x);
            let min = Vec3::new(x - door, self.floor, z - half);
            masonry.fill(min, Vec3::new(x + door, top, z + half), Fill::Opening);
        }
        if self.number > 0 {
            let below = self.number - 1;
            let (z0, z1) =
                if below.is_multiple_of(2) { (high.z - 3.07, high.z) } else { (low.z, low.z + 3.07) };
            let wall = self.partition - half;
            let width = STAIRS_WIDTH_M + 0.04;
            masonry.fill(
                Vec3::new(wall - width, ceiling(below), z0),
                Vec3::new(wall, self.floor, z1),
                Fill::Opening,
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Mesh, oracle};

    #[test]
    fn houses_are_closed_solids_within_their_lots() {
        for seed in 0..30 {
            let house = House::plan(Draw::of_cell(seed, (1, -2)), seed as u32 % 4);
            let middle = f32::midpoint(BLOCK_LOW_M, BLOCK_HIGH_M);
            assert!(
                house.low.min_element() >= 0.0 && house.high.x < BLOCK_HIGH_M && house.high.z < BLOCK_HIGH_M
            );
            let (near, far) = if house.lot & 1 == 1 { (house.low.x, middle) } else { (middle, house.high.x) };
            assert!(near > far + 2.0, "no garden behind the house of lot {}", house.lot);
            let mut masonry = Masonry::default();
            masonry.fill(
                house.low.with_y(FOUNDATION_M),
                house.high.with_y(house.top()),
                Fill::Wall(house.facade.id()),
            );
            let whole = f64::from((house.high.x - house.low.x) * (house.high.z - house.low.z))
                * f64::from(house.top() - FOUNDATION_M);
            for storey in 0..house.storeys {
                Storey::plan(&house, storey).hollow(&house, &mut masonry);
            }
            let mut mesh = Mesh::default();
            masonry.build(&mut mesh);
            assert!(oracle::gap(&mesh) < 1e-2);
            let solid = oracle::volume(&mesh) / whole;
            assert!((0.15..0.45).contains(&solid), "walls take {solid} of the house");
        }
    }
}
