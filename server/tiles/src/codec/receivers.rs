//! Places of receivers as fixed records, byte plane by byte plane.

use super::{Decoded, planes};
use bytemuck::{Pod, Zeroable};
use earthshine_world::{DetailVoxel, Direction, ReceiverPlace, VoxelCoord};

/// Bytes of a place before zstd.
pub(crate) const RECORD_BYTES: usize = size_of::<ReceiverRecord>();
const _: () = assert!(RECORD_BYTES == 16, "a receiver's place is 16 bytes before zstd");

/// A [`ReceiverPlace`] on disk.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ReceiverRecord {
    voxel: [i32; 3],
    direction: u8,
    /// 0 in the air, else one more than the index of its detail voxel; here its low byte.
    detail: u8,
    plane: u8,
    detail_high: u8,
}

pub(crate) fn encode(places: &[ReceiverPlace]) -> Vec<u8> {
    let records: Vec<_> = places
        .iter()
        .map(|place| {
            let [detail, detail_high] = place.detail.map_or(0, |detail| detail.index + 1).to_le_bytes();
            let plane = place.detail.map_or(0, |detail| detail.plane);
            let (voxel, direction) = (place.voxel.to_array(), place.direction as u8);
            ReceiverRecord { voxel, direction, detail, plane, detail_high }
        })
        .collect();
    planes::split(bytemuck::cast_slice(&records), RECORD_BYTES)
}

pub(crate) fn decode(raw: &[u8]) -> Decoded<Vec<ReceiverPlace>> {
    let places = planes::join_as::<ReceiverRecord>(raw)
        .into_iter()
        .map(|record| {
            let ReceiverRecord { voxel, direction, detail, plane, detail_high } = record;
            let direction = Direction::from_index(direction)
                .ok_or_else(|| format!("a receiver faces direction {direction}"))?;
            let detail = u16::from_le_bytes([detail, detail_high]);
            let detail = match detail.checked_sub(1) {
                None if plane == 0 => None,
                Some(index) if u32::from(index) < DetailVoxel::PER_EDGE_MAX.pow(3) && plane < u8::MAX => {
                    Some(DetailVoxel { index, plane })
                }
                _ => return Err(format!("a receiver is in detail voxel {detail} at {plane}")),
            };
            Ok(ReceiverPlace { voxel: VoxelCoord::from_array(voxel), direction, detail })
        })
        .collect::<Decoded<Vec<_>>>()?;
    crate::structure::check_places(&places)?;
    Ok(places)
}
