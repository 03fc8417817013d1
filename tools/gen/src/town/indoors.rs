//! Props of houses: window frames, furniture, stairs.

use super::paint::Paint;
use super::prop::{boxes, feet};
use crate::masonry::{Fill, Masonry};
use crate::mesh::Mesh;
use earthshine_world::Vec3;

/// Opening that the frame fills, m.
pub(crate) const WINDOW_WIDTH_M: f32 = 1.1;
pub(crate) const WINDOW_HEIGHT_M: f32 = 1.3;

pub(crate) fn window_frame() -> Mesh {
    // Its rim reaches 2 cm into the wall.
    let (x, y, deep) = (WINDOW_WIDTH_M / 2.0 + 0.02, WINDOW_HEIGHT_M / 2.0 + 0.02, 0.03);
    let mut masonry = Masonry::default();
    let frame = Vec3::new(x, y, deep);
    masonry.fill(-frame, frame, Fill::Trim(Paint::FrameWhite.id()));
    let (rim, bar) = (0.08, 0.025);
    for (x0, x1) in [(-x + rim, -bar), (bar, x - rim)] {
        for (y0, y1) in [(-y + rim, 0.2 - bar), (0.2 + bar, y - rim)] {
            masonry.fill(Vec3::new(x0, y0, -deep), Vec3::new(x1, y1, deep), Fill::Opening);
        }
    }
    let mut mesh = Mesh::default();
    masonry.build(&mut mesh);
    mesh
}

pub(crate) fn table() -> Mesh {
    let mut parts = feet(Paint::Wood, 0.4, 0.65, 0.07, 0.72).to_vec();
    parts.push((Paint::Wood, [-0.45, 0.72, -0.7], [0.45, 0.76, 0.7]));
    boxes(&parts)
}

pub(crate) fn chair() -> Mesh {
    let mut parts = feet(Paint::Wood, 0.2, 0.2, 0.05, 0.42).to_vec();
    parts.push((Paint::Wood, [-0.21, 0.42, -0.21], [0.21, 0.46, 0.21]));
    parts.push((Paint::Wood, [-0.21, 0.46, -0.21], [0.21, 0.92, -0.17]));
    boxes(&parts)
}

pub(crate) fn shelf() -> Mesh {
    let mut masonry = Masonry::default();
    let wood = Fill::Trim(Paint::Wood.id());
    masonry.fill(Vec3::new(-0.45, -0.01, -0.15), Vec3::new(0.45, 1.8, 0.15), wood);
    let colours = [Paint::CanvasRed, Paint::CanvasBlue, Paint::FruitGreen, Paint::Linen];
    for board in 0..4u32 {
        let y = 0.06 + 0.44 * board as f32;
        masonry.fill(Vec3::new(-0.42, y, -0.12), Vec3::new(0.42, y + 0.4, 0.15), Fill::Opening);
        for (book, colour) in (0..6u32).zip(colours.iter().cycle().skip(board as usize)) {
            let x = -0.4 + 0.06 * book as f32 + 0.1 * ((book + board) % 3) as f32;
            let height = 0.2 + 0.03 * ((book * 2 + board) % 4) as f32;
            masonry.fill(
                Vec3::new(x, y, -0.12),
                Vec3::new(x + 0.05, y + height, 0.08),
                Fill::Trim(colour.id()),
            );
        }
    }
    let mut mesh = Mesh::default();
    masonry.build(&mut mesh);
    mesh
}

pub(crate) fn bed() -> Mesh {
    let mut parts = feet(Paint::Wood, 0.5, 1.0, 0.08, 0.25).to_vec();
    parts.extend([
        (Paint::Wood, [-0.5, 0.2, -1.0], [0.5, 0.3, 1.0]),
        (Paint::Linen, [-0.46, 0.3, -0.92], [0.46, 0.48, 0.98]),
        (Paint::Linen, [-0.35, 0.48, -0.88], [0.35, 0.58, -0.5]),
        (Paint::Wood, [-0.5, 0.2, -1.0], [0.5, 0.85, -0.95]),
    ]);
    boxes(&parts)
}

/// A flight of stairs: width, length and risers.
pub(crate) const STAIRS_WIDTH_M: f32 = 0.86;
pub(crate) const STAIRS_LENGTH_M: f32 = 2.97;
const TREADS: u32 = 11;
/// From one floor to the next, m: what a flight climbs with one riser more than treads.
pub(crate) const STOREY_RISE_M: f32 = 3.05;

pub(crate) fn stairs() -> Mesh {
    let (run, rise) = (STAIRS_LENGTH_M / TREADS as f32, STOREY_RISE_M / (TREADS + 1) as f32);
    let tread = |i: u32| {
        let top = rise * (i + 1) as f32;
        let end = if i + 1 < TREADS { run * (i + 1) as f32 } else { STAIRS_LENGTH_M };
        // Solid below the lowest steps, a sloping slab of steps above.
        let below = if i < 3 { -0.01 } else { rise * (i - 2) as f32 };
        (Paint::Wood, [0.0, below, run * i as f32], [STAIRS_WIDTH_M, top, end])
    };
    boxes(&(0..TREADS).map(tread).collect::<Vec<_>>())
}
