//! Solvers over sparse resident rows: light without a matrix, for resident sets that no matrix fits, and light in motion.
//!
//! One interface, [`Backend`](crate::Backend): [`SolverBackend`] keeps rows and light, and advances them by the
//! [`Method`] that its settings name. The method may change between steps; light goes on from where it was.
//!
//! | method | a frame | a change of light | with nothing changing |
//! |---|---|---|---|
//! | [`Method::Matrix`] | the dense product | at once | nothing is done |
//! | [`Method::Gather`] | one bounce, all rows, exact | a bounce a frame | nothing is done, once settled |
//! | [`Method::Alias`], [`Method::Cdf`] | `k` draws a row, blended with the past | as slow as the history is long | goes on for ever, with noise |
//! | [`Method::Progressive`] | the largest unshot changes are shot | within a few frames | nothing is done, once settled |
//! | [`Method::Hybrid`] | as before, and draws estimate what is not shot yet | at once, noisily; exact within a few frames | nothing is done, once settled |
//!
//! Start at [`backend`] for who is there and which method is in use, at [`row_light`] for what a method is asked and
//! [`cpu_light`] for how the CPU answers, at [`temporal`], [`shooting`] and [`remainder`] for the methods; [`coloured`] draws from
//! rows of the matrix instead ([`DrawnRows::Multibounce`]).

pub mod backend;
pub mod coloured;
pub mod cpu_light;
mod draws;
mod flux;
mod guard;
pub mod links;
pub mod remainder;
pub mod residents;
pub mod row_light;
pub mod sampler;
pub mod settings;
pub mod shooting;
pub mod step_gather;
pub mod temporal;
#[cfg(test)]
mod tests;
pub mod turns;

pub use backend::SolverBackend;
pub use cpu_light::CpuRowLight;
pub use residents::Residents;
pub use row_light::RowLight;
pub use settings::{DrawnRows, Method, SettingsError, SolverSettings};

/// Linear RGB and a number of padding: what loops over light read at once.
pub type Light = [f32; 4];

pub(crate) fn light(rgb: earthshine_world::Rgb) -> Light {
    [rgb.x, rgb.y, rgb.z, 0.0]
}

pub(crate) fn rgb(light: Light) -> earthshine_world::Rgb {
    earthshine_world::Rgb::new(light[0], light[1], light[2])
}

/// `sum += factor * term`, all lanes.
#[inline(always)]
pub(crate) fn add_scaled(sum: &mut Light, factor: f32, term: &Light) {
    for (sum, term) in sum.iter_mut().zip(term) {
        *sum += factor * term;
    }
}
