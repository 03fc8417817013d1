//! Walls, rooms and openings as one rectilinear solid: boxes are filled or hollowed, later ones over earlier ones.
//!
//! Faces are made only where solid meets air, once, fronts towards the air. So the result is watertight, has no
//! coplanar doubles and gives every wall its thickness, whatever the boxes were. Faces are merged into rectangles;
//! their corners may lie on the edges of neighbours (T-junctions), at coordinates that are exactly equal.
//! Anything that is not parallel to the axes is in `solids`.

use crate::material::MaterialId;
use crate::mesh::Mesh;
use earthshine_world::Vec3;

/// Materials of what surrounds a room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RoomPaint {
    pub(crate) walls: MaterialId,
    pub(crate) floor: MaterialId,
    pub(crate) ceiling: MaterialId,
}

/// What a box is filled with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fill {
    /// Solid; its faces towards a room take the room's paint.
    Wall(MaterialId),
    /// Solid; its faces keep its material in rooms too.
    Trim(MaterialId),
    /// Air; faces keep the solid's material.
    Opening,
    /// Air; walls around it are painted.
    Room(RoomPaint),
}

/// Boxes in the order of their painting.
#[derive(Debug, Clone, Default)]
pub(crate) struct Masonry {
    boxes: Vec<(Vec3, Vec3, Fill)>,
}

const NO_FACE: u32 = u32::MAX;

impl Masonry {
    /// Fills the box from `min` to `max`, m; a box without volume is left out.
    pub(crate) fn fill(&mut self, min: Vec3, max: Vec3, fill: Fill) {
        if min.cmplt(max).all() {
            self.boxes.push((min, max, fill));
        }
    }

    /// Appends the faces to `mesh`.
    pub(crate) fn build(&self, mesh: &mut Mesh) {
        self.build_within(Vec3::NEG_INFINITY, Vec3::INFINITY, mesh);
    }

    /// Appends the faces of solid cells whose centres lie between `min` and `max`: what lies beyond is only
    /// there so that no face is made towards it.
    pub(crate) fn build_within(&self, min: Vec3, max: Vec3, mesh: &mut Mesh) {
        let cells = Cells::paint(&self.boxes);
        for axis in 0..3 {
            for positive in [false, true] {
                for layer in 0..cells.count(axis) {
                    let mut faces = cells.faces(axis, positive, layer, (min, max));
                    cells.merge(axis, positive, layer, &mut faces, mesh);
                }
            }
        }
    }
}

/// The boxes' planes cut space into cells; each cell has the fill of the last box over it.
struct Cells {
    planes: [Vec<f32>; 3],
    fills: Vec<Option<Fill>>,
}

impl Cells {
    fn paint(boxes: &[(Vec3, Vec3, Fill)]) -> Self {
        let planes = [0, 1, 2].map(|axis| {
            let mut planes: Vec<f32> = boxes.iter().flat_map(|b| [b.0[axis], b.1[axis]]).collect();
            planes.sort_by(f32::total_cmp);
            planes.dedup();
            planes
        });
        let total = planes.iter().map(|p| p.len().saturating_sub(1)).product();
        let mut cells = Self { planes, fills: vec![None; total] };
        for &(min, max, fill) in boxes {
            let range = |axis: usize| {
                let at = |value: f32| cells.planes[axis].partition_point(|&plane| plane < value);
                at(min[axis])..at(max[axis])
            };
            let (xs, ys, zs) = (range(0), range(1), range(2));
            for (z, y) in zs.flat_map(|z| ys.clone().map(move |y| (z, y))) {
                let row = cells.index([xs.start, y, z]);
                cells.fills[row..row + xs.len()].fill(Some(fill));
            }
        }
        cells
    }

    fn count(&self, axis: usize) -> usize {
        self.planes[axis].len().saturating_sub(1)
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.count(1) + y) * self.count(0) + x
    }

    fn centre(&self, cell: [usize; 3]) -> Vec3 {
        let middle = |axis: usize| (self.planes[axis][cell[axis]] + self.planes[axis][cell[axis] + 1]) * 0.5;
        Vec3::new(middle(0), middle(1), middle(2))
    }

    /// The two other axes, so that their cross product points along `axis`.
    fn across(axis: usize) -> (usize, usize) {
        ((axis + 1) % 3, (axis + 2) % 3)
    }

    /// Material of every face of one layer of cells on one side, [`NO_FACE`] where there is none.
    fn faces(&self, axis: usize, positive: bool, layer: usize, within: (Vec3, Vec3)) -> Vec<u32> {
        let (u_axis, v_axis) = Self::across(axis);
        let mut faces = vec![NO_FACE; self.count(u_axis) * self.count(v_axis)];
        for (at, face) in faces.iter_mut().enumerate() {
            let mut cell = [0; 3];
            (cell[axis], cell[u_axis], cell[v_axis]) =
                (layer, at % self.count(u_axis), at / self.count(u_axis));
            let (solid, keeps) = match self.fills[self.index(cell)] {
                Some(Fill::Wall(material)) => (material, false),
                Some(Fill::Trim(material)) => (material, true),
                _ => continue,
            };
            let centre = self.centre(cell);
            if !(centre.cmpge(within.0).all() && centre.cmple(within.1).all()) {
                continue;
            }
            let air = match self.beside(cell, axis, positive) {
                Some(Fill::Wall(_) | Fill::Trim(_)) => continue,
                Some(Fill::Room(paint)) if !keeps => match (axis, positive) {
                    (1, true) => paint.floor,
                    (1, false) => paint.ceiling,
                    _ => paint.walls,
                },
                _ => solid,
            };
            *face = u32::from(air.0);
        }
        faces
    }

    fn beside(&self, mut cell: [usize; 3], axis: usize, positive: bool) -> Option<Fill> {
        if positive {
            cell[axis] += 1;
        } else {
            cell[axis] = cell[axis].checked_sub(1)?;
        }
        if cell[axis] < self.count(axis) { self.fills[self.index(cell)] } else { None }
    }

    /// Covers the faces of one layer with rectangles of one material, and clears them.
    fn merge(&self, axis: usize, positive: bool, layer: usize, faces: &mut [u32], mesh: &mut Mesh) {
        let (u_axis, v_axis) = Self::across(axis);
        let (width, height) = (self.count(u_axis), self.count(v_axis));
        for start in 0..faces.len() {
            let material = faces[start];
            if material == NO_FACE {
                continue;
            }
            let (u0, v0) = (start % width, start / width);
            let u1 = (u0..width).find(|&u| faces[v0 * width + u] != material).unwrap_or(width);
            let same = |v: usize, faces: &[u32]| {
                faces[v * width + u0..v * width + u1].iter().all(|&f| f == material)
            };
            let v1 = (v0 + 1..height).find(|&v| !same(v, faces)).unwrap_or(height);
            for v in v0..v1 {
                faces[v * width + u0..v * width + u1].fill(NO_FACE);
            }
            let plane = self.planes[axis][layer + usize::from(positive)];
            let corner = |u: usize, v: usize| {
                let mut point = Vec3::splat(plane);
                point[u_axis] = self.planes[u_axis][u];
                point[v_axis] = self.planes[v_axis][v];
                point
            };
            let mut corners = [corner(u0, v0), corner(u1, v0), corner(u1, v1), corner(u0, v1)];
            if !positive {
                corners.reverse();
            }
            mesh.polygon(MaterialId(material as u16), &corners);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::oracle;

    const WALL: Fill = Fill::Wall(MaterialId(0));
    const PAINT: RoomPaint = RoomPaint { walls: MaterialId(1), floor: MaterialId(2), ceiling: MaterialId(3) };

    fn built(masonry: &Masonry) -> Mesh {
        let mut mesh = Mesh::default();
        masonry.build(&mut mesh);
        mesh
    }

    #[test]
    fn a_room_with_a_window_is_closed_painted_and_thick() {
        let mut masonry = Masonry::default();
        masonry.fill(Vec3::ZERO, Vec3::splat(4.0), WALL);
        masonry.fill(Vec3::splat(0.5), Vec3::splat(3.5), Fill::Room(PAINT));
        masonry.fill(Vec3::new(0.0, 1.0, 1.0), Vec3::new(0.5, 2.0, 3.0), Fill::Opening);
        let mesh = built(&masonry);
        assert!(oracle::gap(&mesh) < 1e-5);
        assert!((oracle::volume(&mesh) - (64.0 - 27.0 - 1.0)).abs() < 1e-4, "{}", oracle::volume(&mesh));
        let areas: Vec<f32> = mesh.surfaces.values().map(area).collect();
        // Outside 6 x 16 less the window, and the reveal; inside three walls, one with the window, floor, ceiling.
        assert!(
            (areas[0] - (96.0 - 2.0 + 3.0)).abs() < 1e-4 && (areas[1] - (36.0 - 2.0)).abs() < 1e-4,
            "{areas:?}"
        );
        assert!((areas[2] - 9.0).abs() < 1e-4 && (areas[3] - 9.0).abs() < 1e-4);
    }

    fn area(surface: &crate::mesh::Surface) -> f32 {
        surface.corners().map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
    }

    #[test]
    fn overlapping_solids_have_no_inner_faces_and_merge() {
        let mut masonry = Masonry::default();
        masonry.fill(Vec3::ZERO, Vec3::new(2.0, 1.0, 1.0), WALL);
        masonry.fill(Vec3::new(1.0, 0.0, 0.0), Vec3::new(3.0, 1.0, 1.0), WALL);
        masonry.fill(Vec3::ONE, Vec3::ONE, WALL);
        assert_eq!(built(&masonry).triangles(), 12);
    }

    #[test]
    fn what_lies_beyond_only_hides_faces() {
        let mut masonry = Masonry::default();
        masonry.fill(Vec3::new(-1.0, 0.0, 0.0), Vec3::ONE, WALL);
        masonry.fill(Vec3::ZERO, Vec3::ONE, Fill::Wall(MaterialId(1)));
        let mut mesh = Mesh::default();
        masonry.build_within(Vec3::ZERO, Vec3::ONE, &mut mesh);
        assert_eq!(mesh.triangles(), 10);
        assert!(mesh.surfaces.keys().eq([&MaterialId(1)]));
    }
}
