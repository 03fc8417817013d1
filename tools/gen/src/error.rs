//! What can keep a world from being made.

use std::path::PathBuf;

/// Why there is no world.
#[derive(Debug, thiserror::Error)]
pub enum GenError {
    /// Not the name of a world.
    #[error("unknown world {given:?}: choose one of cornell, furnace, two-rooms, study, corridor, town")]
    UnknownKind {
        /// What was asked for.
        given: String,
    },
    /// A number outside what its option accepts.
    #[error("{name} is {value}, outside {least} to {most}")]
    OutOfRange {
        /// Name of the option.
        name: &'static str,
        /// What was asked for.
        value: f64,
        /// Smallest accepted.
        least: f64,
        /// Largest accepted.
        most: f64,
    },
    /// The town's size and its triangle count do not fit each other.
    #[error(
        "a town of {size_m} m does not hold {asked} triangles (it came to {made}): choose a larger size for more, \
         a smaller one for fewer"
    )]
    Triangles {
        /// What was asked for.
        asked: u64,
        /// What the structure alone, or all its detail, comes to.
        made: u64,
        /// Edge of the town, m.
        size_m: f32,
    },
    /// A `.glb` counts its bytes in 32 bits.
    #[error(
        "the world has more than {limit} bytes, which a .glb cannot hold: leave instances unflattened or make it smaller"
    )]
    TooLarge {
        /// Most bytes.
        limit: u64,
    },
    /// The JSON part could not be written.
    #[error("the glTF document could not be written")]
    Document(#[from] serde_json::Error),
    /// The file could not be written.
    #[error("{path}: could not be written; nothing was left there")]
    Write {
        /// Where it should have gone.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}
