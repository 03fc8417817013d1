//! Meshes, instances and lamps as a binary glTF 2.0 file (`.glb`).
//!
//! One buffer; every mesh has one view of positions and normals and one of indices. Several instances of a mesh
//! are one node with `EXT_mesh_gpu_instancing`, which is then *required*: a reader that ignored it would show one
//! triangle in many, and silently. There are no textures.

use crate::document::{self as json, Document};
use crate::material::Material;
use crate::mesh::{Mesh, Placement, Surface};
use crate::{GenError, GenOptions, WorldKind};
use earthshine_world::{Light, Rgb, Vec3};
use glam::Quat;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

/// A world, ready to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct Glb {
    /// The whole file.
    pub bytes: Vec<u8>,
    /// As rendered: every instance counts.
    pub triangles: u64,
    /// Triangles the file holds, each once.
    pub stored_triangles: u64,
    /// Placed copies of meshes, however they are written.
    pub instances: u64,
    /// `KHR_lights_punctual`.
    pub lights: usize,
    /// Materials.
    pub materials: usize,
}

impl Glb {
    /// Writes the file: to a name beside it first, then renamed, so that a reader never sees half of it.
    ///
    /// # Errors
    /// What the system said; nothing is left behind.
    pub fn write(&self, path: &Path) -> Result<(), GenError> {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{}.partial", std::process::id()));
        let partial = path.with_file_name(name);
        self.write_through(&partial, path).map_err(|source| {
            // The first error is the one to tell; the leftover may not even be there.
            std::fs::remove_file(&partial).ok();
            GenError::Write { path: path.to_owned(), source }
        })
    }

    fn write_through(&self, partial: &Path, path: &Path) -> std::io::Result<()> {
        let mut file = std::fs::File::create(partial)?;
        file.write_all(&self.bytes)?;
        file.sync_all()?;
        std::fs::rename(partial, path)
    }
}

/// Number of a mesh in the file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeshIndex(u32);

/// Number of a node in the file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NodeIndex(u32);

/// Builds the file part by part.
pub(crate) struct GlbBuilder {
    document: Document,
    binary: Vec<u8>,
    lights: Vec<json::Light>,
    mesh_triangles: Vec<u64>,
    triangles: u64,
    instances: u64,
}

/// Most bytes of a file; its header counts in 32 bits.
const BYTES_MAX: u64 = u32::MAX as u64;

impl GlbBuilder {
    pub(crate) fn new(world: WorldKind, options: &GenOptions, materials: &[Material]) -> Self {
        let extras = json::Provenance { world, options: options.clone() };
        let document = Document {
            asset: json::Asset { version: "2.0", generator: "earthshine gen", extras },
            extensions_used: Vec::new(),
            extensions_required: Vec::new(),
            extensions: None,
            scene: 0,
            scenes: vec![json::Scene { nodes: Vec::new() }],
            nodes: Vec::new(),
            materials: materials.iter().map(material_json).collect(),
            meshes: Vec::new(),
            accessors: Vec::new(),
            buffer_views: Vec::new(),
            buffers: Vec::new(),
        };
        let (binary, lights, mesh_triangles) = (Vec::new(), Vec::new(), Vec::new());
        Self { document, binary, lights, mesh_triangles, triangles: 0, instances: 0 }
    }

    /// Stores a mesh; it shows where it is placed.
    pub(crate) fn mesh(&mut self, name: &str, mesh: &Mesh) -> Result<MeshIndex, GenError> {
        let vertices = self.view(Some(json::ARRAY_BUFFER));
        let mut primitives = Vec::with_capacity(mesh.surfaces.len());
        for (material, surface) in &mesh.surfaces {
            let (min, max) = extent(surface);
            let position = self.floats(vertices, bytemuck::cast_slice(&surface.positions), "VEC3", 3);
            self.document.accessors[position as usize].min = Some(min.to_array());
            self.document.accessors[position as usize].max = Some(max.to_array());
            let normal = self.floats(vertices, bytemuck::cast_slice(&surface.normals), "VEC3", 3);
            let attributes = BTreeMap::from([("POSITION", position), ("NORMAL", normal)]);
            primitives.push(json::Primitive { attributes, indices: 0, material: material.0.into() });
        }
        self.close_view(vertices, Some(12))?;
        let indices = self.view(Some(json::ELEMENT_ARRAY_BUFFER));
        for (primitive, surface) in primitives.iter_mut().zip(mesh.surfaces.values()) {
            primitive.indices = self.indices(indices, surface);
        }
        self.close_view(indices, None)?;
        self.document.meshes.push(json::Mesh { name: name.to_owned(), primitives });
        self.mesh_triangles.push(mesh.triangles());
        Ok(MeshIndex(self.mesh_triangles.len() as u32 - 1))
    }

    /// Shows `mesh` at `placement`.
    pub(crate) fn place(&mut self, name: &str, mesh: MeshIndex, placement: &Placement) {
        self.place_with(name, mesh, placement, Vec::new());
    }

    /// Shows `mesh` at `placement`, and nodes that are placed relative to it.
    pub(crate) fn place_with(
        &mut self,
        name: &str,
        mesh: MeshIndex,
        placement: &Placement,
        parts: Vec<NodeIndex>,
    ) {
        self.count(mesh, 1);
        let children = parts.into_iter().map(|part| part.0).collect();
        let node = self.node(json::Node { mesh: Some(mesh.0), children, ..node_json(name, placement) });
        self.show(node);
    }

    /// Copies of `mesh` at each of `placements`; they show as parts of a placed mesh.
    pub(crate) fn copies(
        &mut self,
        name: &str,
        mesh: MeshIndex,
        placements: &[Placement],
    ) -> Result<NodeIndex, GenError> {
        if let [placement] = placements {
            self.count(mesh, 1);
            return Ok(self.node(json::Node { mesh: Some(mesh.0), ..node_json(name, placement) }));
        }
        self.count(mesh, placements.len() as u64);
        let translations: Vec<f32> = placements.iter().flat_map(|p| p.translation.to_array()).collect();
        let rotations: Vec<f32> = placements.iter().flat_map(|p| p.rotation.to_array()).collect();
        let scales: Vec<f32> = placements.iter().flat_map(|p| [p.scale; 3]).collect();
        let mut attributes = BTreeMap::new();
        for (attribute, values, shape, width) in [
            ("TRANSLATION", translations, "VEC3", 3),
            ("ROTATION", rotations, "VEC4", 4),
            ("SCALE", scales, "VEC3", 3),
        ] {
            let view = self.view(None);
            attributes.insert(attribute, self.floats(view, &values, shape, width));
            self.close_view(view, None)?;
        }
        self.uses(json::INSTANCING, true);
        let instancing = Some(json::Instancing { attributes });
        let extensions = Some(json::NodeExtensions { instancing, light: None });
        let node =
            json::Node { mesh: Some(mesh.0), extensions, ..node_json(name, &Placement::at(Vec3::ZERO)) };
        Ok(self.node(node))
    }

    /// Adds a lamp or the sun.
    pub(crate) fn light(&mut self, name: &str, light: &Light) {
        let (kind, strength, position, direction, range, spot) = match *light {
            Light::Directional { direction, illuminance, .. } => {
                ("directional", illuminance, Vec3::ZERO, direction, None, None)
            }
            Light::Point { position, intensity, range_m } => {
                ("point", intensity, position, Vec3::NEG_Z, range_m, None)
            }
            Light::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m } => {
                let cone = json::Cone { inner_cone_angle: inner_cone_rad, outer_cone_angle: outer_cone_rad };
                ("spot", intensity, position, direction, range_m, Some(cone))
            }
        };
        let (color, intensity) = colour_and_strength(strength);
        self.lights.push(json::Light {
            name: name.to_owned(),
            kind,
            color: color.to_array(),
            intensity,
            range,
            spot,
        });
        self.uses(json::LIGHTS, false);
        let light = Some(json::LightOfNode { light: self.lights.len() as u32 - 1 });
        let extensions = Some(json::NodeExtensions { light, instancing: None });
        // A punctual light shines along the -Z axis of its node.
        let rotation = Quat::from_rotation_arc(Vec3::NEG_Z, direction);
        let placement = Placement { translation: position, rotation, scale: 1.0 };
        let node = self.node(json::Node { extensions, ..node_json(name, &placement) });
        self.show(node);
    }

    /// The whole file.
    pub(crate) fn finish(mut self) -> Result<Glb, GenError> {
        pad(&mut self.binary, 0);
        if self.document.materials.iter().any(|material| material.extensions.is_some()) {
            self.uses(json::EMISSIVE_STRENGTH, false);
        }
        self.document.extensions_used.sort_unstable();
        let lights = self.lights.len();
        if lights > 0 {
            let list = json::LightList { lights: self.lights };
            self.document.extensions = Some(json::RootExtensions { lights: list });
        }
        self.document.buffers.push(json::Buffer { byte_length: self.binary.len() as u64 });
        let mut text = serde_json::to_vec(&self.document)?;
        pad(&mut text, b' ');
        let total = 12 + 8 + text.len() as u64 + 8 + self.binary.len() as u64;
        let total = u32::try_from(total).map_err(|_too_long| GenError::TooLarge { limit: BYTES_MAX })?;
        let mut bytes = Vec::with_capacity(total as usize);
        let header = [u32::from_le_bytes(*b"glTF"), 2, total];
        bytes.extend(header.iter().flat_map(|word| word.to_le_bytes()));
        for (tag, chunk) in [(*b"JSON", &text), (*b"BIN\0", &self.binary)] {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(tag);
            bytes.extend(chunk);
        }
        Ok(Glb {
            bytes,
            triangles: self.triangles,
            stored_triangles: self.mesh_triangles.iter().sum(),
            instances: self.instances,
            lights,
            materials: self.document.materials.len(),
        })
    }

    fn count(&mut self, mesh: MeshIndex, placed: u64) {
        self.instances += placed;
        self.triangles += placed * self.mesh_triangles[mesh.0 as usize];
    }

    fn node(&mut self, node: json::Node) -> NodeIndex {
        self.document.nodes.push(node);
        NodeIndex(self.document.nodes.len() as u32 - 1)
    }

    fn show(&mut self, node: NodeIndex) {
        self.document.scenes[0].nodes.push(node.0);
    }

    fn uses(&mut self, extension: &'static str, required: bool) {
        let document = &mut self.document;
        let lists =
            [Some(&mut document.extensions_used), required.then_some(&mut document.extensions_required)];
        for list in lists.into_iter().flatten() {
            if !list.contains(&extension) {
                list.push(extension);
            }
        }
    }

    /// Begins a view at the end of the buffer.
    fn view(&mut self, target: Option<u32>) -> u32 {
        pad(&mut self.binary, 0);
        let byte_offset = self.binary.len() as u64;
        let view = json::BufferView { buffer: 0, byte_offset, byte_length: 0, byte_stride: None, target };
        self.document.buffer_views.push(view);
        self.document.buffer_views.len() as u32 - 1
    }

    fn close_view(&mut self, view: u32, stride: Option<u32>) -> Result<(), GenError> {
        let end = self.binary.len() as u64;
        let view = &mut self.document.buffer_views[view as usize];
        view.byte_length = end - view.byte_offset;
        view.byte_stride = stride;
        if end < BYTES_MAX { Ok(()) } else { Err(GenError::TooLarge { limit: BYTES_MAX }) }
    }

    fn accessor(&mut self, view: u32, component_type: u32, count: usize, shape: &'static str) -> u32 {
        let byte_offset = self.binary.len() as u64 - self.document.buffer_views[view as usize].byte_offset;
        let count = count as u64;
        let accessor = json::Accessor {
            buffer_view: view,
            byte_offset,
            component_type,
            count,
            shape,
            min: None,
            max: None,
        };
        self.document.accessors.push(accessor);
        self.document.accessors.len() as u32 - 1
    }

    fn floats(&mut self, view: u32, values: &[f32], shape: &'static str, width: usize) -> u32 {
        let accessor = self.accessor(view, json::FLOAT, values.len() / width, shape);
        self.binary.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        accessor
    }

    fn indices(&mut self, view: u32, surface: &Surface) -> u32 {
        pad(&mut self.binary, 0);
        // 65,535 is the restart mark of 16-bit indices and may not be used.
        let short = surface.positions.len() <= usize::from(u16::MAX);
        let component = if short { json::UNSIGNED_SHORT } else { json::UNSIGNED_INT };
        let accessor = self.accessor(view, component, surface.indices.len(), "SCALAR");
        if short {
            self.binary.extend(surface.indices.iter().flat_map(|&index| (index as u16).to_le_bytes()));
        } else {
            self.binary.extend(surface.indices.iter().flat_map(|index| index.to_le_bytes()));
        }
        accessor
    }
}

fn pad(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(4), with);
}

fn extent(surface: &Surface) -> (Vec3, Vec3) {
    let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    surface.positions.iter().fold(none, |(min, max), &p| (min.min(p), max.max(p)))
}

/// glTF keeps factors within 0..=1 and the strength beside them.
fn colour_and_strength(light: Rgb) -> (Rgb, f32) {
    let strength = light.max_element();
    if strength > 0.0 { (light / strength, strength) } else { (Rgb::ONE, 0.0) }
}

fn node_json(name: &str, placement: &Placement) -> json::Node {
    let Placement { translation, rotation, scale } = *placement;
    json::Node {
        name: name.to_owned(),
        translation: (translation != Vec3::ZERO).then(|| translation.to_array()),
        rotation: (rotation != Quat::IDENTITY).then(|| rotation.to_array()),
        scale: (scale != 1.0).then_some([scale; 3]),
        ..json::Node::default()
    }
}

fn material_json(material: &Material) -> json::Material {
    let emits = material.emitted_radiance != Rgb::ZERO;
    let (factor, strength) = if material.emitted_radiance.max_element() > 1.0 {
        colour_and_strength(material.emitted_radiance)
    } else {
        (material.emitted_radiance, 1.0)
    };
    let extensions = (strength != 1.0).then_some(json::MaterialExtensions {
        emissive_strength: json::Strength { emissive_strength: strength },
    });
    json::Material {
        name: material.name.clone(),
        pbr_metallic_roughness: json::MetallicRoughness {
            base_color_factor: material.reflectance.extend(1.0).to_array(),
            metallic_factor: 0.0,
            roughness_factor: 1.0,
        },
        emissive_factor: emits.then(|| factor.to_array()),
        double_sided: material.double_sided,
        extensions,
    }
}
