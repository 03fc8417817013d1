//! One filled instance of every message of the schema.

use earthshine_protocol::v1::{self, client_message, light, server_message};
use prost::Message;

type Reader = Box<dyn Fn(&[u8]) -> bool>;

/// A message whose type is forgotten.
pub(crate) struct Sample {
    name: &'static str,
    bytes: Vec<u8>,
    reads_as_same: Reader,
}

impl Sample {
    fn new<M: Message + PartialEq + Default + 'static>(name: &'static str, message: M) -> Self {
        let bytes = message.encode_to_vec();
        let reads_as_same = Box::new(move |bytes: &[u8]| M::decode(bytes).is_ok_and(|read| read == message));
        Self { name, bytes, reads_as_same }
    }

    /// Name of the message, and after a dot which variant of it.
    pub(crate) fn name(&self) -> &'static str {
        self.name
    }

    /// Name of the message alone.
    pub(crate) fn message(&self) -> &'static str {
        self.name.split_once('.').map_or(self.name, |(message, _)| message)
    }

    pub(crate) fn encode(&self) -> Vec<u8> {
        self.bytes.clone()
    }

    pub(crate) fn is_decoded_from(&self, bytes: &[u8]) -> bool {
        (self.reads_as_same)(bytes)
    }
}

fn vector(x: f32) -> v1::Vector3 {
    v1::Vector3 { x, y: -x, z: x + 0.5 }
}

fn rgb(red: f32) -> v1::Rgb {
    v1::Rgb { red, green: red * 2.0, blue: red * 4.0 }
}

fn dims() -> v1::Dims {
    v1::Dims { x: 64, y: 32, z: 300 }
}

fn sun() -> v1::DirectionalLight {
    v1::DirectionalLight {
        direction: Some(vector(0.25)),
        illuminance: Some(rgb(1000.0)),
        angular_diameter_rad: 0.0093,
    }
}

fn lamp() -> v1::PointLight {
    v1::PointLight { position: Some(vector(3.0)), intensity: Some(rgb(80.0)), range_m: Some(12.5) }
}

fn spot() -> v1::SpotLight {
    v1::SpotLight {
        position: Some(vector(4.0)),
        direction: Some(vector(-0.5)),
        intensity: Some(rgb(120.0)),
        inner_cone_rad: 0.25,
        outer_cone_rad: 0.5,
        range_m: Some(8.0),
    }
}

fn sky() -> v1::Sky {
    v1::Sky { lobes: (1..=6).map(|lobe| rgb(lobe as f32)).collect() }
}

fn lights() -> v1::Lights {
    let kinds = [light::Kind::Directional(sun()), light::Kind::Point(lamp()), light::Kind::Spot(spot())];
    v1::Lights {
        lights: kinds.into_iter().map(|kind| v1::Light { kind: Some(kind) }).collect(),
        sky: Some(sky()),
        emission_scale: Some(0.75),
    }
}

fn hello() -> v1::Hello {
    v1::Hello {
        protocol_min: 1,
        protocol_max: 3,
        client_name: "sample 0.1".to_owned(),
        world: Some("town".to_owned()),
        volumes: vec![v1::VolumeWanted { level: 1, dims_max: Some(dims()) }],
        detail: true,
        detail_layers: 3,
    }
}

fn camera() -> v1::CameraUpdate {
    v1::CameraUpdate {
        sequence: 70_000,
        position: Some(vector(10.0)),
        forward: Some(vector(1.0)),
        velocity: Some(vector(2.0)),
    }
}

fn ack() -> v1::Ack {
    v1::Ack { volume: 2, generation: 1 << 40 }
}

fn welcome() -> v1::Welcome {
    v1::Welcome {
        protocol: 1,
        session: 99,
        world: "town".to_owned(),
        voxel_edge_m: 0.5,
        bounds_min: Some(vector(-100.0)),
        bounds_max: Some(vector(100.0)),
        server_version: "earthshine 0.1.0".to_owned(),
        camera_rate_max_hz: 120.0,
        lights_max: 1024,
        client_message_bytes_max: 262_144,
    }
}

fn volume() -> v1::Volume {
    v1::Volume {
        volume: 1,
        level: 2,
        origin: Some(v1::VoxelCoord { x: -300, y: 5, z: -1 }),
        dims: Some(dims()),
        voxel_edge_m: 0.25,
        generation: 12,
    }
}

fn frame() -> v1::FrameQuality {
    v1::FrameQuality {
        resident_patches: 900,
        wanted_patches: 4096,
        stale_direct: 7,
        settled: true,
        missing_near: 3,
    }
}

fn delta() -> v1::Delta {
    v1::Delta {
        volume: 1,
        from_generation: 12,
        to_generation: 400,
        camera_sequence: 31,
        voxels: vec![0, 1, 500],
        present: vec![0b000_101, 0, 0b100_000],
        irradiance: vec![0xF123_4567, 1, 2],
        sky_irradiance: vec![3, 4, 0xFFFF_FFFF],
        quality: vec![0, 128, 255],
        complete: true,
        frame: Some(frame()),
        time_s: 12.125,
        air: vec![0b000_100, 0, 0b100_000],
        plane: vec![128, 0, 0],
        light_unit_lx: 16.0,
        far: vec![0, 64, 200],
        staleness: vec![0, 1, 7],
        tilt: vec![128, 128, 64, 0, 0, 0, 255, 128, 255],
        barred: vec![0b000_001, 0, 0],
        barriers: vec![252, 250, 0, 0],
    }
}

fn statistics() -> v1::Statistics {
    v1::Statistics {
        time_s: 3.5,
        frames_published: 100,
        frames_skipped: 3,
        tick_ms: 4.25,
        resident_patches: 900,
        capacity_patches: 4096,
        tiles_loading: 5,
        tiles_failed: 1,
        messages_ignored: 2,
        sessions: 4,
        matrix_drift: 1e-6,
        promised_radius_m: 16.5,
        promised_speed_m_s: 12.0,
        promise_violations: 2,
        far_share: 0.25,
        fed_share: 0.125,
    }
}

fn error() -> v1::Error {
    v1::Error { code: v1::ErrorCode::Draining.into(), cause: "going down".to_owned(), fatal: true }
}

fn world_info() -> v1::WorldInfo {
    v1::WorldInfo {
        world: "town".to_owned(),
        voxel_edge_m: 0.5,
        chunk_edge_voxels: 16,
        bounds_min: Some(vector(-1.0)),
        bounds_max: Some(vector(1.0)),
        level_count: 1,
        chunk_count: 20,
        patch_count: 1 << 33,
        nonzero_count: 5,
        tile_bytes: 6,
        lights: Some(lights()),
        protocol_min: 1,
        protocol_max: 2,
        server_version: "earthshine 0.1.0".to_owned(),
    }
}

fn from_client(message: client_message::Message) -> v1::ClientMessage {
    v1::ClientMessage { message: Some(message) }
}

fn from_server(message: server_message::Message) -> v1::ServerMessage {
    v1::ServerMessage { message: Some(message) }
}

/// Every message, and every variant of the two that travel.
pub(crate) fn all() -> Vec<Sample> {
    use client_message::Message as Client;
    use server_message::Message as Server;
    vec![
        Sample::new("Vector3", vector(1.0)),
        Sample::new("VoxelCoord", v1::VoxelCoord { x: -1, y: 2, z: i32::MIN }),
        Sample::new("Dims", dims()),
        Sample::new("Rgb", rgb(1.0)),
        Sample::new("VolumeWanted", v1::VolumeWanted { level: 1, dims_max: Some(dims()) }),
        Sample::new("Hello", hello()),
        Sample::new("CameraUpdate", camera()),
        Sample::new("DirectionalLight", sun()),
        Sample::new("PointLight", lamp()),
        Sample::new("SpotLight", spot()),
        Sample::new("Light", v1::Light { kind: Some(light::Kind::Spot(spot())) }),
        Sample::new("Sky", sky()),
        Sample::new("Lights", lights()),
        Sample::new("Ack", ack()),
        Sample::new("Bye", v1::Bye {}),
        Sample::new("ClientMessage.Hello", from_client(Client::Hello(hello()))),
        Sample::new("ClientMessage.CameraUpdate", from_client(Client::Camera(camera()))),
        Sample::new("ClientMessage.Lights", from_client(Client::Lights(lights()))),
        Sample::new("ClientMessage.Ack", from_client(Client::Ack(ack()))),
        Sample::new("ClientMessage.Bye", from_client(Client::Bye(v1::Bye {}))),
        Sample::new("ClientMessage", from_client(Client::Ack(ack()))),
        Sample::new("Welcome", welcome()),
        Sample::new("Volume", volume()),
        Sample::new("Delta", delta()),
        Sample::new("FrameQuality", frame()),
        Sample::new("Statistics", statistics()),
        Sample::new("Error", error()),
        Sample::new("ServerMessage.Welcome", from_server(Server::Welcome(welcome()))),
        Sample::new("ServerMessage.Volume", from_server(Server::Volume(volume()))),
        Sample::new("ServerMessage.Delta", from_server(Server::Delta(delta()))),
        Sample::new("ServerMessage.Statistics", from_server(Server::Statistics(statistics()))),
        Sample::new("ServerMessage.Error", from_server(Server::Error(error()))),
        Sample::new("ServerMessage", from_server(Server::Error(error()))),
        Sample::new("WorldRequest", v1::WorldRequest { world: Some("town".to_owned()) }),
        Sample::new("WorldInfo", world_info()),
    ]
}
