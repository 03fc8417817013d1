//! What stands in a town more than once: made once, placed often.
//!
//! Feet reach a little below y = 0, into whatever the prop stands on, so that no two faces share a plane.

use super::foliage::tree;
use super::paint::Paint;
use super::{indoors, outdoors};
use crate::draw::Draw;
use crate::masonry::{Fill, Masonry};
use crate::mesh::Mesh;
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
            Self::Lamp => outdoors::lamp(),
            Self::Bench => outdoors::bench(),
            Self::Car(variant) => outdoors::car(variant),
            Self::Stall(variant) => outdoors::stall(variant, detail.goods, draw),
            Self::Fountain => outdoors::fountain(),
            Self::WindowFrame => indoors::window_frame(),
            Self::Table => indoors::table(),
            Self::Chair => indoors::chair(),
            Self::Shelf => indoors::shelf(),
            Self::Bed => indoors::bed(),
            Self::Stairs => indoors::stairs(),
            Self::Setts(variant) => outdoors::setts(variant, draw),
            Self::Tiles(roof) => outdoors::tiles(roof),
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
pub(crate) fn boxes(parts: &[(Paint, [f32; 3], [f32; 3])]) -> Mesh {
    let mut masonry = Masonry::default();
    for &(paint, min, max) in parts {
        masonry.fill(min.into(), max.into(), Fill::Trim(paint.id()));
    }
    let mut mesh = Mesh::default();
    masonry.build(&mut mesh);
    mesh
}

/// Four feet at the corners of a rectangle around the origin.
pub(crate) fn feet(
    paint: Paint,
    half_x: f32,
    half_z: f32,
    width: f32,
    top: f32,
) -> [(Paint, [f32; 3], [f32; 3]); 4] {
    [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(x, z): (f32, f32)| {
        let (x, z) = ((half_x - width / 2.0) * x, (half_z - width / 2.0) * z);
        let half = width / 2.0;
        (paint, [x - half, -0.01, z - half], [x + half, top, z + half])
    })
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
