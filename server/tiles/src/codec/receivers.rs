//! Places of receivers as fixed records, byte plane by byte plane.

use super::{Decoded, planes};
use bytemuck::{Pod, Zeroable};
use earthshine_world::{Barrier, DetailVoxel, Direction, ReceiverPlace, SurfacePlane, VoxelCoord};

/// Bytes of a place before zstd.
const RECORD_BYTES: usize = size_of::<ReceiverRecord>();
const _: () = assert!(RECORD_BYTES == 22, "a receiver's place is 22 bytes before zstd");

/// Bytes of a place before tiles had barriers.
const LAYERED_RECORD_BYTES: usize = size_of::<LayeredRecord>();
const _: () = assert!(LAYERED_RECORD_BYTES == 18, "a receiver's place was 18 bytes before zstd");

/// Bytes of a place before tiles had layers.
const UNLAYERED_RECORD_BYTES: usize = size_of::<UnlayeredRecord>();
const _: () = assert!(UNLAYERED_RECORD_BYTES == 16, "a receiver's place was 16 bytes before zstd");

/// The version of the format that brought layers.
const LAYERED_VERSION: u32 = 5;
/// The version that brought barriers.
const BARRIERS_VERSION: u32 = 6;

/// What a layer has of barriers.
type Barriers = [Option<Barrier>; Barrier::PER_LAYER_MAX];

/// A [`ReceiverPlace`] on disk.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
struct ReceiverRecord {
    place: LayeredRecord,
    /// See [`Barrier::code`]; zeros for none, and in the air.
    barriers: [[u8; 2]; Barrier::PER_LAYER_MAX],
}

/// The same of tiles without barriers.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
struct LayeredRecord {
    place: UnlayeredRecord,
    /// See [`SurfacePlane`]; zeros in the air.
    normal: [u8; 2],
}

/// The same of tiles without layers: planes are square to their direction.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
struct UnlayeredRecord {
    voxel: [i32; 3],
    direction: u8,
    /// Low byte of the part: 0 in the air, else one more than the index of its detail voxel in ten bits; above them its
    /// layer.
    part_low: u8,
    /// With layers [`SurfacePlane::distance`]; without, 254ths of the detail voxel's edge from its low side.
    plane: u8,
    part_high: u8,
}

/// Bits of a part that name its detail voxel.
const INDEX_BITS: u32 = 10;

pub(crate) fn encode(places: &[ReceiverPlace]) -> Vec<u8> {
    let record = |place: &ReceiverPlace| {
        let part = |detail: DetailVoxel| (detail.index + 1) | u16::from(detail.layer) << INDEX_BITS;
        let [part_low, part_high] = place.detail.map_or(0, part).to_le_bytes();
        let plane = place.detail.map(|detail| detail.plane);
        let (voxel, direction) = (place.voxel.to_array(), place.direction as u8);
        let distance = plane.map_or(0, |plane| plane.distance);
        let unlayered = UnlayeredRecord { voxel, direction, part_low, plane: distance, part_high };
        let normal = plane.map_or([0; 2], |plane| plane.normal);
        let barriers = place.detail.map_or([None; Barrier::PER_LAYER_MAX], |detail| detail.barriers);
        let barriers = barriers.map(|barrier| barrier.map_or([0; 2], Barrier::code));
        ReceiverRecord { place: LayeredRecord { place: unlayered, normal }, barriers }
    };
    let records: Vec<_> = places.iter().map(record).collect();
    planes::split(bytemuck::cast_slice(&records), RECORD_BYTES)
}

/// Bytes of a place in a tile of format `version`.
pub(crate) fn record_bytes(version: u32) -> u64 {
    let bytes = match version {
        BARRIERS_VERSION.. => RECORD_BYTES,
        LAYERED_VERSION.. => LAYERED_RECORD_BYTES,
        _ => UNLAYERED_RECORD_BYTES,
    };
    bytes as u64
}

/// The places in a tile of format `version`.
pub(crate) fn decode(raw: &[u8], version: u32) -> Decoded<Vec<ReceiverPlace>> {
    match version {
        BARRIERS_VERSION.. => checked(planes::join_as(raw).into_iter().map(ReceiverRecord::decode)),
        LAYERED_VERSION.. => {
            checked(planes::join_as(raw).into_iter().map(|record: LayeredRecord| record.decode(true)))
        }
        _ => decode_unlayered(raw),
    }
}

impl ReceiverRecord {
    fn decode(self) -> Decoded<ReceiverPlace> {
        let barriers = barriers_of(self.barriers)?;
        let place = self.place.decode(barriers[0].is_none())?;
        let with_barriers = |detail| DetailVoxel { barriers, ..detail };
        Ok(ReceiverPlace { detail: place.detail.map(with_barriers), ..place })
    }
}

/// What `codes` are of; what is one comes before what is none.
fn barriers_of(codes: [[u8; 2]; Barrier::PER_LAYER_MAX]) -> Decoded<Barriers> {
    let mut barriers = [None; Barrier::PER_LAYER_MAX];
    for (barrier, code) in barriers.iter_mut().zip(codes) {
        *barrier =
            Barrier::from_code(code).map_err(|code| format!("a receiver has a barrier of code {code:?}"))?;
    }
    if !barriers.is_sorted_by_key(Option::is_none) {
        return Err(format!("a receiver has barriers {codes:?}, the first of which is none"));
    }
    Ok(barriers)
}

impl LayeredRecord {
    /// The place; `is_plain`: whether nothing else speaks against it being in the air.
    fn decode(self, is_plain: bool) -> Decoded<ReceiverPlace> {
        let (distance, normal) = (self.place.plane, self.normal);
        let is_plane = distance <= SurfacePlane::STEPS && normal.iter().all(|&code| code > 0);
        let plane = is_plane.then_some(SurfacePlane { normal, distance });
        self.place.decode(|_, _| plane, is_plain && normal == [0; 2])
    }
}

fn decode_unlayered(raw: &[u8]) -> Decoded<Vec<ReceiverPlace>> {
    let plane = |direction: Direction, plane: u8| {
        let offset = f32::from(plane) / f32::from(SurfacePlane::STEPS) - 0.5;
        let normal = direction.vector();
        (plane <= SurfacePlane::STEPS).then(|| SurfacePlane::new(normal, offset * normal.element_sum()))
    };
    let is_unlayered = |record: &UnlayeredRecord| u16::from(record.part_high) >> (INDEX_BITS - 8) == 0;
    checked(planes::join_as::<UnlayeredRecord>(raw).into_iter().map(|record| {
        if is_unlayered(&record) {
            record.decode(plane, true)
        } else {
            Err("a receiver of a tile without layers is in a layer".to_owned())
        }
    }))
}

impl UnlayeredRecord {
    /// The place, its plane as `plane` says if there is one; `is_plain`: whether nothing else speaks against it being
    /// in the air.
    fn decode(
        self,
        plane: impl Fn(Direction, u8) -> Option<SurfacePlane>,
        is_plain: bool,
    ) -> Decoded<ReceiverPlace> {
        let direction = Direction::from_index(self.direction)
            .ok_or_else(|| format!("a receiver faces direction {}", self.direction))?;
        let part = u16::from_le_bytes([self.part_low, self.part_high]);
        let (number, layer) = (part & ((1 << INDEX_BITS) - 1), (part >> INDEX_BITS) as u8);
        let detail = match number.checked_sub(1) {
            None if part == 0 && self.plane == 0 && is_plain => None,
            Some(index)
                if u32::from(index) < DetailVoxel::PER_EDGE_MAX.pow(3) && layer < DetailVoxel::LAYERS_MAX =>
            {
                let plane = plane(direction, self.plane)
                    .ok_or_else(|| format!("a receiver's plane lies at {}", self.plane))?;
                Some(DetailVoxel { index, layer, plane, barriers: [None; Barrier::PER_LAYER_MAX] })
            }
            _ => return Err(format!("a receiver is in part {part:#06x} at {}", self.plane)),
        };
        Ok(ReceiverPlace { voxel: VoxelCoord::from_array(self.voxel), direction, detail })
    }
}

fn checked(places: impl Iterator<Item = Decoded<ReceiverPlace>>) -> Decoded<Vec<ReceiverPlace>> {
    let places = places.collect::<Decoded<Vec<_>>>()?;
    crate::structure::check_places(&places)?;
    Ok(places)
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::Vec3;

    fn places() -> Vec<ReceiverPlace> {
        let voxel = VoxelCoord::new(-3, 0, 70_000);
        let part = |x: i32, layer: u8, normal: Vec3, distance: f32| {
            DetailVoxel::new(VoxelCoord::new(x, 7, 5), layer, SurfacePlane::new(normal, distance))
        };
        let place = |detail| ReceiverPlace { voxel, direction: Direction::PosX, detail: Some(detail) };
        let slanted = Vec3::new(0.6, -0.8, 0.0);
        let barrier = |towards, distance| Barrier::new(Direction::PosX, towards, distance);
        let corner = [barrier(Vec3::Y, 0.5), barrier(Vec3::NEG_Z, -1.5)];
        vec![
            place(part(2, 0, Vec3::X, 0.25)),
            place(DetailVoxel { barriers: corner, ..part(2, 1, slanted, -0.4) }),
            place(DetailVoxel { barriers: [corner[0], None], ..part(7, 0, Vec3::X, -0.5) }),
            ReceiverPlace::in_air(voxel, Direction::NegZ),
        ]
    }

    #[test]
    fn places_come_back_with_their_layers_and_barriers() {
        let places = places();
        assert!(places[1].detail.unwrap().barriers.iter().all(Option::is_some));
        assert_eq!(decode(&encode(&places), BARRIERS_VERSION).unwrap(), places);
    }

    /// Goal: tiles of the version before are read. Method: what they hold of a place are the first bytes of what is written now.
    #[test]
    fn places_of_tiles_without_barriers_have_none() {
        let places = places();
        let old = &encode(&places)[..places.len() * LAYERED_RECORD_BYTES];
        let read = decode(old, BARRIERS_VERSION - 1).unwrap();
        let bare = |detail| DetailVoxel { barriers: [None; Barrier::PER_LAYER_MAX], ..detail };
        let expected: Vec<ReceiverPlace> =
            places.iter().map(|place| ReceiverPlace { detail: place.detail.map(bare), ..*place }).collect();
        assert_eq!(read, expected);
        assert_eq!(record_bytes(BARRIERS_VERSION - 1) as usize, LAYERED_RECORD_BYTES);
    }

    /// Goal: old tiles are read. Method: what they hold of a place are the first bytes of what is written now, with the plane's
    /// place along the axis for its distance.
    #[test]
    fn places_of_tiles_without_layers_are_square_to_their_direction() {
        let places = [places()[0], places()[3]];
        let mut old = encode(&places)[..2 * UNLAYERED_RECORD_BYTES].to_vec();
        let plane = 2 * std::mem::offset_of!(UnlayeredRecord, plane);
        old[plane] = 190;
        let read = decode(&old, LAYERED_VERSION - 1).unwrap();
        let detail = read[0].detail.unwrap();
        assert_eq!((detail.index, detail.layer), (places[0].detail.unwrap().index, 0));
        assert!((detail.plane.unit_normal() - Vec3::X).length() < 1e-6);
        assert!((detail.plane.offset_along(0) - 190.0 / 254.0).abs() < 0.01);
        assert_eq!(read[1], places[1]);
        old[plane] = 255;
        assert!(decode(&old, LAYERED_VERSION - 1).unwrap_err().contains("plane"));
        old[plane] = 190;
        // The high byte of a part: a layer.
        old[2 * std::mem::offset_of!(UnlayeredRecord, part_high)] |= 1 << 2;
        assert!(decode(&old, LAYERED_VERSION - 1).unwrap_err().contains("without layers"));
    }

    #[test]
    fn parts_and_planes_that_cannot_be_are_refused() {
        let (upper_layer, air) = (1, 3);
        let refused = |place: usize, byte: usize, value: u8| {
            let mut raw = encode(&places());
            raw[4 * byte + place] = value;
            decode(&raw, BARRIERS_VERSION).unwrap_err()
        };
        let plane = std::mem::offset_of!(UnlayeredRecord, plane);
        let part_high = std::mem::offset_of!(UnlayeredRecord, part_high);
        let normal = std::mem::offset_of!(LayeredRecord, normal);
        let barriers = std::mem::offset_of!(ReceiverRecord, barriers);
        assert!(refused(upper_layer, plane, 255).contains("plane"));
        assert!(refused(upper_layer, normal, 0).contains("plane"));
        assert!(refused(upper_layer, part_high, 0x3F).contains("part"), "a fifteenth layer");
        assert!(refused(air, normal, 5).contains("part"), "a normal in the air");
        assert!(refused(air, plane, 5).contains("part"), "a plane in the air");
        assert!(refused(air, part_high, 1 << 2).contains("part"), "a layer in the air");
        assert!(refused(upper_layer, barriers, 253).contains("barrier"), "an angle beyond the last");
        assert!(refused(upper_layer, barriers + 3, 251).contains("barrier"), "a distance beyond the last");
        assert!(refused(0, barriers + 1, 7).contains("barrier"), "a distance of nothing");
        assert!(refused(0, barriers + 2, 7).contains("the first of which is none"));
        assert!(refused(air, barriers, 7).contains("part"), "a barrier in the air");
    }
}
