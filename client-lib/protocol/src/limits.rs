//! How much of anything one message may hold. Both sides refuse more, by name.

/// Longest message from server to client, bytes. A larger frame goes out as several deltas.
pub const MESSAGE_BYTES_MAX: usize = 16 << 20;

/// Longest message from client to server, bytes.
pub const CLIENT_MESSAGE_BYTES_MAX: usize = 256 << 10;

/// Most voxels of one volume: 128^3.
pub const VOLUME_VOXELS_MAX: u32 = 1 << 21;

/// Most voxels along one axis of a volume.
pub const VOLUME_DIM_MAX: u32 = 512;

/// Most volumes of one session.
pub const VOLUMES_MAX: usize = 16;

/// Most lights of one session.
pub const LIGHTS_MAX: usize = 1024;

/// Longest client name, world name or cause, bytes.
pub const TEXT_BYTES_MAX: usize = 1024;

/// Name of the volume that holds the first layer of level 0's detail; the next names are the further layers'.
pub const DETAIL_VOLUME: u32 = 256;

/// Most layers of detail.
pub const DETAIL_LAYERS_MAX: u32 = 4;

/// Which layer of detail the volume `name` holds; `None` for a level's own volume.
#[must_use]
pub fn detail_layer(name: u32) -> Option<u32> {
    name.checked_sub(DETAIL_VOLUME).filter(|&layer| layer < DETAIL_LAYERS_MAX)
}

/// Most voxels that a server should put into one delta. The worst case (six patches in each, nineteen bytes a
/// patch, six bytes a voxel) stays under half of [`MESSAGE_BYTES_MAX`].
pub const DELTA_VOXELS_MAX: usize = 1 << 16;

const _: () = assert!(DELTA_VOXELS_MAX * (6 * 19 + 6) < MESSAGE_BYTES_MAX / 2);
