//! The mathematics (in the making).
pub mod backend;
pub use backend::{ApplyStats, Backend, BackendError, MIN_PIVOT, Slot, StepStats, Update};
/// The oracle.
#[derive(Debug)]
pub struct CpuBackend;
