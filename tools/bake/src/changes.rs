//! Where two states of a scene differ, as a few boxes that a ray can be held against.
//!
//! Whatever changed lies in these boxes, with room for rounding. A ray that meets none of them, or meets something else
//! first, finds what it found before. Start at [`Changes::between`].

use crate::cells::Cells;
use crate::sample::OFF_SURFACE;
use earthshine_world::{Bounds, Vec3};
use glam::IVec3;
use std::collections::BTreeSet;

/// Most boxes: a ray that comes near is held against all of them.
const BOXES_MAX: usize = 32;
/// Most cells that boxes are put together from; more are merged eight to one first.
const CELLS_MAX: usize = 4096;
/// Room around a cell, in voxel edges: hits count for the voxel of a place a little off their surface, and a ray's way
/// is known to rounding only.
const MARGIN_VOXELS: f32 = 0.01 + 2.0 * OFF_SURFACE;

/// The places where two states of a scene differ.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Changes {
    boxes: Vec<Bounds>,
    around: Option<Bounds>,
}

impl Changes {
    /// Where `old` and `new` differ; `None` if their cells are of different sizes.
    pub(crate) fn between(old: &Cells, new: &Cells) -> Option<Self> {
        if !old.has_edge_of(new) {
            return None;
        }
        let (mut cells, mut halvings) = (BTreeSet::<[i32; 3]>::new(), 0i32);
        let changed = old.filled().chain(new.filled()).filter(|(cell, _)| old.at(*cell) != new.at(*cell));
        for (cell, _) in changed {
            cells.insert((cell >> halvings).to_array());
            if cells.len() > CELLS_MAX {
                (cells, halvings) = (halved(&cells), halvings + 1);
            }
        }
        let mut merged = merged(&cells);
        while merged.len() > BOXES_MAX {
            (cells, halvings) = (halved(&cells), halvings + 1);
            merged = self::merged(&cells);
        }
        let (edge_m, margin_m) = (new.edge_m(), MARGIN_VOXELS * new.voxel_edge_m());
        let bounds = |(first, last): (IVec3, IVec3)| Bounds {
            min: (first << halvings).as_vec3() * edge_m - margin_m,
            max: ((last + 1) << halvings).as_vec3() * edge_m + margin_m,
        };
        Some(Self::in_boxes(merged.into_iter().map(bounds).collect()))
    }

    fn in_boxes(boxes: Vec<Bounds>) -> Self {
        let unite = |a: Bounds, b: Bounds| Bounds { min: a.min.min(b.min), max: a.max.max(b.max) };
        let around = boxes.iter().copied().reduce(unite);
        Self { boxes, around }
    }

    /// Whether nothing changed.
    pub(crate) fn is_empty(&self) -> bool {
        self.boxes.is_empty()
    }

    /// The middle of one of them, m; zero if nothing changed.
    pub(crate) fn example(&self) -> Vec3 {
        self.boxes.first().map_or(Vec3::ZERO, |bounds| 0.5 * (bounds.min + bounds.max))
    }

    /// Whether any of them meets the box from `low` to `high`, m.
    pub(crate) fn touch(&self, low: Vec3, high: Vec3) -> bool {
        self.boxes.iter().any(|bounds| bounds.min.cmple(high).all() && bounds.max.cmpge(low).all())
    }

    /// How far along unit `direction` from `origin` the first of them begins, if within `distance_max`, m.
    pub(crate) fn entry(&self, origin: Vec3, direction: Vec3, distance_max: f32) -> Option<f32> {
        let inverse = direction.recip();
        slab_entry(self.around.as_ref()?, origin, inverse, distance_max)?;
        let entries =
            self.boxes.iter().filter_map(|bounds| slab_entry(bounds, origin, inverse, distance_max));
        entries.min_by(f32::total_cmp)
    }
}

/// Where a ray enters `bounds`; zero if it begins inside.
fn slab_entry(bounds: &Bounds, origin: Vec3, inverse: Vec3, distance_max: f32) -> Option<f32> {
    let (mut near, mut far) = (0.0f32, distance_max);
    for axis in 0..3 {
        let a = (bounds.min[axis] - origin[axis]) * inverse[axis];
        let b = (bounds.max[axis] - origin[axis]) * inverse[axis];
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near <= far).then_some(near)
}

/// Cells of twice the edge.
fn halved(cells: &BTreeSet<[i32; 3]>) -> BTreeSet<[i32; 3]> {
    cells.iter().map(|cell| cell.map(|part| part >> 1)).collect()
}

/// Boxes of whole cells, first and last of each, that hold all of `cells` and nothing else.
fn merged(cells: &BTreeSet<[i32; 3]>) -> Vec<(IVec3, IVec3)> {
    let mut left = cells.clone();
    let mut boxes = Vec::new();
    while let Some(&first) = left.first() {
        let first = IVec3::from(first);
        let mut last = first;
        for axis in [2, 1, 0] {
            loop {
                // The next slice of the box along this axis.
                let (mut low, mut high) = (first, last);
                low[axis] = last[axis] + 1;
                high[axis] = low[axis];
                if !cells_of(low, high).all(|cell| left.contains(&cell)) {
                    break;
                }
                last[axis] += 1;
            }
        }
        cells_of(first, last).for_each(|cell| {
            left.remove(&cell);
        });
        boxes.push((first, last));
    }
    boxes
}

fn cells_of(low: IVec3, high: IVec3) -> impl Iterator<Item = [i32; 3]> {
    (low.x..=high.x)
        .flat_map(move |x| (low.y..=high.y).flat_map(move |y| (low.z..=high.z).map(move |z| [x, y, z])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_hold_all_cells_once() {
        let slab = cells_of(IVec3::new(-2, 0, 5), IVec3::new(1, 3, 9));
        let cells: BTreeSet<[i32; 3]> = slab.chain([[7, 7, 7], [7, 7, 8], [-2, 0, 10]]).collect();
        let boxes = merged(&cells);
        assert!(boxes.len() <= 4, "{boxes:?}");
        let mut found: Vec<[i32; 3]> = boxes.iter().flat_map(|&(low, high)| cells_of(low, high)).collect();
        found.sort_unstable();
        assert!(found.iter().eq(cells.iter()), "{boxes:?}");
        assert_eq!(halved(&BTreeSet::from([[-1, 2, 3], [-2, 3, 2]])).len(), 1);
    }

    #[test]
    fn rays_enter_the_nearest_box() {
        let cube = |x: f32| Bounds { min: Vec3::new(x, -1.0, -1.0), max: Vec3::new(x + 2.0, 1.0, 1.0) };
        let changes = Changes::in_boxes(vec![cube(8.0), cube(4.0)]);
        assert_eq!(changes.entry(Vec3::ZERO, Vec3::X, f32::INFINITY), Some(4.0));
        assert_eq!(changes.entry(Vec3::X * 5.0, Vec3::Y, f32::INFINITY), Some(0.0), "begins inside");
        assert_eq!(changes.entry(Vec3::X * 7.0, Vec3::X, 0.5), None, "ends before");
        assert_eq!(changes.entry(Vec3::ZERO, Vec3::NEG_X, f32::INFINITY), None);
        assert_eq!(changes.entry(Vec3::ZERO, Vec3::new(0.8, 0.6, 0.0), f32::INFINITY), None);
        assert!(changes.touch(Vec3::X * 3.0, Vec3::X * 4.5) && !changes.touch(Vec3::ZERO, Vec3::X));
        assert_eq!(Changes::default().entry(Vec3::ZERO, Vec3::X, f32::INFINITY), None);
    }
}
