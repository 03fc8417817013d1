//! Detail: here each patch has one detail voxel with the patch's own row, in a world of its own making.

use super::backend::Faults;
use super::harness::{ALICE, Harness, generous, lamp};
use super::world::{RandomWorld, WorldShape};
use crate::{Frame, PatchLight};
use earthshine_world::{
    Barrier, ChunkRows, DetailVoxel, Direction, LightRig, ReceiverPlace, Receivers, Rgb, Sky, SurfacePlane,
    Vec3,
};
use glam::IVec3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The upper detail voxel of each voxel's low corner, seen from above.
const OFFSET: IVec3 = IVec3::new(0, 1, 0);

/// The way to a wall beside each.
const WALL: Vec3 = Vec3::new(0.3, -0.5, 0.8);

/// One with a detail voxel, of two along an edge, in each patch; nothing in the air.
pub(super) fn world(seed: u64) -> RandomWorld {
    let shape = WorldShape { chunks: [4, 2, 3], patches_per_chunk_max: 12, ..WorldShape::default() };
    let mut world = RandomWorld::new(seed, shape);
    world.index.detail = 2;
    for chunk in world.chunks.values_mut() {
        let chunk = Arc::make_mut(chunk);
        let mut details: Vec<(ReceiverPlace, usize)> = Vec::new();
        for (local, patch) in chunk.patches.iter().enumerate() {
            let plane = SurfacePlane::new(patch.direction.vector(), 0.25);
            let barriers = [Barrier::new(patch.direction, WALL, 0.5), None];
            let detail = Some(DetailVoxel { barriers, ..DetailVoxel::new(OFFSET, 0, plane) });
            details.push((ReceiverPlace { voxel: patch.voxel, direction: patch.direction, detail }, local));
        }
        details.sort_by_key(|(place, _)| place.order());
        let mut rows =
            ChunkRows { segments: chunk.rows.segments.clone(), row_starts: vec![0], ..ChunkRows::default() };
        for &(_, local) in &details {
            for (column, share) in chunk.rows.row(local) {
                rows.columns.push(column);
                rows.shares.push(share);
            }
            rows.row_starts.push(rows.columns.len() as u32);
            rows.sky_shares.push(chunk.rows.sky_shares[local]);
            rows.absorbed_shares.push(chunk.rows.absorbed_shares[local]);
        }
        chunk.receivers = Receivers { places: details.into_iter().map(|(place, _)| place).collect(), rows };
    }
    world
}

type Place = ([i32; 3], Direction);

fn details(frame: &Frame) -> BTreeMap<Place, PatchLight> {
    frame.details.iter().map(|light| ((light.voxel.to_array(), light.direction), *light)).collect()
}

/// Goal: a detail voxel with its patch's row has its patch's light, that from afar included, and is there just if the patch is.
/// Method: a matrix with room for all patches, and for a third of them.
#[test]
fn a_detail_voxel_with_its_patch_s_row_has_its_patch_s_light() {
    for slots in [1000, 40] {
        let mut harness = Harness::new(world(5), generous(slots), Faults::default()).with_camera(Vec3::ZERO);
        let sky = Sky::constant(Rgb::new(1.0, 2.0, 3.0));
        harness.light(ALICE, LightRig { sky, ..lamp(Vec3::ONE) });
        harness.settle();
        let frame = harness.frame(ALICE);
        let details = details(frame);
        assert!(
            !details.is_empty() && details.len() == frame.patches.len(),
            "{} detail voxels",
            details.len()
        );
        for patch in frame.patches.iter() {
            let detail = details[&((patch.voxel * 2 + OFFSET).to_array(), patch.direction)];
            let gap = (detail.irradiance - patch.irradiance).abs().max_element();
            assert!(gap <= 1e-4 * patch.irradiance.max_element(), "{detail:?} of {patch:?}");
            assert_eq!(detail.sky_irradiance, patch.sky_irradiance);
            assert!((detail.known_share - patch.known_share).abs() < 1e-5);
            assert!((detail.fed_share - patch.fed_share).abs() < 1e-5);
            assert_eq!(detail.tilt, Some(SurfacePlane::new(patch.direction.vector(), 0.25)));
            assert_eq!(detail.barriers, [Barrier::new(patch.direction, WALL, 0.5), None]);
            assert_ne!(detail.barriers, [None; 2]);
            let offset = if patch.direction.vector().element_sum() > 0.0 { 0.75 } else { 0.25 };
            assert!((detail.plane_offset.unwrap() - offset).abs() < 0.01);
        }
    }
}
