//! Parameters that cannot be, refused by name before anything is done.

use crate::BakeError;
use earthshine_tiles::BakeParameters;
use earthshine_world::Grid;

/// Largest edge of a voxel: coarse levels double it, and clients know none above a thousand kilometres, six of such doublings.
const VOXEL_EDGE_MAX_M: f32 = 1e4;

/// Refuses what cannot be baked.
///
/// # Errors
/// [`BakeError::Parameter`] for the first that is out of its range.
pub fn check(parameters: &BakeParameters) -> Result<(), BakeError> {
    let edge = parameters.grid.voxel_edge_m;
    if !(edge > 1e-4 && edge <= VOXEL_EDGE_MAX_M) {
        let (name, cause) = ("voxel edge", "must be a length above 0.0001 m and at most 10,000 m");
        return Err(BakeError::Parameter { name, value: edge.to_string(), cause });
    }
    let chunk = parameters.grid.chunk_edge_voxels;
    if !(1..=Grid::CHUNK_EDGE_VOXELS_MAX).contains(&chunk) {
        let (name, cause) = ("chunk edge", "must be 1 to 22 voxels");
        return Err(BakeError::Parameter { name, value: chunk.to_string(), cause });
    }
    let (points, samples) = (parameters.points_per_patch, parameters.samples_per_voxel_face);
    if points == 0 || samples == 0 {
        let (name, cause) = ("points per patch and samples per voxel face", "must be 1 or more");
        return Err(BakeError::Parameter { name, value: format!("{points} and {samples}"), cause });
    }
    let rays = parameters.rays_per_patch;
    if !(1..=1 << 20).contains(&rays) {
        let (name, cause) = ("rays per patch", "must be 1 to 1,048,576");
        return Err(BakeError::Parameter { name, value: rays.to_string(), cause });
    }
    if let Some((name, value, cause)) = parameters.method.fault() {
        return Err(BakeError::Parameter { name, value, cause });
    }
    check_receivers(parameters)
}

fn check_receivers(parameters: &BakeParameters) -> Result<(), BakeError> {
    if ![1, 2, 4, 8].contains(&parameters.detail) {
        let (name, cause) = ("detail voxels along a voxel's edge", "must be 1, 2, 4 or 8");
        return Err(BakeError::Parameter { name, value: parameters.detail.to_string(), cause });
    }
    let bounded = [
        ("receivers", parameters.receiver_reach_voxels, 0..=8, "must be 0 to 8 voxels"),
        ("rays of receivers", parameters.receiver_rays, 64..=1 << 16, "must be 64 to 65,536"),
        ("rays of detail", parameters.detail_rays, 16..=1 << 16, "must be 16 to 65,536"),
        ("columns of detail", parameters.detail_columns, 4..=1 << 12, "must be 4 to 4,096"),
        ("columns of receivers", parameters.receiver_columns, 4..=1 << 12, "must be 4 to 4,096"),
    ];
    match bounded.into_iter().find(|(_, value, range, _)| !range.contains(value)) {
        None => Ok(()),
        Some((name, value, _, cause)) => Err(BakeError::Parameter { name, value: value.to_string(), cause }),
    }
}
