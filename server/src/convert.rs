//! Between the wire's messages and the world's types: the only file that knows both.
//!
//! Everything a client says is checked here, field by field; everything it hears is put together here.
//! Start at [`Request::decode`]; the server's side is in [`reply`].

pub(crate) mod reply;

use earthshine_protocol::v1::{self, client_message::Message};
use earthshine_protocol::{
    DETAIL_LAYERS_MAX, PROTOCOL_MAX, PROTOCOL_MIN, TEXT_BYTES_MAX, VOLUMES_MAX, agree,
};
use earthshine_world::{Camera, Light, LightRig, Rgb, Sky, Vec3};
use glam::UVec3;

/// What kind of refusal; the schema's error codes by name.
pub(crate) use earthshine_protocol::v1::ErrorCode;

/// A message that cannot be acted upon.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Refusal {
    /// What kind.
    pub(crate) code: ErrorCode,
    /// For people: what, why and what to do.
    pub(crate) cause: String,
}

impl Refusal {
    /// `cause`, as a refusal of kind `code`.
    pub(crate) fn new(code: ErrorCode, cause: impl Into<String>) -> Self {
        Self { code, cause: cause.into() }
    }

    fn invalid(cause: impl Into<String>) -> Self {
        Self::new(ErrorCode::Invalid, cause)
    }
}

/// What a client says, checked.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Request {
    /// Opens the session.
    Hello(Greeting),
    /// Moves the camera.
    Camera {
        /// The client's number of it.
        sequence: u64,
        /// Valid.
        camera: Camera,
    },
    /// Changes the lights.
    Lights(LightRig),
    /// Says what is held.
    Ack {
        /// Of which volume.
        volume: u32,
        /// Newest whole generation.
        generation: u64,
    },
    /// Leaves.
    Bye,
    /// Counts, and changes nothing: a camera that cannot be, a kind of message from the future.
    Ignored,
}

/// A hello that can be answered.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Greeting {
    /// Version that both speak.
    pub(crate) protocol: u32,
    /// For the log.
    pub(crate) client_name: String,
    /// Which levels it has room for, and how many voxels of each.
    pub(crate) volumes_wanted: VolumesWanted,
    /// How many layers of detail the client reads; 0 for no detail at all.
    pub(crate) detail_layers: u8,
}

impl Request {
    /// Checks `message`; `world` is what is served, `lights_max` how many lights a rig may hold.
    ///
    /// # Errors
    /// What is wrong with it, by name.
    pub(crate) fn decode(message: v1::ClientMessage, world: &str, lights_max: u32) -> Result<Self, Refusal> {
        Ok(match message.message {
            Some(Message::Hello(hello)) => Self::Hello(greeting(hello, world)?),
            Some(Message::Camera(update)) => camera(&update)
                .map_or(Self::Ignored, |camera| Self::Camera { sequence: update.sequence, camera }),
            Some(Message::Lights(lights)) => Self::Lights(light_rig(&lights, lights_max)?),
            Some(Message::Ack(ack)) => Self::Ack { volume: ack.volume, generation: ack.generation },
            Some(Message::Bye(v1::Bye {})) => Self::Bye,
            None => Self::Ignored,
        })
    }
}

fn greeting(hello: v1::Hello, world: &str) -> Result<Greeting, Refusal> {
    let v1::Hello { protocol_min, protocol_max, client_name, world: wanted, volumes, detail, detail_layers } =
        hello;
    let protocol = agree(protocol_min, protocol_max).ok_or_else(|| {
        let cause = format!(
            "the client speaks protocol {protocol_min} to {protocol_max}, this server {PROTOCOL_MIN} to \
             {PROTOCOL_MAX}: update the older one"
        );
        Refusal::new(ErrorCode::Version, cause)
    })?;
    if client_name.len() > TEXT_BYTES_MAX {
        return Err(Refusal::invalid(format!("the client's name is longer than {TEXT_BYTES_MAX} bytes")));
    }
    check_world(wanted.as_deref(), world)?;
    if detail_layers > DETAIL_LAYERS_MAX {
        let cause =
            format!("{detail_layers} layers of detail are wanted, there are at most {DETAIL_LAYERS_MAX}");
        return Err(Refusal::invalid(cause));
    }
    let detail_layers = if detail { detail_layers.max(1) as u8 } else { 0 };
    Ok(Greeting { protocol, client_name, volumes_wanted: volumes_wanted(&volumes)?, detail_layers })
}

/// Whether `wanted` is what is served.
///
/// # Errors
/// Names both if not.
pub(crate) fn check_world(wanted: Option<&str>, served: &str) -> Result<(), Refusal> {
    match wanted {
        Some(wanted) if wanted != served => {
            let shown: String = wanted.chars().take(64).collect();
            let cause = format!("there is no world {shown:?} here, only {served:?}");
            Err(Refusal::new(ErrorCode::WorldUnknown, cause))
        }
        _ => Ok(()),
    }
}

/// The volumes that a client has room for.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum VolumesWanted {
    /// Whatever the server likes.
    Any,
    /// These levels, each with most voxels along the axes; level 0 is one of them.
    These(Vec<(u8, Option<UVec3>)>),
}

impl VolumesWanted {
    /// Voxels of the volume of `level`, at most `most`; `None` if it is not wanted.
    pub(crate) fn dims_of(&self, level: u8, most: UVec3) -> Option<UVec3> {
        match self {
            Self::Any => Some(most),
            Self::These(wanted) => {
                let (_, dims) = wanted.iter().find(|(wanted, _)| *wanted == level)?;
                Some(dims.map_or(most, |dims| dims.min(most)))
            }
        }
    }
}

fn volumes_wanted(volumes: &[v1::VolumeWanted]) -> Result<VolumesWanted, Refusal> {
    if volumes.len() > VOLUMES_MAX {
        return Err(Refusal::invalid(format!(
            "{} volumes wanted, at most {VOLUMES_MAX} are possible",
            volumes.len()
        )));
    }
    if volumes.is_empty() {
        return Ok(VolumesWanted::Any);
    }
    let mut wanted: Vec<(u8, Option<UVec3>)> = Vec::with_capacity(volumes.len());
    for volume in volumes {
        // A level beyond all worlds is one that this world does not have.
        let level = u8::try_from(volume.level).unwrap_or(u8::MAX);
        let dims = volume.dims_max.map(|dims| UVec3::new(dims.x, dims.y, dims.z));
        if wanted.iter().any(|&(other, _)| other == level) {
            return Err(Refusal::invalid(format!("two volumes of level {level} are wanted: one a level")));
        }
        if dims.is_some_and(|dims| dims.min_element() == 0) {
            return Err(Refusal::invalid("a volume without voxels is wanted: give each axis at least 1"));
        }
        wanted.push((level, dims));
    }
    if wanted.iter().all(|&(level, _)| level != 0) {
        return Err(Refusal::invalid("no volume of level 0 is wanted: it is the one that is always served"));
    }
    Ok(VolumesWanted::These(wanted))
}

fn vector(wire: Option<v1::Vector3>) -> Vec3 {
    wire.map_or(Vec3::ZERO, |v| Vec3::new(v.x, v.y, v.z))
}

fn rgb(wire: Option<v1::Rgb>) -> Rgb {
    wire.map_or(Rgb::ZERO, |v| Rgb::new(v.red, v.green, v.blue))
}

/// `None` for a camera that cannot be. A direction of length zero looks along -Z, as glTF cameras do.
fn camera(update: &v1::CameraUpdate) -> Option<Camera> {
    let position = vector(Some(update.position?));
    let [forward, velocity] = [update.forward, update.velocity].map(vector);
    let camera = Camera { position, forward, velocity };
    camera.is_valid().then(|| Camera { forward: forward.normalize_or(Vec3::NEG_Z), ..camera })
}

fn light_rig(lights: &v1::Lights, lights_max: u32) -> Result<LightRig, Refusal> {
    if lights.lights.len() > lights_max as usize {
        let cause =
            format!("{} lights, this server takes {lights_max} (`engine.lights_max`)", lights.lights.len());
        return Err(Refusal::invalid(cause));
    }
    let numbered = lights.lights.iter().enumerate();
    let lamps = numbered.map(|(index, light)| {
        lamp(light).ok_or_else(|| {
            Refusal::invalid(format!("light {index}: it is of no kind that this server knows"))
        })
    });
    let lobes = lights.sky.as_ref().map_or(&[][..], |sky| &sky.lobes);
    let lobes: [Rgb; 6] = match lobes.len() {
        0 => [Rgb::ZERO; 6],
        6 => std::array::from_fn(|lobe| rgb(Some(lobes[lobe]))),
        other => return Err(Refusal::invalid(format!("the sky has {other} lobes: give none or six"))),
    };
    let rig = LightRig {
        lights: lamps.collect::<Result<_, _>>()?,
        sky: Sky { lobes },
        emission_scale: lights.emission_scale.unwrap_or(1.0),
    };
    rig.validate().map_err(|error| {
        if error.index < rig.lights.len() {
            Refusal::invalid(error.to_string())
        } else {
            Refusal::invalid(error.cause)
        }
    })?;
    Ok(rig)
}

fn lamp(light: &v1::Light) -> Option<Light> {
    use v1::light::Kind;
    Some(match light.kind.as_ref()? {
        Kind::Directional(sun) => Light::Directional {
            direction: vector(sun.direction),
            illuminance: rgb(sun.illuminance),
            angular_diameter_rad: sun.angular_diameter_rad,
        },
        Kind::Point(point) => Light::Point {
            position: vector(point.position),
            intensity: rgb(point.intensity),
            range_m: point.range_m,
        },
        Kind::Spot(spot) => Light::Spot {
            position: vector(spot.position),
            direction: vector(spot.direction),
            intensity: rgb(spot.intensity),
            inner_cone_rad: spot.inner_cone_rad,
            outer_cone_rad: spot.outer_cone_rad,
            range_m: spot.range_m,
        },
    })
}

#[cfg(test)]
#[path = "convert/tests.rs"]
mod tests;
