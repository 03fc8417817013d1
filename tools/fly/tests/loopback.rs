//! Flights against a server of a hundred lines, over a real socket.

mod server;

use earthshine_client::{LightSource, UVec3, Vec3};
use earthshine_fly::{FlyError, FlyOptions, Path, Probe, Probes, SunCourse, SunLight, SunPath, fly};
use server::{ANSWER_DELAY, start};
use std::future::pending;
use std::time::Duration;

fn options(uri: &str, path: Path) -> FlyOptions {
    let mut options = FlyOptions::new(uri, path);
    options.client.dims_max = UVec3::new(16, 8, 16);
    options.duration = Duration::from_millis(900);
    options.rate_hz = 50.0;
    options.probes = Probes::Ground { count: 4, radius_m: 0.4, depth_m: 4.0 };
    options
}

/// Goal: misses are where there is no light. Method: the server's floor ends at x = 0, and the camera flies from
/// -20 m to 20 m.
#[tokio::test]
async fn a_line_over_a_rim_misses_half_of_its_frames() {
    let server = start().await;
    let path =
        Path::Line { from: Vec3::new(-20.0, 1.5, 0.0), to: Vec3::new(20.0, 1.5, 0.0), speed: 40.0 / 0.9 };
    let mut options = options(&server.uri, path);
    options.picture_times_s = vec![0.2, 0.4, 5.0];
    let sun = SunPath {
        course: SunCourse::Straight { azimuth_deg: [0.0, 90.0], elevation_deg: [30.0, 60.0] },
        light: SunLight::ClearSky { ground_reflectance: 0.2 },
        rate_hz: 20.0,
    };
    options.sun = Some(sun);
    let mut pictures = Vec::new();
    let report = fly(&options, pending(), |frame| pictures.push(frame)).await.unwrap();

    assert!(report.camera_updates >= 20, "{report:?}");
    assert!(report.frames > 5 && report.bytes > 0 && report.first_light_ms.is_some(), "{report:?}");
    let share = report.misses as f64 / report.probed_frames as f64;
    assert!((0.2..0.8).contains(&share), "{share} of the frames are misses: {report:?}");
    assert!(report.latency_ms_p50.unwrap() >= ANSWER_DELAY.as_secs_f64() * 1000.0, "{report:?}");
    assert_eq!((report.teleports, report.teleport_to_light_ms_p50), (0, None));

    assert_eq!(pictures.iter().map(|frame| frame.picture).collect::<Vec<_>>(), [0, 1]);
    assert!(pictures[0].time_s >= 0.2 && pictures[0].light.number() > 0);
    let lights = pictures[1].lights.as_ref().unwrap();
    assert!(matches!(lights.sources[..], [LightSource::Directional { .. }]));
    assert!(lights.sky[2].z > lights.sky[2].x, "the sky follows the sun: {:?}", lights.sky);
    assert!(server.lights_received() > 3, "the sun moved {} times", server.lights_received());
}

#[tokio::test]
async fn a_flight_that_is_told_to_land_reports_what_it_has() {
    let server = start().await;
    let path = Path::Line { from: Vec3::new(-9.0, 1.5, 0.0), to: Vec3::new(9.0, 1.5, 0.0), speed: 0.1 };
    let options = FlyOptions { duration: Duration::from_secs(600), ..options(&server.uri, path) };
    let report = fly(&options, tokio::time::sleep(Duration::from_millis(400)), |_| {}).await.unwrap();
    assert!(report.duration_s < 60.0 && report.frames > 0, "{report:?}");
}

#[tokio::test]
async fn teleports_are_timed_until_their_light_is_there() {
    let server = start().await;
    let path = Path::Teleports {
        seed: 3,
        bounds_min: Vec3::new(-200.0, 1.5, -200.0),
        bounds_max: Vec3::new(-50.0, 1.5, 200.0),
        every_s: 0.2,
    };
    let report = fly(&options(&server.uri, path), pending(), |_| {}).await.unwrap();
    assert!((3..=5).contains(&report.teleports), "{report:?}");
    assert!(report.teleports_lit >= 2, "{report:?}");
    let p50 = report.teleport_to_light_ms_p50.unwrap();
    assert!(p50 >= ANSWER_DELAY.as_secs_f64() * 1000.0 && p50 < 250.0, "{report:?}");
}

#[tokio::test]
async fn surface_probes_miss_when_one_of_them_is_dark() {
    let server = start().await;
    let path = Path::Orbit { centre: Vec3::new(-4.0, 1.5, 0.0), radius: 0.5, height: 0.0, period_s: 1.0 };
    let probe = |x| Probe { position: Vec3::new(x, 0.1, 0.2), normal: Vec3::Y };
    let mut dark_and_bright = Vec::new();
    for far in [-6.0, 1.5, 100.0] {
        let mut options = options(&server.uri, path.clone());
        options.duration = Duration::from_millis(400);
        let probes = vec![probe(far), probe(-4.0)];
        options.probes = Probes::Surface { probes, radius_m: 8.0, count_max: 16 };
        let report = fly(&options, pending(), |_| {}).await.unwrap();
        assert!(report.probed_frames > 3, "{report:?}");
        let per_frame = report.probes / report.probed_frames;
        dark_and_bright.push((report.misses == report.probed_frames, report.dark_probes > 0, per_frame));
    }
    // Both lit; one beyond the rim; one out of reach, which is not asked.
    assert_eq!(dark_and_bright, [(false, false, 2), (true, true, 2), (false, false, 1)]);
}

#[tokio::test]
async fn flights_that_cannot_be_say_why() {
    let path = Path::Line { from: Vec3::ZERO, to: Vec3::X, speed: 1.0 };
    let fault = async |change: fn(&mut FlyOptions)| {
        let mut options = options("http://127.0.0.1:1", path.clone());
        change(&mut options);
        fly(&options, pending(), |_| {}).await.unwrap_err()
    };
    assert!(matches!(fault(|o| o.rate_hz = f32::NAN).await, FlyError::Options { .. }));
    assert!(matches!(fault(|o| o.picture_times_s = vec![2.0, 1.0]).await, FlyError::Options { .. }));
    assert!(matches!(fault(|o| o.path = Path::Recorded { keys: vec![] }).await, FlyError::Path(_)));
    assert!(matches!(fault(|_| {}).await, FlyError::Client { .. }));
}
