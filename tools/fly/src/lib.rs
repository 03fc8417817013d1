//! A camera on a path, through the client library: how fast is the light there, and where is it missing?
//!
//! [`fly()`] connects like any other client, moves the camera (and the sun), looks light up at probes and returns a
//! [`FlyReport`]. It knows nothing of the server but the wire, and draws nothing: pictures are made by whoever gives
//! the callback. Start at [`FlyOptions`].

pub mod daylight;
pub mod fly;
pub mod path;
mod path_file;
pub mod probe;
pub mod report;
pub mod sun;
mod sun_file;
mod toml_table;

pub use fly::{FlyError, FlyFrame, FlyOptions, fly};
pub use path::{Key, Path, PathError};
pub use probe::{Probe, Probes};
pub use report::FlyReport;
pub use sun::{SunCourse, SunFault, SunLight, SunPath};
pub use sun_file::{SunFile, SunPathError};
