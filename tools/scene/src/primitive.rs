//! One primitive: which vertices make its triangles, and what the corners carry besides a position.
//!
//! Opening and placing primitives is in `geometry`.

use crate::Scene;
use crate::accessor::Accessor;
use crate::texture::transformed;

/// How vertex references make triangles.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Topology {
    List,
    Strip,
    Fan,
}

/// One primitive of a mesh, its accessors opened and checked against each other.
#[derive(Debug)]
pub(crate) struct Primitive<'a> {
    pub(crate) mesh: usize,
    pub(crate) number: usize,
    pub(crate) topology: Topology,
    pub(crate) triangles: usize,
    pub(crate) material: u32,
    pub(crate) positions: Accessor<'a>,
    pub(crate) indices: Option<Accessor<'a>>,
    pub(crate) base: Option<(Accessor<'a>, [f32; 6])>,
    /// Only where it differs from `base`.
    pub(crate) emissive: Option<(Accessor<'a>, [f32; 6])>,
    pub(crate) colours: Option<Accessor<'a>>,
}

impl Topology {
    /// How many triangles `references` make, and how many are left over.
    pub(crate) fn triangles(self, references: usize) -> (usize, usize) {
        match self {
            Self::List => (references / 3, references % 3),
            Self::Strip | Self::Fan if references < 3 => (0, references),
            Self::Strip | Self::Fan => (references - 2, 0),
        }
    }

    /// Which references make triangle `i`, counter-clockwise.
    pub(crate) fn references(self, i: usize) -> [usize; 3] {
        match self {
            Self::List => [3 * i, 3 * i + 1, 3 * i + 2],
            Self::Strip => [i, i + 1 + i % 2, i + 2 - i % 2],
            Self::Fan => [i + 1, i + 2, 0],
        }
    }
}

impl Primitive<'_> {
    pub(crate) fn vertex(&self, reference: usize) -> usize {
        self.indices.as_ref().map_or(reference, |indices| indices.vertex(reference))
    }

    /// Coordinates and colours of the triangle just pushed; lists begin when the first primitive needs them.
    pub(crate) fn write_attributes(&self, vertices: [usize; 3], scene: &mut Scene) {
        let before = scene.triangles.len() - 1;
        let read = |source: &Option<(Accessor<'_>, [f32; 6])>| {
            source.as_ref().map(|(list, matrix)| vertices.map(|v| transformed(matrix, list.floats(v))))
        };
        let capacity = scene.triangles.capacity();
        let base = read(&self.base);
        if base.is_some() || !scene.texture_coordinates.is_empty() {
            push_at(
                &mut scene.texture_coordinates,
                base.unwrap_or_default(),
                [[0.0; 2]; 3],
                before,
                capacity,
            );
        }
        let emissive = read(&self.emissive);
        if emissive.is_some() || scene.emissive_coordinates.is_some() {
            let all = scene.emissive_coordinates.get_or_insert_with(|| scene.texture_coordinates.clone());
            push_at(all, emissive.or(base).unwrap_or_default(), [[0.0; 2]; 3], before, capacity);
        }
        if self.colours.is_some() || scene.corner_colours.is_some() {
            let colours = self.colours.as_ref().map_or(Scene::WHITE_CORNERS, |colours| {
                vertices.map(|v| colours.floats::<4>(v).map(|part| (part * 65535.0).round() as u16))
            });
            let all = scene.corner_colours.get_or_insert_default();
            push_at(all, colours, Scene::WHITE_CORNERS, before, capacity);
        }
    }
}

/// Puts `value` at `place`, after `filler` for the triangles that had none; room for `capacity` is made once.
fn push_at<T: Clone>(list: &mut Vec<T>, value: T, filler: T, place: usize, capacity: usize) {
    list.reserve_exact(capacity.saturating_sub(list.len()));
    list.resize(place, filler);
    list.push(value);
}
