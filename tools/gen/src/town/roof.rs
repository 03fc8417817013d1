//! Roofs: flat ones with a parapet, gables with overhanging eaves and a chimney, and tiles on them.

use super::cell::{CellBuilder, Rank};
use super::house::House;
use super::paint::Paint;
use super::prop::Prop;
use crate::draw::Use;
use crate::masonry::{Fill, Masonry, RoomPaint};
use crate::mesh::Placement;
use crate::solids::gable;
use earthshine_world::Vec3;
use glam::{Mat3, Quat};

const PARAPET_HEIGHT_M: f32 = 0.5;
const PARAPET_M: f32 = 0.25;
const EAVES_M: f32 = 0.4;
/// How far the gable's underside lies below the walls' top, m: inside the slab, not in its plane.
const SUNK_M: f32 = 0.1;

/// What covers a house.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Roof {
    Flat,
    Gable {
        /// Into [`Paint::ROOFS`].
        paint: u32,
        /// Of the ridge over the eaves, m.
        rise: f32,
        along_x: bool,
    },
}

pub(crate) fn plan(house: &House) -> Roof {
    let (draw, lot) = (house.draw, house.lot);
    if draw.chance(Use::HouseShape, lot << 3 | 2, 0.25) {
        return Roof::Flat;
    }
    let size = house.high - house.low;
    let along_x = size.x >= size.z;
    let half_span = EAVES_M + size.x.min(size.z) / 2.0;
    let rise = half_span * draw.between(Use::HouseShape, lot << 3 | 3, 0.55, 0.95);
    Roof::Gable { paint: draw.below(Use::Paint, 16 + lot, Paint::ROOFS.len() as u32), rise, along_x }
}

impl Roof {
    /// The parts that are masonry: a parapet, or a chimney.
    pub(crate) fn build_flat_parts(self, house: &House, masonry: &mut Masonry) {
        let (low, high, top) = (house.low, house.high, house.top());
        match self {
            Self::Flat => {
                let rim = top + PARAPET_HEIGHT_M;
                masonry.fill(low.with_y(top), high.with_y(rim), Fill::Wall(house.facade.id()));
                let inset = Vec3::new(PARAPET_M, 0.0, PARAPET_M);
                let felt = Paint::RoofFelt.id();
                let paint = RoomPaint { walls: house.facade.id(), floor: felt, ceiling: felt };
                masonry.fill(low.with_y(top) + inset, high.with_y(rim) - inset, Fill::Room(paint));
            }
            Self::Gable { rise, .. } => {
                let foot = low.lerp(high, 0.3).with_y(top);
                let size = Vec3::new(0.6, rise + 0.4, 0.6);
                masonry.fill(foot, foot + size, Fill::Trim(Paint::Chimney.id()));
            }
        }
    }

    /// The parts that are not.
    pub(crate) fn build(self, house: &House, cell: &mut CellBuilder<'_>) {
        let Self::Gable { paint, rise, along_x } = self else { return };
        let eaves = Vec3::new(EAVES_M, 0.0, EAVES_M);
        let (low, high) = (house.low - eaves, house.high + eaves);
        let y = house.top() - SUNK_M;
        gable(
            &mut cell.mesh,
            Paint::ROOFS[paint as usize].id(),
            low.with_y(y),
            high.with_y(y),
            rise,
            along_x,
        );
        for side in [-1.0f32, 1.0] {
            let slope = Slope::of((low.with_y(y), high.with_y(y)), rise, along_x, side);
            slope.tile(paint as u8, cell);
        }
    }
}

/// One rectangle of a gable.
struct Slope {
    /// Middle of the eaves.
    foot: Vec3,
    /// Along the eaves, outward from the roof, and down the slope.
    axes: Mat3,
    length: f32,
    height: f32,
}

impl Slope {
    fn of((low, high): (Vec3, Vec3), rise: f32, along_x: bool, side: f32) -> Self {
        let size = high - low;
        let (out, length, half) =
            if along_x { (Vec3::Z, size.x, size.z / 2.0) } else { (Vec3::X, size.z, size.x / 2.0) };
        let out = out * side;
        let normal = (out * rise + Vec3::Y * half).normalize_or(Vec3::Y);
        let along = Vec3::Y.cross(out);
        let middle = (low + high) * 0.5;
        Self {
            foot: middle + out * half,
            axes: Mat3::from_cols(along, normal, along.cross(normal)),
            length,
            height: (rise * rise + half * half).sqrt(),
        }
    }

    /// Whole square metres of tiles, centred.
    fn tile(&self, roof: u8, cell: &mut CellBuilder<'_>) {
        let (columns, rows) = ((self.length - 0.1) as u32, (self.height - 0.1) as u32);
        let rotation = Quat::from_mat3(&self.axes);
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let along = column as f32 + 0.5 - columns as f32 / 2.0;
            let up = (self.height - rows as f32) / 2.0 + row as f32 + 0.5;
            let translation = self.foot + self.axes * Vec3::new(along, 0.0, -up);
            cell.offer(Rank::Roof, Prop::Tiles(roof), Placement { translation, rotation, scale: 1.0 });
        }
    }
}
