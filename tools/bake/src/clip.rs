//! Cutting triangles at the faces of a grid, so that every piece lies in one cell with its exact area.

use earthshine_world::Vec3;
use glam::IVec3;

/// A convex piece of a triangle: at most three corners more than it had cuts, on the stack.
#[derive(Debug, Clone, Copy)]
pub struct Polygon {
    corners: [Vec3; Self::CORNERS_MAX],
    count: usize,
}

impl Polygon {
    /// A triangle cut by the six faces of a cell has at most nine corners.
    pub const CORNERS_MAX: usize = 10;

    /// The uncut triangle.
    #[must_use]
    pub fn triangle([a, b, c]: [Vec3; 3]) -> Self {
        let mut corners = [Vec3::ZERO; Self::CORNERS_MAX];
        corners[..3].copy_from_slice(&[a, b, c]);
        Self { corners, count: 3 }
    }

    /// Corners in order; fewer than three is nothing.
    #[must_use]
    pub fn corners(&self) -> &[Vec3] {
        &self.corners[..self.count]
    }

    /// The triangles of a fan around the first corner.
    pub fn fan(&self) -> impl Iterator<Item = [Vec3; 3]> + '_ {
        let corners = self.corners();
        (2..corners.len()).map(move |i| [corners[0], corners[i - 1], corners[i]])
    }

    /// m2.
    #[must_use]
    pub fn area(&self) -> f32 {
        self.fan().map(|[a, b, c]| (b - a).cross(c - a).length() * 0.5).sum()
    }

    /// The parts below and above `plane` along `axis`.
    fn split(&self, axis: usize, plane: f32) -> (Self, Self) {
        let empty = Self { corners: [Vec3::ZERO; Self::CORNERS_MAX], count: 0 };
        let (mut below, mut above) = (empty, empty);
        for (i, &corner) in self.corners().iter().enumerate() {
            let next = self.corners[(i + 1) % self.count];
            let (here, there) = (corner[axis] - plane, next[axis] - plane);
            if here <= 0.0 {
                below.push(corner);
            }
            if here >= 0.0 {
                above.push(corner);
            }
            if here * there < 0.0 {
                let mut cut = corner + (next - corner) * (here / (here - there));
                cut[axis] = plane;
                below.push(cut);
                above.push(cut);
            }
        }
        (below, above)
    }

    fn push(&mut self, corner: Vec3) {
        if self.count < Self::CORNERS_MAX {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }
}

/// Calls `piece(cell, polygon)` for every cell of edge `cell_edge` that the triangle crosses, in a fixed order.
///
/// The areas of the pieces add up to the triangle's. A triangle that lies in a face of the grid goes to the
/// cell above it: callers that care shift it to the side they mean first.
pub fn clip_to_grid(corners: [Vec3; 3], cell_edge: f32, piece: impl FnMut(IVec3, &Polygon)) {
    clip_to_cells(corners, cell_edge, (IVec3::MIN, IVec3::MAX), piece);
}

/// As [`clip_to_grid`], for the cells from `low` to `high` (inclusive) alone: the cost is that of these cells.
pub fn clip_to_cells(
    corners: [Vec3; 3],
    cell_edge: f32,
    (low, high): (IVec3, IVec3),
    mut piece: impl FnMut(IVec3, &Polygon),
) {
    let least = corners[0].min(corners[1]).min(corners[2]);
    let most = corners[0].max(corners[1]).max(corners[2]);
    let crossed = ((least / cell_edge).floor().as_ivec3(), (most / cell_edge).floor().as_ivec3());
    let wanted = (crossed.0.max(low), crossed.1.min(high));
    if wanted.0.cmpgt(wanted.1).any() {
        return;
    }
    let whole = Polygon::triangle(corners);
    if crossed.0 == crossed.1 {
        piece(crossed.0, &whole);
        return;
    }
    let cut = |axis: usize| Slabs { axis, crossed, wanted, edge: cell_edge };
    cut(0).of(&whole, &mut |x, slab| {
        cut(1).of(slab, &mut |y, beam| {
            cut(2).of(beam, &mut |z, cell| piece(IVec3::new(x, y, z), cell));
        });
    });
}

/// Cuts along one axis.
struct Slabs {
    axis: usize,
    /// First and last cell that the triangle crosses.
    crossed: (IVec3, IVec3),
    /// Those of them that are asked for.
    wanted: (IVec3, IVec3),
    edge: f32,
}

impl Slabs {
    fn of(&self, polygon: &Polygon, each: &mut dyn FnMut(i32, &Polygon)) {
        let Self { axis, edge, .. } = *self;
        let (first, last) = (self.wanted.0[axis], self.wanted.1[axis]);
        let mut rest = *polygon;
        if first > self.crossed.0[axis] {
            rest = rest.split(axis, first as f32 * edge).1;
        }
        for cell in first..=last {
            if rest.count < 3 {
                return;
            }
            let (below, above) = if cell < self.crossed.1[axis] {
                rest.split(axis, (cell + 1) as f32 * edge)
            } else {
                (rest, rest)
            };
            if below.count >= 3 && below.area() > 0.0 {
                each(cell, &below);
            }
            rest = above;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_lie_in_their_cells_and_keep_the_area() {
        let triangle = [Vec3::new(-1.3, 0.2, 0.7), Vec3::new(2.9, 1.1, -0.4), Vec3::new(0.3, 3.7, 2.2)];
        let (mut area, mut count) = (0.0, 0);
        clip_to_grid(triangle, 0.5, |cell, polygon| {
            area += polygon.area();
            count += 1;
            for corner in polygon.corners() {
                let inside = *corner / 0.5 - cell.as_vec3();
                assert!(inside.min_element() > -1e-4 && inside.max_element() < 1.0 + 1e-4);
            }
        });
        assert!((area / Polygon::triangle(triangle).area() - 1.0).abs() < 1e-5);
        assert!(count > 20);
    }

    #[test]
    fn pieces_of_some_cells_are_those_of_all() {
        let triangle = [Vec3::new(-1.3, 0.2, 0.7), Vec3::new(2.9, 1.1, -0.4), Vec3::new(0.3, 3.7, 2.2)];
        let (low, high) = (IVec3::new(0, 1, 0), IVec3::new(2, 4, 2));
        let (mut all, mut some) = (Vec::new(), Vec::new());
        clip_to_grid(triangle, 0.5, |cell, polygon| {
            if cell.cmpge(low).all() && cell.cmple(high).all() {
                all.push((cell, polygon.area()));
            }
        });
        clip_to_cells(triangle, 0.5, (low, high), |cell, polygon| some.push((cell, polygon.area())));
        assert!(some.len() > 5 && all.len() == some.len());
        for (a, b) in all.iter().zip(&some) {
            assert!(a.0 == b.0 && (a.1 - b.1).abs() < 1e-5, "{a:?} {b:?}");
        }
    }
}
