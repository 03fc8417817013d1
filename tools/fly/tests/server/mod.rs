//! A tiny lighting server: a lit floor at y = 0 for x below 0, in a volume that follows the camera.
#![expect(clippy::unwrap_used, reason = "a panic is how a test fails")]

use earthshine_protocol::v1::{
    self,
    client_message::Message as FromClient,
    lighting_server::{Lighting, LightingServer},
    server_message::Message as ToClient,
};
use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};
use tokio::sync::mpsc;
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::{Request, Response, Status, Streaming};

/// From a camera to its light.
pub(crate) const ANSWER_DELAY: Duration = Duration::from_millis(15);

const DIMS: [u32; 3] = [16, 8, 16];
/// RGB9E5 of (1, 1, 1).
const ONE: u32 = 256 | 256 << 9 | 256 << 18 | 16 << 27;

pub(crate) struct Server {
    pub(crate) uri: String,
    lights: Arc<AtomicU64>,
}

impl Server {
    pub(crate) fn lights_received(&self) -> u64 {
        self.lights.load(Ordering::Relaxed)
    }
}

pub(crate) async fn start() -> Server {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let uri = format!("http://{}", listener.local_addr().unwrap());
    let lights = Arc::new(AtomicU64::new(0));
    let service = LightingServer::new(Service { lights: Arc::clone(&lights) });
    let incoming = TcpListenerStream::new(listener);
    tokio::spawn(tonic::transport::Server::builder().add_service(service).serve_with_incoming(incoming));
    Server { uri, lights }
}

struct Service {
    lights: Arc<AtomicU64>,
}

type Outgoing = mpsc::Sender<Result<v1::ServerMessage, Status>>;

fn volume(camera: &v1::CameraUpdate) -> v1::Volume {
    let position = camera.position.unwrap();
    let low = |at: f32, dim: u32| at.floor() as i32 - (dim / 2).cast_signed();
    v1::Volume {
        volume: 1,
        origin: Some(v1::VoxelCoord { x: low(position.x, DIMS[0]), y: -4, z: low(position.z, DIMS[2]) }),
        dims: Some(v1::Dims { x: DIMS[0], y: DIMS[1], z: DIMS[2] }),
        voxel_edge_m: 1.0,
        ..v1::Volume::default()
    }
}

/// The whole floor, each time.
fn floor(volume: &v1::Volume, camera_sequence: u64, generation: u64) -> v1::Delta {
    let low = volume.origin.unwrap().x;
    let lit = (0..DIMS[2]).flat_map(|z| (0..DIMS[0]).map(move |x| (x, z)));
    let lit = lit.filter(|&(x, _)| low + x.cast_signed() < 0);
    let indices: Vec<u32> = lit.map(|(x, z)| x + DIMS[0] * (4 + DIMS[1] * z)).collect();
    let before = std::iter::once(0).chain(indices.iter().copied());
    let count = indices.len();
    v1::Delta {
        volume: 1,
        to_generation: generation,
        camera_sequence,
        voxels: indices.iter().zip(before).map(|(index, before)| index - before).collect(),
        present: vec![0b100; count],
        irradiance: vec![ONE; count],
        quality: vec![255; count],
        complete: true,
        ..v1::Delta::default()
    }
}

async fn converse(lights: Arc<AtomicU64>, mut from: Streaming<v1::ClientMessage>, to: Outgoing) {
    let send = async |message| {
        // A client that left is no fault of the server.
        to.send(Ok(v1::ServerMessage { message: Some(message) })).await.ok();
    };
    send(ToClient::Welcome(v1::Welcome { protocol: 1, voxel_edge_m: 1.0, ..v1::Welcome::default() })).await;
    let mut generation = 0;
    while let Ok(Some(message)) = from.message().await {
        match message.message {
            Some(FromClient::Camera(camera)) => {
                tokio::time::sleep(ANSWER_DELAY).await;
                generation += 1;
                let volume = volume(&camera);
                let delta = floor(&volume, camera.sequence, generation);
                send(ToClient::Volume(volume)).await;
                send(ToClient::Delta(delta)).await;
            }
            Some(FromClient::Lights(_)) => {
                lights.fetch_add(1, Ordering::Relaxed);
            }
            Some(FromClient::Bye(_)) => return,
            _ => {}
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
        tokio::spawn(converse(Arc::clone(&self.lights), request.into_inner(), to));
        Ok(Response::new(ReceiverStream::new(outgoing)))
    }

    async fn world(&self, _: Request<v1::WorldRequest>) -> Result<Response<v1::WorldInfo>, Status> {
        Err(Status::unimplemented("not asked by a flight"))
    }
}
