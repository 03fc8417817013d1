//! Patches as fixed records, byte plane by byte plane.

use super::{Decoded, planes};
use bytemuck::{Pod, Zeroable};
use earthshine_world::{Direction, Patch, Vec3, VoxelCoord};

const _: () = assert!(size_of::<PatchRecord>() == 64, "a patch is 64 bytes before zstd");

/// A [`Patch`] on disk.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct PatchRecord {
    voxel: [i32; 3],
    direction: u32,
    area: f32,
    centroid: [f32; 3],
    reflectance: [f32; 3],
    emission: [f32; 3],
    point_first: u32,
    point_count: u32,
}

pub(crate) fn encode(patches: &[Patch]) -> Vec<u8> {
    let records: Vec<_> = patches
        .iter()
        .map(|patch| PatchRecord {
            voxel: patch.voxel.to_array(),
            direction: patch.direction as u32,
            area: patch.area,
            centroid: patch.centroid.to_array(),
            reflectance: patch.reflectance.to_array(),
            emission: patch.emission.to_array(),
            point_first: patch.point_first,
            point_count: patch.point_count,
        })
        .collect();
    planes::split(bytemuck::cast_slice(&records), size_of::<PatchRecord>())
}

pub(crate) fn decode(raw: &[u8]) -> Decoded<Vec<Patch>> {
    planes::join_as::<PatchRecord>(raw)
        .into_iter()
        .map(|record| {
            let direction = u8::try_from(record.direction)
                .ok()
                .and_then(Direction::from_index)
                .ok_or_else(|| format!("a patch faces direction {}", record.direction))?;
            Ok(Patch {
                voxel: VoxelCoord::from_array(record.voxel),
                direction,
                area: record.area,
                centroid: Vec3::from_array(record.centroid),
                reflectance: Vec3::from_array(record.reflectance),
                emission: Vec3::from_array(record.emission),
                point_first: record.point_first,
                point_count: record.point_count,
            })
        })
        .collect()
}
