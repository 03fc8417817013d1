//! Ground, road, pavement, street trees, lamps, parked cars; stones where triangles are left.

use super::cell::{BLOCK_HIGH_M, BLOCK_LOW_M, Block, CellBuilder, Rank};
use super::outdoors::LAMP_LIGHT;
use super::paint::Paint;
use super::prop::Prop;
use crate::GenOptions;
use crate::draw::Use;
use crate::masonry::{Fill, Masonry};
use crate::mesh::Placement;
use earthshine_world::{Light, Rgb, Vec3};

const EDGE: f32 = GenOptions::TOWN_CELL_M;
/// Kerb of the pavement, from the cell's border, m: half the width of a road.
const KERB_M: f32 = 4.0;
const PAVEMENT_M: f32 = 0.15;
/// Top of the block's ground, m.
pub(crate) const LAWN_M: f32 = 0.18;
pub(crate) const PAVING_M: f32 = 0.17;
/// How deep the ground goes, m: a closed slab, so that what lies in it sees only back faces.
const DEPTH_M: f32 = 1.5;

/// Lays the ground and everything outside the block.
pub(crate) fn lay(cell: &mut CellBuilder<'_>, block: Block, neighbours: [bool; 4]) {
    ground(cell, block, neighbours);
    for side in 0..4 {
        lamp(cell, side);
        trees_and_cars(cell, side);
    }
    stones(cell);
}

/// Where `along` metres of side `side` and `inward` metres from the border are. Sides: -X, -Z, +X, +Z.
fn at(side: u32, along: f32, inward: f32, y: f32) -> Vec3 {
    match side {
        0 => Vec3::new(inward, y, along),
        1 => Vec3::new(along, y, inward),
        2 => Vec3::new(EDGE - inward, y, along),
        _ => Vec3::new(along, y, EDGE - inward),
    }
}

fn ground(cell: &mut CellBuilder<'_>, block: Block, neighbours: [bool; 4]) {
    let mut masonry = Masonry::default();
    let mut slab = |low: f32, high: f32, top: f32, paint: Paint| {
        masonry.fill(Vec3::new(low, -DEPTH_M, low), Vec3::new(high, top, high), Fill::Wall(paint.id()));
    };
    slab(0.0, EDGE, 0.0, Paint::Asphalt);
    slab(KERB_M, EDGE - KERB_M, PAVEMENT_M, Paint::Pavement);
    match block {
        Block::Market => slab(BLOCK_LOW_M, BLOCK_HIGH_M, PAVING_M, Paint::Paving),
        Block::Houses | Block::Park => slab(BLOCK_LOW_M, BLOCK_HIGH_M, LAWN_M, Paint::Lawn),
    }
    // The neighbours' ground hides the sides of ours; the town's border shows them.
    let reach = |side: usize| if neighbours[side] { 1.0 } else { 0.0 };
    let low = Vec3::new(-reach(0), -DEPTH_M, -reach(1));
    let high = Vec3::new(EDGE + reach(2), -DEPTH_M / 2.0, EDGE + reach(3));
    masonry.fill(low, high, Fill::Wall(Paint::Soil.id()));
    let high = high.with_y(0.0);
    for (strip_low, strip_high) in
        [(low, high.with_x(0.0)), (low.with_x(EDGE), high), (low, high.with_z(0.0)), (low.with_z(EDGE), high)]
    {
        masonry.fill(strip_low, strip_high, Fill::Wall(Paint::Asphalt.id()));
    }
    for side in 0..4 {
        for stripe in 0..3u8 {
            let inward = 0.5 + f32::from(stripe);
            let (a, b) = (at(side, 18.6, inward, 0.0), at(side, 21.4, inward + 0.5, 0.012));
            masonry.fill(a.min(b), a.max(b), Fill::Wall(Paint::Marking.id()));
        }
    }
    masonry.build_within(Vec3::ZERO.with_y(f32::NEG_INFINITY), Vec3::splat(EDGE), &mut cell.mesh);
}

/// A lamp in the middle of each side; two of four are lights where the town is lit.
fn lamp(cell: &mut CellBuilder<'_>, side: u32) {
    let placement = Placement::quarter_turned(
        at(side, EDGE / 2.0, KERB_M + 0.5, PAVEMENT_M),
        [2, 1, 0, 3][side as usize],
    );
    cell.place(Prop::Lamp, placement);
    if !cell.lamps_light {
        return;
    }
    let (position, warm, range_m) = (placement.apply(LAMP_LIGHT), Rgb::new(1.0, 0.82, 0.58), Some(40.0));
    match side {
        0 => cell.lamp(side, Light::Point { position, intensity: warm * 400.0, range_m }),
        2 => {
            let intensity = warm * 900.0;
            let (inner_cone_rad, outer_cone_rad) = (0.6, 1.1);
            let direction = Vec3::NEG_Y;
            let spot =
                Light::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m };
            cell.lamp(side, spot);
        }
        _ => {}
    }
}

fn trees_and_cars(cell: &mut CellBuilder<'_>, side: u32) {
    for (i, along) in [12.5, 27.5].into_iter().enumerate() {
        let foot = at(side, along, KERB_M + 1.0, PAVEMENT_M);
        tree(cell, foot, side * 2 + i as u32, (0.85, 1.1));
    }
    for (i, along) in [9.0, 14.8, 25.2, 31.0].into_iter().enumerate() {
        let index = side * 4 + i as u32;
        if cell.draw.chance(Use::Car, index, 0.45) {
            let foot = at(side, along, KERB_M - 1.15, 0.0);
            // Cars point along Z; on the sides along X they are turned.
            let quarters = side % 2 + 2 * cell.draw.below(Use::Car, 64 + index, 2);
            let car = Prop::Car(cell.draw.below(Use::Car, 128 + index, Prop::CARS.into()) as u8);
            cell.offer(Rank::Street, car, Placement::quarter_turned(foot, quarters));
        }
    }
}

/// Offers a tree of any kind, turned and scaled; `index` tells it from the others of the cell.
pub(crate) fn tree(cell: &mut CellBuilder<'_>, foot: Vec3, index: u32, scale: (f32, f32)) {
    let draw = cell.draw;
    let kind = Prop::Tree(draw.below(Use::Tree, index << 2, Prop::TREES.into()) as u8);
    let scale = draw.between(Use::Tree, index << 2 | 1, scale.0, scale.1);
    let turn = draw.between(Use::Tree, index << 2 | 2, -1.0, 1.0);
    cell.offer(Rank::Tree, kind, Placement::turned(foot, turn, scale));
}

/// Square metres of stones: pavements and squares first, then the road.
fn stones(cell: &mut CellBuilder<'_>) {
    for (z, x) in (0..EDGE as u32).flat_map(|z| (0..EDGE as u32).map(move |x| (z, x))) {
        let centre = Vec3::new(x as f32 + 0.5, 0.0, z as f32 + 0.5);
        let inward = centre.min(Vec3::splat(EDGE) - centre);
        let inward = inward.x.min(inward.z);
        let index = z * EDGE as u32 + x;
        let quarters = cell.draw.below(Use::Stone, index, 4);
        let (rank, y, variant) = if inward < KERB_M {
            (Rank::Road, 0.0, 0)
        } else if inward < BLOCK_LOW_M {
            (Rank::Paving, PAVEMENT_M, 1)
        } else {
            continue;
        };
        cell.offer(rank, Prop::Setts(variant), Placement::quarter_turned(centre.with_y(y), quarters));
    }
}
