//! Progressive refinement radiosity, classic form: the patch with the most unshot power shoots, again and again.
//!
//! Cohen, Chen, Wallace, Greenberg 1988; G. Coombe, M. Harris, GPU Gems 2 ch. 39. Form factors are computed on the
//! fly, one shooter at a time, so nothing is stored but the elements: for small scenes, and a second oracle beside
//! the path tracer that shares its rays and its lamps, and no random path.
//!
//! | step | where |
//! |---|---|
//! | cut triangles into patches (shooters) and leaves (receivers) | [`elements`] |
//! | discs, as many as nearness asks for | [`form_factor`] |
//! | what a shooter sees, by rays or by an id buffer | [`Visibility`], [`id_buffer`] |
//! | first light, shots, splitting where light changes fast | [`shooting`] |
//! | light between the leaves' middles, for pictures | [`display`] |
//!
//! Not here: the service's shooting (incremental, with stored rows), pictures, plots.

pub mod display;
pub mod elements;
pub mod form_factor;
pub mod id_buffer;
pub mod shooting;

pub use shooting::{Power, Progressive, Shot};

/// Most leaves that may be asked for.
pub const ELEMENTS_MAX: usize = 1 << 20;
/// Most texels along an id buffer's edge.
pub const ID_BUFFER_TEXELS_MAX: u32 = 4096;
/// Deepest splits below a patch: a leaf is 1/4096 of it.
pub const SPLITS_MAX: u32 = 6;

/// How a shooter finds out what it sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Visibility {
    /// A ray for every part of the shooter and place on the receiver.
    Rays,
    /// A hemispherical picture of ids from the middle of the shooter.
    IdBuffer {
        /// Along each edge.
        edge_texels: u32,
    },
}

/// How to solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProgressiveOptions {
    /// Largest patch, m2; `None` for a thousandth of all sides together.
    pub patch_area_max_m2: Option<f32>,
    /// Most leaves, at most [`ELEMENTS_MAX`].
    pub elements_max: usize,
    /// Splits below a patch, at most [`SPLITS_MAX`]; 0 for none.
    pub splits_max: u32,
    /// A leaf splits where a shot's light changes across it by more than this share of its mean over all it reaches.
    pub gradient_max: f32,
    /// Who sees whom.
    pub visibility: Visibility,
    /// Of the random numbers (area lamps and the sun's disc).
    pub seed: u64,
}

impl Default for ProgressiveOptions {
    fn default() -> Self {
        Self {
            patch_area_max_m2: None,
            elements_max: 20_000,
            splits_max: 2,
            gradient_max: 0.5,
            visibility: Visibility::Rays,
            seed: 1,
        }
    }
}

/// What cannot be solved this way.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProgressiveError {
    /// More elements than allowed even before any was split.
    #[error(
        "patches of {area_m2} m2 are more than {elements_max} elements: progressive refinement is for small scenes; \
         allow larger patches or more elements, or bake a world"
    )]
    TooMany {
        /// The limit.
        elements_max: usize,
        /// The largest patch asked for.
        area_m2: f32,
    },
    /// More triangles than elements.
    #[error(
        "{triangles} triangles have {} sides, more than the limit of {elements_max} elements: progressive refinement \
         is for small scenes; allow more elements, or bake a world", 2 * triangles
    )]
    TooManyTriangles {
        /// In the scene.
        triangles: usize,
        /// The limit.
        elements_max: usize,
    },
    /// An option out of range.
    #[error("{name} is {value}; it must be {range}")]
    Option {
        /// Which.
        name: &'static str,
        /// What it was.
        value: f64,
        /// What it may be.
        range: &'static str,
    },
    /// No triangles.
    #[error("the scene has no triangles")]
    Empty,
}

impl ProgressiveOptions {
    /// Whether the options are in range.
    ///
    /// # Errors
    /// Names the one that is not.
    pub fn validate(&self) -> Result<(), ProgressiveError> {
        let fault = |name, value, range| Err(ProgressiveError::Option { name, value, range });
        if let Some(area) = self.patch_area_max_m2
            && !(area > 0.0 && area.is_finite())
        {
            return fault("the largest patch (m2)", f64::from(area), "positive and finite");
        }
        if !(1..=ELEMENTS_MAX).contains(&self.elements_max) {
            return fault("the number of elements", self.elements_max as f64, "1 to 1048576");
        }
        if self.splits_max > SPLITS_MAX {
            return fault("the number of splits", f64::from(self.splits_max), "0 to 6");
        }
        if self.gradient_max.is_nan() || self.gradient_max <= 0.0 {
            return fault("the gradient", f64::from(self.gradient_max), "positive");
        }
        if let Visibility::IdBuffer { edge_texels } = self.visibility
            && !(8..=ID_BUFFER_TEXELS_MAX).contains(&edge_texels)
        {
            return fault("the id buffer's edge (texels)", f64::from(edge_texels), "8 to 4096");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
