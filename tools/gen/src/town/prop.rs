//! What stands in a town more than once: made once, placed often.
//!
//! Feet reach a little below y = 0, into whatever the prop stands on, so that no two faces share a plane.

use super::foliage::tree;
use super::paint::Paint;
use crate::draw::{Draw, Use};
use crate::masonry::{Fill, Masonry};
use crate::mesh::Mesh;
use crate::solids::{octahedron, taper};
use earthshine_world::Vec3;
use std::collections::BTreeMap;

/// A kind of prop; numbers tell variants apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Prop {
    /// Two broad trees, two tall ones, two conifers.
    Tree(u8),
    /// Street lamp; its arm points along +X.
    Lamp,
    /// Seat for a square, facing +Z.
    Bench,
    /// Parked, along Z.
    Car(u8),
    /// Market stall, its counter towards +Z.
    Stall(u8),
    /// Steps and a basin.
    Fountain,
    /// Fills a window opening in a wall that faces Z; origin in its middle.
    WindowFrame,
    /// Top 0.9 m by 1.4 m.
    Table,
    /// Its back towards -Z.
    Chair,
    /// 0.9 m wide, its back towards -Z.
    Shelf,
    /// 1 m by 2 m, origin in its middle.
    Bed,
    /// One storey up along +Z; its foot begins at z = 0, its left side at x = 0.
    Stairs,
    /// One square metre of raised stones.
    Setts(u8),
    /// One square metre of roof tiles, a colour each, normal +Y.
    Tiles(u8),
}

impl Prop {
    pub(crate) const TREES: u8 = 6;
    pub(crate) const CARS: u8 = 4;
    pub(crate) const STALLS: u8 = 3;
    pub(crate) const SETTS: u8 = 2;

    /// Every prop of every town.
    fn all() -> Vec<Self> {
        let mut all = vec![Self::Lamp, Self::Bench, Self::Fountain, Self::WindowFrame, Self::Table];
        all.extend([Self::Chair, Self::Shelf, Self::Bed, Self::Stairs]);
        all.extend((0..Self::TREES).map(Self::Tree));
        all.extend((0..Self::CARS).map(Self::Car));
        all.extend((0..Self::STALLS).map(Self::Stall));
        all.extend((0..Self::SETTS).map(Self::Setts));
        all.extend((0..Paint::ROOFS.len() as u8).map(Self::Tiles));
        all
    }

    fn make(self, detail: &Detail, draw: Draw) -> Mesh {
        match self {
            Self::Tree(variant) => tree(variant, detail.tufts, draw),
            Self::Lamp => lamp(),
            Self::Bench => bench(),
            Self::Car(variant) => car(variant),
            Self::Stall(variant) => stall(variant, detail.goods, draw),
            Self::Fountain => fountain(),
            Self::WindowFrame => window_frame(),
            Self::Table => table(),
            Self::Chair => chair(),
            Self::Shelf => shelf(),
            Self::Bed => bed(),
            Self::Stairs => stairs(),
            Self::Setts(variant) => setts(variant, draw),
            Self::Tiles(roof) => tiles(roof),
        }
    }
}

impl std::fmt::Display for Prop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (name, variant) = match *self {
            Self::Tree(v) => ("tree", Some(v)),
            Self::Car(v) => ("car", Some(v)),
            Self::Stall(v) => ("stall", Some(v)),
            Self::Setts(v) => ("setts", Some(v)),
            Self::Tiles(v) => ("roof tiles", Some(v)),
            Self::Lamp => ("lamp", None),
            Self::Bench => ("bench", None),
            Self::Fountain => ("fountain", None),
            Self::WindowFrame => ("window frame", None),
            Self::Table => ("table", None),
            Self::Chair => ("chair", None),
            Self::Shelf => ("shelf", None),
            Self::Bed => ("bed", None),
            Self::Stairs => ("stairs", None),
        };
        match variant {
            Some(variant) => write!(f, "{name} {variant}"),
            None => f.write_str(name),
        }
    }
}

/// How finely props are made; the same for the whole town.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Detail {
    /// Tufts of leaves a tree, 8 triangles each.
    pub(crate) tufts: u32,
    /// Fruit a stall, 8 triangles each.
    pub(crate) goods: u32,
}

impl Detail {
    /// For cells of about `triangles`: what plain props leave over goes in part to foliage.
    pub(crate) fn for_cell(triangles: u64) -> Self {
        let over = triangles.saturating_sub(12_000);
        // A third of it, over about twelve trees a cell of eight triangles a tuft.
        Self { tufts: (over / 3 / 96).min(600) as u32, goods: 12 + (over / 1000).min(60) as u32 }
    }
}

/// All props of one town.
#[derive(Debug)]
pub(crate) struct PropLibrary {
    meshes: BTreeMap<Prop, Mesh>,
}

impl PropLibrary {
    pub(crate) fn new(seed: u64, detail: &Detail) -> Self {
        let draw = Draw::of_world(seed);
        Self { meshes: Prop::all().into_iter().map(|prop| (prop, prop.make(detail, draw))).collect() }
    }

    /// The mesh of `prop`: every prop has one.
    pub(crate) fn mesh(&self, prop: Prop) -> &Mesh {
        &self.meshes[&prop]
    }
}

/// Boxes united into one closed solid.
fn boxes(parts: &[(Paint, [f32; 3], [f32; 3])]) -> Mesh {
    let mut masonry = Masonry::default();
    for &(paint, min, max) in parts {
        masonry.fill(min.into(), max.into(), Fill::Trim(paint.id()));
    }
    let mut mesh = Mesh::default();
    masonry.build(&mut mesh);
    mesh
}

/// Four feet at the corners of a rectangle around the origin.
fn feet(paint: Paint, half_x: f32, half_z: f32, width: f32, top: f32) -> [(Paint, [f32; 3], [f32; 3]); 4] {
    [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(x, z): (f32, f32)| {
        let (x, z) = ((half_x - width / 2.0) * x, (half_z - width / 2.0) * z);
        let half = width / 2.0;
        (paint, [x - half, -0.01, z - half], [x + half, top, z + half])
    })
}

/// Where a lamp of its own would hang below the head of [`Prop::Lamp`], m.
pub(crate) const LAMP_LIGHT: Vec3 = Vec3::new(0.6, 4.0, 0.0);

fn lamp() -> Mesh {
    let mut mesh = boxes(&[
        (Paint::Iron, [-0.04, 4.33, -0.04], [0.7, 4.41, 0.04]),
        (Paint::Iron, [0.42, 4.25, -0.18], [0.78, 4.35, 0.18]),
        (Paint::StreetLamp, [0.45, 4.19, -0.15], [0.75, 4.25, 0.15]),
    ]);
    taper(&mut mesh, Paint::Iron.id(), Vec3::new(0.0, -0.05, 0.0), 4.5, 0.09, 0.06);
    taper(&mut mesh, Paint::Iron.id(), Vec3::new(0.0, -0.07, 0.0), 0.42, 0.16, 0.12);
    mesh
}

fn bench() -> Mesh {
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

fn car(variant: u8) -> Mesh {
    let body = [Paint::CarRed, Paint::CarBlue, Paint::CarWhite, Paint::CarGreen][usize::from(variant % Prop::CARS)];
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

fn stall(variant: u8, goods: u32, draw: Draw) -> Mesh {
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

fn fountain() -> Mesh {
    let mut mesh = Mesh::default();
    let step = |mesh: &mut Mesh, paint: Paint, y: f32, height: f32, lower: f32, upper: f32| {
        taper(mesh, paint.id(), Vec3::Y * y, height, lower, upper);
    };
    step(&mut mesh, Paint::Stone, -0.05, 0.25, 2.2, 2.2);
    step(&mut mesh, Paint::Stone, 0.1, 0.5, 1.8, 1.7);
    step(&mut mesh, Paint::Water, 0.55, 0.1, 1.5, 1.5);
    step(&mut mesh, Paint::Stone, 0.6, 1.0, 0.3, 0.2);
    step(&mut mesh, Paint::Stone, 1.55, 0.2, 0.3, 0.8);
    step(&mut mesh, Paint::Stone, 1.7, 0.6, 0.15, 0.0);
    mesh
}

/// Opening that the frame fills, m.
pub(crate) const WINDOW_WIDTH_M: f32 = 1.1;
pub(crate) const WINDOW_HEIGHT_M: f32 = 1.3;

fn window_frame() -> Mesh {
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

fn table() -> Mesh {
    let mut parts = feet(Paint::Wood, 0.4, 0.65, 0.07, 0.72).to_vec();
    parts.push((Paint::Wood, [-0.45, 0.72, -0.7], [0.45, 0.76, 0.7]));
    boxes(&parts)
}

fn chair() -> Mesh {
    let mut parts = feet(Paint::Wood, 0.2, 0.2, 0.05, 0.42).to_vec();
    parts.push((Paint::Wood, [-0.21, 0.42, -0.21], [0.21, 0.46, 0.21]));
    parts.push((Paint::Wood, [-0.21, 0.46, -0.21], [0.21, 0.92, -0.17]));
    boxes(&parts)
}

fn shelf() -> Mesh {
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
            masonry.fill(Vec3::new(x, y, -0.12), Vec3::new(x + 0.05, y + height, 0.08), Fill::Trim(colour.id()));
        }
    }
    let mut mesh = Mesh::default();
    masonry.build(&mut mesh);
    mesh
}

fn bed() -> Mesh {
    let mut parts = feet(Paint::Wood, 0.5, 1.0, 0.08, 0.25).to_vec();
    parts.extend([
        (Paint::Wood, [-0.5, 0.2, -1.0], [0.5, 0.3, 1.0]),
        (Paint::Linen, [-0.46, 0.3, -0.92], [0.46, 0.48, 0.98]),
        (Paint::Linen, [-0.35, 0.48, -0.88], [0.35, 0.58, -0.5]),
        (Paint::Wood, [-0.5, 0.2, -1.0], [0.5, 0.85, -0.95]),
    ]);
    boxes(&parts)
}

/// A flight of [`Prop::Stairs`]: width, length and risers.
pub(crate) const STAIRS_WIDTH_M: f32 = 0.86;
pub(crate) const STAIRS_LENGTH_M: f32 = 2.97;
const TREADS: u32 = 11;
/// From one floor to the next, m: what a flight climbs with one riser more than treads.
pub(crate) const STOREY_RISE_M: f32 = 3.05;

fn stairs() -> Mesh {
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

/// Rows and columns of one square metre of stones, and of tiles.
const SETTS_ON_EDGE: u32 = 5;
const TILES_ON_EDGE: u32 = 4;

fn setts(variant: u8, draw: Draw) -> Mesh {
    let paint = [Paint::Sett, Paint::Paving][usize::from(variant % Prop::SETTS)];
    let pitch = 1.0 / SETTS_ON_EDGE as f32;
    let stone = |i: u32| {
        let (x, z) = ((i % SETTS_ON_EDGE) as f32 * pitch - 0.49, (i / SETTS_ON_EDGE) as f32 * pitch - 0.49);
        let top = draw.between(Use::Stone, u32::from(variant) << 8 | i, 0.015, 0.035);
        (paint, [x, -0.02, z], [x + pitch - 0.02, top, z + pitch - 0.02])
    };
    boxes(&(0..SETTS_ON_EDGE * SETTS_ON_EDGE).map(stone).collect::<Vec<_>>())
}

fn tiles(roof: u8) -> Mesh {
    let paint = Paint::ROOFS[usize::from(roof) % Paint::ROOFS.len()];
    let pitch = 1.0 / TILES_ON_EDGE as f32;
    let tile = |i: u32| {
        let (x, z) = ((i % TILES_ON_EDGE) as f32 * pitch - 0.49, (i / TILES_ON_EDGE) as f32 * pitch - 0.49);
        (paint, [x, -0.02, z], [x + pitch - 0.02, 0.025, z + pitch - 0.02])
    };
    boxes(&(0..TILES_ON_EDGE * TILES_ON_EDGE).map(tile).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::oracle;

    #[test]
    fn every_prop_is_a_closed_solid_with_its_fronts_outside() {
        let library = PropLibrary::new(1, &Detail::for_cell(20_000));
        for (prop, mesh) in &library.meshes {
            assert!(oracle::gap(mesh) < 1e-3, "{prop} is open");
            assert!(oracle::volume(mesh) > 0.001, "{prop} is inside out: {}", oracle::volume(mesh));
        }
    }
}
