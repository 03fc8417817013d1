//! A world that is baked again under a running server: taken over without a missing frame, or refused.

use earthshine_client::{Client, ClientOptions, Light, Vec3};
use earthshine_gen::fixtures;
use earthshine_scene::Scene;
use earthshine_tests::agreement::{assert_is, served_patches};
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tests::served::ServedWorld;
use earthshine_tests::solved::SolvedWorld;
use earthshine_tests::viewer::{connect, settled_at};
use std::collections::BTreeSet;
use std::time::{Duration, Instant};

const INSIDE: Vec3 = Vec3::new(-2.5, 1.5, 0.0);

/// Two rooms with a board across the first, at the height `y`.
fn rooms(y: f32) -> Scene {
    let mut scene = imported(&fixtures::two_rooms_glb());
    let [a, b, c, d] =
        [(-3.4, -0.6), (-3.4, 0.9), (-1.8, 0.9), (-1.8, -0.6)].map(|(x, z)| Vec3::new(x, y, z));
    for corners in [[a, b, c], [a, c, d]] {
        scene.triangles.push(corners);
        scene.texture_coordinates.push([[0.0; 2]; 3]);
        scene.material_of.push(0);
    }
    scene
}

fn world(scene: &Scene) -> BakedWorld {
    BakedWorld::new("two-rooms", scene, own_lights(scene), coarse(0.75, 8))
}

async fn serve(world: &BakedWorld) -> ServedWorld {
    // Room for every patch before and after.
    let slots = world.patch_count() + 512;
    ServedWorld::start(world.path(), slots, |config| config.world_poll_s = 0.05).await
}

type Places = BTreeSet<([i32; 3], usize)>;

fn places(light: &Light) -> Places {
    served_patches(light).into_keys().collect()
}

/// Every state that `client` sees until `ended`, which is asked now and then.
async fn watch(client: &mut Client, mut ended: impl FnMut(&Light) -> bool) -> Vec<Places> {
    let mut seen = Vec::new();
    let deadline = Instant::now() + Duration::from_secs(30);
    loop {
        let light = match tokio::time::timeout(Duration::from_millis(100), client.next_light()).await {
            Ok(light) => light.expect("the session goes on"),
            Err(_elapsed) => client.light(),
        };
        let patches = served_patches(&light);
        assert!(patches.values().all(|patch| patch.irradiance.is_finite()));
        assert!(patches.values().any(|patch| patch.irradiance.max_element() > 1.0), "a dark frame");
        seen.push(patches.into_keys().collect());
        if ended(&light) {
            return seen;
        }
        assert!(Instant::now() < deadline, "waited in vain for the new world");
    }
}

#[tokio::test]
async fn an_edited_world_is_taken_over_without_a_missing_frame() {
    let mut world = world(&rooms(0.9));
    let before_edit = world.summary.rays;
    let served = serve(&world).await;
    let mut client = connect(&served.uri).await;
    let before = places(&*settled_at(&mut client, INSIDE).await);

    world.bake_again(&rooms(1.9), coarse(0.75, 8));
    assert!(world.summary.rays <= before_edit && world.summary.stale.changed_tiles > 0);
    let solved = SolvedWorld::load(world.path());
    let after = solved.places().into_iter().collect::<Places>();
    assert_ne!(before, after, "the board stands elsewhere");
    let seen = watch(&mut client, |light| places(light) == after).await;
    // The old world or the new one; never a mixture, never a hole.
    assert!(seen.iter().all(|places| *places == before || *places == after));
    let described =
        earthshine_client::world(&served.uri, &ClientOptions::default()).await.expect("a description");
    assert_eq!(described.patch_count, world.patch_count() as u64, "who comes now is told of the new state");
    let light = settled_at(&mut client, INSIDE + Vec3::X * 0.01).await;
    assert_is(&solved, &solved.solve(&solved.lights), &light);
    client.close().await;
    served.stop().await.expect("a clean end");
}

#[tokio::test]
async fn a_world_with_other_parameters_is_refused_and_the_old_one_stays() {
    let scene = rooms(0.9);
    let mut world = world(&scene);
    let served = serve(&world).await;
    let mut client = connect(&served.uri).await;
    let before = places(&*settled_at(&mut client, INSIDE).await);
    world.bake_again(&scene, coarse(0.6, 8));
    let until = Instant::now() + Duration::from_secs(1);
    let seen = watch(&mut client, |_| Instant::now() > until).await;
    assert!(seen.iter().all(|places| *places == before));
    // A manifest that is cut off changes nothing either.
    std::fs::write(world.path().join("world.toml"), "format_version = ").expect("written");
    let until = Instant::now() + Duration::from_millis(300);
    let seen = watch(&mut client, |_| Instant::now() > until).await;
    assert!(seen.iter().all(|places| *places == before));
    client.close().await;
    served.stop().await.expect("a clean end");
}
