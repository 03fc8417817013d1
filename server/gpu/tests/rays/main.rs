//! Rays on a device against the CPU whose trees it was given: what they meet first, what fans of them face, where runs of
//! them end. `asked` has the rays, and the words of the CPU's questions as a device reads them.

#![expect(clippy::print_stdout, reason = "counts are wanted beside a pass")]

mod asked;
mod closest;
mod ends;
mod fans;
