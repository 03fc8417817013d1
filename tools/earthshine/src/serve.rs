//! `earthshine serve`: the streaming service, until a signal.

use crate::output::out;
use anyhow::Context as _;
use earthshine_server::{Promise, ServeArgs, Server, shutdown};

/// Runs the subcommand.
pub(crate) fn run(arguments: ServeArgs) -> anyhow::Result<()> {
    let config = arguments.resolve()?;
    let runtime = tokio::runtime::Runtime::new().context("the asynchronous runtime could not start")?;
    runtime.block_on(async {
        let server = Server::bind(config).await?;
        let signal = shutdown::signal()?;
        out!("serving  http://{}   (gRPC; {})", server.local_addr(), server.world_name());
        out!("admin    http://{}/metrics, /health, /ready, /solver", server.admin_addr());
        out!("{}", promised(server.promise()));
        server.run(signal).await?;
        Ok(())
    })
}

/// What the server promises, in words.
fn promised(promise: &Promise) -> String {
    if promise.radius_m <= 0.0 {
        return "promise  none: the most crowded places do not fit the slots or the memory; raise \
                engine.resident_patches_max or engine.decoded_bytes_max, or bake with larger voxels"
            .to_owned();
    }
    let also = [10.0, 50.0, 200.0]
        .into_iter()
        .filter(|&speed| speed > promise.speed_m_s)
        .map(|speed| format!("; at {speed} m/s {}", by_level(promise, speed)))
        .collect::<String>();
    format!(
        "promise  one camera has light of level 0 within {:.1} m in every frame, at up to {:.1} m/s with {:.1} MB/s of \
         tiles, and {:.1} s after a jump{also}",
        promise.radius_m,
        promise.speed_m_s,
        promise.tile_bytes_per_s / 1e6,
        promise.recovery_s
    )
}

/// What is promised of each level at `speed_m_s`: a fast camera has little of the fine ones, and more of the coarse ones.
fn by_level(promise: &Promise, speed_m_s: f32) -> String {
    let radius = |level: u8| match promise.radius_of(level, speed_m_s) {
        radius_m if radius_m.is_infinite() => format!("all of level {level}"),
        radius_m => format!("level {level} within {radius_m:.1} m"),
    };
    (0..promise.level_count()).map(radius).collect::<Vec<_>>().join(", ")
}
