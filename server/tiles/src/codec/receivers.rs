//! Places of receivers as fixed records, byte plane by byte plane.

use super::{Decoded, planes};
use bytemuck::{Pod, Zeroable};
use earthshine_world::{Direction, ReceiverPlace, VoxelCoord};

/// Bytes of a place before zstd.
pub(crate) const RECORD_BYTES: usize = size_of::<ReceiverRecord>();
const _: () = assert!(RECORD_BYTES == 16, "a receiver's place is 16 bytes before zstd");

/// A [`ReceiverPlace`] on disk.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ReceiverRecord {
    voxel: [i32; 3],
    direction: u32,
}

pub(crate) fn encode(places: &[ReceiverPlace]) -> Vec<u8> {
    let records: Vec<_> = places
        .iter()
        .map(|place| ReceiverRecord { voxel: place.voxel.to_array(), direction: place.direction as u32 })
        .collect();
    planes::split(bytemuck::cast_slice(&records), RECORD_BYTES)
}

pub(crate) fn decode(raw: &[u8]) -> Decoded<Vec<ReceiverPlace>> {
    let places = planes::join_as::<ReceiverRecord>(raw)
        .into_iter()
        .map(|record| {
            let direction = u8::try_from(record.direction)
                .ok()
                .and_then(Direction::from_index)
                .ok_or_else(|| format!("a receiver faces direction {}", record.direction))?;
            Ok(ReceiverPlace { voxel: VoxelCoord::from_array(record.voxel), direction })
        })
        .collect::<Decoded<Vec<_>>>()?;
    crate::structure::check_places(&places)?;
    Ok(places)
}
