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
pub fn clip_to_grid(corners: [Vec3; 3], cell_edge: f32, mut piece: impl FnMut(IVec3, &Polygon)) {
    let low = corners[0].min(corners[1]).min(corners[2]);
    let high = corners[0].max(corners[1]).max(corners[2]);
    let first = (low / cell_edge).floor().as_ivec3();
    let last = (high / cell_edge).floor().as_ivec3();
    let whole = Polygon::triangle(corners);
    if first == last {
        piece(first, &whole);
        return;
    }
    slabs(&whole, 0, first, last, cell_edge, &mut |x, slab| {
        slabs(slab, 1, first, last, cell_edge, &mut |y, beam| {
            slabs(beam, 2, first, last, cell_edge, &mut |z, cell| piece(IVec3::new(x, y, z), cell));
        });
    });
}

fn slabs(
    polygon: &Polygon,
    axis: usize,
    first: IVec3,
    last: IVec3,
    edge: f32,
    each: &mut dyn FnMut(i32, &Polygon),
) {
    let mut rest = *polygon;
    for cell in first[axis]..last[axis] {
        let (below, above) = rest.split(axis, (cell + 1) as f32 * edge);
        if below.count >= 3 && below.area() > 0.0 {
            each(cell, &below);
        }
        rest = above;
        if rest.count < 3 {
            return;
        }
    }
    if rest.area() > 0.0 {
        each(last[axis], &rest);
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
}
