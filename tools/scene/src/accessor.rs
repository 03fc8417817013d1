//! Typed reads of vertex data: strides, integers as numbers, sparse replacements, bounds checked once.
//!
//! Elements are read one at a time and never copied out whole, so that thousands of primitives that share one
//! buffer cost what their triangles cost. Start at [`Accessor::open`].

use crate::SceneError;
use crate::document::Document;
use gltf::json::accessor::{ComponentType, Type, sparse};
use gltf::json::validation::Checked;

/// What an accessor is for, which decides the types it may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// Vertex numbers.
    Indices,
    /// Positions, translations and scales.
    Vector,
    /// Texture coordinates.
    Coordinates,
    /// Vertex colours.
    Colours,
    /// Quaternions.
    Rotations,
    /// Anything that has a count.
    Counted,
}

/// A list of elements somewhere in the buffers.
#[derive(Debug, Clone)]
pub(crate) struct Accessor<'a> {
    /// How many elements; below [`ELEMENTS_MAX`].
    pub(crate) count: usize,
    components: usize,
    kind: ComponentType,
    normalised: bool,
    /// `None` for zeros.
    base: Option<Strided<'a>>,
    sparse: Option<Sparse<'a>>,
}

#[derive(Debug, Clone, Copy)]
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
    element: usize,
}

/// Elements that replace those of the base, by strictly increasing index.
#[derive(Debug, Clone)]
struct Sparse<'a> {
    indices: Vec<u32>,
    values: Strided<'a>,
}

/// Vertex numbers are 32 bits.
const ELEMENTS_MAX: u64 = u32::MAX as u64;

impl Role {
    fn accepts(self, components: usize, kind: ComponentType) -> bool {
        use ComponentType::{F32, U8, U16, U32};
        match self {
            Self::Indices => components == 1 && matches!(kind, U8 | U16 | U32),
            Self::Vector => components == 3 && kind != U32,
            Self::Coordinates => components == 2 && kind != U32,
            Self::Colours => matches!(components, 3 | 4) && matches!(kind, F32 | U8 | U16),
            Self::Rotations => components == 4 && !matches!(kind, U8 | U16 | U32),
            Self::Counted => true,
        }
    }

    fn expected(self) -> &'static str {
        match self {
            Self::Indices => "unsigned integer scalars",
            Self::Vector => "vectors of three floats (or short integers)",
            Self::Coordinates => "vectors of two floats (or short integers)",
            Self::Colours => "vectors of three or four floats (or short unsigned integers)",
            Self::Rotations => "vectors of four floats (or short signed integers)",
            Self::Counted => "elements",
        }
    }
}

impl<'a> Accessor<'a> {
    /// Looks accessor `index` up and checks that all of it lies inside the buffers.
    ///
    /// # Errors
    /// [`SceneError::Malformed`], naming the accessor.
    pub(crate) fn open(document: &'a Document<'_>, index: usize, role: Role) -> Result<Self, SceneError> {
        let wrong = |cause: String| document.malformed(format!("accessor {index}"), cause);
        let json = document.root.accessors.get(index).ok_or_else(|| wrong("it is not there".to_owned()))?;
        let (Checked::Valid(kind), Checked::Valid(shape)) = (json.component_type, json.type_) else {
            return Err(wrong("its type is none that glTF knows".to_owned()));
        };
        let kind = kind.0;
        let components = component_count(shape).filter(|&components| role.accepts(components, kind));
        let Some(components) = components else {
            return Err(wrong(format!("it holds {shape:?} of {kind:?}, and {} are needed", role.expected())));
        };
        if json.count.0 > ELEMENTS_MAX {
            return Err(document.limit("elements in an accessor", json.count.0, ELEMENTS_MAX));
        }
        let count = json.count.0 as usize;
        let element = components * kind.size();
        let offset = json.byte_offset.map_or(0, |offset| offset.0);
        let base = match json.buffer_view {
            Some(view) => Some(Strided::open(document, view.value(), offset, element, count).map_err(wrong)?),
            None => None,
        };
        let sparse = match &json.sparse {
            Some(sparse) => Some(Sparse::open(document, sparse, element, count).map_err(wrong)?),
            None => None,
        };
        // Colours and rotations have no other meaning as integers, flagged or not.
        let normalised = json.normalized || matches!(role, Role::Colours | Role::Rotations);
        Ok(Self { count, components, kind, normalised, base, sparse })
    }

    /// Element `i` as floats; components it does not have are 1.
    pub(crate) fn floats<const N: usize>(&self, i: usize) -> [f32; N] {
        let bytes = self.element(i);
        let size = self.kind.size();
        std::array::from_fn(|k| match bytes {
            _ if k >= self.components => 1.0,
            Some(bytes) => self.number(&bytes[k * size..(k + 1) * size]),
            None => 0.0,
        })
    }

    /// Element `i` of [`Role::Indices`].
    pub(crate) fn vertex(&self, i: usize) -> usize {
        self.element(i).map_or(0, |bytes| unsigned(bytes) as usize)
    }

    fn element(&self, i: usize) -> Option<&'a [u8]> {
        if let Some(sparse) = &self.sparse
            && let Ok(place) = sparse.indices.binary_search(&(i as u32))
        {
            return Some(sparse.values.at(place));
        }
        self.base.map(|base| base.at(i))
    }

    fn number(&self, bytes: &[u8]) -> f32 {
        let scaled = |value: f32, most: f32| if self.normalised { (value / most).max(-1.0) } else { value };
        match (self.kind, bytes) {
            (ComponentType::F32, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
            (ComponentType::I8, &[a]) => scaled(f32::from(a.cast_signed()), 127.0),
            (ComponentType::I16, &[a, b]) => scaled(f32::from(i16::from_le_bytes([a, b])), 32767.0),
            (ComponentType::U8, &[a]) => scaled(f32::from(a), 255.0),
            (ComponentType::U16, &[a, b]) => scaled(f32::from(u16::from_le_bytes([a, b])), 65535.0),
            _ => unsigned(bytes) as f32,
        }
    }
}

impl<'a> Strided<'a> {
    fn open(
        document: &'a Document<'_>,
        view: usize,
        offset: u64,
        element: usize,
        count: usize,
    ) -> Result<Self, String> {
        let (bytes, stride) = document.view(view)?;
        let stride = stride.unwrap_or(element);
        if stride < element {
            return Err(format!("its stride of {stride} bytes is less than its elements of {element}"));
        }
        let reach = (count as u64)
            .checked_sub(1)
            .map_or(Some(0), |last| last.checked_mul(stride as u64)?.checked_add(element as u64));
        let end = reach.and_then(|reach| reach.checked_add(offset));
        if end.is_none_or(|end| end > bytes.len() as u64) {
            return Err(format!(
                "{count} elements reach beyond the {} bytes of buffer view {view}",
                bytes.len()
            ));
        }
        Ok(Self { bytes: &bytes[offset as usize..], stride, element })
    }

    fn at(&self, i: usize) -> &'a [u8] {
        let start = i * self.stride;
        &self.bytes[start..start + self.element]
    }
}

impl<'a> Sparse<'a> {
    fn open(
        document: &'a Document<'_>,
        json: &sparse::Sparse,
        element: usize,
        count: usize,
    ) -> Result<Self, String> {
        let Checked::Valid(kind) = json.indices.component_type else {
            return Err("its sparse indices have no valid type".to_owned());
        };
        if json.count.0 > count as u64 {
            return Err(format!("{} sparse elements replace those of {count}", json.count.0));
        }
        let replaced = json.count.0 as usize;
        let view = json.indices.buffer_view.value();
        let listed = Strided::open(document, view, json.indices.byte_offset.0, kind.0.size(), replaced)?;
        let view = json.values.buffer_view.value();
        let values = Strided::open(document, view, json.values.byte_offset.0, element, replaced)?;
        let indices: Vec<u32> = (0..replaced).map(|i| unsigned(listed.at(i))).collect();
        let inside = indices.last().is_none_or(|&last| (last as usize) < count);
        if !(inside && indices.is_sorted_by(|a, b| a < b)) {
            return Err("its sparse indices do not increase strictly up to its count".to_owned());
        }
        Ok(Self { indices, values })
    }
}

fn component_count(shape: Type) -> Option<usize> {
    match shape {
        Type::Scalar => Some(1),
        Type::Vec2 => Some(2),
        Type::Vec3 => Some(3),
        Type::Vec4 => Some(4),
        Type::Mat2 | Type::Mat3 | Type::Mat4 => None,
    }
}

fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}
