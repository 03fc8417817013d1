//! The deterministic heart of the server (in the making).
pub mod event;
pub mod frame;
pub use event::{Command, Event, SessionId};
pub use frame::{Frame, FrameQuality, PatchLight};
