//! A client before the two plates, and how far the light that it holds is from the closed form.

use crate::world::{POSITIONS, closed_form, within};
use earthshine_client::{Camera, Client, Light, Vec3};
use std::sync::Arc;

pub(crate) const CAMERA: Camera =
    Camera { position: Vec3::new(6.5, 4.5, 4.5), forward: Vec3::NEG_X, velocity: Vec3::ZERO };

/// Largest relative error that the wire may bring: RGB9E5 has nine bits.
pub(crate) const WIRE_REL: f32 = 1.0 / 400.0;

/// Largest error of both plates' light where all lamps shine `factor` times as bright, relative to the light at one.
pub(crate) fn plates_error(light: &Light, factor: f32) -> f32 {
    let normals = [Vec3::X, Vec3::NEG_X];
    let of = |((position, normal), expected): ((Vec3, Vec3), Vec3)| {
        let found = light.lookup(position, normal).expect("light here");
        (found.irradiance - expected * factor).abs().max_element() / expected.max_element()
    };
    POSITIONS.into_iter().zip(normals).zip(closed_form()).map(of).fold(0.0, f32::max)
}

/// The first light that is all there.
pub(crate) async fn settled(client: &mut Client) -> Arc<Light> {
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
