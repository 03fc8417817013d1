//! Towns: a grid of streets, each block four houses, a market or a park, made cell by cell.
//!
//! Start at [`generate_town_cell`]. A town of n x n cells is those cells beside each other, the meshes of their
//! props once, and a sun; the total of triangles is steered by what adorns each cell, never by another cell.

mod cell;
mod foliage;
mod furnish;
mod house;
mod indoors;
mod outdoors;
mod paint;
mod prop;
mod roof;
mod square;
mod street;

pub use cell::{CellMesh, generate_town_cell};
pub use prop::Prop;

use crate::glb::{GlbBuilder, MeshIndex};
use crate::mesh::Placement;
use crate::{GenError, GenOptions, Glb, WorldKind};
use earthshine_world::{Light, Rgb, Vec3};
use prop::PropLibrary;
use std::collections::BTreeMap;

/// Triangles are met within one part in this many.
const TOLERANCE: u64 = 10;

pub(crate) fn generate(options: &GenOptions, progress: &dyn Fn(u64, u64)) -> Result<Glb, GenError> {
    let library = cell::library(options);
    let builder = GlbBuilder::new(WorldKind::Town, options, &paint::materials());
    let mut town = TownWriter { builder, library: &library, props: BTreeMap::new() };
    let range = options.town_cell_range();
    let cells: Vec<(i32, i32)> = range.clone().flat_map(|z| range.clone().map(move |x| (x, z))).collect();
    let mut triangles = 0;
    for (done, &at) in (0u64..).zip(&cells) {
        progress(done, cells.len() as u64);
        let cell = cell::make_cell(options, at, &library);
        triangles += cell.triangles;
        town.write(&cell)?;
    }
    if let Some(asked) = options.town_triangles
        && triangles.abs_diff(asked) > asked / TOLERANCE
    {
        return Err(GenError::Triangles { asked, made: triangles, size_m: options.town_size_m });
    }
    town.builder.light("sun", &sun());
    let glb = town.builder.finish()?;
    progress(cells.len() as u64, cells.len() as u64);
    Ok(glb)
}

/// A clear afternoon.
fn sun() -> Light {
    let direction = Vec3::new(-0.45, -0.72, -0.53).normalize_or(Vec3::NEG_Y);
    Light::Directional {
        direction,
        illuminance: Rgb::new(1.0, 0.96, 0.9) * 100_000.0,
        angular_diameter_rad: 0.0,
    }
}

struct TownWriter<'a> {
    builder: GlbBuilder,
    library: &'a PropLibrary,
    /// Props that are in the file already.
    props: BTreeMap<Prop, MeshIndex>,
}

impl TownWriter<'_> {
    fn write(&mut self, cell: &CellMesh) -> Result<(), GenError> {
        let (x, z) = cell.cell;
        let name = format!("cell {x},{z}");
        let mut parts = Vec::with_capacity(cell.props.len());
        for (&prop, placements) in &cell.props {
            let mesh = match self.props.get(&prop) {
                Some(&mesh) => mesh,
                None => {
                    let mesh = self.builder.mesh(&prop.to_string(), self.library.mesh(prop))?;
                    *self.props.entry(prop).or_insert(mesh)
                }
            };
            parts.push(self.builder.copies(&format!("{name} {prop}"), mesh, placements)?);
        }
        let mesh = self.builder.mesh(&name, &cell.mesh)?;
        self.builder.place_with(&name, mesh, &Placement::at(cell.origin), parts);
        for (lamp, light) in &cell.lamps {
            self.builder.light(lamp, &moved(light, cell.origin));
        }
        Ok(())
    }
}

fn moved(light: &Light, by: Vec3) -> Light {
    let mut light = *light;
    if let Light::Point { position, .. } | Light::Spot { position, .. } = &mut light {
        *position += by;
    }
    light
}
