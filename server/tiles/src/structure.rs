//! What must hold of a chunk for its bytes to mean anything: checked before encoding, so that a
//! mistake shows where it was made, and (for what the frames cannot rule out) after decoding.
//!
//! Row sums and the like are not structure; they are in [`crate::invariant`].

use crate::{codec::Decoded, limits};
use earthshine_world::{Chunk, ChunkRows, Patch, ReceiverPlace, Receivers, Vec3};

/// Checks all of `chunk`.
pub(crate) fn check(chunk: &Chunk) -> Decoded<()> {
    if chunk.patches.len() > Chunk::PATCHES_MAX {
        return Err(format!("{} patches, the limit is {}", chunk.patches.len(), Chunk::PATCHES_MAX));
    }
    check_patches(&chunk.patches, chunk.points.len())?;
    check_rows(chunk, &chunk.rows, chunk.patches.len())?;
    check_receivers(chunk).map_err(|cause| format!("receivers: {cause}"))?;
    let mesh = &chunk.occluders;
    if mesh.triangles.len() != mesh.surfaces.len() {
        return Err(format!("{} triangles with {} surfaces", mesh.triangles.len(), mesh.surfaces.len()));
    }
    if mesh.triangles.iter().flatten().any(|&index| index as usize >= mesh.vertices.len()) {
        return Err("an occluder uses a vertex that does not exist".to_owned());
    }
    if mesh.vertices.iter().any(|vertex| !vertex.is_finite()) {
        return Err("an occluder's vertex is not finite".to_owned());
    }
    Ok(())
}

/// Checks what decoding indexes with, divides by or sums up.
pub(crate) fn check_patches(patches: &[Patch], point_count: usize) -> Decoded<()> {
    let not_negative = |v: Vec3| v.is_finite() && v.min_element() >= 0.0;
    for (index, patch) in patches.iter().enumerate() {
        let end = u64::from(patch.point_first) + u64::from(patch.point_count);
        let cause = if patch.point_count == 0 || end > point_count as u64 {
            "has sample points that are not in the list, or none"
        } else if !(patch.area.is_finite() && patch.area > 0.0) {
            "has no positive area"
        } else if !patch.centroid.is_finite() {
            "has a centroid that is not finite"
        } else if !(not_negative(patch.reflectance) && patch.reflectance.max_element() <= 1.0) {
            "has a reflectance that is not between 0 and 1"
        } else if !not_negative(patch.emission) {
            "has an emission that is negative or not finite"
        } else {
            continue;
        };
        return Err(format!("patch {index} {cause}"));
    }
    Ok(())
}

/// Checks that no place comes twice, and that layers are counted from 0.
pub(crate) fn check_places(places: &[ReceiverPlace]) -> Decoded<()> {
    if !places.is_sorted_by(|a, b| a.order() < b.order()) {
        return Err("the receivers do not ascend".to_owned());
    }
    let below = |place: &ReceiverPlace| {
        let (voxel, direction, (index, layer)) = place.order();
        layer.checked_sub(1).map(|below| (voxel, direction, (index, below)))
    };
    let before = std::iter::once(None).chain(places.iter().map(|place| Some(place.order())));
    match places.iter().zip(before).find(|(place, before)| below(place).is_some_and(|it| Some(it) != *before))
    {
        None => Ok(()),
        Some((place, _)) => {
            Err(format!("{} facing {:?} is missing a layer below another", place.voxel, place.direction))
        }
    }
}

/// Checks that receivers in the air are where no patch is, and those on surfaces where one is.
pub(crate) fn check_apart(patches: &[Patch], places: &[ReceiverPlace]) -> Decoded<()> {
    let mut taken: Vec<_> = patches.iter().map(|patch| (patch.voxel.to_array(), patch.direction)).collect();
    taken.sort_unstable();
    let has_patch =
        |place: &ReceiverPlace| taken.binary_search(&(place.voxel.to_array(), place.direction)).is_ok();
    match places.iter().find(|place| has_patch(place) != place.detail.is_some()) {
        None => Ok(()),
        Some(place) => {
            let what = if place.detail.is_some() { "no patch" } else { "a patch" };
            Err(format!("{} facing {:?} has {what}", place.voxel, place.direction))
        }
    }
}

fn check_receivers(chunk: &Chunk) -> Decoded<()> {
    let places = &chunk.receivers.places;
    if places.len() > Receivers::COUNT_MAX {
        return Err(format!("{} of them, the limit is {}", places.len(), Receivers::COUNT_MAX));
    }
    check_places(places)?;
    check_apart(&chunk.patches, places)?;
    check_rows(chunk, &chunk.receivers.rows, places.len())
}

/// Checks `rows`, which should be `count`, of `chunk`.
fn check_rows(chunk: &Chunk, rows: &ChunkRows, count: usize) -> Decoded<()> {
    if rows.sky_shares.len() != count || rows.absorbed_shares.len() != count {
        return Err(format!("{} rows for {count} places", rows.sky_shares.len()));
    }
    if !rows.segments.is_sorted_by(|a, b| a < b) {
        return Err("the segments do not ascend".to_owned());
    }
    if !starts_fit(rows) {
        return Err("the row starts do not ascend from zero to the number of columns".to_owned());
    }
    let own = rows.segments.binary_search(&chunk.id).ok();
    for row in 0..count {
        let columns = &rows.columns[rows.row_starts[row] as usize..rows.row_starts[row + 1] as usize];
        if columns.len() > limits::ROW_NONZEROS_MAX as usize {
            return Err(format!("row {row} has {} non-zeros", columns.len()));
        }
        if !columns.is_sorted_by(|a, b| a < b) {
            return Err(format!("the columns of row {row} do not ascend"));
        }
        if columns.last().is_some_and(|column| usize::from(column.segment) >= rows.segments.len()) {
            return Err(format!("row {row} points into a segment that does not exist"));
        }
        let patches = chunk.patches.len();
        let strays = |column: &&earthshine_world::Column| usize::from(column.local) >= patches;
        if let Some(column) = columns.iter().filter(|c| Some(usize::from(c.segment)) == own).find(strays) {
            return Err(format!("row {row} points at patch {} of its own chunk of {patches}", column.local));
        }
    }
    let is_share = |share: &f32| (0.0..=limits::SHARE_MAX).contains(share);
    if let Some(index) = rows.shares.iter().position(|share| !is_share(share)) {
        let row = rows.row_starts.partition_point(|&start| start as usize <= index) - 1;
        return Err(format!("row {row} has the share {}", rows.shares[index]));
    }
    let tail = |row: &usize| rows.sky_shares[*row].iter().chain([&rows.absorbed_shares[*row]]).all(is_share);
    match (0..count).find(|row| !tail(row)) {
        None => Ok(()),
        Some(row) => Err(format!(
            "row {row} has sky shares {:?} and the absorbed share {}",
            rows.sky_shares[row], rows.absorbed_shares[row]
        )),
    }
}

/// Whether `row_starts` can be indexed with.
pub(crate) fn starts_fit(rows: &ChunkRows) -> bool {
    rows.row_starts.len() == rows.sky_shares.len() + 1
        && rows.row_starts.first() == Some(&0)
        && rows.row_starts.is_sorted()
        && rows.row_starts.last().is_some_and(|&end| end as usize == rows.columns.len())
        && rows.columns.len() == rows.shares.len()
}
