//! The client against a server of a hundred lines, over a real socket.

mod server;

use earthshine_client::{
    Camera, Client, ClientError, ClientOptions, LightSource, Lights, UVec3, Vec3, blocking,
};
use server::{Behaviour, start};
use std::time::Duration;

fn options() -> ClientOptions {
    ClientOptions {
        dims_max: UVec3::splat(8),
        connect_timeout: Duration::from_millis(700),
        ..ClientOptions::default()
    }
}

fn camera(x: f32) -> Camera {
    Camera { position: Vec3::new(x, 0.5, 0.5), forward: Vec3::X, velocity: Vec3::ZERO }
}

/// Goal: what the server means is what the client reads, from hello to bye. Method: the server answers camera x with
/// an up-facing patch of x lx under the camera.
#[tokio::test]
async fn light_follows_the_camera() {
    let server = start(Behaviour::Good).await;
    let mut client = Client::connect(&server.uri, options()).await.unwrap();
    assert_eq!((client.session().world.as_str(), client.session().voxel_edge_m), ("loopback", 1.0));
    assert_eq!(client.light().number(), 0);
    for step in 1..=5u8 {
        let x = f32::from(step) + 0.5;
        let sequence = client.set_camera(camera(x)).unwrap();
        let light = loop {
            let light = client.next_light().await.unwrap();
            if light.camera_sequence() == sequence {
                break light;
            }
        };
        let read = light.lookup(Vec3::new(x, 0.25, 0.5), Vec3::Y).expect("light under the camera");
        assert_eq!(read.irradiance, Vec3::splat(x));
        assert!(light.frame().settled);
    }
    let statistics = client.statistics();
    assert_eq!((statistics.frames, statistics.cameras), (5, 5));
    assert!(statistics.bytes > 0 && statistics.latency.is_some());
    assert_eq!(client.take_answers().iter().map(|a| a.camera_sequence).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);

    let sun = LightSource::Directional {
        direction: Vec3::NEG_Y,
        illuminance: Vec3::splat(9.0),
        angular_diameter_rad: 0.0,
    };
    client.set_lights(&Lights { sources: vec![sun], ..Lights::default() }).unwrap();
    assert!(client.set_camera(camera(f32::NAN)).is_err());
    client.close().await;
    let log = server.log();
    assert!(log.contains(&"lights 1".to_owned()), "{log:?}");
    assert!(log.contains(&"ack 7 5".to_owned()), "{log:?}");
    assert_eq!(log.last().map(String::as_str), Some("bye"), "{log:?}");
}

#[tokio::test]
async fn refusals_and_faults_have_names() {
    let fails = async |behaviour| {
        let server = start(behaviour).await;
        match Client::connect(&server.uri, options()).await {
            Err(error) => error,
            Ok(mut client) => {
                client.set_camera(camera(1.5)).unwrap();
                let error = client.next_light().await.unwrap_err();
                assert_eq!(client.set_camera(camera(1.5)), Err(error.clone()), "and it stays so");
                error
            }
        }
    };
    assert!(matches!(fails(Behaviour::WrongVersion).await, ClientError::Version { .. }));
    assert!(matches!(fails(Behaviour::FutureWelcome).await, ClientError::Version { .. }));
    assert!(matches!(fails(Behaviour::Busy).await, ClientError::Refused { .. }));
    assert!(matches!(fails(Behaviour::Silent).await, ClientError::Timeout { what: "welcome", .. }));
    assert!(matches!(fails(Behaviour::BadDelta).await, ClientError::Protocol { .. }));
    assert!(matches!(fails(Behaviour::Drain).await, ClientError::Lost { .. }));
    assert!(matches!(fails(Behaviour::HangUp).await, ClientError::Lost { .. }));
}

#[tokio::test]
async fn addresses_without_a_server_are_unreachable() {
    for uri in ["http://127.0.0.1:1", "not a uri", ""] {
        let error = Client::connect(uri, options()).await.unwrap_err();
        assert!(matches!(error, ClientError::Unreachable { .. }), "{uri}: {error}");
    }
    // Something that accepts and never speaks.
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let uri = format!("http://{}", listener.local_addr().unwrap());
    let error = Client::connect(&uri, options()).await.unwrap_err();
    assert!(matches!(error, ClientError::Timeout { .. } | ClientError::Unreachable { .. }), "{error}");
}

#[tokio::test]
async fn a_world_is_described_without_a_session() {
    let server = start(Behaviour::Good).await;
    let world = earthshine_client::world(&server.uri, &options()).await.unwrap();
    assert_eq!((world.name.as_str(), world.patch_count), ("loopback", 42));
    let elsewhere = ClientOptions { world: Some("atlantis".into()), ..options() };
    let error = earthshine_client::world(&server.uri, &elsewhere).await;
    assert!(matches!(error, Err(ClientError::Refused { .. })), "{error:?}");
}

#[test]
fn the_blocking_client_needs_no_runtime() {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let server = runtime.block_on(start(Behaviour::Good));
    let mut client = blocking::Client::connect(&server.uri, options()).unwrap();
    let timeout = Duration::from_millis(50);
    assert_eq!(client.next_light(timeout), Err(ClientError::Timeout { what: "light", timeout }));
    client.set_camera(camera(2.5)).unwrap();
    let light = client.next_light(Duration::from_secs(5)).unwrap();
    assert_eq!(light.lookup(Vec3::new(2.5, 0.25, 0.5), Vec3::Y).unwrap().irradiance, Vec3::splat(2.5));
    client.close();
    assert_eq!(server.log().last().map(String::as_str), Some("bye"));
}
