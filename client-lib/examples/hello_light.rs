//! Connect, move, read a colour: `cargo run --release --example hello_light -p earthshine-client -- http://127.0.0.1:7461`

use earthshine_client::{Camera, ClientError, ClientOptions, Vec3, blocking::Client};
use std::time::Duration;

fn main() -> Result<(), ClientError> {
    let uri = std::env::args().nth(1).unwrap_or_else(|| "http://127.0.0.1:7461".to_owned());
    let mut client = Client::connect(&uri, ClientOptions::default())?;
    let middle = (client.session().bounds_min + client.session().bounds_max) / 2.0;
    for step in 0..100 {
        let position = middle + Vec3::X * (step as f32 / 100.0);
        client.set_camera(Camera { position, forward: Vec3::X, velocity: Vec3::X })?;
        let light = client.next_light(Duration::from_secs(10))?;
        let floor = Vec3::new(position.x, client.session().bounds_min.y, position.z);
        match light.lookup(floor, Vec3::Y) {
            Some(read) => tell(&format!("indirect irradiance on the floor: {} lx", read.irradiance)),
            None => tell(&format!("no light there yet; {} patches elsewhere", light.patch_count())),
        }
    }
    client.close();
    Ok(())
}

#[expect(clippy::print_stdout, reason = "an example talks to its reader")]
fn tell(text: &str) {
    println!("{text}");
}
