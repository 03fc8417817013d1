//! Every field a client can get wrong, and the round trip of those it gets right.

use super::*;

fn decode(message: Message) -> Result<Request, Refusal> {
    Request::decode(v1::ClientMessage { message: Some(message) }, "town", 3)
}

fn hello() -> v1::Hello {
    v1::Hello { protocol_min: PROTOCOL_MIN, protocol_max: PROTOCOL_MAX, ..v1::Hello::default() }
}

fn refused_hello(change: fn(&mut v1::Hello)) -> Refusal {
    let mut hello = hello();
    change(&mut hello);
    decode(Message::Hello(hello)).unwrap_err()
}

fn refused_lights(lights: v1::Lights) -> String {
    decode(Message::Lights(lights)).unwrap_err().cause
}

#[test]
fn a_client_gets_as_many_layers_as_it_reads_and_an_old_one_gets_the_first() {
    let layers = |detail: bool, detail_layers: u32| {
        greeting(v1::Hello { detail, detail_layers, ..hello() }, "w").map(|greeting| greeting.detail_layers)
    };
    assert_eq!([layers(true, 0), layers(true, 1), layers(true, 3)].map(Result::unwrap), [1, 1, 3]);
    assert_eq!(layers(false, 4).unwrap(), 0);
    let refused = layers(true, DETAIL_LAYERS_MAX + 1).unwrap_err();
    assert!(refused.cause.contains("5 layers of detail"), "{}", refused.cause);
}

#[test]
fn a_wrong_version_is_refused_with_both_named() {
    let refusal = refused_hello(|hello| {
        (hello.protocol_min, hello.protocol_max) = (PROTOCOL_MAX + 6, PROTOCOL_MAX + 8);
    });
    assert_eq!(refusal.code, ErrorCode::Version);
    let both =
        format!("{} to {}, this server {PROTOCOL_MIN} to {PROTOCOL_MAX}", PROTOCOL_MAX + 6, PROTOCOL_MAX + 8);
    assert!(refusal.cause.contains(&both), "{}", refusal.cause);
}

#[test]
fn hellos_that_cannot_be_are_named() {
    let refusal = refused_hello(|hello| hello.world = Some("village".to_owned()));
    assert_eq!(refusal.code, ErrorCode::WorldUnknown);
    assert!(refusal.cause.contains("village") && refusal.cause.contains("town"));
    let wanted = |level, x| v1::VolumeWanted { level, dims_max: Some(v1::Dims { x, y: 4, z: 4 }) };
    let faults = [
        refused_hello(|hello| hello.client_name = "x".repeat(TEXT_BYTES_MAX + 1)).cause,
        refused_hello(|hello| hello.volumes = vec![v1::VolumeWanted::default(); VOLUMES_MAX + 1]).cause,
        decode(Message::Hello(v1::Hello { volumes: vec![wanted(3, 4)], ..hello() })).unwrap_err().cause,
        decode(Message::Hello(v1::Hello { volumes: vec![wanted(0, 4), wanted(0, 4)], ..hello() }))
            .unwrap_err()
            .cause,
        decode(Message::Hello(v1::Hello { volumes: vec![wanted(0, 0)], ..hello() })).unwrap_err().cause,
    ];
    for (fault, words) in
        faults.iter().zip(["name is longer", "17 volumes", "level 0", "two volumes", "without voxels"])
    {
        assert!(fault.contains(words), "{fault} does not say {words}");
    }
}

#[test]
fn wishes_are_taken_level_by_level() {
    let wanted = |level, x| v1::VolumeWanted { level, dims_max: Some(v1::Dims { x, y: 5, z: 6 }) };
    let hello = v1::Hello { volumes: vec![wanted(1, 9), wanted(0, 4)], ..hello() };
    let Ok(Request::Hello(greeting)) = decode(Message::Hello(hello)) else { panic!("a hello") };
    let most = UVec3::new(8, 8, 5);
    let dims = |level| greeting.volumes_wanted.dims_of(level, most);
    assert_eq!((dims(0), dims(1), dims(2)), (Some(UVec3::new(4, 5, 5)), Some(UVec3::new(8, 5, 5)), None));
    assert_eq!(greeting.protocol, PROTOCOL_MAX);
}

#[test]
fn cameras_that_cannot_be_are_ignored() {
    let update = |x: f32| v1::CameraUpdate {
        sequence: 3,
        position: Some(v1::Vector3 { x, y: 0.0, z: 0.0 }),
        ..v1::CameraUpdate::default()
    };
    for x in [f32::NAN, f32::INFINITY, 1e9] {
        assert_eq!(decode(Message::Camera(update(x))), Ok(Request::Ignored));
    }
    assert_eq!(
        decode(Message::Camera(v1::CameraUpdate { position: None, ..update(0.0) })),
        Ok(Request::Ignored)
    );
    let camera = Camera { position: Vec3::X, forward: Vec3::NEG_Z, velocity: Vec3::ZERO };
    assert_eq!(decode(Message::Camera(update(1.0))), Ok(Request::Camera { sequence: 3, camera }));
}

#[test]
fn impossible_lights_are_named() {
    let sun = |x: f32| Light::Directional {
        direction: Vec3::NEG_Y,
        illuminance: Rgb::new(x, 1.0, 1.0),
        angular_diameter_rad: 0.01,
    };
    let rig = |lights: Vec<Light>| LightRig { lights, sky: Sky::default(), emission_scale: 1.0 };
    let lights = reply::lights(&rig(vec![sun(1.0), sun(-1.0)]));
    assert!(refused_lights(lights).contains("light 1: the intensity is negative"));
    assert!(refused_lights(reply::lights(&rig(vec![sun(f32::NAN)]))).contains("light 0:"));
    assert!(refused_lights(reply::lights(&rig(vec![sun(1.0); 4]))).contains("4 lights, this server takes 3"));
    let no_kind = v1::Lights { lights: vec![v1::Light { kind: None }], ..v1::Lights::default() };
    assert!(refused_lights(no_kind).contains("light 0: it is of no kind"));
    let sky =
        v1::Lights { sky: Some(v1::Sky { lobes: vec![v1::Rgb::default(); 5] }), ..v1::Lights::default() };
    assert!(refused_lights(sky).contains("5 lobes"));
    let sky = v1::Sky { lobes: vec![v1::Rgb { red: f32::NAN, green: 0.0, blue: 0.0 }; 6] };
    assert!(
        refused_lights(v1::Lights { sky: Some(sky), ..v1::Lights::default() }).contains("the sky's radiance")
    );
    let scale = v1::Lights { emission_scale: Some(-1.0), ..v1::Lights::default() };
    assert!(refused_lights(scale).contains("the emission scale"));
}

#[test]
fn lights_survive_the_wire() {
    let rig = LightRig {
        lights: vec![
            Light::Directional { direction: Vec3::NEG_Y, illuminance: Rgb::ONE, angular_diameter_rad: 0.01 },
            Light::Point { position: Vec3::X, intensity: Rgb::new(1.0, 2.0, 3.0), range_m: Some(4.0) },
            Light::Spot {
                position: Vec3::Z,
                direction: Vec3::X,
                intensity: Rgb::ONE,
                inner_cone_rad: 0.1,
                outer_cone_rad: 0.5,
                range_m: None,
            },
        ],
        sky: Sky { lobes: std::array::from_fn(|lobe| Rgb::splat(lobe as f32)) },
        emission_scale: 0.5,
    };
    assert_eq!(decode(Message::Lights(reply::lights(&rig))), Ok(Request::Lights(rig)));
    // What is absent: no lamps, a black sky, emissive surfaces as baked.
    assert_eq!(
        decode(Message::Lights(v1::Lights::default())),
        Ok(Request::Lights(LightRig::emission_only()))
    );
}

#[test]
fn a_message_from_the_future_is_ignored() {
    assert_eq!(Request::decode(v1::ClientMessage { message: None }, "town", 3), Ok(Request::Ignored));
}
