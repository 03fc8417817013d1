//! How the service starts, refuses to start, and stops.

use crate::world::{Raw, Service, config, within, write};
use earthshine_client::{Camera, Client, ClientError, ClientOptions, Vec3};
use earthshine_protocol::v1::ErrorCode;
use earthshine_server::{Config, Server, ServerError};
use earthshine_tiles::{Manifest, PatchBuilder};
use std::time::{Duration, Instant};
use tonic::transport::Channel;
use tonic_health::pb::{
    HealthCheckRequest, health_check_response::ServingStatus, health_client::HealthClient,
};
use tonic_reflection::pb::v1::{
    ServerReflectionRequest, server_reflection_client::ServerReflectionClient,
    server_reflection_request::MessageRequest, server_reflection_response::MessageResponse,
};

#[tokio::test]
async fn a_port_in_use_names_the_address_and_the_cure() {
    let service = Service::start(|_| ()).await;
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    for key in ["listen", "admin_listen"] {
        let mut config = config(folder.path());
        let (taken, entry) = match key {
            "listen" => (&service.address, &mut config.listen),
            _ => (&service.admin, &mut config.admin_listen),
        };
        *entry = taken.parse().unwrap();
        let error = Server::bind(config).await.unwrap_err();
        assert!(matches!(error, ServerError::AddressInUse { .. }), "{error}");
        assert_eq!(error.exit_code(), 6);
        let message = error.to_string();
        assert!(message.contains(taken) && message.contains(&format!("`{key}`")), "{message}");
    }
    service.stop().await;
}

#[tokio::test]
async fn a_missing_world_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = Server::bind(config(&folder.path().join("nowhere"))).await.unwrap_err();
    assert_eq!(error.exit_code(), 4);
    assert!(
        error.to_string().contains("nowhere") && error.to_string().contains("earthshine bake"),
        "{error}"
    );
    // Damaged rather than missing.
    std::fs::write(folder.path().join("world.toml"), "format_version = ").unwrap();
    let error = Server::bind(config(folder.path())).await.unwrap_err();
    assert_eq!(error.exit_code(), 4);
}

#[tokio::test]
async fn a_world_of_clusters_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let mut manifest = Manifest::load(folder.path()).unwrap();
    manifest.parameters.method.builder = PatchBuilder::Clustered;
    manifest.save(folder.path()).unwrap();
    let error = Server::bind(config(folder.path())).await.unwrap_err();
    assert!(matches!(error, ServerError::ClusteredWorld { .. }), "{error}");
    assert_eq!(error.exit_code(), 4);
    assert!(error.to_string().contains("--builder clustered"), "{error}");
}

#[tokio::test]
async fn an_impossible_setting_is_refused_before_anything_is_bound() {
    let config = Config { tick_rate_hz: 0.0, ..Config::default() };
    let error = Server::bind(config).await.unwrap_err();
    assert_eq!(error.exit_code(), 5);
    assert!(error.to_string().contains("tick_rate_hz"), "{error}");
}

#[tokio::test]
async fn a_damaged_tile_costs_its_light_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let world = folder.path().to_owned();
    let service = Service::start(|config| {
        config.engine.retries_max = 0;
        config.world = world;
        for entry in walk(&config.world) {
            if entry.extension().is_none_or(|extension| extension != "toml") {
                let mut bytes = std::fs::read(&entry).unwrap();
                let last = bytes.len() - 1;
                bytes[last] ^= 1;
                std::fs::write(&entry, bytes).unwrap();
            }
        }
    })
    .await;
    let client = Client::connect(&service.uri, ClientOptions::default()).await.unwrap();
    client.set_camera(Camera { position: Vec3::splat(5.0), forward: Vec3::X, velocity: Vec3::ZERO }).unwrap();
    service.metric_reaches("earthshine_tiles_failed_total", 1.0).await;
    service.metric_reaches("earthshine_engine_chunks_quarantined", 1.0).await;
    assert_eq!(client.light().patch_count(), 0);
    assert!(client.ended().is_none());
    client.close().await;
    service.stop().await;
}

fn walk(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] }).collect()
}

#[tokio::test]
async fn a_drain_says_goodbye_to_everybody_in_time() {
    let mut service = Service::start(|_| ()).await;
    within(async {
        // Ready with the engine's first tick.
        while service.get("/ready").await.0 != "HTTP/1.1 200 OK" {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    })
    .await;
    let mut raw = Raw::greeted(&service.uri).await;
    let mut silent = Raw::open(&service.uri).await;
    let mut client = Client::connect(&service.uri, ClientOptions::default()).await.unwrap();
    client.set_camera(Camera { position: Vec3::splat(5.0), forward: Vec3::X, velocity: Vec3::ZERO }).unwrap();
    within(client.next_light()).await.unwrap();
    let started = Instant::now();
    service.ask_to_stop();
    assert_eq!(raw.hear_end().await.code(), ErrorCode::Draining);
    assert_eq!(silent.hear_end().await.code(), ErrorCode::Draining);
    let lost = within(async {
        loop {
            if let Err(error) = client.next_light().await {
                return error;
            }
        }
    })
    .await;
    assert!(matches!(&lost, ClientError::Lost { cause } if cause.contains("shuts down")), "{lost}");
    let address = service.address.clone();
    service.join().await.unwrap();
    assert!(started.elapsed() < Duration::from_secs(5));
    assert!(tokio::net::TcpStream::connect(address).await.is_err(), "nobody listens any more");
}

#[tokio::test]
async fn operators_see_counters_health_and_readiness() {
    let service = Service::start(|_| ()).await;
    let mut client = Client::connect(&service.uri, ClientOptions::default()).await.unwrap();
    client.set_camera(Camera { position: Vec3::splat(5.0), forward: Vec3::X, velocity: Vec3::ZERO }).unwrap();
    within(client.next_light()).await.unwrap();
    service.metric_reaches("earthshine_engine_resident_patches", 2.0).await;
    assert_eq!(service.metric("earthshine_tiles_loaded_total").await, 1.0);
    assert_eq!(service.metric("earthshine_engine_patches_added_total").await, 2.0);
    for counter in
        ["earthshine_sent_bytes_total", "earthshine_received_bytes_total", "earthshine_tick_seconds_count"]
    {
        assert!(service.metric(counter).await > 0.0, "{counter}");
    }
    assert_eq!(service.get("/health").await, ("HTTP/1.1 200 OK".to_owned(), "alive\n".to_owned()));
    assert_eq!(service.get("/nowhere").await.0, "HTTP/1.1 404 Not Found");
    client.close().await;
    service.stop().await;
}

#[tokio::test]
async fn grpc_health_and_reflection_answer() {
    let service = Service::start(|_| ()).await;
    let channel = Channel::from_shared(service.uri.clone()).unwrap().connect().await.unwrap();
    let mut health = HealthClient::new(channel.clone());
    for name in ["", "earthshine.v1.Lighting"] {
        let request = HealthCheckRequest { service: name.to_owned() };
        let status = health.check(request).await.unwrap().into_inner().status();
        assert_eq!(status, ServingStatus::Serving, "{name}");
    }
    let mut reflection = ServerReflectionClient::new(channel.clone());
    let message_request = Some(MessageRequest::ListServices(String::new()));
    let request = ServerReflectionRequest { host: String::new(), message_request };
    let mut answers =
        reflection.server_reflection_info(tokio_stream::iter([request])).await.unwrap().into_inner();
    let answer = within(answers.message()).await.unwrap().unwrap().message_response.unwrap();
    let MessageResponse::ListServicesResponse(list) = answer else { panic!("{answer:?}") };
    assert!(list.service.iter().any(|service| service.name == "earthshine.v1.Lighting"), "{list:?}");
    drop((health, answers, reflection, channel));
    service.stop().await;
}
