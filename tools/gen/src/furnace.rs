//! A closed box of one reflectance and one emission, 2 m, centred on the Y axis, floor at y = 0, fronts inward.
//!
//! Its answer is known: exitance is `pi L / (1 - rho)` everywhere, irradiance the same.

use crate::glb::GlbBuilder;
use crate::material::{Material, MaterialId};
use crate::mesh::{Mesh, Placement};
use crate::{GenError, GenOptions, Glb, WorldKind};
use earthshine_world::{Rgb, Vec3};

pub(crate) fn generate(options: &GenOptions) -> Result<Glb, GenError> {
    let reflectance = Rgb::splat(options.furnace_reflectance);
    let material = Material::emitting("furnace", reflectance, Rgb::splat(options.furnace_radiance));
    let mut builder = GlbBuilder::new(WorldKind::Furnace, options, &[material]);
    let mesh = builder.mesh("furnace", &mesh())?;
    builder.place("furnace", mesh, &Placement::at(Vec3::ZERO));
    builder.finish()
}

fn mesh() -> Mesh {
    let mut mesh = Mesh::default();
    for axis in 0..3 {
        for side in [-1.0f32, 1.0] {
            let corner = |u: f32, v: f32| {
                let mut point = Vec3::splat(side);
                (point[(axis + 1) % 3], point[(axis + 2) % 3]) = (u, v);
                point + Vec3::Y
            };
            let mut corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            if side > 0.0 {
                corners.reverse();
            }
            mesh.polygon(MaterialId(0), &corners);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_a_closed_box_turned_inside_out() {
        let mesh = mesh();
        assert_eq!(mesh.triangles(), 12);
        assert!(crate::mesh::oracle::gap(&mesh) < 1e-6);
        assert!((crate::mesh::oracle::volume(&mesh) + 8.0).abs() < 1e-5);
    }
}
