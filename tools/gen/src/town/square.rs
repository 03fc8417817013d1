//! Blocks without houses: a market around a fountain, a park.

use super::cell::{BLOCK_HIGH_M, BLOCK_LOW_M, CellBuilder, Rank};
use super::prop::Prop;
use super::street::{LAWN_M, PAVING_M, tree};
use crate::draw::Use;
use crate::mesh::Placement;
use earthshine_world::Vec3;

const MIDDLE: f32 = f32::midpoint(BLOCK_LOW_M, BLOCK_HIGH_M);
/// Street trees use the numbers below.
const FIRST_TREE: u32 = 16;

/// Paved: a fountain, benches, stalls, trees around.
pub(crate) fn market(cell: &mut CellBuilder<'_>) {
    cell.place(Prop::Fountain, Placement::at(Vec3::new(MIDDLE, PAVING_M, MIDDLE)));
    benches(cell, 3.4, PAVING_M);
    for i in 0..16u32 {
        let (column, row) = (i % 4, i / 4);
        let inner = (1..3).contains(&column) && (1..3).contains(&row);
        if inner || !cell.draw.chance(Use::Square, i, 0.85) {
            continue;
        }
        let place = |k: u32| [12.8, 17.4, 22.6, 27.2][k as usize];
        let stall = Prop::Stall(cell.draw.below(Use::Square, 32 + i, Prop::STALLS.into()) as u8);
        let quarters = cell.draw.below(Use::Square, 64 + i, 4);
        let foot = Vec3::new(place(column), PAVING_M, place(row));
        cell.offer(Rank::Fitting, stall, Placement::quarter_turned(foot, quarters));
    }
    // Five to a side, the corners shared.
    let steps = |k: u32| BLOCK_LOW_M + 1.8 + 5.6 * k as f32;
    let ring = (0..25u32).filter(|i| i % 5 % 4 == 0 || i / 5 % 4 == 0);
    for i in ring {
        tree(cell, Vec3::new(steps(i % 5), PAVING_M, steps(i / 5)), FIRST_TREE + i, (0.85, 1.1));
    }
}

/// Lawn, trees by chance, benches in the middle.
pub(crate) fn park(cell: &mut CellBuilder<'_>) {
    benches(cell, 2.2, LAWN_M);
    for i in 0..25u32 {
        if i == 12 || !cell.draw.chance(Use::Square, 128 + i, 0.8) {
            continue;
        }
        let aside = |k: u32| cell.draw.between(Use::Square, 256 + 2 * i + k, -0.7, 0.7);
        let foot = Vec3::new(
            BLOCK_LOW_M + 2.6 + 5.2 * (i % 5) as f32 + aside(0),
            LAWN_M,
            BLOCK_LOW_M + 2.6 + 5.2 * (i / 5) as f32 + aside(1),
        );
        tree(cell, foot, FIRST_TREE + i, (0.8, 1.4));
    }
}

/// One on each side of the middle, facing away from it.
fn benches(cell: &mut CellBuilder<'_>, radius: f32, y: f32) {
    for (quarters, direction) in [Vec3::Z, Vec3::X, Vec3::NEG_Z, Vec3::NEG_X].into_iter().enumerate() {
        let foot = Vec3::new(MIDDLE, y, MIDDLE) + direction * radius;
        cell.offer(Rank::Street, Prop::Bench, Placement::quarter_turned(foot, quarters as u32));
    }
}
