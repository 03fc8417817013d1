//! What no client should do: each ends that client alone, in time, with the reason said.

use crate::world::{Raw, Service, hello, within};
use earthshine_client::{Camera, Client, ClientError, ClientOptions, Vec3};
use earthshine_protocol::v1::{self, ErrorCode, client_message::Message, server_message};
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

/// The service still works for everybody else.
async fn assert_serves(service: &Service) {
    let mut client = Client::connect(&service.uri, ClientOptions::default()).await.unwrap();
    client.set_camera(Camera { position: Vec3::splat(5.0), forward: Vec3::X, velocity: Vec3::ZERO }).unwrap();
    within(client.next_light()).await.unwrap();
    client.close().await;
}

#[tokio::test]
async fn a_wrong_version_is_refused_with_both_named() {
    let service = Service::start(|_| ()).await;
    let mut raw = Raw::open(&service.uri).await;
    raw.say(Message::Hello(v1::Hello { protocol_min: 7, protocol_max: 9, ..hello() })).await;
    let error = raw.hear_end().await;
    assert_eq!(error.code(), ErrorCode::Version);
    assert!(error.cause.contains("7 to 9") && error.cause.contains("this server 1 to 1"), "{}", error.cause);
    assert_serves(&service).await;
    service.stop().await;
}

#[tokio::test]
async fn an_unknown_world_and_a_missing_hello_are_refused() {
    let service = Service::start(|_| ()).await;
    let options = ClientOptions { world: Some("village".to_owned()), ..ClientOptions::default() };
    let error = Client::connect(&service.uri, options).await.unwrap_err();
    assert!(matches!(&error, ClientError::Refused { cause } if cause.contains("village")), "{error}");
    let mut raw = Raw::open(&service.uri).await;
    raw.say_camera(1, 0.0).await;
    assert_eq!(raw.hear_end().await.code(), ErrorCode::HelloExpected);
    let mut raw = Raw::greeted(&service.uri).await;
    raw.say(Message::Hello(hello())).await;
    assert_eq!(raw.hear_end().await.code(), ErrorCode::HelloExpected);
    assert_eq!(service.metric("earthshine_sessions_failed_total").await, 3.0);
    service.stop().await;
}

#[tokio::test]
async fn impossible_lights_and_cameras_change_nothing() {
    let service = Service::start(|_| ()).await;
    let mut raw = Raw::greeted(&service.uri).await;
    let lamp = v1::PointLight {
        intensity: Some(v1::Rgb { red: -1.0, green: 0.0, blue: 0.0 }),
        ..Default::default()
    };
    let lamp = v1::Light { kind: Some(v1::light::Kind::Point(lamp)) };
    raw.say(Message::Lights(v1::Lights { lights: vec![lamp], ..v1::Lights::default() })).await;
    let server_message::Message::Error(error) = raw.hear().await else { panic!("an error") };
    assert!(!error.fatal && error.cause.contains("light 0: the intensity is negative"), "{error:?}");
    raw.say_camera(1, f32::NAN).await;
    raw.say(Message::Ack(v1::Ack { volume: 0, generation: 99 })).await;
    raw.say_camera(2, 6.5).await;
    assert_eq!(raw.hear_delta().await.camera_sequence, 2);
    assert_eq!(service.metric("earthshine_messages_ignored_total").await, 3.0);
    service.stop().await;
}

/// Goal: whoever sends lights of another unit hears it, once, and gets them. Method: a lamp of 1e12 cd, three times.
#[tokio::test]
async fn blinding_lights_are_remarked_on_once_a_session() {
    let service = Service::start(|_| ()).await;
    for _session in 0..2 {
        let mut raw = Raw::greeted(&service.uri).await;
        let lamp = v1::PointLight {
            intensity: Some(v1::Rgb { red: 0.0, green: 1e12, blue: 0.0 }),
            ..Default::default()
        };
        let lamp = v1::Light { kind: Some(v1::light::Kind::Point(lamp)) };
        for _time in 0..3 {
            raw.say(Message::Lights(v1::Lights { lights: vec![lamp], ..v1::Lights::default() })).await;
        }
        let server_message::Message::Error(error) = raw.hear().await else { panic!("an error") };
        assert!(!error.fatal && error.code() == ErrorCode::Unlikely, "{error:?}");
        assert!(error.cause.contains("light 0 has an intensity of 1.0e12 cd or lx"), "{error:?}");
        // What comes next is light, and no second remark before it.
        raw.say_camera(1, 6.5).await;
        loop {
            match raw.hear().await {
                server_message::Message::Error(error) => panic!("twice: {error:?}"),
                server_message::Message::Delta(delta) if delta.camera_sequence == 1 => break,
                _ => (),
            }
        }
    }
    assert_eq!(service.metric("earthshine_messages_ignored_total").await, 0.0, "they were acted upon");
    service.stop().await;
}

#[tokio::test]
async fn garbage_on_the_port_is_hung_up_on() {
    let service = Service::start(|_| ()).await;
    for garbage in [&b"GET / HTTP/1.1\r\nhost: x\r\n\r\n"[..], &[0xff; 4096][..]] {
        let mut stream = TcpStream::connect(&service.address).await.unwrap();
        stream.write_all(garbage).await.unwrap();
        let mut answer = Vec::new();
        // A reset is an end too.
        drop(within(stream.read_to_end(&mut answer)).await);
    }
    // The right greeting, then garbage.
    let mut stream = TcpStream::connect(&service.address).await.unwrap();
    stream.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n").await.unwrap();
    stream.write_all(&[0xee; 4096]).await.unwrap();
    drop(within(stream.read_to_end(&mut Vec::new())).await);
    assert_serves(&service).await;
    service.stop().await;
}

#[tokio::test]
async fn an_oversize_message_ends_its_session_alone() {
    let service = Service::start(|config| config.message_bytes_max = 4096).await;
    let mut raw = Raw::greeted(&service.uri).await;
    let lights = vec![v1::Light::default(); 4000];
    raw.say(Message::Lights(v1::Lights { lights, ..v1::Lights::default() })).await;
    let error = raw.hear_end().await;
    assert_eq!(error.code(), ErrorCode::Invalid);
    assert!(error.cause.contains("4096"), "{}", error.cause);
    assert_serves(&service).await;
    service.stop().await;
}

#[tokio::test]
async fn silent_peers_are_closed() {
    let service = Service::start(|config| config.hello_timeout_s = 0.2).await;
    let started = Instant::now();
    // Half of a greeting, then nothing.
    let mut silent = TcpStream::connect(&service.address).await.unwrap();
    silent.write_all(b"PRI * HTTP/2.0").await.unwrap();
    // A stream without a hello.
    let mut raw = Raw::open(&service.uri).await;
    let error = raw.hear_end().await;
    assert_eq!(error.code(), ErrorCode::Silent);
    assert!(error.cause.contains("hello_timeout_s"), "{}", error.cause);
    drop(within(silent.read_to_end(&mut Vec::new())).await);
    assert!(started.elapsed() >= Duration::from_millis(200));
    service.metric_reaches("earthshine_connections_silent_total", 1.0).await;
    assert_eq!(service.metric("earthshine_sessions").await, 0.0);
    service.stop().await;
}

#[tokio::test]
async fn an_idle_session_is_closed() {
    let service = Service::start(|config| config.idle_timeout_s = 0.2).await;
    let mut raw = Raw::greeted(&service.uri).await;
    let error = raw.hear_end().await;
    assert_eq!(error.code(), ErrorCode::Silent);
    assert!(error.cause.contains("idle_timeout_s"), "{}", error.cause);
    service.stop().await;
}

/// Goal: a peer that vanished without a word frees its place. Method: a client behind a proxy that stops
/// passing bytes but keeps both of its connections open.
#[tokio::test]
async fn a_half_open_connection_is_found_by_keepalive() {
    let service = Service::start(|config| {
        config.keepalive_interval_s = 0.2;
        config.keepalive_timeout_s = 0.2;
    })
    .await;
    let proxy = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let uri = format!("http://{}", proxy.local_addr().unwrap());
    let address = service.address.clone();
    let passing = tokio::spawn(async move {
        let (mut near, _) = proxy.accept().await.unwrap();
        let mut far = TcpStream::connect(address).await.unwrap();
        let copying = tokio::io::copy_bidirectional(&mut near, &mut far);
        drop(tokio::time::timeout(Duration::from_millis(500), copying).await);
        // Frozen: neither side is told.
        tokio::time::sleep(Duration::from_secs(60)).await;
    });
    let _raw = Raw::greeted(&uri).await;
    assert_eq!(service.metric("earthshine_sessions").await, 1.0);
    within(async {
        while service.metric("earthshine_sessions").await > 0.0 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    })
    .await;
    passing.abort();
    service.stop().await;
}

#[tokio::test]
async fn sessions_are_bounded_and_a_place_is_free_again_after_a_goodbye() {
    let service = Service::start(|config| config.engine.sessions_max = 1).await;
    let first = Client::connect(&service.uri, ClientOptions::default()).await.unwrap();
    let error = Client::connect(&service.uri, ClientOptions::default()).await.unwrap_err();
    assert!(
        matches!(&error, ClientError::Refused { cause } if cause.contains("engine.sessions_max")),
        "{error}"
    );
    first.close().await;
    within(async {
        while service.metric("earthshine_sessions").await > 0.0 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    })
    .await;
    assert_serves(&service).await;
    assert_eq!(service.metric("earthshine_engine_events_ignored_total").await, 0.0);
    service.stop().await;
}

#[tokio::test]
async fn cameras_beyond_the_rate_are_merged_and_the_newest_arrives() {
    let service = Service::start(|config| config.camera_rate_max_hz = 10.0).await;
    let mut raw = Raw::greeted(&service.uri).await;
    for sequence in 1..=50 {
        raw.say_camera(sequence, 6.5).await;
    }
    let mut answered = 0;
    while answered < 50 {
        let delta = raw.hear_delta().await;
        answered = delta.camera_sequence;
        raw.say(Message::Ack(v1::Ack { volume: 0, generation: delta.to_generation })).await;
    }
    assert!(service.metric("earthshine_cameras_superseded_total").await >= 40.0);
    service.stop().await;
}
