//! Reads a world back: the document through the `gltf` crate, `EXT_mesh_gpu_instancing` from its JSON.

#![expect(clippy::unwrap_used, reason = "a panic is how a test fails, also in what tests share")]

use earthshine_world::Vec3;
use glam::{Mat4, Quat};
use std::collections::BTreeMap;

/// One instance as the file has it.
pub(crate) struct Instance {
    pub translation: Vec3,
    pub rotation: [f32; 4],
    pub scale: Vec3,
}

/// A world in memory, instances expanded.
pub(crate) struct Loaded {
    pub triangles: Vec<[Vec3; 3]>,
    /// By node name: translation, and positions, normals and indices of each primitive in turn.
    pub meshes: BTreeMap<String, (Vec3, Vec<u8>)>,
    /// By node name.
    pub instances: BTreeMap<String, Vec<Instance>>,
    pub lights: usize,
    pub materials: usize,
    pub emissive_materials: usize,
    pub binary: Vec<u8>,
}

impl Loaded {
    pub(crate) fn from(bytes: &[u8]) -> Self {
        let gltf = gltf::Gltf::from_slice_without_validation(bytes).unwrap();
        let known = ["KHR_lights_punctual", "KHR_materials_emissive_strength", "EXT_mesh_gpu_instancing"];
        assert!(gltf.extensions_used().chain(gltf.extensions_required()).all(|name| known.contains(&name)));
        validate(&gltf, bytes);
        let binary = gltf.blob.clone().unwrap();
        let mut loaded = Self {
            triangles: Vec::new(),
            meshes: BTreeMap::new(),
            instances: BTreeMap::new(),
            lights: gltf.nodes().filter(|node| node.light().is_some()).count(),
            materials: gltf.materials().count(),
            emissive_materials: gltf.materials().filter(|m| m.emissive_factor() != [0.0; 3]).count(),
            binary,
        };
        for node in gltf.default_scene().unwrap().nodes() {
            loaded.node(&gltf, &node, Mat4::IDENTITY);
        }
        loaded
    }

    fn node(&mut self, gltf: &gltf::Gltf, node: &gltf::Node<'_>, parent: Mat4) {
        let (translation, rotation, scale) = node.transform().decomposed();
        let rotate = Quat::from_array(rotation);
        let global = parent * Mat4::from_scale_rotation_translation(scale.into(), rotate, translation.into());
        for child in node.children() {
            self.node(gltf, &child, global);
        }
        let Some(mesh) = node.mesh() else { return };
        let name = node.name().unwrap().to_owned();
        let instances = node.extension_value("EXT_mesh_gpu_instancing").map(|extension| {
            let values = |attribute: &str| {
                let accessor = extension["attributes"][attribute].as_u64().unwrap() as usize;
                self.floats(&gltf.accessors().nth(accessor).unwrap())
            };
            let (translations, rotations, scales) =
                (values("TRANSLATION"), values("ROTATION"), values("SCALE"));
            let rotations = rotations.chunks_exact(4);
            let rows = translations.chunks_exact(3).zip(rotations).zip(scales.chunks_exact(3));
            rows.map(|((t, r), s)| Instance {
                translation: Vec3::from_slice(t),
                rotation: [r[0], r[1], r[2], r[3]],
                scale: Vec3::from_slice(s),
            })
            .collect::<Vec<_>>()
        });
        let mut transforms: Vec<Mat4> = instances.iter().flatten().map(|i| global * i.matrix()).collect();
        if let Some(instances) = instances {
            self.instances.insert(name, instances);
        } else {
            transforms.push(global);
            let single = Instance { translation: translation.into(), rotation, scale: scale.into() };
            self.instances.insert(name.clone(), vec![single]);
            let bytes = mesh.primitives().flat_map(|p| self.primitive_bytes(&p)).collect();
            self.meshes.insert(name, (translation.into(), bytes));
        }
        for primitive in mesh.primitives() {
            let reader = primitive.reader(|_| Some(&self.binary));
            let positions: Vec<Vec3> = reader.read_positions().unwrap().map(Vec3::from).collect();
            let bounds = primitive.bounding_box();
            let inside = |p: &Vec3| p.cmpge(bounds.min.into()).all() && p.cmple(bounds.max.into()).all();
            assert!(positions.iter().all(inside), "accessor bounds are wrong");
            assert_eq!(reader.read_normals().unwrap().count(), positions.len());
            let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
            for transform in &transforms {
                let corner = |i: u32| transform.transform_point3(positions[i as usize]);
                self.triangles
                    .extend(indices.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]));
            }
        }
    }

    fn primitive_bytes(&self, primitive: &gltf::Primitive<'_>) -> Vec<u8> {
        let reader = primitive.reader(|_| Some(&self.binary));
        let positions = reader.read_positions().unwrap().flatten();
        let normals = reader.read_normals().unwrap().flatten();
        let floats = positions.chain(normals).flat_map(f32::to_le_bytes);
        floats.chain(reader.read_indices().unwrap().into_u32().flat_map(u32::to_le_bytes)).collect()
    }

    fn floats(&self, accessor: &gltf::Accessor<'_>) -> Vec<f32> {
        let view = accessor.view().unwrap();
        let bytes = &self.binary[view.offset() + accessor.offset()..][..accessor.count() * accessor.size()];
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    }

    pub(crate) fn bounds(&self) -> (Vec3, Vec3) {
        let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        self.triangles.iter().flatten().fold(none, |(min, max), &p| (min.min(p), max.max(p)))
    }

    /// Distance to the nearest triangle, m.
    pub(crate) fn first_hit(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        let hits = self.triangles.iter().filter_map(|triangle| hit(triangle, origin, direction));
        hits.min_by(f32::total_cmp)
    }
}

impl Instance {
    fn matrix(&self) -> Mat4 {
        Mat4::from_scale_rotation_translation(self.scale, Quat::from_array(self.rotation), self.translation)
    }
}

/// The checks of the `gltf` crate, without its refusal of the instancing extension; and of the container.
fn validate(gltf: &gltf::Gltf, bytes: &[u8]) {
    use gltf::json::validation::Validate;
    let mut faults = Vec::new();
    let root = gltf.document.clone().into_json();
    root.validate(&root, gltf::json::Path::new, &mut |path, fault| faults.push((path().to_string(), fault)));
    faults.retain(|(path, _)| !path.starts_with("extensionsRequired"));
    assert!(faults.is_empty(), "{faults:?}");
    assert_eq!(u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]) as usize, bytes.len());
    assert_eq!(root.buffers[0].byte_length.0 as usize, gltf.blob.as_ref().unwrap().len());
    for accessor in gltf.accessors() {
        let view = accessor.view().unwrap();
        let start = view.offset() + accessor.offset();
        assert_eq!(start % accessor.data_type().size(), 0, "an accessor is not aligned");
        assert_eq!(view.offset() % 4, 0);
        assert!(accessor.offset() + accessor.count() * accessor.size() <= view.length());
    }
}

fn hit(&[a, b, c]: &[Vec3; 3], origin: Vec3, direction: Vec3) -> Option<f32> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(ac);
    let inverse = 1.0 / ab.dot(p);
    let t = origin - a;
    let u = t.dot(p) * inverse;
    let q = t.cross(ab);
    let (v, distance) = (direction.dot(q) * inverse, ac.dot(q) * inverse);
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 1e-4).then_some(distance)
}

/// Fails if two triangles lie within a millimetre of one plane and overlap by more than a square centimetre or so.
pub(crate) fn assert_no_shared_planes(triangles: &[[Vec3; 3]], what: &str) {
    let mut planes: BTreeMap<[i32; 4], Vec<usize>> = BTreeMap::new();
    for (i, &[a, b, c]) in triangles.iter().enumerate() {
        let normal = (b - a).cross(c - a).normalize_or(Vec3::Y);
        // Opposite fronts share a plane, too.
        let first = normal.to_array().into_iter().find(|n| n.abs() > 0.01).unwrap();
        let normal = normal * first.signum();
        let key = |offset: f32| {
            let n = (normal * 500.0).round().as_ivec3();
            [n.x, n.y, n.z, offset as i32]
        };
        let offset = (normal.dot(a) * 500.0).floor();
        // Each triangle is listed in its slab of 2 mm, and pairs are looked for there and in the next one.
        planes.entry(key(offset)).or_default().push(i);
    }
    for (key, members) in &planes {
        let next = planes.get(&[key[0], key[1], key[2], key[3] + 1]);
        let near: Vec<usize> = members.iter().chain(next.into_iter().flatten()).copied().collect();
        for (k, &i) in members.iter().enumerate() {
            for &j in &near[k + 1..] {
                assert!(
                    !overlap(&triangles[i], &triangles[j]),
                    "{what}: {:?} and {:?}",
                    triangles[i],
                    triangles[j]
                );
            }
        }
    }
}

/// Whether two nearly coplanar triangles overlap by more than 5 mm in every direction: separating edges, in 3D.
fn overlap(first: &[Vec3; 3], second: &[Vec3; 3]) -> bool {
    let apart = |a: &[Vec3; 3], b: &[Vec3; 3]| {
        let normal = (a[1] - a[0]).cross(a[2] - a[0]).normalize_or(Vec3::Y);
        if a.iter().any(|&p| b.iter().all(|&q| normal.dot(q - p).abs() > 1e-3)) {
            return true;
        }
        (0..3).any(|i| {
            let (from, to) = (a[i], a[(i + 1) % 3]);
            let outward = (to - from).cross(normal).normalize_or(Vec3::Y);
            b.iter().all(|&p| outward.dot(p - from) > -5e-3)
        })
    };
    !apart(first, second) && !apart(second, first)
}
