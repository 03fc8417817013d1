//! A tiny lighting server: one world, one volume, good or bad manners.

#![expect(clippy::unwrap_used, reason = "a panic is how a test fails")]

use earthshine_protocol::v1::{
    self,
    client_message::Message as FromClient,
    lighting_server::{Lighting, LightingServer},
    server_message::Message as ToClient,
};
use earthshine_volume::rgb9e5;
use glam::Vec3;
use std::sync::{Arc, Mutex};
use tokio::sync::mpsc;
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::{Request, Response, Status, Streaming};

/// What the server does wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Behaviour {
    Good,
    WrongVersion,
    FutureWelcome,
    Busy,
    Silent,
    BadDelta,
    Drain,
    HangUp,
}

pub(crate) struct Server {
    pub(crate) uri: String,
    log: Arc<Mutex<Vec<String>>>,
}

impl Server {
    /// What clients said, in words.
    pub(crate) fn log(&self) -> Vec<String> {
        self.log.lock().unwrap().clone()
    }
}

pub(crate) async fn start(behaviour: Behaviour) -> Server {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let uri = format!("http://{}", listener.local_addr().unwrap());
    let log = Arc::new(Mutex::new(Vec::new()));
    let service = LightingServer::new(Service { behaviour, log: Arc::clone(&log) });
    tokio::spawn(
        tonic::transport::Server::builder()
            .add_service(service)
            .serve_with_incoming(TcpListenerStream::new(listener)),
    );
    Server { uri, log }
}

struct Service {
    behaviour: Behaviour,
    log: Arc<Mutex<Vec<String>>>,
}

type Outgoing = mpsc::Sender<Result<v1::ServerMessage, Status>>;

async fn send(to: &Outgoing, message: ToClient) {
    // A client that left is no fault of the server.
    to.send(Ok(v1::ServerMessage { message: Some(message) })).await.ok();
}

fn fatal(code: v1::ErrorCode) -> ToClient {
    ToClient::Error(v1::Error { code: code.into(), cause: "because".to_owned(), fatal: true })
}

fn welcome(protocol: u32) -> ToClient {
    ToClient::Welcome(v1::Welcome {
        protocol,
        session: 1,
        world: "loopback".to_owned(),
        voxel_edge_m: 1.0,
        ..v1::Welcome::default()
    })
}

fn volume() -> ToClient {
    ToClient::Volume(v1::Volume {
        volume: 7,
        level: 0,
        origin: None,
        dims: Some(v1::Dims { x: 8, y: 1, z: 1 }),
        voxel_edge_m: 1.0,
        generation: 0,
    })
}

/// `x` lx under camera x.
fn answer(camera: &v1::CameraUpdate, generation: u64) -> v1::Delta {
    let x = camera.position.unwrap().x;
    v1::Delta {
        volume: 7,
        from_generation: generation,
        to_generation: generation + 1,
        camera_sequence: camera.sequence,
        voxels: vec![x as u32],
        present: vec![0b100],
        irradiance: vec![rgb9e5::encode(Vec3::splat(x))],
        quality: vec![255],
        complete: true,
        frame: Some(v1::FrameQuality { settled: true, ..v1::FrameQuality::default() }),
        ..v1::Delta::default()
    }
}

async fn converse(
    behaviour: Behaviour,
    log: Arc<Mutex<Vec<String>>>,
    mut from: Streaming<v1::ClientMessage>,
    to: Outgoing,
) {
    let note = |line: String| log.lock().unwrap().push(line);
    let hello = from.message().await;
    assert!(matches!(hello, Ok(Some(v1::ClientMessage { message: Some(FromClient::Hello(_)) }))));
    match behaviour {
        Behaviour::WrongVersion => return send(&to, fatal(v1::ErrorCode::Version)).await,
        Behaviour::Busy => return send(&to, fatal(v1::ErrorCode::Busy)).await,
        Behaviour::FutureWelcome => return send(&to, welcome(99)).await,
        Behaviour::Silent => std::future::pending().await,
        _ => send(&to, welcome(1)).await,
    }
    send(&to, volume()).await;
    // Of a kind that this client has never heard of.
    to.send(Ok(v1::ServerMessage { message: None })).await.ok();
    let mut generation = 0;
    while let Ok(Some(message)) = from.message().await {
        match message.message {
            Some(FromClient::Camera(camera)) => {
                let mut delta = answer(&camera, generation);
                match behaviour {
                    Behaviour::BadDelta => delta.voxels[0] = 8,
                    Behaviour::Drain => return send(&to, fatal(v1::ErrorCode::Draining)).await,
                    Behaviour::HangUp => return,
                    _ => {}
                }
                generation += 1;
                send(&to, ToClient::Delta(delta)).await;
            }
            Some(FromClient::Lights(lights)) => note(format!("lights {}", lights.lights.len())),
            Some(FromClient::Ack(ack)) => note(format!("ack {} {}", ack.volume, ack.generation)),
            Some(FromClient::Bye(_)) => return note("bye".to_owned()),
            other => note(format!("{other:?}")),
        }
    }
}

#[tonic::async_trait]
impl Lighting for Service {
    type SessionStream = ReceiverStream<Result<v1::ServerMessage, Status>>;

    async fn session(
        &self,
        request: Request<Streaming<v1::ClientMessage>>,
    ) -> Result<Response<Self::SessionStream>, Status> {
        let (to, outgoing) = mpsc::channel(8);
        tokio::spawn(converse(self.behaviour, Arc::clone(&self.log), request.into_inner(), to));
        Ok(Response::new(ReceiverStream::new(outgoing)))
    }

    async fn world(&self, request: Request<v1::WorldRequest>) -> Result<Response<v1::WorldInfo>, Status> {
        if let Some(name) = &request.get_ref().world {
            return Err(Status::not_found(format!("no world {name}")));
        }
        Ok(Response::new(v1::WorldInfo {
            world: "loopback".to_owned(),
            patch_count: 42,
            ..v1::WorldInfo::default()
        }))
    }
}
