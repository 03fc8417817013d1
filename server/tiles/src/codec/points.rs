//! Sample points: 10 bytes each instead of 24.
//!
//! Positions are whole multiples of a step, which is a power of two metres chosen so that the tile's
//! points span less than 2^16 steps: half a millimetre at most for chunks of 16 m. The step and the
//! origin come from the points, not from the chunk's cube, so a point may lie outside; and since
//! multiples of the step are exact in `f32`, decoding and encoding again changes nothing.
//! Normals are octahedral, 2 x 16 bits: better than 1e-4 rad.

use super::{Decoded, planes, take};
use crate::limits;
use bytemuck::{Pod, Zeroable};
use earthshine_world::{SamplePoint, Vec3};

const _: () = assert!(size_of::<PointRecord>() == 10, "a point is 10 bytes before zstd");

/// Exponents of the step: 60 nm to 16,000 km.
const STEP_EXPONENTS: std::ops::RangeInclusive<i32> = -24..=24;
/// Bytes before the points: step exponent and origin.
pub(crate) const HEAD_BYTES: usize = 4 + 3 * 8;
/// Half of the largest octahedral coordinate. Whole, so that zero is exact and axes stay axes.
const OCTAHEDRAL_MIDDLE: f32 = 32767.0;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct PointRecord {
    steps: [u16; 3],
    octahedral: [u16; 2],
}

pub(crate) fn encode(points: &[SamplePoint]) -> Decoded<Vec<u8>> {
    let usable = |v: Vec3| v.is_finite() && v.abs().max_element() <= limits::POSITION_MAX_M;
    if let Some(index) = points.iter().position(|p| !usable(p.position) || p.normal.try_normalize().is_none())
    {
        return Err(format!("sample point {index} has no usable position or normal"));
    }
    let min = points.iter().fold(Vec3::INFINITY, |min, point| min.min(point.position));
    let max = points.iter().fold(Vec3::NEG_INFINITY, |max, point| max.max(point.position));
    let (exponent, origin) = if points.is_empty() { (0, [0; 3]) } else { step_and_origin(min, max)? };
    let mut raw = Vec::with_capacity(HEAD_BYTES + points.len() * size_of::<PointRecord>());
    raw.extend_from_slice(&exponent.to_le_bytes());
    raw.extend_from_slice(bytemuck::cast_slice(&origin));
    let records: Vec<_> = points
        .iter()
        .map(|point| PointRecord {
            steps: [0, 1, 2].map(|axis| (steps(point.position[axis], exponent) - origin[axis]) as u16),
            octahedral: octahedral_from_normal(point.normal),
        })
        .collect();
    raw.extend(planes::split(bytemuck::cast_slice(&records), size_of::<PointRecord>()));
    Ok(raw)
}

pub(crate) fn decode(mut raw: &[u8]) -> Decoded<Vec<SamplePoint>> {
    let exponent: i32 = bytemuck::pod_read_unaligned(take(&mut raw, 4, "step")?);
    let origin: [i64; 3] = bytemuck::pod_read_unaligned(take(&mut raw, 24, "origin")?);
    if !STEP_EXPONENTS.contains(&exponent) {
        return Err(format!("a step of 2^{exponent} m"));
    }
    let step = f64::from(exponent).exp2();
    let origin = origin.map(|steps| steps as f64 * step);
    if origin.iter().any(|metres| metres.abs() > 2.0 * f64::from(limits::POSITION_MAX_M)) {
        return Err("the origin is out of this world".to_owned());
    }
    let count = raw.len() / size_of::<PointRecord>();
    let mut points = vec![SamplePoint { position: Vec3::ZERO, normal: Vec3::ZERO }; count];
    // Column by column straight from the planes: joining records first takes longer than all the rest.
    for (axis, origin) in origin.into_iter().enumerate() {
        for (point, steps) in points.iter_mut().zip(column(raw, count, axis)) {
            point.position[axis] = (origin + f64::from(steps) * step) as f32;
        }
    }
    let octahedral = column(raw, count, 3).zip(column(raw, count, 4));
    for (point, (x, y)) in points.iter_mut().zip(octahedral) {
        point.normal = normal_from_octahedral([x, y]);
    }
    Ok(points)
}

/// The numbers of the `column`-th `u16` of each record.
fn column(planes: &[u8], count: usize, column: usize) -> impl Iterator<Item = u16> + '_ {
    let (low, high) = planes[2 * column * count..][..2 * count].split_at(count);
    low.iter().zip(high).map(|(&low, &high)| u16::from_le_bytes([low, high]))
}

fn steps(metres: f32, exponent: i32) -> i64 {
    (f64::from(metres) * f64::from(-exponent).exp2()).round() as i64
}

/// The finest step with which the box spans at most 2^16 - 1 steps, and the box's corner in steps.
fn step_and_origin(min: Vec3, max: Vec3) -> Decoded<(i32, [i64; 3])> {
    STEP_EXPONENTS
        .map(|exponent| (exponent, min.to_array().map(|m| steps(m, exponent))))
        .find(|(exponent, origin)| {
            (0..3).all(|axis| steps(max[axis], *exponent) - origin[axis] <= i64::from(u16::MAX))
        })
        .ok_or_else(|| "the sample points are too far apart".to_owned())
}

fn octahedral_from_normal(normal: Vec3) -> [u16; 2] {
    let scale = 1.0 / (normal.x.abs() + normal.y.abs() + normal.z.abs());
    let (x, y) = (normal.x * scale, normal.y * scale);
    let (x, y) = if normal.z < 0.0 { fold(x, y, 1.0) } else { (x, y) };
    [x, y].map(|e| (e * OCTAHEDRAL_MIDDLE + OCTAHEDRAL_MIDDLE).round() as u16)
}

fn normal_from_octahedral(octahedral: [u16; 2]) -> Vec3 {
    let [x, y] = octahedral.map(|q| (f32::from(q) - OCTAHEDRAL_MIDDLE).min(OCTAHEDRAL_MIDDLE));
    let z = OCTAHEDRAL_MIDDLE - x.abs() - y.abs();
    let (x, y) = if z < 0.0 { fold(x, y, OCTAHEDRAL_MIDDLE) } else { (x, y) };
    // Never zero: |x| + |y| + |z| is the middle.
    let normal = Vec3::new(x, y, z);
    normal / normal.length()
}

/// Mirrors the lower half of the octahedron out of, or back into, the corners of the square.
fn fold(x: f32, y: f32, edge: f32) -> (f32, f32) {
    ((edge - y.abs()).copysign(x), (edge - x.abs()).copysign(y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::random::{Purpose, hash, unit_pair};

    fn random_point(i: u64, corner: Vec3, edge: f32) -> SamplePoint {
        let pair = |b| unit_pair(hash(5, Purpose::SamplePoint, i, b));
        let ((a, b), (c, d), (e, f)) = (pair(0), pair(1), pair(2));
        let normal = Vec3::new(d - 0.5, e - 0.5, f - 0.5).normalize_or(Vec3::Y);
        SamplePoint { position: corner + Vec3::new(a, b, c) * edge, normal }
    }

    #[test]
    fn points_are_close_and_encoding_again_changes_nothing() {
        let places = [(Vec3::ZERO, 16.5), (Vec3::new(-4321.0, 77.0, 9e5), 17.0), (Vec3::splat(-8.0), 16.0)];
        for (corner, edge) in places {
            let points: Vec<_> = (0..2000).map(|i| random_point(i, corner, edge)).collect();
            let decoded = decode(&encode(&points).unwrap()).unwrap();
            for (point, back) in points.iter().zip(&decoded) {
                assert!((point.position - back.position).abs().max_element() <= 0.5 / 2048.0);
                assert!((point.normal - back.normal).length() < 1e-4, "{} {}", point.normal, back.normal);
                assert!((back.normal.length() - 1.0).abs() < 1e-6);
            }
            let again = decode(&encode(&decoded).unwrap()).unwrap();
            assert_eq!(again, decoded);
        }
    }

    #[test]
    fn every_octahedral_border_is_stable_and_axes_are_exact() {
        for axis in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
            assert_eq!(normal_from_octahedral(octahedral_from_normal(axis)), axis);
        }
        for a in (0..=65534).step_by(127).chain([65535]) {
            for b in [0, 1, 32766, 32767, 32768, 65533, 65534, 65535] {
                for pair in [[a, b], [b, a]] {
                    let normal = normal_from_octahedral(pair);
                    let again = normal_from_octahedral(octahedral_from_normal(normal));
                    assert_eq!(normal, again, "{pair:?}");
                }
            }
        }
    }

    #[test]
    fn points_without_place_or_normal_are_refused() {
        let point = SamplePoint { position: Vec3::ZERO, normal: Vec3::Y };
        assert!(encode(&[SamplePoint { position: Vec3::splat(f32::NAN), ..point }]).is_err());
        assert!(encode(&[SamplePoint { normal: Vec3::ZERO, ..point }]).is_err());
        assert_eq!(decode(&encode(&[point]).unwrap()).unwrap(), [point]);
        assert!(decode(&encode(&[]).unwrap()).unwrap().is_empty());
    }
}
