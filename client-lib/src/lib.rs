//! Connect to a lighting service, say where the camera is, read the light.
//!
//! ```no_run
//! # async fn example() -> Result<(), earthshine_client::ClientError> {
//! use earthshine_client::{Camera, Client, ClientOptions, Vec3};
//!
//! let mut client = Client::connect("http://127.0.0.1:7461", ClientOptions::default()).await?;
//! client.set_camera(Camera { position: Vec3::new(0.0, 1.7, 0.0), forward: Vec3::NEG_Z, velocity: Vec3::ZERO })?;
//! let light = client.next_light().await?;
//! println!("{:?}", light.lookup(Vec3::ZERO, Vec3::Y));
//! # Ok(()) }
//! ```
//!
//! **Units**: right-handed, +Y up, metres; linear RGB. What is looked up is *indirect* irradiance in lx: the
//! outgoing radiance of a diffuse surface is `reflectance / pi` times it. The first arrival from sun and lamps is
//! yours to draw, with your own shadows.
//!
//! **Threads**: nothing here blocks a frame. [`Client::set_camera`] and [`Client::set_lights`] leave a note that a
//! background task sends, the newest wins; [`Client::light`] hands out the newest whole state, which never
//! changes while it is held. [`blocking::Client`] is the same for programs without tokio.
//!
//! **Errors**: the background task checks every number that comes in. Whatever ends a session is told by the next
//! call, and again by every call after it; the last light stays readable. Connecting again is the caller's decision.
//!
//! It does not render, and it depends on nothing of the server but the wire.

mod assembly;
pub mod blocking;
mod camera;
mod client;
mod credentials;
mod decode;
mod error;
mod light;
mod lights;
mod outbox;
mod session;
mod statistics;
mod world;

pub use camera::Camera;
pub use client::Client;
pub use credentials::Credentials;
pub use earthshine_volume::{LookedUp, Volume};
pub use error::ClientError;
pub use glam::{UVec3, Vec3};
pub use light::{FrameQuality, Light};
pub use lights::{LightSource, Lights};
pub use session::{ClientOptions, Session};
pub use statistics::{Answer, ServerStatistics, Statistics};
pub use world::{World, world};
