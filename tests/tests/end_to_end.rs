//! From a generated scene to the light in a client's hands: gen, scene, bake, tiles, server, engine, client, lookup.
//!
//! The oracle is the whole world solved at once from the same tiles; what lies between is streaming.

use earthshine_client::{Client, ClientError, ClientOptions, Lights, Vec3};
use earthshine_gen::fixtures;
use earthshine_tests::agreement::{assert_between, assert_detail_is, assert_is, served_patches};
use earthshine_tests::baked::{BakedWorld, coarse, imported, own_lights};
use earthshine_tests::served::ServedWorld;
use earthshine_tests::solved::SolvedWorld;
use earthshine_tests::viewer::{connect, light_where, settled_at, within};
use earthshine_tiles::BakeParameters;
use earthshine_world::{Light, LightRig, Rgb, Sky};

/// Inside of the corridor: near its start, at `x` m.
fn in_the_corridor(x: f32) -> Vec3 {
    Vec3::new(x, 1.6, 1.5)
}

fn corridor(length_m: f32, sky: Sky) -> BakedWorld {
    let scene = imported(&fixtures::corridor_glb(length_m));
    let lights = LightRig { sky, ..own_lights(&scene) };
    BakedWorld::new("corridor", &scene, lights, coarse(1.0, 8))
}

fn two_rooms() -> BakedWorld {
    let scene = imported(&fixtures::two_rooms_glb());
    BakedWorld::new("two-rooms", &scene, own_lights(&scene), coarse(0.75, 8))
}

const IN_THE_FIRST_ROOM: Vec3 = Vec3::new(-2.5, 1.5, 0.0);
const IN_THE_SECOND_ROOM: Vec3 = Vec3::new(2.5, 1.5, 0.0);

/// A sun, a lamp and a spot beside what the scene has, under a sky of six colours.
fn every_kind_of_light(own: LightRig, inside: Vec3) -> LightRig {
    let down = Vec3::new(0.3, -0.9, -0.4).normalize_or(Vec3::NEG_Y);
    let (intensity, angular_diameter_rad) = (Rgb::new(90.0, 70.0, 50.0), 0.0);
    let mut lights = own.lights;
    lights.push(Light::Directional { direction: down, illuminance: Rgb::splat(900.0), angular_diameter_rad });
    lights.push(Light::Point { position: inside, intensity, range_m: None });
    lights.push(Light::Spot {
        position: inside + Vec3::X * 0.2,
        direction: Vec3::NEG_Y,
        intensity,
        inner_cone_rad: 0.3,
        outer_cone_rad: 0.7,
        range_m: Some(10.0),
    });
    let lobes = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0].map(|lobe| Rgb::new(lobe, 20.0 - lobe, 10.0) * 10.0);
    LightRig { lights, sky: Sky { lobes }, emission_scale: 0.5 }
}

/// Serves `world` with room for every patch and compares all of it.
async fn assert_served_as_solved(world: &BakedWorld, inside: Vec3) {
    let served = ServedWorld::start(world.path(), world.patch_count(), |_| ()).await;
    let mut client = connect(&served.uri).await;
    let light = settled_at(&mut client, inside).await;
    let solved = SolvedWorld::load(world.path());
    let solution = solved.solve(&solved.lights);
    assert!(solution.irradiance.iter().any(|light| light.max_element() > 1.0), "the world is dark");
    assert_is(&solved, &solution, &light);
    client.close().await;
    served.stop().await.expect("a clean end");
}

#[tokio::test]
async fn a_cornell_box_under_every_kind_of_light_is_served_as_solved() {
    let scene = imported(&fixtures::cornell_glb());
    let inside = Vec3::new(-0.3, 1.7, 0.4);
    let lights = every_kind_of_light(own_lights(&scene), inside);
    let world = BakedWorld::new("cornell", &scene, lights, coarse(0.25, 5));
    assert_served_as_solved(&world, inside).await;
}

#[tokio::test]
async fn two_rooms_are_served_as_solved() {
    assert_served_as_solved(&two_rooms(), IN_THE_FIRST_ROOM).await;
}

/// Goal: detail reaches the client, and a client that does not ask for it gets none. Method: the two rooms in half voxels.
#[tokio::test]
async fn detail_is_served_as_solved() {
    let scene = imported(&fixtures::two_rooms_glb());
    let parameters = BakeParameters { detail: 2, detail_rays: 64, ..coarse(0.75, 8) };
    // A lamp near walls: no two points of a patch have the same light, and what is next to it must tell them apart.
    let lamp = Light::Point { position: IN_THE_FIRST_ROOM, intensity: Rgb::splat(200.0), range_m: None };
    let lights = LightRig { lights: vec![lamp], ..own_lights(&scene) };
    let world = BakedWorld::new("two-rooms", &scene, lights, parameters);
    let served = ServedWorld::start(world.path(), world.patch_count(), |_| ()).await;
    let mut client = connect(&served.uri).await;
    let light = settled_at(&mut client, IN_THE_FIRST_ROOM).await;
    let solved = SolvedWorld::load(world.path());
    let solution = solved.solve(&solved.lights);
    assert!(assert_detail_is(&solved, &solution, &light) > 2 * solution.irradiance.len());
    client.close().await;
    served.stop().await.expect("a clean end");
}

#[tokio::test]
async fn a_corridor_of_many_chunks_is_served_as_solved() {
    let world = corridor(24.0, Sky::constant(Rgb::splat(50.0)));
    assert!(world.summary.chunks > 8, "{:?}", world.summary);
    assert_served_as_solved(&world, in_the_corridor(12.0)).await;
}

/// Goal: what is not loaded is missing and said to be missing; it is never given to the sky. Method: a dim corridor
/// under a dazzling sky, far more patches than slots. Inside no patch sees the sky, and a far share that went to it
/// would outshine every lamp.
#[tokio::test]
async fn unloaded_light_is_reported_and_never_given_to_the_sky() {
    let world = corridor(48.0, Sky::constant(Rgb::splat(1e4)));
    let solved = SolvedWorld::load(world.path());
    let whole = solved.solve(&solved.lights);
    let mut least = Vec::new();
    for slots in [world.patch_count() / 8, world.patch_count() / 3] {
        let served = ServedWorld::start(world.path(), slots, |_| ()).await;
        let mut client = connect(&served.uri).await;
        let light = settled_at(&mut client, in_the_corridor(12.0)).await;
        assert_eq!(light.frame().resident_patches, slots);
        let patches = served_patches(&light);
        let alone = solved.solve_among(&solved.lights, &patches.keys().copied().collect());
        least.push(assert_between(&solved, &whole, &alone, &patches));
        client.close().await;
        served.stop().await.expect("a clean end");
    }
    assert!(least[0] < 0.9, "a small matrix knows little: {least:?}");
}

/// Goal: adds and removals along the way leave nothing behind. Method: a camera goes away, everything it saw is
/// replaced, and it comes back. Without hysteresis the resident set is a function of the place.
#[tokio::test]
async fn a_camera_that_comes_back_finds_the_same_light() {
    let world = corridor(48.0, Sky::default());
    let slots = world.patch_count() / 4;
    let served = ServedWorld::start(world.path(), slots, |config| config.engine.hysteresis = 0.0).await;
    let mut client = connect(&served.uri).await;
    let before = served_patches(&*settled_at(&mut client, in_the_corridor(4.0)).await);
    let elsewhere = served_patches(&*settled_at(&mut client, in_the_corridor(36.0)).await);
    assert!(elsewhere.keys().all(|place| !before.contains_key(place)), "nothing in common");
    let after = served_patches(&*settled_at(&mut client, in_the_corridor(4.0)).await);
    assert!(before.keys().eq(after.keys()), "another resident set");
    for (place, before) in &before {
        let gap = (after[place].irradiance - before.irradiance).abs().max_element();
        // One step of the wire's nine bits, where rounding falls to the other side.
        assert!(gap <= before.irradiance.max_element() / 250.0 + 1e-4, "{:?} was {before:?}", after[place]);
    }
    served.stop().await.expect("a clean end");
}

/// Goal: a session's lights are its own, and off is off. Method: the lamps of one of two sessions go out and on again.
#[tokio::test]
async fn lights_off_and_on_again_is_the_light_from_before_and_nobody_elses_business() {
    let world = two_rooms();
    let served = ServedWorld::start(world.path(), world.patch_count(), |_| ()).await;
    let on: Lights =
        earthshine_client::world(&served.uri, &ClientOptions::default()).await.expect("a description").lights;
    let (mut first, mut second) = (connect(&served.uri).await, connect(&served.uri).await);
    let (before, beside) =
        tokio::join!(settled_at(&mut first, IN_THE_FIRST_ROOM), settled_at(&mut second, IN_THE_SECOND_ROOM));
    let brightest = |client: &Client| {
        let patches = served_patches(&client.light());
        patches.values().map(|patch| patch.irradiance.max_element()).fold(0.0, f32::max)
    };
    assert!(brightest(&first) > 100.0);
    first.set_lights(&Lights { emission_scale: 0.0, ..Lights::default() }).expect("an open session");
    light_where(&mut first, "darkness", |light| {
        light.frame().settled && served_patches(light).values().all(|patch| patch.irradiance == Rgb::ZERO)
    })
    .await;
    first.set_lights(&on).expect("an open session");
    light_where(&mut first, "the light from before", |light| {
        light.frame().settled && light.volumes() == before.volumes()
    })
    .await;
    assert_eq!(second.light().volumes(), beside.volumes(), "the other session's light has not moved");
    // The same world for both, wherever they stand.
    assert_eq!(served_patches(&before).len(), served_patches(&beside).len());
    drop(first);
    second.close().await;
    served.stop().await.expect("a clean end");
}

/// Goal: a stop in the middle of everything is a clean one. Method: sessions whose tiles are still being loaded and
/// whose patches are still being added; then the signal.
#[tokio::test]
async fn a_server_that_is_busy_drains() {
    let world = corridor(48.0, Sky::default());
    let slow = |config: &mut earthshine_server::Config| config.engine.adds_per_tick_max = 1;
    let served = ServedWorld::start(world.path(), world.patch_count(), slow).await;
    let mut clients = Vec::new();
    for x in [2.0, 20.0, 40.0] {
        let mut client = connect(&served.uri).await;
        client
            .set_camera(earthshine_client::Camera {
                position: in_the_corridor(x),
                forward: Vec3::X,
                velocity: Vec3::ZERO,
            })
            .expect("an open session");
        light_where(&mut client, "the first light", |light| light.patch_count() > 0).await;
        assert!(!client.light().frame().settled, "there is still work to do");
        clients.push(client);
    }
    served.stop().await.expect("a clean end");
    for client in &mut clients {
        let error = within("the end of a session", async {
            loop {
                if let Err(error) = client.next_light().await {
                    return error;
                }
            }
        })
        .await;
        assert!(matches!(&error, ClientError::Lost { cause } if cause.contains("shuts down")), "{error}");
        assert!(client.light().patch_count() > 0, "the last light stays readable");
    }
}
