//! Where rays end, in a device's own words: triangles and voxels of a bake as those of a kernel's buffers.

use earthshine_bake::ends::{Buried, EndTriangle, EndVoxel};
use earthshine_gpu::ends::{
    BURIED_IN_PLACES, BURIED_OPEN, EndSide, MapVoxel, SIDE_BACK_BURIED, SIDE_FOR_HOST, SIDE_FRONT_BURIED,
    SIDE_LEFT_OUT, SIDE_TWO_SIDED,
};

/// A voxel with what ends there.
pub(crate) fn voxel(of: &EndVoxel) -> MapVoxel {
    let EndVoxel { voxel, patches, has_left_out, buried } = *of;
    let buried = u32::from(buried.buried) | u32::from(buried.open) << BURIED_OPEN;
    MapVoxel { voxel: voxel.to_array(), patches, has_left_out, buried }
}

/// Both sides of a triangle.
pub(crate) fn side(triangle: &EndTriangle) -> EndSide {
    let EndTriangle { normal, parts, is_for_host, has_left_out, is_two_sided, buried } = *triangle;
    let flags = [(is_for_host, SIDE_FOR_HOST), (has_left_out, SIDE_LEFT_OUT), (is_two_sided, SIDE_TWO_SIDED)];
    let flags: u32 = flags.into_iter().filter(|(is_set, _)| *is_set).map(|(_, flag)| flag).sum();
    let of_side = |(flag, buried): (u32, Buried)| match buried {
        Buried::Nowhere => 0,
        Buried::InPlaces => flag << BURIED_IN_PLACES,
        Buried::Everywhere => flag,
    };
    let buried: u32 = [SIDE_FRONT_BURIED, SIDE_BACK_BURIED].into_iter().zip(buried).map(of_side).sum();
    EndSide { normal: normal.to_array(), flags: flags | buried, parts, spare: 0 }
}
