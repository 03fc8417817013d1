//! Why light at a point is wrong: the error taken apart into causes that add up to it.
//!
//! The light served at a point passes three stages, and each can be checked by a *final gather* (rays from a place that
//! sum the exitance of the patches they hit): the rows of the patches that the lookup reads, the lookup between them,
//! and the exitance of the patches that the point sees. With `I` solved and `G` gathered at the patches read with
//! weights `w`, `T` gathered at the point, `D` the same rays with the true emission and lamp light of what they hit:
//!
//! ```text
//! served - reference = sum w (I - G)  +  sum w (G - T)  +  (T - D)  +  (D - reference)
//!                      rows              lookup            exitance    light further away
//! ```
//!
//! The lookup's part goes point by point of each patch read, so that what lies behind a wall is told apart from what
//! merely differs. Every part is signed; a point's cause is the one that explains most of its error.
//!
//! Where light in the air answers the lookup is no weighted mean, and its whole part, `served - T`, is one cause.
//!
//! This is a diagnosis of a whole world in memory; the service does none of it.

mod contributions;
mod explain;
mod gather;
mod in_air;
mod ranking;
mod reads;
mod report;
mod scene_light;
#[cfg(test)]
mod tests;

use earthshine_world::Rgb;

pub(crate) use explain::{ExplainOptions, Explained, Explainer};
pub(crate) use ranking::rank;
pub(crate) use report::{check_path, print_table, write};

/// Of the channels.
fn mean(light: Rgb) -> f64 {
    f64::from(light.element_sum()) / 3.0
}

/// What makes light at a point wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Cause {
    /// Patches read lie behind a wall as seen from the point.
    ThinWall,
    /// Patches read contain points in crevices or inside of something.
    HiddenPoints,
    /// Patches read contain points that face elsewhere.
    MixedNormals,
    /// The light changes within what is read, in plain sight: the voxel is larger than the detail.
    VoxelDetail,
    /// A direction of the normal has no patch near by; others stand in for it.
    LookupFallback,
    /// A patch of tiny area speaks for a whole voxel.
    SmallPatch,
    /// Light in the air answers: of the middles of voxels, in six directions, by few rays.
    Air,
    /// Rows differ from many more rays by no more than their noise.
    TooFewRays,
    /// Rows differ by more: balancing, absorbed shares, patches left out, half floats.
    RowBalance,
    /// An emitter's edge lies within a patch that the point sees.
    EmitterEdge,
    /// The edge of lamp or sun light lies within a patch that the point sees.
    LampEdge,
    /// Reflectance differs within patches that the point sees.
    ReflectanceMix,
    /// Rays from the point end on surfaces without patches.
    NoPatchSeen,
    /// The light on what the point sees is off already.
    FarLight,
    /// Reference and final gather are no more exact than this.
    Noise,
}

impl Cause {
    /// How many there are.
    pub(crate) const COUNT: usize = 15;
    /// All, in the order of the stages.
    pub(crate) const ALL: [Self; Self::COUNT] = [
        Self::ThinWall,
        Self::HiddenPoints,
        Self::MixedNormals,
        Self::VoxelDetail,
        Self::LookupFallback,
        Self::SmallPatch,
        Self::Air,
        Self::TooFewRays,
        Self::RowBalance,
        Self::EmitterEdge,
        Self::LampEdge,
        Self::ReflectanceMix,
        Self::NoPatchSeen,
        Self::FarLight,
        Self::Noise,
    ];

    /// As in files.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::ThinWall => "thin-wall",
            Self::HiddenPoints => "hidden-points",
            Self::MixedNormals => "mixed-normals",
            Self::VoxelDetail => "voxel-detail",
            Self::LookupFallback => "lookup-fallback",
            Self::SmallPatch => "small-patch",
            Self::Air => "air",
            Self::TooFewRays => "too-few-rays",
            Self::RowBalance => "row-balance",
            Self::EmitterEdge => "emitter-edge",
            Self::LampEdge => "lamp-edge",
            Self::ReflectanceMix => "reflectance-mix",
            Self::NoPatchSeen => "no-patch-seen",
            Self::FarLight => "far-light",
            Self::Noise => "noise",
        }
    }

    /// For people.
    pub(crate) fn meaning(self) -> &'static str {
        match self {
            Self::ThinWall => "reads patches behind a wall",
            Self::HiddenPoints => "reads points in crevices or inside of something",
            Self::MixedNormals => "reads points that face elsewhere",
            Self::VoxelDetail => "light changes within the voxels read: smaller --voxel",
            Self::LookupFallback => "a direction has no patch near by, others stand in",
            Self::SmallPatch => "a patch of tiny area speaks for its voxel",
            Self::Air => "light in the air is that of voxels' middles, in six directions",
            Self::TooFewRays => "noise of the rows: more --rays",
            Self::RowBalance => "rows off by more than noise: balance, absorbed, left-out points",
            Self::EmitterEdge => "emission smeared over patches in sight: smaller --voxel",
            Self::LampEdge => "lamp or sun light smeared over patches in sight",
            Self::ReflectanceMix => "reflectance smeared over patches in sight",
            Self::NoPatchSeen => "rays end on surfaces without patches",
            Self::FarLight => "light on what is seen is off already",
            Self::Noise => "within noise of reference and gather",
        }
    }
}
