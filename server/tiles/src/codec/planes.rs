//! Byte planes: all first bytes of the records, then all second bytes, ...
//!
//! Exponents lie beside exponents and noise beside noise, which is what an entropy coder wants.

/// The bytes of `records`, `stride` bytes each, plane by plane.
pub(crate) fn split(records: &[u8], stride: usize) -> Vec<u8> {
    let mut planes = Vec::with_capacity(records.len());
    for plane in 0..stride {
        planes.extend(records.iter().skip(plane).step_by(stride));
    }
    planes
}

/// Undoes [`split`]. `planes` holds a whole number of records.
pub(crate) fn join(planes: &[u8], stride: usize) -> Vec<u8> {
    let count = planes.len() / stride;
    let mut records = vec![0; count * stride];
    for (index, plane) in planes.chunks_exact(count.max(1)).enumerate() {
        for (record, &byte) in records.chunks_exact_mut(stride).zip(plane) {
            record[index] = byte;
        }
    }
    records
}

/// The records of type `T` that [`split`] took apart.
pub(crate) fn join_as<T: bytemuck::AnyBitPattern>(planes: &[u8]) -> Vec<T> {
    join(planes, size_of::<T>()).chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joining_undoes_splitting() {
        let records: Vec<u8> = (0..30).collect();
        assert_eq!(split(&records, 10)[..4], [0, 10, 20, 1]);
        for stride in [1, 3, 10, 30] {
            assert_eq!(join(&split(&records, stride), stride), records);
        }
        assert!(join(&[], 7).is_empty());
    }
}
