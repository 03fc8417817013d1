//! What crosses packages: scenes to worlds to service to client, suites that every backend and store must pass, the
//! shared scenes. What one package promises alone is tested there and not repeated here; bad input through the
//! command is tested beside the command.
//!
//! Start at the files in `tests/`; this library holds what they share, one subject a module.
//!
//! | module | what |
//! |---|---|
//! | [`baked`] | a scene becomes a world in a scratch folder |
//! | [`solved`] | the same world lit as a whole: what the service is held against |
//! | [`served`] | a server in the background on a free port |
//! | [`on_disk`] | an engine over a world on disk, without a server |
//! | [`viewer`] | a client that waits until its light is what it should be |
//! | [`agreement`] | served light beside solved light |
//! | [`adapter`] | a device for the GPU backend, or a line that says why not |
//! | [`backend_suite`] | what every [`Backend`](earthshine_radiosity::Backend) promises |
//! | [`solver_suite`] | what every [`RowLight`](earthshine_radiosity::solver::RowLight) promises |
//! | [`news_suite`] | what both promise of the light that they tell |
//! | [`store_suite`] | what every [`TileStore`](earthshine_tiles::TileStore) promises |
//! | [`shared`] | the shared scenes, or a line that says they are not there |

pub mod adapter;
pub mod agreement;
pub mod backend_suite;
pub mod baked;
pub mod news_suite;
pub mod on_disk;
pub mod served;
pub mod shared;
pub mod solved;
pub mod solver_suite;
pub mod store_suite;
pub mod viewer;
