//! Operators change solvers while clients look on: light does not jump, and what cannot be is refused by name.

use crate::plates::{CAMERA, WIRE_REL, plates_error, settled};
use crate::world::Service;
use earthshine_client::{Client, ClientOptions};

/// Goal: no jump. Method: every solver in turn under a client that looks on, frames of thirty ticks after each change; no
/// light that it ever holds is further from the closed form than the wire's own rounding.
#[tokio::test]
async fn solvers_change_under_a_client_without_a_jump() {
    let service = Service::start(|_| ()).await;
    let mut client = Client::connect(&service.uri, ClientOptions::default()).await.unwrap();
    client.set_camera(CAMERA).unwrap();
    assert!(plates_error(&*settled(&mut client).await, 1.0) < WIRE_REL);
    for solver in ["hybrid", "matrix", "gather", "progressive", "hybrid", "matrix"] {
        let wish = format!("by_level = [\"{solver}\"]");
        let (status, text) = service.ask("PUT", "/solver", "", &wish).await;
        assert!(status.contains("200") && text.contains(solver), "{status} {text}");
        let ticks = service.metric("earthshine_engine_ticks_total").await;
        for after in 1..=10 {
            service.metric_reaches("earthshine_engine_ticks_total", ticks + f64::from(after) * 3.0).await;
            let found = plates_error(&client.light(), 1.0);
            assert!(found < WIRE_REL, "{solver}, {after}: {found}");
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
