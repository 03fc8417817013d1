//! Mesh primitives to world-space triangles.
//!
//! Two passes: [`Geometry::open`] checks every accessor and counts, [`Geometry::write`] then fills lists of exactly
//! that size. Start at [`Geometry`].

use crate::accessor::{Accessor, Role};
use crate::document::Document;
use crate::materials::{UvSource, UvSources};
use crate::nodes::Placement;
use crate::primitive::{Primitive, Topology};
use crate::scene::PlacedMesh;
use crate::{ImportOptions, Scene, SceneError};
use earthshine_world::Vec3;
use glam::{DAffine3, DVec3};
use gltf::json::mesh::{Mode, Primitive as Json, Semantic};
use gltf::json::validation::Checked;
use std::collections::BTreeMap;

/// All meshes in use, opened.
#[derive(Debug)]
pub(crate) struct Geometry<'a> {
    document: &'a Document<'a>,
    meshes: BTreeMap<usize, Vec<Primitive<'a>>>,
    /// Triangles of all placements, those without area too.
    pub(crate) triangle_count: u64,
    /// Instances that `EXT_mesh_gpu_instancing` adds.
    pub(crate) instance_count: u64,
    /// What was left out.
    pub(crate) skipped: Skipped,
}

/// Counts for the warnings, once a primitive of the file however often it is placed.
#[derive(Debug, Default)]
pub(crate) struct Skipped {
    pub(crate) point_and_line_primitives: u64,
    pub(crate) primitives_without_positions: u64,
    pub(crate) primitives_without_coordinates: u64,
    pub(crate) left_over_vertices: u64,
    pub(crate) morphed_primitives: u64,
}

impl<'a> Geometry<'a> {
    /// Opens the meshes of `placements`; `uv_sources` is one a material, the default material last.
    ///
    /// # Errors
    /// [`SceneError::Malformed`] for what does not fit together, [`SceneError::Limit`] for too many triangles.
    pub(crate) fn open(
        document: &'a Document<'a>,
        placements: &[Placement<'_>],
        uv_sources: &[UvSources],
        options: &ImportOptions,
    ) -> Result<Self, SceneError> {
        let mut geometry = Self {
            document,
            meshes: BTreeMap::new(),
            triangle_count: 0,
            instance_count: 0,
            skipped: Skipped::default(),
        };
        for placement in placements {
            geometry.open_mesh(placement.mesh, uv_sources)?;
            let times = placement.instances.as_ref().map_or(1, |instances| instances.count as u64);
            let primitives = &geometry.meshes[&placement.mesh];
            let triangles: u64 = primitives.iter().map(|primitive| primitive.triangles as u64).sum();
            geometry.triangle_count = geometry.triangle_count.saturating_add(triangles.saturating_mul(times));
            if placement.instances.is_some() {
                geometry.instance_count += times;
            }
        }
        if geometry.triangle_count > options.triangle_limit {
            return Err(document.limit("triangles", geometry.triangle_count, options.triangle_limit));
        }
        Ok(geometry)
    }

    fn open_mesh(&mut self, index: usize, uv_sources: &[UvSources]) -> Result<(), SceneError> {
        if self.meshes.contains_key(&index) {
            return Ok(());
        }
        let mesh = self.document.root.meshes.get(index);
        let mesh = mesh.ok_or_else(|| self.document.malformed(format!("mesh {index}"), "it is not there"))?;
        let mut primitives = Vec::with_capacity(mesh.primitives.len());
        for (number, json) in mesh.primitives.iter().enumerate() {
            primitives.extend(self.open_primitive((index, number), json, uv_sources)?);
        }
        self.meshes.insert(index, primitives);
        Ok(())
    }

    fn open_primitive(
        &mut self,
        (mesh, number): (usize, usize),
        json: &Json,
        uv_sources: &[UvSources],
    ) -> Result<Option<Primitive<'a>>, SceneError> {
        let document = self.document;
        let wrong = |cause: &str| {
            document.malformed(format!("{}, primitive {number}", document.mesh_name(mesh)), cause)
        };
        let topology = match json.mode {
            Checked::Valid(Mode::Triangles) => Topology::List,
            Checked::Valid(Mode::TriangleStrip) => Topology::Strip,
            Checked::Valid(Mode::TriangleFan) => Topology::Fan,
            Checked::Valid(Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) => {
                self.skipped.point_and_line_primitives += 1;
                return Ok(None);
            }
            Checked::Invalid => return Err(wrong("its mode is none that glTF knows")),
        };
        let attribute = |semantic: Semantic, role: Role| {
            let index = json.attributes.get(&Checked::Valid(semantic));
            index.map(|index| Accessor::open(document, index.value(), role)).transpose()
        };
        let Some(positions) = attribute(Semantic::Positions, Role::Vector)? else {
            self.skipped.primitives_without_positions += 1;
            return Ok(None);
        };
        let indices = json.indices.map(|index| Accessor::open(document, index.value(), Role::Indices));
        let indices = indices.transpose()?;
        let material = json.material.map_or(uv_sources.len() - 1, |material| material.value());
        let named_last = json.material.is_some() && material + 1 >= uv_sources.len();
        let sources = uv_sources.get(material).filter(|_| !named_last);
        let sources = sources.ok_or_else(|| wrong("its material is not there"))?;
        let coordinates = |source: Option<UvSource>| match source {
            Some(UvSource { set, transform }) => {
                let list = attribute(Semantic::TexCoords(set), Role::Coordinates)?;
                Ok::<_, SceneError>(list.map(|list| (list, transform)))
            }
            None => Ok(None),
        };
        // The one list of coordinates serves whichever texture there is; a second is kept where two differ.
        let (first, second) = match sources {
            UvSources { base: None, emissive } => (*emissive, None),
            UvSources { base, emissive } => (*base, emissive.filter(|own| Some(*own) != *base)),
        };
        let base = coordinates(first)?;
        let emissive = coordinates(second)?;
        let colours = attribute(Semantic::Colors(0), Role::Colours)?;
        let lists = [base.as_ref().map(|(list, _)| list), emissive.as_ref().map(|(list, _)| list)];
        if lists.into_iter().chain([colours.as_ref()]).flatten().any(|list| list.count < positions.count) {
            return Err(wrong("it has fewer texture coordinates or colours than positions"));
        }
        let lacks_any = (first.is_some() && base.is_none()) || (second.is_some() && emissive.is_none());
        let references = indices.as_ref().map_or(positions.count, |list| list.count);
        let (triangles, left_over) = topology.triangles(references);
        self.skipped.primitives_without_coordinates += u64::from(lacks_any);
        self.skipped.left_over_vertices += left_over as u64;
        self.skipped.morphed_primitives +=
            u64::from(json.targets.as_ref().is_some_and(|targets| !targets.is_empty()));
        let material = material as u32;
        Ok(Some(Primitive {
            mesh,
            number,
            topology,
            triangles,
            material,
            positions,
            indices,
            base,
            emissive,
            colours,
        }))
    }

    /// Appends the triangles of `placements`, which [`Self::open`] has seen, to `scene`.
    ///
    /// # Errors
    /// [`SceneError::IndexOutOfRange`] and [`SceneError::NotFinite`].
    pub(crate) fn write(&self, placements: &[Placement<'_>], scene: &mut Scene) -> Result<(), SceneError> {
        let count = self.triangle_count as usize;
        scene.triangles.reserve_exact(count);
        scene.material_of.reserve_exact(count);
        let mut shapes = BTreeMap::new();
        for placement in placements {
            match &placement.instances {
                None => self.write_mesh(placement.mesh, placement.world, scene, &mut shapes)?,
                Some(instances) => {
                    for i in 0..instances.count {
                        let world = placement.world * instances.transform(i);
                        self.write_mesh(placement.mesh, world, scene, &mut shapes)?;
                    }
                }
            }
        }
        // Untouched zero pages cost nothing, so a scene without textures pays for no coordinates.
        if scene.texture_coordinates.is_empty() {
            scene.texture_coordinates = vec![[[0.0; 2]; 3]; scene.triangles.len()];
        }
        scene.texture_coordinates.resize(scene.triangles.len(), [[0.0; 2]; 3]);
        Ok(())
    }

    /// Appends one mesh in one place, and notes it as a placement of its shape.
    fn write_mesh(
        &self,
        mesh: usize,
        world: DAffine3,
        scene: &mut Scene,
        shapes: &mut BTreeMap<(usize, bool, Vec<u64>), u32>,
    ) -> Result<(), SceneError> {
        let (first, mut skipped) = (scene.triangles.len(), Vec::new());
        for primitive in self.meshes[&mesh].iter().filter(|primitive| primitive.triangles > 0) {
            let before = scene.triangles.len() + skipped.len();
            self.write_primitive(primitive, world, scene, |triangle| {
                skipped.push((before - first + triangle) as u64);
            })?;
        }
        let inverse = world.inverse();
        if inverse.is_finite() && scene.triangles.len() > first {
            let next = shapes.len() as u32;
            // Mirrored ones have the same triangles, but other corners first.
            let is_mirrored = world.matrix3.determinant() < 0.0;
            let shape = *shapes.entry((mesh, is_mirrored, skipped)).or_insert(next);
            let count = (scene.triangles.len() - first) as u32;
            scene.placements.push(PlacedMesh { first: first as u32, count, shape, to_world: world });
        }
        Ok(())
    }

    fn write_primitive(
        &self,
        primitive: &Primitive<'_>,
        world: DAffine3,
        scene: &mut Scene,
        mut skip: impl FnMut(usize),
    ) -> Result<(), SceneError> {
        // A mirrored mesh would show its back faces; its corners are taken the other way round.
        let order = if world.matrix3.determinant() < 0.0 { [0, 2, 1] } else { [0, 1, 2] };
        for triangle in 0..primitive.triangles {
            let references = primitive.topology.references(triangle);
            let vertices = order.map(|k| primitive.vertex(references[k]));
            let mut corners = [Vec3::ZERO; 3];
            for (corner, &vertex) in corners.iter_mut().zip(&vertices) {
                *corner = self.position(primitive, vertex, &world)?;
            }
            let [a, b, c] = corners;
            if (b - a).cross(c - a).try_normalize().is_none() {
                scene.report.zero_area_triangles += 1;
                skip(triangle);
                continue;
            }
            scene.triangles.push(corners);
            scene.material_of.push(primitive.material);
            primitive.write_attributes(vertices, scene);
        }
        Ok(())
    }

    fn position(
        &self,
        primitive: &Primitive<'_>,
        vertex: usize,
        world: &DAffine3,
    ) -> Result<Vec3, SceneError> {
        let (file, mesh) = (self.document.file, primitive.mesh);
        if vertex >= primitive.positions.count {
            return Err(SceneError::IndexOutOfRange {
                file: file.to_owned(),
                mesh: self.document.mesh_name(mesh),
                primitive: primitive.number,
                index: vertex as u64,
                vertices: primitive.positions.count as u64,
            });
        }
        let local: [f32; 3] = primitive.positions.floats(vertex);
        let placed = world.transform_point3(DVec3::from_array(local.map(f64::from))).as_vec3();
        if !placed.is_finite() {
            return Err(SceneError::NotFinite {
                file: file.to_owned(),
                mesh: self.document.mesh_name(mesh),
                primitive: primitive.number,
                vertex: vertex as u64,
            });
        }
        Ok(placed)
    }
}
