//! A server in the background: free ports, budgets that let a small world settle at once.

use crate::viewer::within;
use earthshine_server::{Config, CurrentDevice, Server, ServerError};
use std::net::SocketAddr;
use std::path::Path;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

/// A running server.
#[derive(Debug)]
pub struct ServedWorld {
    /// `http://address` for clients.
    pub uri: String,
    /// The device that computes, if any.
    pub device: CurrentDevice,
    admin: SocketAddr,
    stop: oneshot::Sender<()>,
    ended: JoinHandle<Result<(), ServerError>>,
}

impl ServedWorld {
    /// Serves the world in the folder `world` with up to `resident_patches_max` patches a session, and with what
    /// `change` makes of the configuration.
    ///
    /// # Panics
    /// If the server does not start.
    pub async fn start(world: &Path, resident_patches_max: u32, change: impl FnOnce(&mut Config)) -> Self {
        let free = "127.0.0.1:0".parse().expect("an address");
        let mut config = Config {
            world: world.to_owned(),
            listen: free,
            admin_listen: free,
            tick_rate_hz: 200.0,
            ..Config::default()
        };
        config.engine.resident_patches_max = resident_patches_max;
        config.engine.load_radius_m = 1000.0;
        config.engine.adds_per_tick_max = 256;
        config.engine.removals_per_tick_max = 256;
        config.engine.shadow_points_per_tick_max = 1 << 20;
        change(&mut config);
        let server = Server::bind(config).await.expect("a sound world and a free port");
        let (uri, device) = (format!("http://{}", server.local_addr()), server.device());
        let admin = server.admin_addr();
        let (stop, stopped) = oneshot::channel();
        let ended = tokio::spawn(server.run(async { drop(stopped.await) }));
        Self { uri, device, admin, stop, ended }
    }

    /// The sum of all lines of a metric, as a scraper reads them; 0 if there is none.
    ///
    /// # Panics
    /// If the server does not answer.
    pub async fn metric(&self, name: &str) -> f64 {
        let asked = async {
            let mut stream = TcpStream::connect(self.admin).await?;
            stream.write_all(b"GET /metrics HTTP/1.0\r\nHost: local\r\n\r\n").await?;
            let mut text = String::new();
            stream.read_to_string(&mut text).await?;
            std::io::Result::Ok(text)
        };
        let text = within("metrics", asked).await.expect("the server answers");
        let value = |line: &str| {
            let (what, value) = line.rsplit_once(' ')?;
            if what.split('{').next()? == name { value.parse::<f64>().ok() } else { None }
        };
        text.lines().filter_map(value).sum()
    }

    /// Stops it and returns how it ended.
    ///
    /// # Panics
    /// If it does not end in time, or panics.
    ///
    /// # Errors
    /// Whatever ended the server's task.
    pub async fn stop(self) -> Result<(), ServerError> {
        drop(self.stop);
        within("the server's end", self.ended).await.expect("the server does not panic")
    }
}
