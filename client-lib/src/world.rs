//! What a server serves, asked without a session.

use crate::{ClientError, ClientOptions, Lights, camera::vector_from_wire, session::open};
use earthshine_protocol::v1;
use glam::Vec3;

/// A world in numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    /// Its name.
    pub name: String,
    /// Edge of a voxel of level 0, m.
    pub voxel_edge_m: f32,
    /// Voxels along a chunk's edge.
    pub chunk_edge_voxels: u32,
    /// Box around all geometry, lower corner, m.
    pub bounds_min: Vec3,
    /// Box around all geometry, upper corner, m.
    pub bounds_max: Vec3,
    /// Levels of the pyramid.
    pub level_count: u32,
    /// Chunks of all levels.
    pub chunk_count: u64,
    /// Patches of all levels.
    pub patch_count: u64,
    /// Form factors of all levels.
    pub nonzero_count: u64,
    /// Bytes of all tiles.
    pub tile_bytes: u64,
    /// The lights that came with the scene: what a session starts with.
    pub lights: Lights,
    /// Program and version of the server.
    pub server_version: String,
}

/// Asks the server at `uri` for the world that the options name.
///
/// # Errors
/// [`ClientError::Unreachable`]; [`ClientError::Refused`] for an unknown world; [`ClientError::Timeout`];
/// [`ClientError::Lost`]; [`ClientError::Protocol`]; [`ClientError::Invalid`] for a token that cannot be sent.
pub async fn world(uri: &str, options: &ClientOptions) -> Result<World, ClientError> {
    let timeout = options.connect_timeout;
    let request = v1::WorldRequest { world: options.world.clone() };
    let mut client = open(uri, options).await?;
    let answer = tokio::time::timeout(timeout, client.world(request)).await;
    let info = answer
        .map_err(|_elapsed| ClientError::Timeout { what: "description of the world", timeout })?
        .map_err(|status| ClientError::from_status(&status))?
        .into_inner();
    Ok(World {
        name: info.world,
        voxel_edge_m: info.voxel_edge_m,
        chunk_edge_voxels: info.chunk_edge_voxels,
        bounds_min: vector_from_wire(info.bounds_min, "the bounds' lower corner")?,
        bounds_max: vector_from_wire(info.bounds_max, "the bounds' upper corner")?,
        level_count: info.level_count,
        chunk_count: info.chunk_count,
        patch_count: info.patch_count,
        nonzero_count: info.nonzero_count,
        tile_bytes: info.tile_bytes,
        lights: Lights::from_wire(&info.lights.unwrap_or_default())?,
        server_version: info.server_version,
    })
}
