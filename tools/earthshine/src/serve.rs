//! `earthshine serve`: the streaming service, until a signal.

use crate::output::out;
use anyhow::Context as _;
use earthshine_server::{ServeArgs, Server, shutdown};

/// Runs the subcommand.
pub(crate) fn run(arguments: ServeArgs) -> anyhow::Result<()> {
    let config = arguments.resolve()?;
    let runtime = tokio::runtime::Runtime::new().context("the asynchronous runtime could not start")?;
    runtime.block_on(async {
        let server = Server::bind(config).await?;
        out!("serving  http://{}   (gRPC; {})", server.local_addr(), server.world_name());
        out!("admin    http://{}/metrics, /health, /ready", server.admin_addr());
        server.run(async { drop(shutdown::signal().await) }).await?;
        Ok(())
    })
}
