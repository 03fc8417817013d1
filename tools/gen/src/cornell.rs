//! The Cornell box in metres: 2 m wide, high and deep, centred on the Y axis, floor at y = 0.
//!
//! Walls are single sheets of two triangles that face inward; the front (+Z) is open, and what leaves through it
//! meets a black sky. The two blocks stand on the floor without a bottom of their own: the floor closes them. The
//! lamp hangs 1 cm below the ceiling and shines down.

use crate::glb::GlbBuilder;
use crate::material::{Material, MaterialId};
use crate::mesh::{Mesh, Placement};
use crate::{GenError, GenOptions, Glb, WorldKind};
use earthshine_world::{Rgb, Vec3};

const WHITE: MaterialId = MaterialId(0);
const RED: MaterialId = MaterialId(1);
const GREEN: MaterialId = MaterialId(2);
const LAMP: MaterialId = MaterialId(3);

/// Edge of the measured box, mm; footprints below are in its coordinates, x to the left and z away from the viewer.
const MEASURED_EDGE: f32 = 555.0;
const SHORT_BLOCK: ([(f32, f32); 4], f32) =
    ([(130.0, 65.0), (82.0, 225.0), (240.0, 272.0), (290.0, 114.0)], 165.0);
const TALL_BLOCK: ([(f32, f32); 4], f32) =
    ([(423.0, 247.0), (265.0, 296.0), (314.0, 456.0), (472.0, 406.0)], 330.0);
const LAMP_BELOW_CEILING_M: f32 = 0.01;

pub(crate) fn generate(options: &GenOptions) -> Result<Glb, GenError> {
    let materials = [
        Material::reflecting("white", Rgb::splat(0.73)),
        Material::reflecting("red", Rgb::new(0.63, 0.065, 0.05)),
        Material::reflecting("green", Rgb::new(0.14, 0.45, 0.091)),
        Material::emitting("lamp", Rgb::splat(0.73), Rgb::new(17.0, 12.0, 4.0)),
    ];
    let mut builder = GlbBuilder::new(WorldKind::Cornell, options, &materials);
    let mesh = builder.mesh("cornell box", &mesh())?;
    builder.place("cornell box", mesh, &Placement::at(Vec3::ZERO));
    builder.finish()
}

fn mesh() -> Mesh {
    let mut mesh = Mesh::default();
    let corner = |x: f32, y: f32, z: f32| Vec3::new(x, y + 1.0, z);
    let (a, b) = (-1.0, 1.0);
    mesh.polygon(WHITE, &[corner(a, a, b), corner(b, a, b), corner(b, a, a), corner(a, a, a)]);
    mesh.polygon(WHITE, &[corner(a, b, a), corner(b, b, a), corner(b, b, b), corner(a, b, b)]);
    mesh.polygon(WHITE, &[corner(a, a, a), corner(b, a, a), corner(b, b, a), corner(a, b, a)]);
    mesh.polygon(RED, &[corner(a, a, b), corner(a, a, a), corner(a, b, a), corner(a, b, b)]);
    mesh.polygon(GREEN, &[corner(b, a, a), corner(b, a, b), corner(b, b, b), corner(b, b, a)]);
    for (footprint, height) in [SHORT_BLOCK, TALL_BLOCK] {
        block(&mut mesh, &footprint, height);
    }
    let lamp = [(213.0, 227.0), (213.0, 332.0), (343.0, 332.0), (343.0, 227.0)];
    let mut lamp = lamp.map(|(x, z)| place(x, MEASURED_EDGE, z) - Vec3::Y * LAMP_BELOW_CEILING_M);
    lamp.reverse();
    mesh.polygon(LAMP, &lamp);
    mesh
}

/// A point of the measured box, in ours: half a turn about Y, so that red is on the left.
fn place(x: f32, y: f32, z: f32) -> Vec3 {
    let scale = 2.0 / MEASURED_EDGE;
    Vec3::new(1.0 - x * scale, y * scale, 1.0 - z * scale)
}

/// A block without a bottom. Footprints go round clockwise seen from above in measured coordinates.
fn block(mesh: &mut Mesh, footprint: &[(f32, f32); 4], height: f32) {
    let (foot, head) =
        (footprint.map(|(x, z)| place(x, 0.0, z)), footprint.map(|(x, z)| place(x, height, z)));
    mesh.polygon(WHITE, &head);
    for i in 0..4 {
        let next = (i + 1) % 4;
        mesh.polygon(WHITE, &[foot[i], foot[next], head[next], head[i]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_face_the_inside_and_blocks_face_the_walls() {
        let mesh = mesh();
        assert_eq!(mesh.triangles(), 32);
        let bounds = mesh.bounds();
        assert_eq!((bounds.min, bounds.max), (Vec3::new(-1.0, 0.0, -1.0), Vec3::new(1.0, 2.0, 1.0)));
        for (material, wall) in &mesh.surfaces {
            for [a, b, c] in wall.corners() {
                let normal = (b - a).cross(c - a);
                let centre = (a + b + c) / 3.0;
                let at_border =
                    centre.x.abs() > 0.999 || centre.z < -0.999 || centre.y < 1e-6 || centre.y > 1.98;
                if at_border {
                    assert!(normal.dot(Vec3::Y - centre) > 0.0, "a wall of {material:?} faces out");
                }
            }
        }
    }

    #[test]
    fn blocks_are_closed_by_the_floor() {
        for (footprint, height) in [SHORT_BLOCK, TALL_BLOCK] {
            let mut mesh = Mesh::default();
            block(&mut mesh, &footprint, height);
            let mut floor = footprint.map(|(x, z)| place(x, 0.0, z));
            floor.reverse();
            mesh.polygon(WHITE, &floor);
            assert!(crate::mesh::oracle::gap(&mesh) < 1e-5);
            assert!(crate::mesh::oracle::volume(&mesh) > 0.1);
        }
    }
}
