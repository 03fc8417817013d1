//! What the server says, put together from the world's types.

use super::Refusal;
use crate::engine_thread::EngineReport;
use crate::publish::{Changes, DeltaStore, LIGHT_UNIT_LX};
use earthshine_engine::{FrameQuality, SessionStats};
use earthshine_protocol::v1::{self, server_message::Message};
use earthshine_protocol::{PROTOCOL_MAX, PROTOCOL_MIN, TEXT_BYTES_MAX};
use earthshine_volume::plane;
use earthshine_world::{Bounds, Light, LightRig, Rgb, Vec3, WorldIndex};
use glam::IVec3;

/// Program and version, as clients see it.
pub(crate) const SERVER_VERSION: &str = concat!("earthshine ", env!("CARGO_PKG_VERSION"));

fn say(message: Message) -> v1::ServerMessage {
    v1::ServerMessage { message: Some(message) }
}

fn vector(v: Vec3) -> v1::Vector3 {
    v1::Vector3 { x: v.x, y: v.y, z: v.z }
}

fn rgb(v: Rgb) -> v1::Rgb {
    v1::Rgb { red: v.x, green: v.y, blue: v.z }
}

/// A world without geometry has bounds turned inside out; on the wire it is a point.
fn corners(bounds: &Bounds) -> (v1::Vector3, v1::Vector3) {
    let finite = bounds.min.is_finite() && bounds.max.is_finite();
    if finite { (vector(bounds.min), vector(bounds.max)) } else { (vector(Vec3::ZERO), vector(Vec3::ZERO)) }
}

/// What a session is told about limits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// 1/s.
    pub(crate) camera_rate_max_hz: f64,
    /// In one rig.
    pub(crate) lights_max: u32,
    /// Of one message.
    pub(crate) message_bytes_max: u32,
}

/// The session is open.
pub(crate) fn welcome(
    protocol: u32,
    session: u64,
    world: &str,
    index: &WorldIndex,
    limits: Limits,
) -> v1::ServerMessage {
    let (bounds_min, bounds_max) = corners(&index.bounds);
    say(Message::Welcome(v1::Welcome {
        protocol,
        session,
        world: world.to_owned(),
        voxel_edge_m: index.grid.voxel_edge_m,
        bounds_min: Some(bounds_min),
        bounds_max: Some(bounds_max),
        server_version: SERVER_VERSION.to_owned(),
        camera_rate_max_hz: limits.camera_rate_max_hz as f32,
        lights_max: limits.lights_max,
        client_message_bytes_max: limits.message_bytes_max,
    }))
}

/// Where the volume is now.
pub(crate) fn volume(store: &DeltaStore) -> v1::ServerMessage {
    let layout = store.layout();
    let IVec3 { x, y, z } = layout.origin;
    say(Message::Volume(v1::Volume {
        volume: store.name(),
        level: layout.level.into(),
        origin: Some(v1::VoxelCoord { x, y, z }),
        dims: Some(v1::Dims { x: layout.dims.x, y: layout.dims.y, z: layout.dims.z }),
        voxel_edge_m: layout.voxel_edge_m,
        generation: store.layout_generation(),
    }))
}

/// Light that changed. Always whole: the store's bounds keep a generation within one message.
pub(crate) fn delta(changes: &Changes) -> v1::ServerMessage {
    let mut delta = v1::Delta {
        volume: changes.volume,
        from_generation: changes.from,
        to_generation: changes.to,
        camera_sequence: changes.caption.camera_sequence,
        complete: true,
        frame: Some(frame_quality(&changes.caption.quality)),
        time_s: changes.caption.time_s,
        voxels: Vec::with_capacity(changes.voxels.len()),
        present: Vec::with_capacity(changes.voxels.len()),
        air: Vec::with_capacity(changes.voxels.len()),
        light_unit_lx: LIGHT_UNIT_LX,
        ..v1::Delta::default()
    };
    let mut before = 0;
    for (index, codes) in &changes.voxels {
        delta.voxels.push(index - before);
        before = *index;
        delta.present.push(codes.present);
        delta.air.push(codes.air);
        for direction in (0..6).filter(|direction| codes.present >> direction & 1 == 1) {
            delta.irradiance.push(codes.irradiance[direction]);
            delta.sky_irradiance.push(codes.sky_irradiance[direction]);
            delta.quality.push(codes.quality[direction]);
            delta.far.push(codes.far[direction]);
            delta.staleness.push(codes.staleness[direction]);
            delta.plane.push(codes.plane[direction]);
            delta.tilt.extend(codes.tilt[direction]);
        }
        delta.barred.push(codes.barred());
        let barred = (0..6).filter(|direction| codes.barred() >> direction & 1 == 1);
        delta.barriers.extend(barred.flat_map(|direction| codes.barriers[direction]).flatten());
    }
    if delta.sky_irradiance.iter().all(|&code| code == 0) {
        delta.sky_irradiance.clear();
    }
    for codes in [&mut delta.air, &mut delta.far, &mut delta.staleness, &mut delta.tilt, &mut delta.barred] {
        if codes.iter().all(|&code| code == 0) {
            codes.clear();
        }
    }
    if delta.plane.iter().all(|&code| code == plane::UNKNOWN) {
        delta.plane.clear();
    }
    say(Message::Delta(delta))
}

fn frame_quality(quality: &FrameQuality) -> v1::FrameQuality {
    v1::FrameQuality {
        resident_patches: quality.resident_patches,
        wanted_patches: quality.wanted_patches,
        stale_direct: quality.stale_direct,
        settled: quality.settled,
        missing_near: quality.missing_near,
    }
}

/// What the session itself counts.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SessionCounts {
    /// Frames the client was too slow for.
    pub(crate) frames_skipped: u64,
    /// Messages that made no difference.
    pub(crate) messages_ignored: u64,
    /// Failed tiles of the whole server when the session opened.
    pub(crate) tiles_failed_before: u64,
}

/// How the server fares.
pub(crate) fn statistics(
    report: &EngineReport,
    own: Option<&SessionStats>,
    capacity_patches: u32,
    counts: SessionCounts,
) -> v1::ServerMessage {
    let saturated = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
    say(Message::Statistics(v1::Statistics {
        time_s: report.time_s,
        frames_published: own.map_or(0, |own| own.frames),
        frames_skipped: counts.frames_skipped,
        tick_ms: (report.tick_s * 1e3) as f32,
        resident_patches: own.map_or(0, |own| own.resident_patches),
        capacity_patches,
        tiles_loading: saturated(report.tiles_pending),
        tiles_failed: report.stats.counters.tile_failures.saturating_sub(counts.tiles_failed_before),
        messages_ignored: counts.messages_ignored,
        sessions: saturated(report.stats.sessions.len()),
        matrix_drift: own.map_or(0.0, |own| own.drift),
        promised_radius_m: report.stats.promised_radius_m,
        promised_speed_m_s: report.stats.promised_speed_m_s,
        promise_violations: own.map_or(0, |own| own.violations),
        far_share: own.map_or(0.0, |own| own.far_share),
        fed_share: own.map_or(0.0, |own| own.fed_share),
    }))
}

/// Something went wrong.
pub(crate) fn error(refusal: &Refusal, fatal: bool) -> v1::ServerMessage {
    let cause: String = refusal.cause.chars().take(TEXT_BYTES_MAX / 4).collect();
    say(Message::Error(v1::Error { code: refusal.code.into(), cause, fatal }))
}

/// What is served, for those without a session.
pub(crate) fn world_info(world: &str, index: &WorldIndex) -> v1::WorldInfo {
    let (bounds_min, bounds_max) = corners(&index.bounds);
    let chunks = &index.chunks;
    v1::WorldInfo {
        world: world.to_owned(),
        voxel_edge_m: index.grid.voxel_edge_m,
        chunk_edge_voxels: index.grid.chunk_edge_voxels,
        bounds_min: Some(bounds_min),
        bounds_max: Some(bounds_max),
        level_count: index.level_count().max(1).into(),
        chunk_count: chunks.len() as u64,
        patch_count: chunks.iter().map(|chunk| u64::from(chunk.patch_count)).sum(),
        nonzero_count: chunks.iter().map(|chunk| chunk.nonzero_count).sum(),
        tile_bytes: chunks.iter().map(|chunk| chunk.tile_bytes).sum(),
        lights: Some(lights(&index.lights)),
        protocol_min: PROTOCOL_MIN,
        protocol_max: PROTOCOL_MAX,
        server_version: SERVER_VERSION.to_owned(),
    }
}

/// A rig on the wire.
pub(crate) fn lights(rig: &LightRig) -> v1::Lights {
    v1::Lights {
        lights: rig.lights.iter().map(lamp).collect(),
        sky: Some(v1::Sky { lobes: rig.sky.lobes.iter().copied().map(rgb).collect() }),
        emission_scale: Some(rig.emission_scale),
    }
}

fn lamp(light: &Light) -> v1::Light {
    use v1::light::Kind;
    let kind = match *light {
        Light::Directional { direction, illuminance, angular_diameter_rad } => {
            Kind::Directional(v1::DirectionalLight {
                direction: Some(vector(direction)),
                illuminance: Some(rgb(illuminance)),
                angular_diameter_rad,
            })
        }
        Light::Point { position, intensity, range_m } => Kind::Point(v1::PointLight {
            position: Some(vector(position)),
            intensity: Some(rgb(intensity)),
            range_m,
        }),
        Light::Spot { position, direction, intensity, inner_cone_rad, outer_cone_rad, range_m } => {
            Kind::Spot(v1::SpotLight {
                position: Some(vector(position)),
                direction: Some(vector(direction)),
                intensity: Some(rgb(intensity)),
                inner_cone_rad,
                outer_cone_rad,
                range_m,
            })
        }
    };
    v1::Light { kind: Some(kind) }
}
