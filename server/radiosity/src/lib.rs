//! The mathematics of light between patches: the [`Backend`] trait, the CPU backend, and its oracles.
//!
//! ```text
//! B = E + R (I)               exitance: emitted and directly lit, plus reflected
//! I = F B + g                 irradiance: from other patches, plus from outside
//! H = F (Id - R F)^-1         all bounces at once; R = diag(reflectance), one plane a colour channel
//! I = H (E + R g) + g         what a step computes
//! ```
//!
//! No I/O, no clock, no threads of its own (rayon's pool), no knowledge of chunks, tiles or cameras. Nothing
//! here depends on the number of threads, to the bit.
//!
//! | to | use |
//! |---|---|
//! | stream patches in and out and light them | [`Backend`], [`CpuBackend`] |
//! | work on `H` itself | [`LocalMatrix`]: exact block updates, products, drift probe, repair, fresh solve |
//! | light a whole world at once | [`gather::gather`] over [`gather::SparseRows`] |
//! | light some patches of a world, the rest by coarse parents | [`far_light::ResidentSet`] |
//! | have the truth for a few hundred patches | [`multibounce::multibounce`], [`multibounce::series`] |
//! | know a form factor in closed form, or join two estimates | [`form_factor`] |
//! | light without a matrix, or more patches than one holds | [`solver::SolverBackend`] |
//! | draw from rows: alias and CDF tables | [`tables`] |
//! | gather light of receivers on a device | [`receivers::ReceiverLight`] |
//! | check rows | [`invariant`] |
//! | have a closed room to test with | [`closed_box::ClosedBox`] |
//! | measure | [`bench::measure_matrix`] |

pub mod backend;
pub mod bench;
mod buffer;
pub mod closed_box;
mod cpu;
pub mod dense;
mod exchange;
pub mod far_light;
pub mod form_factor;
pub mod gather;
pub mod invariant;
mod kernel;
pub mod local_matrix;
pub mod multibounce;
pub mod receivers;
mod resident_rows;
mod simd;
pub mod slot_check;
pub mod solver;
pub mod tables;
mod tile_kernel;
pub mod told;
pub mod update_check;

pub use backend::{
    ApplyStats, Backend, BackendError, HeldBytes, MIN_PIVOT, RECIPROCITY_TOLERANCE, Repaired, Slot,
    StepStats, Update,
};
pub use cpu::CpuBackend;
pub use local_matrix::{Arrival, CapacityError, LocalMatrix};
