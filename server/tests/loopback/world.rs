//! Two square metres that face each other, one of them a lamp; and a server that serves them.

use earthshine_protocol::v1::{
    self, client_message::Message, lighting_client::LightingClient, server_message,
};
use earthshine_server::{Config, Server, ServerError};
use earthshine_tiles::{
    BakeParameters, ChunkEntry, EncodeOptions, Manifest, encode, format, tile_file_name, tile_hash,
    write_atomic,
};
use earthshine_world::{
    Bounds, Chunk, ChunkCoord, ChunkId, ChunkRows, Column, Direction, LightRig, OccluderMesh, Patch,
    ReceiverPlace, Receivers, Rgb, SamplePoint, Vec3, VoxelCoord,
};
use std::path::Path;
use std::time::Duration;
use tempfile::TempDir;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Streaming;
use tonic::transport::Channel;

/// Emitted exitance of the lamp, lm/m2.
pub(crate) const EMITTED: Rgb = Rgb::new(10.0, 20.0, 30.0);
/// Reflectance of the lamp and of the wall.
pub(crate) const REFLECTANCES: [f32; 2] = [0.5, 0.8];
/// Form factor between them; exact in half precision.
pub(crate) const SHARE: f32 = 0.25;
/// Where a point on the wall, and on the lamp, reads its light: in the middle of the voxel.
pub(crate) const POSITIONS: [Vec3; 2] = [Vec3::new(4.25, 4.5, 4.5), Vec3::new(8.75, 4.5, 4.5)];

/// Irradiance of (lamp, wall): `I_w = F (E + r_l I_l)`, `I_l = F r_w I_w`.
pub(crate) fn closed_form() -> [Rgb; 2] {
    let wall = EMITTED * SHARE / (1.0 - SHARE * SHARE * REFLECTANCES[0] * REFLECTANCES[1]);
    [wall * SHARE * REFLECTANCES[1], wall]
}

fn chunk() -> Chunk {
    let patch = |index: usize, direction: Direction, emission| Patch {
        voxel: VoxelCoord::new(4 + 4 * index as i32, 4, 4),
        direction,
        area: 1.0,
        centroid: POSITIONS[index],
        reflectance: Rgb::splat(REFLECTANCES[index]),
        emission,
        point_first: index as u32,
        point_count: 1,
    };
    let patches = vec![patch(0, Direction::PosX, EMITTED), patch(1, Direction::NegX, Rgb::ZERO)];
    let points =
        patches.iter().map(|p| SamplePoint { position: p.centroid, normal: p.direction.vector() }).collect();
    let id = ChunkId::new(0, ChunkCoord::ZERO);
    let rows = ChunkRows {
        segments: vec![id],
        row_starts: vec![0, 1, 2],
        columns: vec![Column { segment: 0, local: 1 }, Column { segment: 0, local: 0 }],
        shares: vec![SHARE; 2],
        sky_shares: vec![[0.0; 6]; 2],
        absorbed_shares: vec![1.0 - SHARE; 2],
    };
    Chunk { id, patches, points, rows, receivers: receivers(id), occluders: OccluderMesh::default() }
}

/// Half-way between the two, facing the lamp.
pub(crate) const AIR_VOXEL: VoxelCoord = VoxelCoord::new(6, 4, 4);
/// Of what arrives there, what the lamp may send.
pub(crate) const AIR_SHARE: f32 = 0.5;

fn receivers(id: ChunkId) -> Receivers {
    let rows = ChunkRows {
        segments: vec![id],
        row_starts: vec![0, 1],
        columns: vec![Column { segment: 0, local: 0 }],
        shares: vec![AIR_SHARE],
        sky_shares: vec![[0.0; 6]],
        absorbed_shares: vec![1.0 - AIR_SHARE],
    };
    Receivers { places: vec![ReceiverPlace::in_air(AIR_VOXEL, Direction::NegX)], rows }
}

/// Writes the world into `folder`.
pub(crate) fn write(folder: &Path) {
    const WORLD_HASH: u64 = 0x7e57;
    let chunk = chunk();
    let bytes = encode(&chunk, &EncodeOptions::new(WORLD_HASH)).unwrap();
    let hash = tile_hash(&bytes);
    let file = tile_file_name(chunk.id, hash);
    std::fs::create_dir_all(folder.join(&file).parent().unwrap()).unwrap();
    write_atomic(&folder.join(&file), &bytes).unwrap();
    let manifest = Manifest {
        format_version: format::VERSION,
        world_hash: WORLD_HASH,
        content_hash: WORLD_HASH,
        scene: "two plates".to_owned(),
        parameters: BakeParameters::default(),
        bounds: Bounds { min: Vec3::splat(4.0), max: Vec3::new(9.0, 5.0, 5.0) },
        lights: LightRig::emission_only(),
        chunks: vec![ChunkEntry {
            level: 0,
            coord: [0; 3],
            file,
            tile_bytes: bytes.len() as u64,
            tile_hash: hash,
            input_hash: 0,
            patch_count: 2,
            nonzero_count: 2,
            receiver_count: 1,
            receiver_nonzero_count: 1,
        }],
    };
    manifest.save(folder).unwrap();
}

/// A server in the background.
pub(crate) struct Service {
    /// `http://address` for clients.
    pub(crate) uri: String,
    /// `address:port` for clients.
    pub(crate) address: String,
    /// `address:port` for operators.
    pub(crate) admin: String,
    stop: Option<oneshot::Sender<()>>,
    ended: JoinHandle<Result<(), ServerError>>,
    _folder: TempDir,
}

/// Free ports, and time-outs that tests do not notice.
pub(crate) fn config(folder: &Path) -> Config {
    let free = "127.0.0.1:0".parse().unwrap();
    Config {
        world: folder.to_owned(),
        listen: free,
        admin_listen: free,
        tick_rate_hz: 200.0,
        ..Config::default()
    }
}

impl Service {
    /// The two plates, served with what `change` makes of the test's configuration.
    pub(crate) async fn start(change: impl FnOnce(&mut Config)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let world = folder.path().join("plates");
        std::fs::create_dir(&world).unwrap();
        write(&world);
        let mut config = config(&world);
        change(&mut config);
        let server = Server::bind(config).await.unwrap();
        let (address, admin) = (server.local_addr().to_string(), server.admin_addr().to_string());
        let (stop, stopped) = oneshot::channel();
        let ended = tokio::spawn(server.run(async { drop(stopped.await) }));
        Self { uri: format!("http://{address}"), address, admin, stop: Some(stop), ended, _folder: folder }
    }

    /// Asks it to stop, without waiting.
    pub(crate) fn ask_to_stop(&mut self) {
        // Dropping the sender resolves the other end too.
        drop(self.stop.take());
    }

    /// Stops it; it must drain in time and without an error.
    pub(crate) async fn stop(mut self) {
        self.ask_to_stop();
        self.join().await.unwrap();
    }

    /// Waits for its end.
    pub(crate) async fn join(self) -> Result<(), ServerError> {
        within(self.ended).await.unwrap()
    }

    /// Status line and body of an operators' page.
    pub(crate) async fn get(&self, path: &str) -> (String, String) {
        self.ask("GET", path, "", "").await
    }

    /// The same of any request; `headers` end in line breaks.
    pub(crate) async fn ask(&self, method: &str, path: &str, headers: &str, body: &str) -> (String, String) {
        let mut stream = TcpStream::connect(&self.admin).await.unwrap();
        let length = body.len();
        let request = format!(
            "{method} {path} HTTP/1.1\r\nhost: test\r\nconnection: close\r\n{headers}content-length: {length}\r\n\r\n{body}"
        );
        stream.write_all(request.as_bytes()).await.unwrap();
        let mut answer = String::new();
        within(stream.read_to_string(&mut answer)).await.unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (head.lines().next().unwrap().to_owned(), body.to_owned())
    }

    /// The value of the metric `name`.
    pub(crate) async fn metric(&self, name: &str) -> f64 {
        let (_, text) = self.get("/metrics").await;
        let line = text.lines().find(|line| line.split(' ').next() == Some(name));
        line.unwrap_or_else(|| panic!("no {name} in\n{text}")).rsplit(' ').next().unwrap().parse().unwrap()
    }

    /// Waits until the metric `name` is at least `value`.
    pub(crate) async fn metric_reaches(&self, name: &str, value: f64) {
        within(async {
            while self.metric(name).await < value {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        })
        .await;
    }
}

/// No test waits longer than this for anything: long enough for a machine with much else to do.
pub(crate) async fn within<T>(waiting: impl Future<Output = T>) -> T {
    tokio::time::timeout(Duration::from_secs(60), waiting).await.expect("in time")
}

/// A session without the client library.
pub(crate) struct Raw {
    pub(crate) to_server: mpsc::Sender<v1::ClientMessage>,
    pub(crate) from_server: Streaming<v1::ServerMessage>,
}

impl Raw {
    /// A stream on which nothing has been said.
    pub(crate) async fn open(uri: &str) -> Self {
        let channel = Channel::from_shared(uri.to_owned()).unwrap().connect().await.unwrap();
        let (to_server, outgoing) = mpsc::channel(64);
        let answer = LightingClient::new(channel).session(ReceiverStream::new(outgoing)).await.unwrap();
        Self { to_server, from_server: answer.into_inner() }
    }

    /// A session that is welcome.
    pub(crate) async fn greeted(uri: &str) -> Self {
        let mut raw = Self::open(uri).await;
        raw.say(Message::Hello(hello())).await;
        let welcome = raw.hear().await;
        assert!(matches!(welcome, server_message::Message::Welcome(_)), "{welcome:?}");
        raw
    }

    pub(crate) async fn say(&self, message: Message) {
        self.to_server.send(v1::ClientMessage { message: Some(message) }).await.unwrap();
    }

    pub(crate) async fn say_camera(&self, sequence: u64, x: f32) {
        let position = Some(v1::Vector3 { x, y: 4.5, z: 4.5 });
        self.say(Message::Camera(v1::CameraUpdate { sequence, position, ..v1::CameraUpdate::default() }))
            .await;
    }

    /// The next message that is not statistics.
    pub(crate) async fn hear(&mut self) -> server_message::Message {
        loop {
            let message =
                within(self.from_server.message()).await.unwrap().expect("a message before the end");
            match message.message.unwrap() {
                server_message::Message::Statistics(_) => {}
                other => return other,
            }
        }
    }

    /// The next delta; volumes are passed over.
    pub(crate) async fn hear_delta(&mut self) -> v1::Delta {
        loop {
            match self.hear().await {
                server_message::Message::Delta(delta) => return delta,
                server_message::Message::Volume(_) => {}
                other => panic!("{other:?} instead of a delta"),
            }
        }
    }

    /// The fatal error that ends the stream.
    pub(crate) async fn hear_end(&mut self) -> v1::Error {
        loop {
            match self.hear().await {
                server_message::Message::Error(error) => {
                    assert!(error.fatal, "{error:?}");
                    assert!(within(self.from_server.message()).await.unwrap().is_none(), "the stream ends");
                    return error;
                }
                server_message::Message::Delta(_) | server_message::Message::Volume(_) => {}
                other => panic!("{other:?} instead of an error"),
            }
        }
    }
}

pub(crate) fn hello() -> v1::Hello {
    let [protocol_min, protocol_max] = [earthshine_protocol::PROTOCOL_MIN, earthshine_protocol::PROTOCOL_MAX];
    v1::Hello { protocol_min, protocol_max, client_name: "test".to_owned(), ..v1::Hello::default() }
}
