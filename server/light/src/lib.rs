//! Lamps and sun to direct irradiance: closed forms in the open, shadow rays against resident chunks.
//!
//! Not here: the sky (its shares are in the rows, so it needs no rays), emissive surfaces (they are
//! patches), far occluders, and any decision about what to refresh when. Nothing here draws on
//! threads, clocks or state: the same arguments give the same bits.
//!
//! Start at [`direct_irradiance`]: what the engine asks for, one patch at a time.
//!
//! | module | what |
//! |---|---|
//! | [`arrival`](mod@arrival) | one light at one point, nothing in between |
//! | [`direct`] | the mean over a patch's sample points, with shadows |
//! | [`near`] | what a surface near by sees of direct light within a patch |
//! | [`occluders`] | one chunk's shadow casters |
//! | [`occluder_set`] | the shadow casters of all resident chunks |
//! | [`ray_triangle`] | where a ray crosses a triangle |
//! | [`tree_layout`] | the same trees for a device that follows rays by itself |

pub mod arrival;
pub mod direct;
pub mod near;
pub mod occluder_set;
pub mod occluders;
pub mod ray_triangle;
pub mod tree_layout;

pub use arrival::{Arrival, arrival, may_reach};
pub use direct::{
    DirectLight, LightUnderWay, LitPatch, PatchPoints, direct_irradiance, direct_irradiance_on, told_apart,
};
pub use near::{NEAR_SHARE_MIN, NearPatch, Viewer};
pub use occluder_set::OccluderSet;
pub use occluders::Occluders;
pub use tree_layout::TreeLayout;
