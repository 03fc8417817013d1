//! Streamed in pieces, a world has the light of the whole: what is not resident comes from coarse levels.
//!
//! The oracle is level 0 solved at once from the same tiles.

use earthshine_bake::Levels;
use earthshine_client::Vec3;
use earthshine_gen::fixtures;
use earthshine_tests::agreement::{PatchPlaces, served_patches};
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tests::served::ServedWorld;
use earthshine_tests::solved::{SolvedWorld, place_of};
use earthshine_tests::viewer::{connect, settled_at};
use std::collections::BTreeMap;

/// Relative RMSE of what `served` says of its patches nearest to `camera`, half of them, against the whole world.
fn error(solved: &SolvedWorld, served: &PatchPlaces, camera: Vec3) -> f64 {
    let whole = solved.solve(&solved.lights);
    let mut nearest: Vec<(f32, usize)> = solved
        .told()
        .filter(|(_, patch)| served.contains_key(&place_of(patch)))
        .map(|(index, patch)| (patch.centroid.distance(camera), index))
        .collect();
    nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
    nearest.truncate(nearest.len() / 2);
    let places: BTreeMap<usize, _> = solved.told().map(|(index, patch)| (index, place_of(patch))).collect();
    let (mut gap, mut norm) = (0.0f64, 0.0f64);
    for (_, index) in nearest {
        let truth = whole.irradiance[index];
        gap += f64::from((served[&places[&index]].irradiance - truth).length_squared());
        norm += f64::from(truth.length_squared());
    }
    (gap / norm).sqrt()
}

/// Error with `slots` patches resident around `camera`, without and with coarse levels; with them also whether there is
/// light at `afar`, where no patch of level 0 is resident.
async fn errors(name: &str, glb: &[u8], voxel_edge_m: f32, camera: Vec3, afar: Vec3) -> [f64; 2] {
    let scene = imported(glb);
    let mut found = [0.0; 2];
    for (levels, found) in [Levels::Exactly(1), Levels::Auto].into_iter().zip(&mut found) {
        let world =
            BakedWorld::with_levels(name, &scene, own_lights(&scene), coarse(voxel_edge_m, 8), levels);
        let slots = world.patch_count() / 8;
        let served = ServedWorld::start(world.path(), slots, |_| ()).await;
        let mut client = connect(&served.uri).await;
        let light = settled_at(&mut client, camera).await;
        assert_eq!(light.frame().resident_patches, slots);
        let has_levels = world.summary.levels.len() > 1;
        assert_eq!(light.volumes().len(), world.summary.levels.len());
        assert_eq!(light.lookup(afar, Vec3::Y).is_some(), has_levels, "{name}: light afar");
        *found = error(&SolvedWorld::load(world.path()), &served_patches(&light), camera);
        client.close().await;
        served.stop().await.expect("a clean end");
    }
    found
}

#[tokio::test]
async fn a_corridor_in_pieces_has_the_light_of_the_whole() {
    let glb = fixtures::corridor_glb(48.0);
    let [alone, fed] =
        errors("corridor", &glb, 1.0, Vec3::new(12.0, 1.6, 1.5), Vec3::new(40.0, 0.05, 1.5)).await;
    assert!(fed < 0.05 && fed < 0.6 * alone, "{alone} without coarse levels, {fed} with them");
}

#[tokio::test]
async fn two_rooms_in_pieces_have_the_light_of_the_whole() {
    let glb = fixtures::two_rooms_glb();
    let [alone, fed] =
        errors("two-rooms", &glb, 0.75, Vec3::new(-2.5, 1.5, 0.0), Vec3::new(3.5, 0.05, 1.0)).await;
    assert!(fed < 0.1 && fed < 0.6 * alone, "{alone} without coarse levels, {fed} with them");
}
