//! From one level to the next without a seam.
//!
//! A finer volume ends where the server's resident patches end. There a point's eight voxels are partly lit, partly
//! beyond the end, and what is beyond is the coarser volume's: each gets the trilinear weight of its voxels, so that the
//! weights sum to one and change continuously as the point moves. A voxel that is dark because nothing faces there
//! is not beyond the end: its neighbours in the same coarse voxel are lit, or the coarse voxel is dark as well.

use crate::Volume;
use glam::{IVec3, Vec3};

/// Whether `voxel` has no light on `direction` in `fine` because `fine` ends before it: the covering voxel of `coarse`
/// has light there, and none of the eight voxels that it covers has in `fine`.
pub(crate) fn is_beyond_the_end(fine: &Volume, coarse: &Volume, voxel: IVec3, direction: usize) -> bool {
    // Each step halves the coordinates.
    let steps =
        (coarse.layout().voxel_edge_m / fine.layout().voxel_edge_m).log2().round().clamp(0.0, 16.0) as u32;
    let covering = voxel >> steps;
    let is_detail = is_detail(fine, coarse);
    // Detail ends where surfaces end, not where the air begins.
    let is_lit = coarse
        .at(covering)
        .is_some_and(|light| light.has(direction) && !(is_detail && light.is_air(direction)));
    // All parts of the voxel; of a missing level in between, the next eight.
    let block = if is_detail { steps } else { 1 };
    let (first, count) = (voxel >> block << block, 1 << (3 * block));
    let mask = (1 << block) - 1;
    is_lit
        && (0..count).all(|at| {
            let sibling = first + IVec3::new(at & mask, at >> block & mask, at >> (2 * block));
            fine.at(sibling).is_none_or(|light| !light.has(direction))
        })
}

/// Whether `fine` holds the surfaces of the level of `coarse` in more detail: it is of the same level.
pub(crate) fn is_detail(fine: &Volume, coarse: &Volume) -> bool {
    fine.layout().level == coarse.layout().level
}

/// Share of a point's light that `fine` gives up to `coarse`, 0..=1: the trilinear weight of voxels beyond its end, over
/// that and the weight of those that are lit, each direction by the square of the normal.
///
/// `low` and `fraction` are the lowest of the point's eight voxels and its place between them.
pub(crate) fn share_of_coarser(
    fine: &Volume,
    coarse: &Volume,
    low: IVec3,
    fraction: Vec3,
    normal: Vec3,
) -> f32 {
    let (mut lit, mut beyond) = (0.0f32, 0.0f32);
    for corner in 0..8 {
        let step = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
        let along = |axis: usize| if step[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] };
        let weight = along(0) * along(1) * along(2);
        let voxel = low + step;
        let light = fine.at(voxel);
        for axis in 0..3 {
            let (weight, direction) =
                (weight * normal[axis] * normal[axis], axis * 2 + usize::from(normal[axis] < 0.0));
            if weight > 0.0 {
                if light.is_some_and(|light| light.has(direction)) {
                    lit += weight;
                } else if is_beyond_the_end(fine, coarse, voxel, direction) {
                    beyond += weight;
                }
            }
        }
    }
    if beyond > 0.0 { beyond / (lit + beyond) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Layout, lookup};
    use glam::UVec3;

    /// A floor of up-facing patches along x: fine ones of light 1 up to x = 8 m, coarse ones of light 3 everywhere.
    fn floors() -> [Volume; 2] {
        let layout =
            Layout { level: 0, origin: IVec3::splat(-16), dims: UVec3::splat(48), voxel_edge_m: 1.0 };
        let mut fine = Volume::new(layout).unwrap();
        let mut coarse = Volume::new(Layout { level: 1, voxel_edge_m: 2.0, ..layout }).unwrap();
        for x in -8..8 {
            for z in -4..4 {
                fine.set_patch(IVec3::new(x, 0, z), 2, Vec3::splat(1.0), Vec3::ZERO, 255);
            }
        }
        for x in -8..12 {
            for z in -4..4 {
                coarse.set_patch(IVec3::new(x, 0, z), 2, Vec3::splat(3.0), Vec3::ZERO, 255);
            }
        }
        [fine, coarse]
    }

    fn read(volumes: &[Volume], x: f32) -> f32 {
        lookup(volumes, Vec3::new(x, 0.1, 0.3), Vec3::Y).unwrap().irradiance.x
    }

    /// Goal: no seam. Method: a walk across the end of the fine level in steps of a centimetre.
    #[test]
    fn light_crosses_the_end_of_a_level_without_a_jump() {
        let volumes = floors();
        let mut before = read(&volumes, 4.0);
        assert_eq!(before, 1.0, "well inside the fine level speaks alone");
        for step in 1..=800 {
            let now = read(&volumes, 4.0 + step as f32 * 0.01);
            assert!((now - before).abs() <= 0.021 && now >= before - 1e-5, "{step}: {before} to {now}");
            before = now;
        }
        assert_eq!(before, 3.0, "well outside the coarse level does");
    }

    /// A floor of detail voxels of 0.25 m as bright as 5, in voxels of 1 m as bright as 1 under air as bright as 3.
    fn detailed_floor() -> [Volume; 2] {
        let layout = Layout { level: 0, origin: IVec3::splat(-8), dims: UVec3::splat(16), voxel_edge_m: 1.0 };
        let place =
            Layout { origin: IVec3::splat(-32), dims: UVec3::splat(64), voxel_edge_m: 0.25, ..layout };
        let (mut details, mut voxels) = (Volume::new(place).unwrap(), Volume::new(layout).unwrap());
        for index in 0..layout.voxel_count() {
            voxels.set_receiver(layout.voxel_of(index), 2, Vec3::splat(3.0), Vec3::ZERO, 255);
        }
        for (x, z) in (-8..8).flat_map(|x| (-8..8).map(move |z| (x, z))) {
            voxels.set_patch(IVec3::new(x, 0, z), 2, Vec3::splat(1.0), Vec3::ZERO, 255);
        }
        // Only the middle has detail; the floor lies in the third layer of detail voxels.
        for (x, z) in (-16..16).flat_map(|x| (-16..16).map(move |z| (x, z))) {
            details.set_patch(IVec3::new(x, 2, z), 2, Vec3::splat(5.0), Vec3::ZERO, 255);
        }
        [details, voxels]
    }

    /// Goal: surfaces read detail voxels, the air and what has none reads voxels, without a seam. Method: points on the floor, above
    /// it, beyond the end; walks up and along in steps of a centimetre.
    #[test]
    fn detail_answers_on_its_surfaces_and_fades_beyond() {
        let volumes = detailed_floor();
        let read =
            |position: Vec3| lookup(&volumes, position, Vec3::Y).map_or(f32::NAN, |found| found.irradiance.x);
        for (height, expected) in [(0.51, 5.0), (0.74, 5.0), (2.5, 3.0)] {
            let found = read(Vec3::new(0.13, height, 0.4));
            assert!((found - expected).abs() < 1e-5, "{height}: {found}");
        }
        assert_eq!(read(Vec3::new(6.1, 0.6, 0.4)), 1.0, "beyond the end of the detail");
        let ways = [(Vec3::new(0.13, 0.6, 0.4), Vec3::Y * 2.0), (Vec3::new(0.13, 0.6, 0.4), Vec3::X * 6.0)];
        for (start, way) in ways {
            let largest = |steps: u32| {
                let at = |step: u32| read(start + way * (step as f32 / steps as f32));
                (0..steps).map(|step| (at(step + 1) - at(step)).abs()).fold(0.0, f32::max)
            };
            let (coarse, fine) = (largest(2000), largest(8000));
            assert!(fine < 0.3 * coarse, "{way}: {coarse}, then {fine}");
        }
    }

    #[test]
    fn air_beside_a_surface_is_not_the_end_of_a_level() {
        let [fine, coarse] = floors();
        // Above the floor: dark in both, or dark beside lit siblings.
        assert!(!is_beyond_the_end(&fine, &coarse, IVec3::new(0, 1, 0), 2));
        assert!(!is_beyond_the_end(&fine, &coarse, IVec3::new(0, 5, 0), 2));
        assert!(is_beyond_the_end(&fine, &coarse, IVec3::new(9, 0, 0), 2));
        assert!(!is_beyond_the_end(&fine, &coarse, IVec3::new(9, 0, 0), 3));
    }
}
