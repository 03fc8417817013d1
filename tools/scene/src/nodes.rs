//! The node tree: which meshes stand where, how often, and which lights.
//!
//! Transforms are composed in f64, so that a town 10 km from the origin keeps its millimetres until the end.
//! Start at [`walk`].

use crate::SceneError;
use crate::accessor::{Accessor, Role};
use crate::document::Document;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use gltf::json::{Node, extensions::scene::Node as NodeExtensions};

/// A mesh somewhere in the world.
#[derive(Debug)]
pub(crate) struct Placement<'a> {
    /// Index of the mesh.
    pub(crate) mesh: usize,
    /// Of the node.
    pub(crate) world: DAffine3,
    /// `EXT_mesh_gpu_instancing`: the mesh stands at each of these instead, seen from the node.
    pub(crate) instances: Option<Instances<'a>>,
}

/// Transforms of one instanced node.
#[derive(Debug)]
pub(crate) struct Instances<'a> {
    /// How many.
    pub(crate) count: usize,
    translations: Option<Accessor<'a>>,
    rotations: Option<Accessor<'a>>,
    scales: Option<Accessor<'a>>,
}

/// What the tree holds.
#[derive(Debug, Default)]
pub(crate) struct Walk<'a> {
    /// In depth-first order.
    pub(crate) placements: Vec<Placement<'a>>,
    /// Index of the light and the transform of its node.
    pub(crate) lights: Vec<(usize, DAffine3)>,
    /// Nodes with a skin.
    pub(crate) skinned_nodes: u64,
    /// Nodes that `KHR_node_visibility` hides, with everything below them.
    pub(crate) hidden_nodes: u64,
}

const INSTANCING: &str = "EXT_mesh_gpu_instancing";
const VISIBILITY: &str = "KHR_node_visibility";

/// Visits the default scene once, or all roots where no scene is named.
///
/// # Errors
/// [`SceneError::Malformed`] for a node that is not there, is reached twice (which a cycle does) or has a
/// transform that is not finite.
pub(crate) fn walk<'a>(document: &'a Document<'_>) -> Result<Walk<'a>, SceneError> {
    let nodes = &document.root.nodes;
    let mut reached = vec![false; nodes.len()];
    let mut found = Walk::default();
    let mut pending: Vec<(usize, DAffine3)> =
        roots(document)?.into_iter().rev().map(|root| (root, DAffine3::IDENTITY)).collect();
    while let Some((index, parent)) = pending.pop() {
        let wrong = |cause: &str| document.malformed(format!("node {index}"), cause);
        let node = nodes.get(index).ok_or_else(|| wrong("it is not there"))?;
        if std::mem::replace(&mut reached[index], true) {
            return Err(wrong("it is reached twice: it has two parents or is its own ancestor"));
        }
        let world = parent * local(node);
        if !world.is_finite() {
            return Err(wrong("its transform is not finite"));
        }
        if is_hidden(node) {
            found.hidden_nodes += 1;
            continue;
        }
        if let Some(mesh) = node.mesh {
            let instances = Instances::of(document, index, node)?;
            found.placements.push(Placement { mesh: mesh.value(), world, instances });
            found.skinned_nodes += u64::from(node.skin.is_some());
        }
        if let Some(light) = extensions(node).and_then(|known| known.khr_lights_punctual.as_ref()) {
            found.lights.push((light.light.value(), world));
        }
        let children = node.children.iter().flatten().rev();
        pending.extend(children.map(|child| (child.value(), world)));
    }
    Ok(found)
}

fn roots(document: &Document<'_>) -> Result<Vec<usize>, SceneError> {
    let root = &document.root;
    let named = match root.scene {
        Some(scene) => Some(scene.value()),
        None if root.scenes.len() == 1 => Some(0),
        None => None,
    };
    if let Some(index) = named {
        let scene = root.scenes.get(index);
        let scene = scene.ok_or_else(|| document.malformed(format!("scene {index}"), "it is not there"))?;
        return Ok(scene.nodes.iter().map(|node| node.value()).collect());
    }
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().filter_map(|node| node.children.as_ref()).flatten() {
        if let Some(is_child) = is_child.get_mut(child.value()) {
            *is_child = true;
        }
    }
    let roots: Vec<usize> = (0..is_child.len()).filter(|&node| !is_child[node]).collect();
    if roots.is_empty() && !root.nodes.is_empty() {
        return Err(document.malformed("nodes", "every node is the child of another, so they form a cycle"));
    }
    Ok(roots)
}

fn extensions(node: &Node) -> Option<&NodeExtensions> {
    node.extensions.as_ref()
}

fn is_hidden(node: &Node) -> bool {
    extensions(node)
        .and_then(|known| known.others.get(VISIBILITY)?.get("visible")?.as_bool())
        .is_some_and(|visible| !visible)
}

fn local(node: &Node) -> DAffine3 {
    if let Some(matrix) = node.matrix {
        return DAffine3::from_mat4(DMat4::from_cols_array(&matrix.map(f64::from)));
    }
    compose(
        node.translation.unwrap_or_default(),
        node.rotation.unwrap_or_default().0,
        node.scale.unwrap_or([1.0; 3]),
    )
}

fn compose(translation: [f32; 3], rotation: [f32; 4], scale: [f32; 3]) -> DAffine3 {
    let rotation = DQuat::from_array(rotation.map(f64::from));
    // A rotation of length zero is no rotation; others are brought to length one, as integers seldom have it.
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    let turned_and_scaled =
        DMat3::from_quat(rotation) * DMat3::from_diagonal(DVec3::from_array(scale.map(f64::from)));
    DAffine3 { matrix3: turned_and_scaled, translation: DVec3::from_array(translation.map(f64::from)) }
}

impl<'a> Instances<'a> {
    fn of(document: &'a Document<'_>, index: usize, node: &Node) -> Result<Option<Self>, SceneError> {
        let Some(extension) = extensions(node).and_then(|known| known.others.get(INSTANCING)) else {
            return Ok(None);
        };
        let wrong = |cause: &str| document.malformed(format!("node {index}, {INSTANCING}"), cause);
        let attributes = extension.get("attributes").and_then(|value| value.as_object());
        let attributes = attributes.ok_or_else(|| wrong("it has no attributes"))?;
        let mut count = None;
        let mut found = [None, None, None];
        for (name, accessor) in attributes {
            let (place, role) = match name.as_str() {
                "TRANSLATION" => (Some(0), Role::Vector),
                "ROTATION" => (Some(1), Role::Rotations),
                "SCALE" => (Some(2), Role::Vector),
                _ => (None, Role::Counted),
            };
            let accessor = accessor.as_u64().and_then(|value| usize::try_from(value).ok());
            let accessor = accessor.ok_or_else(|| wrong("an attribute is not the number of an accessor"))?;
            let accessor = Accessor::open(document, accessor, role)?;
            if count.is_some_and(|count| count != accessor.count) {
                return Err(wrong("its attributes differ in length"));
            }
            count = Some(accessor.count);
            if let Some(place) = place {
                found[place] = Some(accessor);
            }
        }
        let count = count.ok_or_else(|| wrong("it has no attributes"))?;
        let [translations, rotations, scales] = found;
        Ok(Some(Self { count, translations, rotations, scales }))
    }

    /// Transform of instance `i`, seen from its node.
    pub(crate) fn transform(&self, i: usize) -> DAffine3 {
        compose(
            self.translations.as_ref().map_or([0.0; 3], |list| list.floats(i)),
            self.rotations.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |list| list.floats(i)),
            self.scales.as_ref().map_or([1.0; 3], |list| list.floats(i)),
        )
    }
}
