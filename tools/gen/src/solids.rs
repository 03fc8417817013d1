//! Closed solids that are not parallel to the axes: tapered prisms, cones, blobs, gables.
//!
//! No sines: circles are tables and square roots, so that every platform makes the same bits.

use crate::draw::{Draw, Use};
use crate::material::MaterialId;
use crate::mesh::Mesh;
use earthshine_world::Vec3;
use std::collections::BTreeMap;

/// Corners of a regular octagon of radius 1, +X first, towards -Z (counter-clockwise seen from above).
const OCTAGON: [(f32, f32); 8] = {
    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;
    [
        (1.0, 0.0),
        (HALF, -HALF),
        (0.0, -1.0),
        (-HALF, -HALF),
        (-1.0, 0.0),
        (-HALF, HALF),
        (0.0, 1.0),
        (HALF, HALF),
    ]
};

/// An octagonal prism from `base` up by `height`, radius `lower` at its foot and `upper` at its head, m.
/// An `upper` of zero makes a cone.
pub(crate) fn taper(mesh: &mut Mesh, material: MaterialId, base: Vec3, height: f32, lower: f32, upper: f32) {
    let ring = |radius: f32, rise: f32| OCTAGON.map(|(x, z)| base + Vec3::new(x * radius, rise, z * radius));
    let (foot, head) = (ring(lower, 0.0), ring(upper, height));
    for i in 0..8 {
        let next = (i + 1) % 8;
        if upper > 0.0 {
            mesh.polygon(material, &[foot[i], foot[next], head[next], head[i]]);
        } else {
            mesh.polygon(material, &[foot[i], foot[next], head[i]]);
        }
    }
    if upper > 0.0 {
        mesh.polygon(material, &head);
    }
    let mut below = foot;
    below.reverse();
    mesh.polygon(material, &below);
}

/// A solid gable roof over the rectangle from `min` to `max` (at `min.y`): its ridge lies `rise` higher, along X
/// or along Z.
pub(crate) fn gable(mesh: &mut Mesh, material: MaterialId, min: Vec3, max: Vec3, rise: f32, along_x: bool) {
    let (y, top) = (min.y, min.y + rise);
    let corners =
        [(min.x, max.z), (max.x, max.z), (max.x, min.z), (min.x, min.z)].map(|(x, z)| Vec3::new(x, y, z));
    // From the middle of one gable to the other, starting at corner 0's end.
    let middle = (min + max) * 0.5;
    let ridge = if along_x {
        [Vec3::new(min.x, top, middle.z), Vec3::new(max.x, top, middle.z)]
    } else {
        [Vec3::new(middle.x, top, max.z), Vec3::new(middle.x, top, min.z)]
    };
    let [a, b, c, d] = if along_x { corners } else { [corners[1], corners[2], corners[3], corners[0]] };
    mesh.polygon(material, &[a, b, ridge[1], ridge[0]]);
    mesh.polygon(material, &[c, d, ridge[0], ridge[1]]);
    mesh.polygon(material, &[b, c, ridge[1]]);
    mesh.polygon(material, &[d, a, ridge[0]]);
    mesh.polygon(material, &[d, c, b, a]);
}

/// An octahedron of eight triangles.
pub(crate) fn octahedron(mesh: &mut Mesh, material: MaterialId, centre: Vec3, radius: f32) {
    let axes = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let faces = [[0, 2, 4], [4, 2, 1], [1, 2, 5], [5, 2, 0], [0, 4, 3], [4, 1, 3], [1, 5, 3], [5, 0, 3]];
    mesh.surface(material).push(&axes.map(|axis| centre + axis * radius), &axes, &faces.map(outward(&axes)));
}

/// Turns a triangle of a solid around the origin so that its front faces away from it.
fn outward(corners: &[Vec3]) -> impl Fn([u32; 3]) -> [u32; 3] + '_ {
    |[a, b, c]| {
        let [p, q, r] = [a, b, c].map(|i| corners[i as usize]);
        if (q - p).cross(r - p).dot(p + q + r) > 0.0 { [a, b, c] } else { [a, c, b] }
    }
}

/// A lump like the crown of a tree: a sphere of 20 x 4^`subdivisions` triangles, stretched to `radii`, with bumps
/// of up to `roughness` of its radius.
pub(crate) fn blob(mesh: &mut Mesh, material: MaterialId, lump: &Lump, draw: Draw) {
    let (sphere, triangles) = icosphere(lump.subdivisions);
    let positions: Vec<Vec3> = (0u32..)
        .zip(&sphere)
        .map(|(i, &p)| {
            let bump = draw.between(Use::Foliage, lump.number << 16 | i, -lump.roughness, lump.roughness);
            lump.centre + p * lump.radii * (1.0 + bump)
        })
        .collect();
    mesh.surface(material).push(&positions, &sphere, &triangles);
}

/// Shape of a [`blob`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lump {
    pub(crate) centre: Vec3,
    pub(crate) radii: Vec3,
    pub(crate) roughness: f32,
    pub(crate) subdivisions: u32,
    /// Tells its bumps from those of other lumps of the same place; below 65,536.
    pub(crate) number: u32,
}

fn icosphere(subdivisions: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let golden = f32::midpoint(1.0, 5f32.sqrt());
    let mut corners: Vec<Vec3> = Vec::new();
    for (a, b) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
        corners.extend([Vec3::new(0.0, a, b), Vec3::new(a, b, 0.0), Vec3::new(b, 0.0, a)]);
    }
    let mut triangles = Vec::new();
    // Corners of an icosahedron with edge 2 are neighbours at distance 2.
    let near = |a: usize, b: usize, corners: &[Vec3]| (corners[a].distance(corners[b]) - 2.0).abs() < 0.1;
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b, &corners) && near(b, c, &corners) && near(a, c, &corners) {
                    triangles.push(outward(&corners)([a as u32, b as u32, c as u32]));
                }
            }
        }
    }
    for corner in &mut corners {
        *corner = corner.normalize_or(Vec3::Y);
    }
    for _ in 0..subdivisions {
        triangles = split(&mut corners, &triangles);
    }
    (corners, triangles)
}

/// Four triangles for each, new corners on the unit sphere and shared between neighbours.
fn split(corners: &mut Vec<Vec3>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut middles = BTreeMap::new();
    let mut finer = Vec::with_capacity(triangles.len() * 4);
    for &[a, b, c] in triangles {
        let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(from, to)| {
            *middles.entry((from.min(to), from.max(to))).or_insert_with(|| {
                corners.push((corners[from as usize] + corners[to as usize]).normalize_or(Vec3::Y));
                corners.len() as u32 - 1
            })
        });
        finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    finer
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::oracle;

    fn of(make: impl Fn(&mut Mesh)) -> Mesh {
        let mut mesh = Mesh::default();
        make(&mut mesh);
        mesh
    }

    #[test]
    fn solids_are_closed_with_fronts_outward_and_the_right_volume() {
        let material = MaterialId(0);
        let octagon = 2.0 * 2f64.sqrt();
        let lump = |subdivisions| Lump {
            centre: Vec3::X,
            radii: Vec3::ONE,
            roughness: 0.0,
            subdivisions,
            number: 0,
        };
        let draw = Draw::of_world(1);
        let (low, high) = (Vec3::new(-1.0, 2.0, -3.0), Vec3::new(5.0, 2.0, 4.0));
        let cases = [
            ("prism", of(|m| taper(m, material, Vec3::Y, 3.0, 1.0, 1.0)), 3.0 * octagon, 28),
            ("cone", of(|m| taper(m, material, Vec3::Y, 3.0, 1.0, 0.0)), octagon, 14),
            ("gable along x", of(|m| gable(m, material, low, high, 2.0, true)), 42.0, 8),
            ("gable along z", of(|m| gable(m, material, low, high, 2.0, false)), 42.0, 8),
            ("octahedron", of(|m| octahedron(m, material, Vec3::Y, 1.0)), 4.0 / 3.0, 8),
            ("icosahedron", of(|m| blob(m, material, &lump(0), draw)), 2.536_15, 20),
            ("sphere", of(|m| blob(m, material, &lump(3), draw)), 4.15, 1280),
        ];
        for (name, mesh, volume, triangles) in cases {
            assert!(oracle::gap(&mesh) < 1e-4, "{name} is open");
            let found = oracle::volume(&mesh);
            assert!((found - volume).abs() < 0.01 * volume, "{name}: {found} m3, not {volume}");
            assert_eq!(mesh.triangles(), triangles, "{name}");
        }
    }
}
