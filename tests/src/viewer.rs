//! A client that waits until its light is what it should be, and says what it waited for when it never is.

use earthshine_client::{Camera, Client, ClientOptions, Light, Vec3};
use std::sync::Arc;
use std::time::Duration;

/// No test waits longer than this for anything.
const PATIENCE: Duration = Duration::from_secs(30);

/// Waits for `what`.
///
/// # Panics
/// If it takes too long.
pub async fn within<T>(what: &str, waiting: impl Future<Output = T>) -> T {
    match tokio::time::timeout(PATIENCE, waiting).await {
        Ok(value) => value,
        Err(_elapsed) => panic!("waited {PATIENCE:?} in vain for {what}"),
    }
}

/// Opens a session at `uri`.
///
/// # Panics
/// If it is refused.
pub async fn connect(uri: &str) -> Client {
    within("a session", Client::connect(uri, ClientOptions::default())).await.expect("an open session")
}

/// Looks from `position` and waits until the light there is settled.
///
/// # Panics
/// If it never is, or the session ends.
pub async fn settled_at(client: &mut Client, position: Vec3) -> Arc<Light> {
    let sequence = client
        .set_camera(Camera { position, forward: Vec3::X, velocity: Vec3::ZERO })
        .expect("the session is open");
    light_where(client, "settled light", |light| light.camera_sequence() >= sequence && light.frame().settled)
        .await
}

/// Waits until the light fulfils `condition`; it is called `what` if it never does.
///
/// # Panics
/// If it never does, or the session ends.
pub async fn light_where(client: &mut Client, what: &str, condition: impl Fn(&Light) -> bool) -> Arc<Light> {
    let waiting = async {
        let mut light = client.light();
        while !condition(&light) {
            light = client.next_light().await.expect("the session is open");
        }
        light
    };
    match tokio::time::timeout(PATIENCE, waiting).await {
        Ok(light) => light,
        Err(_elapsed) => {
            let light = client.light();
            panic!(
                "waited {PATIENCE:?} in vain for {what}; the last light is state {} for camera {}, {:?}; server: {:?}",
                light.number(),
                light.camera_sequence(),
                light.frame(),
                client.statistics().server,
            )
        }
    }
}
