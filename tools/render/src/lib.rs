//! The oracle and its yardsticks: path-traced light at points and in pictures, and how far off something is.
//!
//! Not here: form factors (the bake has its own rays), the service, the command line. Service light comes
//! in as a function from position and normal to irradiance.
//!
//! Start at [`reference::irradiance_at`] for numbers, at [`picture::render`] for pictures.
//!
//! | module | what |
//! |---|---|
//! | [`tracer`] | a scene under a tree: closest hit, blocked or not |
//! | [`emitters`] | which emissive triangle to look at, and how likely that was |
//! | [`path`] | one random path: its light at a point |
//! | [`sky`] | what escaping paths see: lobes, or an environment map looked at on purpose |
//! | [`sampling`] | random streams and directions |
//! | [`reference`](mod@reference) | many paths: mean, standard error, when to stop |
//! | [`chart`] | figures against each other, as SVG and PNG |
//! | [`csv`] | reference light on disk |
//! | [`agreement`](mod@agreement) | whether two estimates agree within their noise |
//! | [`compare_points`](mod@compare_points) | errors of light at points |
//! | [`camera`] | a pinhole |
//! | [`picture`] | layers of a picture: direct, indirect, full |
//! | [`image_file`] | exposure, PNG, EXR |
//! | [`difference`] | false colours for differences |
//! | [`legend`] | what colours mean, below a picture |
//! | [`sheet`] | labelled pictures side by side |
//! | [`progressive`] | progressive refinement radiosity, for small scenes |
//! | [`screen_space`] | the screen-space method: far light, mip chain, near occlusion |
//! | [`metrics`] | RMSE, PSNR, SSIM, FLIP |

pub mod agreement;
pub mod camera;
pub mod chart;
#[cfg(test)]
mod closed_forms;
pub mod compare_points;
pub mod csv;
pub mod difference;
pub mod emitters;
mod glyphs;
pub mod image_file;
pub mod legend;
pub mod metrics;
pub mod noiseless;
pub mod path;
pub mod picture;
pub mod progressive;
pub mod reference;
pub mod sampling;
pub mod screen_space;
pub mod sheet;
pub mod sky;
#[cfg(test)]
mod sky_forms;
#[cfg(test)]
mod test_scenes;
pub mod tracer;

pub use camera::Pinhole;
pub use compare_points::{LightErrors, compare_points};
pub use csv::ReferencePoint;
pub use metrics::{PictureErrors, compare_pictures};
pub use picture::{Layers, LightSource, PictureOptions, render};
pub use reference::{PointEstimate, ReferenceOptions, irradiance_at, irradiance_at_points};
pub use tracer::{Hit, SceneTracer, Sides};
