//! From wire numbers to voxels: every length, index and mask is checked before anything is changed.

use crate::ClientError;
use earthshine_protocol::{VOLUME_DIM_MAX, VOLUME_VOXELS_MAX, v1};
use earthshine_volume::barrier::{self, Barriers};
use earthshine_volume::tilt::{self, Tilt};
use earthshine_volume::{Layout, Volume, VoxelLight, plane, rgb9e5};
use glam::{IVec3, UVec3};

/// Largest unit of light: with it the largest code is still far from infinity.
const LIGHT_UNIT_MAX_LX: f32 = 1e9;

/// Bytes of a plane with its normal.
const TILT_BYTES: usize = size_of::<Tilt>();

/// Bytes of the barriers of a patch that has some.
const BARRIER_BYTES: usize = size_of::<Barriers>();

/// Where a volume is said to be.
///
/// # Errors
/// If that is nowhere, or larger than the wire allows.
pub(crate) fn layout(volume: &v1::Volume) -> Result<Layout, ClientError> {
    let fault = |cause: &str| ClientError::protocol(format!("volume {}: {cause}", volume.volume));
    let origin = volume.origin.unwrap_or_default();
    let dims = volume.dims.unwrap_or_default();
    let layout = Layout {
        level: u8::try_from(volume.level)
            .map_err(|error| fault(&format!("level {}: {error}", volume.level)))?,
        origin: IVec3::new(origin.x, origin.y, origin.z),
        dims: UVec3::new(dims.x, dims.y, dims.z),
        voxel_edge_m: volume.voxel_edge_m,
    };
    layout.validate().map_err(|error| fault(&error.to_string()))?;
    if layout.dims.max_element() > VOLUME_DIM_MAX || layout.voxel_count() > VOLUME_VOXELS_MAX {
        return Err(fault(&format!("{} voxels are more than the wire allows", layout.dims)));
    }
    Ok(layout)
}

/// Checks a delta for a volume of `voxel_count` voxels, so that [`apply_delta`] cannot fail.
///
/// # Errors
/// The first thing that does not fit.
pub(crate) fn check_delta(delta: &v1::Delta, voxel_count: u32) -> Result<(), ClientError> {
    let fault = |cause: String| {
        Err(ClientError::protocol(format!(
            "delta of volume {} to {}: {cause}",
            delta.volume, delta.to_generation
        )))
    };
    if !(delta.light_unit_lx >= 0.0 && delta.light_unit_lx <= LIGHT_UNIT_MAX_LX) {
        return fault(format!("a unit of light of {} lx", delta.light_unit_lx));
    }
    if delta.present.len() != delta.voxels.len() {
        return fault(format!("{} masks for {} voxels", delta.present.len(), delta.voxels.len()));
    }
    if let Some(mask) = delta.present.iter().find(|&&mask| mask > VoxelLight::ALL_PRESENT) {
        return fault(format!("mask {mask:#010b} has more than six directions"));
    }
    if !(delta.air.is_empty() || delta.air.len() == delta.present.len()) {
        return fault(format!("{} air masks for {} voxels", delta.air.len(), delta.voxels.len()));
    }
    let is_dark = |(air, present): &(&u8, &u8)| **air & !**present != 0;
    if let Some((air, present)) = delta.air.iter().zip(&delta.present).find(is_dark) {
        return fault(format!("air mask {air:#010b} has more directions than {present:#010b}"));
    }
    let patches = delta.present.iter().map(|mask| mask.count_ones() as usize).sum::<usize>();
    if delta.irradiance.len() != patches || delta.quality.len() != patches {
        let (light, quality) = (delta.irradiance.len(), delta.quality.len());
        return fault(format!("{light} irradiances and {quality} qualities for {patches} patches"));
    }
    if !(delta.sky_irradiance.is_empty() || delta.sky_irradiance.len() == patches) {
        return fault(format!("{} sky irradiances for {patches} patches", delta.sky_irradiance.len()));
    }
    for (codes, what) in
        [(&delta.plane, "planes"), (&delta.far, "far shares"), (&delta.staleness, "ages of direct light")]
    {
        if !(codes.is_empty() || codes.len() == patches) {
            return fault(format!("{} {what} for {patches} patches", codes.len()));
        }
    }
    if !(delta.tilt.is_empty() || delta.tilt.len() == TILT_BYTES * patches) {
        return fault(format!("{} bytes of tilted planes for {patches} patches", delta.tilt.len()));
    }
    if let Some(cause) = fault_of_barriers(delta) {
        return fault(cause);
    }
    if delta.voxels.iter().skip(1).any(|&step| step == 0) {
        return fault("voxels do not ascend".to_owned());
    }
    // Differences add up to the last and largest index: in `u64`, because they are anything.
    let last = delta.voxels.iter().map(|&step| u64::from(step)).sum::<u64>();
    if !delta.voxels.is_empty() && last >= u64::from(voxel_count) {
        return fault(format!("voxel {last} of {voxel_count}"));
    }
    Ok(())
}

/// What is wrong with the barriers of a delta whose other masks are good.
fn fault_of_barriers(delta: &v1::Delta) -> Option<String> {
    if !(delta.barred.is_empty() || delta.barred.len() == delta.present.len()) {
        return Some(format!("{} masks of barriers for {} voxels", delta.barred.len(), delta.voxels.len()));
    }
    let airs = delta.air.iter().chain(std::iter::repeat(&0));
    for ((barred, present), air) in delta.barred.iter().zip(&delta.present).zip(airs) {
        let surfaces = present & !air;
        if barred & !surfaces != 0 {
            return Some(format!(
                "mask of barriers {barred:#010b} has more directions than {surfaces:#010b}"
            ));
        }
    }
    let barred = delta.barred.iter().map(|mask| mask.count_ones() as usize).sum::<usize>();
    if delta.barriers.len() != BARRIER_BYTES * barred {
        return Some(format!("{} bytes of barriers for {barred} patches", delta.barriers.len()));
    }
    let (codes, _) = delta.barriers.as_chunks();
    let bad = codes.iter().find(|&&code| !barrier::is_code(code));
    bad.map(|[angle, distance]| format!("a barrier at angle {angle}, distance {distance}"))
}

/// Writes a checked delta into `volume`.
pub(crate) fn apply_delta(delta: &v1::Delta, volume: &mut Volume) {
    let unit = if delta.light_unit_lx == 0.0 { 1.0 } else { delta.light_unit_lx };
    let decode = |code| rgb9e5::decode(code) * unit;
    let mut index = 0;
    let mut patch = 0;
    let (mut barriers, _) = delta.barriers.as_chunks::<2>();
    for (voxel, (&step, &present)) in delta.voxels.iter().zip(&delta.present).enumerate() {
        index += step;
        let air = delta.air.get(voxel).copied().unwrap_or(0);
        let barred = delta.barred.get(voxel).copied().unwrap_or(0);
        let mut light = VoxelLight::EMPTY;
        for direction in (0..6).filter(|direction| present >> direction & 1 == 1) {
            let sky = delta.sky_irradiance.get(patch).copied().unwrap_or(0);
            let irradiance = decode(delta.irradiance[patch]);
            let (sky, quality) = (decode(sky), delta.quality[patch]);
            if air >> direction & 1 == 1 {
                light.set_air(direction, irradiance, sky, quality);
            } else {
                light.set(direction, irradiance, sky, quality);
            }
            light.plane[direction] = delta.plane.get(patch).copied().unwrap_or(plane::UNKNOWN);
            let tilt = delta.tilt.get(TILT_BYTES * patch..).and_then(<[u8]>::first_chunk);
            light.tilt[direction] = tilt.copied().unwrap_or(tilt::UNKNOWN);
            if let Some((&own, rest)) = barriers.split_first_chunk().filter(|_| barred >> direction & 1 == 1)
            {
                (light.barriers[direction], barriers) = (own, rest);
            }
            light.far[direction] = delta.far.get(patch).copied().unwrap_or(0);
            light.staleness[direction] = delta.staleness.get(patch).copied().unwrap_or(0);
            patch += 1;
        }
        volume.set(index, &light);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn wire_volume() -> v1::Volume {
        v1::Volume {
            volume: 3,
            level: 0,
            origin: Some(v1::VoxelCoord { x: -2, y: 0, z: 5 }),
            dims: Some(v1::Dims { x: 4, y: 3, z: 2 }),
            voxel_edge_m: 0.5,
            generation: 1,
        }
    }

    /// Voxels 1 (directions 0 and 2) and 23 (direction 5), and voxel 7 emptied.
    fn wire_delta() -> v1::Delta {
        v1::Delta {
            volume: 3,
            to_generation: 1,
            voxels: vec![1, 6, 16],
            present: vec![0b101, 0, 0b10_0000],
            irradiance: [1.0, 2.0, 3.0].map(|v| rgb9e5::encode(Vec3::splat(v))).to_vec(),
            sky_irradiance: [0.5, 0.0, 0.25].map(|v| rgb9e5::encode(Vec3::splat(v))).to_vec(),
            quality: vec![10, 20, 30],
            complete: true,
            air: vec![0b100, 0, 0],
            tilt: (1..=9).collect(),
            barred: vec![0b001, 0, 0b10_0000],
            barriers: vec![1, 2, 0, 0, 252, 250, 3, 4],
            ..v1::Delta::default()
        }
    }

    #[test]
    fn a_hand_built_delta_lands_where_it_should() {
        let layout = layout(&wire_volume()).unwrap();
        let mut volume = Volume::new(layout).unwrap();
        volume.set_patch(layout.voxel_of(7), 4, Vec3::ONE, Vec3::ZERO, 1);
        let delta = wire_delta();
        check_delta(&delta, layout.voxel_count()).unwrap();
        apply_delta(&delta, &mut volume);
        let first = volume.at(IVec3::new(-1, 0, 5)).unwrap();
        assert_eq!((first.present, first.irradiance[2], first.quality[2]), (0b101, Vec3::splat(2.0), 20));
        assert_eq!((first.sky_irradiance[0], first.air), (Vec3::splat(0.5), 0b100));
        assert_eq!([first.tilt[0], first.tilt[2], first.tilt[1]], [[1, 2, 3], [4, 5, 6], tilt::UNKNOWN]);
        assert_eq!((first.barriers[0], first.barriers[2]), ([[1, 2], [0, 0]], barrier::NONE));
        let last = volume.at(IVec3::new(1, 2, 6)).unwrap();
        assert_eq!(last.barriers[5], [[252, 250], [3, 4]]);
        assert_eq!((last.present, last.air, last.irradiance[5]), (0b10_0000, 0, Vec3::splat(3.0)));
        assert_eq!(volume.lit_voxels(), 2, "voxel 7 was emptied");
    }

    #[test]
    fn a_black_sky_no_air_and_no_barriers_may_be_left_out() {
        let (sky_irradiance, air, barred, barriers) = Default::default();
        let delta = v1::Delta { sky_irradiance, air, barred, barriers, ..wire_delta() };
        check_delta(&delta, 24).unwrap();
    }

    #[test]
    fn light_comes_in_the_unit_that_the_server_names() {
        let layout = layout(&wire_volume()).unwrap();
        let mut volume = Volume::new(layout).unwrap();
        apply_delta(&v1::Delta { light_unit_lx: 16.0, ..wire_delta() }, &mut volume);
        let voxel = volume.at(IVec3::new(-1, 0, 5)).unwrap();
        assert_eq!((voxel.irradiance[2], voxel.sky_irradiance[0]), (Vec3::splat(32.0), Vec3::splat(8.0)));
    }

    #[test]
    fn deltas_that_do_not_fit_are_named() {
        let fault = |change: fn(&mut v1::Delta)| {
            let mut delta = wire_delta();
            change(&mut delta);
            check_delta(&delta, 24).unwrap_err().to_string()
        };
        assert!(fault(|d| d.voxels.push(1)).contains("3 masks for 4 voxels"));
        assert!(fault(|d| d.light_unit_lx = f32::NAN).contains("unit"));
        assert!(fault(|d| d.light_unit_lx = f32::INFINITY).contains("unit"));
        assert!(fault(|d| d.light_unit_lx = -1.0).contains("unit"));
        assert!(fault(|d| d.present[0] = 0b100_0001).contains("more than six"));
        assert!(fault(|d| d.irradiance.truncate(1)).contains("1 irradiances"));
        assert!(fault(|d| d.quality.push(1)).contains("4 qualities"));
        assert!(fault(|d| d.far.push(1)).contains("1 far shares"));
        assert!(fault(|d| d.tilt.truncate(8)).contains("8 bytes of tilted planes"));
        assert!(fault(|d| d.barred.truncate(1)).contains("1 masks of barriers for 3 voxels"));
        assert!(fault(|d| d.barred[1] = 1).contains("more directions"));
        assert!(fault(|d| d.barred[0] = 0b100).contains("more directions"));
        assert!(fault(|d| d.barred.clear()).contains("8 bytes of barriers for 0 patches"));
        assert!(fault(|d| d.barriers.truncate(7)).contains("7 bytes of barriers for 2 patches"));
        assert!(fault(|d| d.barriers[0] = 253).contains("angle 253"));
        assert!(fault(|d| d.barriers[3] = 1).contains("angle 0, distance 1"));
        assert!(fault(|d| d.staleness.push(1)).contains("1 ages of direct light"));
        assert!(fault(|d| d.sky_irradiance.truncate(2)).contains("2 sky"));
        assert!(fault(|d| d.air.truncate(1)).contains("1 air masks"));
        assert!(fault(|d| d.air[1] = 1).contains("more directions"));
        assert!(fault(|d| d.voxels[1] = 0).contains("ascend"));
        assert!(fault(|d| d.voxels[2] = 17).contains("voxel 24 of 24"));
        assert!(fault(|d| d.voxels = vec![u32::MAX; 3]).contains("of 24"));
    }

    #[test]
    fn volumes_that_cannot_be_are_named() {
        let fault = |change: fn(&mut v1::Volume)| {
            let mut volume = wire_volume();
            change(&mut volume);
            layout(&volume).unwrap_err().to_string()
        };
        assert!(fault(|v| v.dims = None).contains("voxels"));
        assert!(fault(|v| v.dims = Some(v1::Dims { x: 256, y: 256, z: 256 })).contains("wire allows"));
        assert!(fault(|v| v.level = 256).contains("level"));
        assert!(fault(|v| v.voxel_edge_m = 0.0).contains("edge"));
        assert!(fault(|v| v.origin = Some(v1::VoxelCoord { x: i32::MAX, y: 0, z: 0 })).contains("origin"));
    }
}
