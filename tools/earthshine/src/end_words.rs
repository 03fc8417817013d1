//! Where rays end, in a device's own words: triangles and voxels of a bake as those of a kernel's buffers.

use earthshine_bake::ends::{Buried, EndTriangle, EndVoxel};
use earthshine_gpu::ends::{
    BURIED_IN_PLACES, BURIED_OPEN, EndSide, MapVoxel, SIDE_BACK_BURIED, SIDE_FOR_HOST,
    SIDE_FOR_HOST_IN_PLACES, SIDE_FRONT_BURIED, SIDE_TWO_SIDED,
};

/// A voxel with what ends there.
pub(crate) fn voxel(of: &EndVoxel) -> MapVoxel {
    let EndVoxel { voxel, patches, asks_host, buried } = *of;
    let buried = u32::from(buried.buried) | u32::from(buried.open) << BURIED_OPEN;
    MapVoxel { voxel: voxel.to_array(), patches, asks_host, buried }
}

/// Both sides of a triangle.
pub(crate) fn side(triangle: &EndTriangle) -> EndSide {
    let EndTriangle { normal, parts, is_for_host, is_for_host_in_places, is_two_sided, buried } = *triangle;
    let flags = [
        (is_for_host, SIDE_FOR_HOST),
        (is_for_host_in_places, SIDE_FOR_HOST_IN_PLACES),
        (is_two_sided, SIDE_TWO_SIDED),
    ];
    let flags: u32 = flags.into_iter().filter(|(is_set, _)| *is_set).map(|(_, flag)| flag).sum();
    let of_side = |(flag, buried): (u32, Buried)| match buried {
        Buried::Nowhere => 0,
        Buried::InPlaces => flag << BURIED_IN_PLACES,
        Buried::Everywhere => flag,
    };
    let buried: u32 = [SIDE_FRONT_BURIED, SIDE_BACK_BURIED].into_iter().zip(buried).map(of_side).sum();
    EndSide { normal: normal.to_array(), flags: flags | buried, parts, spare: 0 }
}
