//! The main path: hello, camera, volume, delta, and the light is right.

use crate::plates::{CAMERA, WIRE_REL, plates_error, settled};
use crate::world::{
    AIR_SHARE, AIR_VOXEL, EMITTED, POSITIONS, REFLECTANCES, Raw, Service, closed_form, within,
};
use earthshine_client::{Client, ClientOptions, Light, Lights, Vec3};
use earthshine_protocol::v1::{
    self, client_message::Message, lighting_client::LightingClient, server_message,
};

fn assert_light(light: &Light, factor: f32) {
    let found = plates_error(light, factor);
    assert!(found < WIRE_REL, "{found}");
}

/// What arrives between the plates from the lamp's side.
fn air() -> Vec3 {
    AIR_SHARE * (EMITTED + REFLECTANCES[0] * closed_form()[0])
}

/// Between the plates what the lamp sends is there, at once with the plates' own light.
fn assert_air(light: &Light) {
    let centre = AIR_VOXEL.as_vec3() + 0.5;
    let found = light.lookup(centre + Vec3::X * 0.25, Vec3::NEG_X).expect("light in the air");
    let expected = air();
    let error = (found.irradiance - expected).abs().max_element() / expected.max_element();
    assert!(error < 1.0 / 400.0, "{:?} instead of {expected:?}", found.irradiance);
    assert!((found.quality - 1.0).abs() < 1e-3);
    assert_eq!(light.lookup(centre, Vec3::X), None, "only one direction has a receiver");
}

#[tokio::test]
async fn two_plates_are_lit_as_the_closed_form_says() {
    let service = Service::start(|_| ()).await;
    let mut client = Client::connect(&service.uri, ClientOptions::default()).await.unwrap();
    assert_eq!(client.session().world, "plates");
    client.set_camera(CAMERA).unwrap();
    let light = settled(&mut client).await;
    assert_eq!(light.patch_count(), 3, "two patches and a receiver");
    assert_light(&light, 1.0);
    assert_air(&light);

    // Twice the emission, twice the light.
    client.set_lights(&Lights { emission_scale: 2.0, ..Lights::default() }).unwrap();
    within(async {
        let bright = closed_form()[1].x * 1.9;
        while client.light().lookup(POSITIONS[1], Vec3::NEG_X).is_none_or(|read| read.irradiance.x < bright) {
            client.next_light().await.unwrap();
        }
    })
    .await;
    assert_light(&client.light(), 2.0);
    client.close().await;
    service.stop().await;
}

#[tokio::test]
async fn two_clients_at_once_have_their_own_lights() {
    let service = Service::start(|_| ()).await;
    let mut first = Client::connect(&service.uri, ClientOptions::default()).await.unwrap();
    let mut second = Client::connect(&service.uri, ClientOptions::default()).await.unwrap();
    assert_ne!(first.session().id, second.session().id);
    second.set_lights(&Lights { emission_scale: 0.5, ..Lights::default() }).unwrap();
    first.set_camera(CAMERA).unwrap();
    second.set_camera(CAMERA).unwrap();
    assert_light(&*settled(&mut first).await, 1.0);
    assert_light(&*settled(&mut second).await, 0.5);
    assert_eq!(service.metric("earthshine_sessions").await, 2.0);
    drop(first);
    // The engine lets go of the first, the second goes on.
    within(async {
        while service.metric("earthshine_engine_resident_patches").await > 2.0 {
            tokio::task::yield_now().await;
        }
    })
    .await;
    assert_light(&second.light(), 0.5);
    second.close().await;
    service.stop().await;
}

#[tokio::test]
async fn every_camera_gets_its_answer_and_only_changes_are_sent() {
    let service = Service::start(|_| ()).await;
    let mut raw = Raw::greeted(&service.uri).await;
    raw.say_camera(1, 6.5).await;
    let server_message::Message::Volume(volume) = raw.hear().await else { panic!("a volume comes first") };
    assert_eq!((volume.voxel_edge_m, volume.dims.unwrap().x), (1.0, 128));
    let mut held = 0;
    let mut light_sent = 0;
    let mut sequence = 1;
    // Light arrives; then cameras that change nothing are answered without voxels.
    while sequence < 6 {
        let delta = raw.hear_delta().await;
        assert!(delta.complete && delta.from_generation <= held && delta.to_generation > held);
        held = delta.to_generation;
        light_sent += delta.voxels.len();
        raw.say(Message::Ack(v1::Ack { volume: delta.volume, generation: held })).await;
        if delta.camera_sequence == sequence && delta.frame.unwrap().settled {
            sequence += 1;
            raw.say_camera(sequence, 6.5 + sequence as f32 * 0.01).await;
        }
    }
    assert!((3..=12).contains(&light_sent), "{light_sent} voxels for two patches and a receiver");
    service.stop().await;
}

/// Goal: a slow client costs one dirty set. Method: take one delta, acknowledge nothing while the light
/// changes dozens of times, then acknowledge: one delta brings the newest light.
#[tokio::test]
async fn a_slow_client_gets_one_merged_delta() {
    let service = Service::start(|config| config.deltas_in_flight_max = 1).await;
    let mut raw = Raw::greeted(&service.uri).await;
    raw.say_camera(1, 6.5).await;
    let first = raw.hear_delta().await;
    for step in 1..=40 {
        let emission_scale = Some(1.0 + step as f32);
        raw.say(Message::Lights(v1::Lights { emission_scale, ..v1::Lights::default() })).await;
        let frames = service.metric("earthshine_engine_frames_total").await;
        service.metric_reaches("earthshine_engine_frames_total", frames + 1.0).await;
    }
    assert_eq!(service.metric("earthshine_deltas_total").await, 1.0, "nothing is sent before the ack");
    raw.say(Message::Ack(v1::Ack { volume: first.volume, generation: first.to_generation })).await;
    let merged = raw.hear_delta().await;
    assert_eq!(merged.from_generation, first.to_generation);
    assert_eq!(merged.voxels.len(), 3);
    let [lamp, wall] = closed_form();
    let newest = [lamp, air(), wall]
        .map(|light| earthshine_volume::rgb9e5::encode(light * 41.0 / merged.light_unit_lx));
    assert_eq!(merged.irradiance, newest);
    assert!(service.metric("earthshine_frames_skipped_total").await >= 30.0);

    // A client that lost its light says so, and gets all of it.
    raw.say(Message::Ack(v1::Ack { volume: first.volume, generation: 0 })).await;
    let whole = raw.hear_delta().await;
    assert_eq!((whole.from_generation, whole.voxels.len()), (0, 3));
    service.stop().await;
}

#[tokio::test]
async fn a_small_volume_follows_the_camera() {
    let service = Service::start(|config| {
        config.volume_dims_max = [8, 8, 8];
        config.volume_snap_voxels = 2;
    })
    .await;
    let mut raw = Raw::greeted(&service.uri).await;
    let mut held = 0;
    let mut sequence = 0;
    let mut lit = Vec::new();
    // Near both plates, beyond the wall, and far away.
    for x in [6.5, 9.5, 40.0] {
        sequence += 1;
        raw.say_camera(sequence, x).await;
        let mut last = None;
        loop {
            match raw.hear().await {
                server_message::Message::Volume(volume) => {
                    let (origin, edge) = (volume.origin.unwrap().x as f32, volume.dims.unwrap().x as f32);
                    assert!((origin..origin + edge).contains(&x), "{x} is outside of {volume:?}");
                    last = Some(volume.origin.unwrap().x);
                }
                server_message::Message::Delta(delta) => {
                    held = delta.to_generation.max(held);
                    raw.say(Message::Ack(v1::Ack { volume: delta.volume, generation: held })).await;
                    if delta.camera_sequence == sequence && delta.frame.unwrap().settled {
                        break;
                    }
                }
                other => panic!("{other:?}"),
            }
        }
        lit.push(last.expect("each place is another volume"));
    }
    assert_eq!(lit, [2, 4, 36]);
    service.stop().await;
}

#[tokio::test]
async fn the_world_is_described_without_a_session() {
    let service = Service::start(|_| ()).await;
    let mut client = LightingClient::connect(service.uri.clone()).await.unwrap();
    let info = client.world(v1::WorldRequest::default()).await.unwrap().into_inner();
    assert_eq!(
        (info.world.as_str(), info.chunk_count, info.patch_count, info.nonzero_count),
        ("plates", 1, 2, 3)
    );
    assert_eq!(info.lights.unwrap().emission_scale, Some(1.0));
    let wrong = v1::WorldRequest { world: Some("town".to_owned()) };
    assert_eq!(client.world(wrong).await.unwrap_err().code(), tonic::Code::NotFound);
    service.stop().await;
}
