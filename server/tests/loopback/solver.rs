//! Operators change solvers while clients look on: light does not jump, and what cannot be is refused by name.

use crate::world::{POSITIONS, Service, closed_form, within};
use earthshine_client::{Camera, Client, ClientOptions, Light, Vec3};
use std::sync::Arc;

const CAMERA: Camera =
    Camera { position: Vec3::new(6.5, 4.5, 4.5), forward: Vec3::NEG_X, velocity: Vec3::ZERO };

/// Largest relative error of both plates' light: RGB9E5 has nine bits.
const JUMP_MAX: f32 = 1.0 / 400.0;

fn error(light: &Light) -> f32 {
    let normals = [Vec3::X, Vec3::NEG_X];
    let of = |((position, normal), expected): ((Vec3, Vec3), Vec3)| {
        let found = light.lookup(position, normal).expect("light here");
        (found.irradiance - expected).abs().max_element() / expected.max_element()
    };
    POSITIONS.into_iter().zip(normals).zip(closed_form()).map(of).fold(0.0, f32::max)
}

async fn settled(client: &mut Client) -> Arc<Light> {
    within(async {
        loop {
            let light = client.next_light().await.unwrap();
            if light.frame().settled {
                return light;
            }
        }
    })
    .await
}

/// Goal: no jump. Method: every solver in turn under a client that looks on, frames of thirty ticks after each change; no
/// light that it ever holds is further from the closed form than the wire's own rounding.
#[tokio::test]
async fn solvers_change_under_a_client_without_a_jump() {
    let service = Service::start(|_| ()).await;
    let mut client = Client::connect(&service.uri, ClientOptions::default()).await.unwrap();
    client.set_camera(CAMERA).unwrap();
    assert!(error(&*settled(&mut client).await) < JUMP_MAX);
    for solver in ["hybrid", "matrix", "gather", "progressive", "hybrid", "matrix"] {
        let wish = format!("by_level = [\"{solver}\"]");
        let (status, text) = service.ask("PUT", "/solver", "", &wish).await;
        assert!(status.contains("200") && text.contains(solver), "{status} {text}");
        let ticks = service.metric("earthshine_engine_ticks_total").await;
        for after in 1..=10 {
            service.metric_reaches("earthshine_engine_ticks_total", ticks + f64::from(after) * 3.0).await;
            let found = error(&client.light());
            assert!(found < JUMP_MAX, "{solver}, {after}: {found}");
        }
        assert!(service.get("/solver").await.1.contains(solver));
    }
    client.close().await;
    service.stop().await;
}

#[tokio::test]
async fn wishes_that_cannot_be_change_nothing() {
    let service = Service::start(|_| ()).await;
    let before = service.get("/solver").await.1;
    let long = "#".repeat(5000);
    for (wish, status, words) in [
        ("by_level = [\"radiosity\"]", "400", "radiosity"),
        ("samples_per_row = 0", "400", "solver.samples_per_row"),
        ("history_weight = nan", "400", "solver.history_weight"),
        (long.as_str(), "413", ""),
    ] {
        let (found, cause) = service.ask("PUT", "/solver", "", wish).await;
        assert!(found.contains(status) && cause.contains(words), "{wish}: {found} {cause}");
    }
    assert_eq!(service.get("/solver").await.1, before);
    service.stop().await;
}

#[tokio::test]
async fn where_clients_show_a_token_operators_do_too() {
    let service = Service::start(|config| config.bearer_token.0 = "sesame".to_owned()).await;
    let wish = "by_level = [\"gather\"]";
    for headers in ["", "authorization: Bearer sesam\r\n"] {
        let (status, cause) = service.ask("PUT", "/solver", headers, wish).await;
        assert!(status.contains("401") && cause.contains("token"), "{status} {cause}");
    }
    let (status, text) = service.ask("PUT", "/solver", "authorization: Bearer sesame\r\n", wish).await;
    assert!(status.contains("200") && text.contains("gather"), "{status} {text}");
    service.stop().await;
}
