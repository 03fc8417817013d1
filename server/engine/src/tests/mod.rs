//! Tests of the engine as a whole: in-memory worlds, a backend that iterates, a seeded simulator.

mod air;
mod asked_light;
mod backend;
mod budgets;
mod decided_late;
mod detail;
mod far;
mod faults;
mod harness;
mod light;
mod light_off;
mod pyramid;
mod receivers;
mod residency;
mod simulator;
mod solvers;
pub(crate) mod world;
