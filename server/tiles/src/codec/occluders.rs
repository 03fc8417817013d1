//! Occluder triangles: vertices as they are, indices as differences, surfaces; all in byte planes.

use super::{Decoded, planes, take};
use earthshine_world::{OccluderMesh, Vec3};

/// Bytes before zstd of a mesh with these counts.
pub(crate) fn raw_bytes(vertex_count: u32, triangle_count: u32) -> u64 {
    u64::from(vertex_count) * 12 + u64::from(triangle_count) * 16
}

pub(crate) fn encode(mesh: &OccluderMesh) -> Vec<u8> {
    let mut raw = planes::split(bytemuck::cast_slice(&mesh.vertices), 12);
    let mut previous = 0u32;
    let differences: Vec<u32> = mesh
        .triangles
        .iter()
        .flatten()
        .map(|&index| zigzag(index.wrapping_sub(std::mem::replace(&mut previous, index)).cast_signed()))
        .collect();
    raw.extend(planes::split(bytemuck::cast_slice(&differences), 4));
    raw.extend(planes::split(bytemuck::cast_slice(&mesh.surfaces), 4));
    raw
}

pub(crate) fn decode(mut raw: &[u8], vertex_count: u32, triangle_count: u32) -> Decoded<OccluderMesh> {
    let vertices: Vec<Vec3> = planes::join_as(take(&mut raw, vertex_count as usize * 12, "vertices")?);
    if vertices.iter().any(|vertex| !vertex.is_finite()) {
        return Err("a vertex is not finite".to_owned());
    }
    let differences: Vec<u32> = planes::join_as(take(&mut raw, triangle_count as usize * 12, "triangles")?);
    let surfaces = planes::join_as(take(&mut raw, triangle_count as usize * 4, "surfaces")?);
    let mut index = 0u32;
    let indices: Vec<u32> = differences
        .into_iter()
        .map(|difference| {
            index = index.wrapping_add(unzigzag(difference).cast_unsigned());
            index
        })
        .collect();
    if let Some(index) = indices.iter().find(|&&index| index >= vertex_count) {
        return Err(format!("a triangle uses vertex {index} of {vertex_count}"));
    }
    let (triangles, _) = indices.as_chunks::<3>();
    Ok(OccluderMesh { vertices, triangles: triangles.to_vec(), surfaces })
}

/// Small differences of either sign as small numbers.
fn zigzag(difference: i32) -> u32 {
    (difference.wrapping_shl(1) ^ (difference >> 31)).cast_unsigned()
}

fn unzigzag(number: u32) -> i32 {
    (number >> 1).cast_signed() ^ -((number & 1).cast_signed())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zigzag_is_undone_at_the_extremes() {
        for difference in [0, 1, -1, 77, -77, i32::MAX, i32::MIN] {
            assert_eq!(unzigzag(zigzag(difference)), difference);
        }
        assert_eq!((zigzag(-1), zigzag(1)), (1, 2));
    }
}
