//! `bench flight`: a camera flown through a served world, held against what the server promises.
//!
//! Server and client run in this process and speak gRPC over loopback; tiles come from the world's folder through the
//! real loader. A frame's time is that of an engine's tick.

mod figures;
mod footprint;

use super::Report;
use crate::exit_code::WrongUse;
use crate::output::out;
use anyhow::Context as _;
use clap::Args;
use earthshine_fly::{FlyOptions, FlyReport, Path as FlyPath};
use earthshine_render::chart;
use earthshine_server::{Observer, ServeArgs, Server, TickSample};
use earthshine_world::{Bounds, Vec3};
use figures::Figures;
use footprint::{Footprint, LapMemory, drop_pages};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// How often ticks are collected and memory is looked at.
const SAMPLE_PERIOD: Duration = Duration::from_millis(100);

/// Arguments of `bench flight`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine bench flight --world town.world --speed 50 --json
  earthshine bench flight --world town.world --speed 10 --laps 10 --plot flight
  earthshine bench flight --world town.world --teleports --cold
Cold: before each lap the kernel is told to drop the tiles' pages (posix_fadvise, DONTNEED).")]
pub(super) struct FlightArguments {
    /// Folder of a baked world.
    #[arg(long)]
    world: PathBuf,
    /// Speed of the camera, on a circle around the world's middle, m/s.
    #[arg(long, default_value_t = 10.0)]
    speed: f32,
    /// Laps, one after the other without a pause.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    laps: u32,
    /// Length of a lap, s.
    #[arg(long, default_value_t = 60.0)]
    seconds: f32,
    /// Jumps to random places instead of flying.
    #[arg(long)]
    teleports: bool,
    /// Teleports: rest at each place, s.
    #[arg(long, default_value_t = 3.0, requires = "teleports")]
    every: f32,
    /// Drops the tiles' pages before each lap.
    #[arg(long)]
    cold: bool,
    /// Above the world's lowest point, m.
    #[arg(long, default_value_t = 1.7)]
    height: f32,
    /// Which places are jumped to.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Configuration of the server, as for `serve`.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Any key of it: --set engine.KEY=VALUE (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Draws frame time and missing patches over time as STEM.svg and STEM.png.
    #[arg(long, value_name = "STEM")]
    plot: Option<PathBuf>,
}

/// What was seen of a flight.
struct Flown {
    report: FlyReport,
    ticks: Vec<TickSample>,
    observer: Observer,
    footprint: Footprint,
    seconds: f64,
}

pub(super) fn run(arguments: &FlightArguments, json: bool) -> anyhow::Result<()> {
    let started = Instant::now();
    let mut config = ServeArgs {
        world: Some(arguments.world.clone()),
        config: arguments.config.clone(),
        set: arguments.set.clone(),
        ..ServeArgs::default()
    }
    .resolve()?;
    if config.tls.is_some() {
        return Err(WrongUse(
            "bench flight serves and flies in one process, without a certificate: leave tls out",
        )
        .into());
    }
    let token = Some(config.bearer_token.0.clone()).filter(|token| !token.is_empty());
    config.listen.set_port(0);
    config.admin_listen.set_port(0);
    let levels = 0..config.engine.solver.by_level.len().max(1);
    let solvers: Vec<&str> =
        levels.map(|level| config.engine.solver_settings(level as u8).method.name()).collect();
    let solvers = solvers.join(",");
    let runtime = tokio::runtime::Runtime::new().context("the asynchronous runtime could not start")?;
    let (flown, backend) = runtime.block_on(async {
        let server = Server::bind(config).await?;
        let (observer, device) = (server.observer(), server.device());
        let mut options = options(arguments, &server);
        options.client.credentials.bearer_token = token;
        let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
        let serving = tokio::spawn(server.run(async { drop(stopped.await) }));
        let flown = fly(arguments, &options, observer).await;
        let backend = if device.get().is_some() { "gpu" } else { "cpu" };
        if stop.send(()).is_err() {
            eprintln!("the server stopped by itself; its own error follows");
        }
        serving.await.context("the server's task")??;
        anyhow::Ok((flown?, backend))
    })?;
    let files = match &arguments.plot {
        Some(stem) => chart::write_both(stem, &figures::charts(&flown))?.to_vec(),
        None => Vec::new(),
    };
    let figures = Figures::of(arguments, &flown, files);
    if !json {
        figures.print(&flown.observer);
        return Ok(());
    }
    let scene = arguments.world.display().to_string();
    let seconds = started.elapsed().as_secs_f64();
    let mut report = Report::new("flight", &scene, &solvers, arguments.seed, seconds, figures);
    report.backend = backend;
    report.print(json)
}

fn options(arguments: &FlightArguments, server: &Server) -> FlyOptions {
    let uri = format!("http://{}", server.local_addr());
    let mut options = FlyOptions::new(uri, path(arguments, &server.world_index().bounds));
    let seconds = arguments.seconds.clamp(0.1, 36_000.0);
    options.duration = Duration::from_millis((seconds * 1e3) as u64) * arguments.laps;
    options
}

fn path(arguments: &FlightArguments, bounds: &Bounds) -> FlyPath {
    let (size, centre) = (bounds.size(), bounds.centre());
    let eye = bounds.min.y + arguments.height;
    if arguments.teleports {
        // A tenth of the world is left at each rim: there is little there to see.
        let inner = Vec3::new(size.x, 0.0, size.z) * 0.4;
        let middle = Vec3::new(centre.x, eye, centre.z);
        return FlyPath::Teleports {
            seed: arguments.seed,
            bounds_min: middle - inner,
            bounds_max: middle + inner,
            every_s: arguments.every,
        };
    }
    let radius = (size.x.min(size.z) * 0.25).max(1e-3);
    let period_s = std::f32::consts::TAU * radius / arguments.speed.max(1e-3);
    FlyPath::Orbit { centre: Vec3::new(centre.x, eye, centre.z), radius, height: 0.0, period_s }
}

/// Flies, and looks on.
async fn fly(arguments: &FlightArguments, options: &FlyOptions, observer: Observer) -> anyhow::Result<Flown> {
    let began = Instant::now();
    let lap = options.duration / arguments.laps;
    let mut footprint = Footprint::new(arguments.laps);
    let mut ticks = Vec::new();
    if arguments.cold {
        footprint.dropped_bytes += drop_pages(&arguments.world)?;
    }
    let flight = earthshine_fly::fly(options, std::future::pending(), |_| ());
    let mut flight = std::pin::pin!(flight);
    let mut samples = tokio::time::interval(SAMPLE_PERIOD);
    let mut laps_begun = 1;
    let report = loop {
        tokio::select! {
            report = &mut flight => break report?,
            _ = samples.tick() => {
                ticks.extend(observer.take_ticks());
                let at = (began.elapsed().as_secs_f64() / lap.as_secs_f64()) as u32;
                footprint.look(at, observer.memory());
                if arguments.cold && at >= laps_begun && at < arguments.laps {
                    laps_begun = at + 1;
                    footprint.dropped_bytes += drop_pages(&arguments.world)?;
                }
            }
        }
    };
    ticks.extend(observer.take_ticks());
    footprint.end();
    Ok(Flown { report, ticks, observer, footprint, seconds: began.elapsed().as_secs_f64() })
}

fn milliseconds(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.0} ms"))
}

impl Figures {
    fn print(&self, observer: &Observer) {
        let promise = observer.promise();
        out!(
            "promised: light of level 0 within {:.1} m at up to {:.1} m/s with {:.1} MB/s of tiles; after a jump within {:.1} s",
            self.promised_radius_m,
            self.promised_speed_m_s,
            promise.tile_bytes_per_s / 1e6,
            promise.recovery_s
        );
        out!(
            "at {:.0} m/s within {:.1} m: {} violations in {} ticks (waiting for tiles {}, slots {}, light {})",
            self.speed_m_s,
            self.promised_radius_at_speed_m,
            self.violations,
            self.promised_ticks,
            self.violations_by_cause.tiles,
            self.violations_by_cause.slots,
            self.violations_by_cause.light
        );
        out!(
            "{} frames to the client ({:.1} a second), {} of {} without light below the camera",
            self.frames,
            self.frames_per_s,
            self.dark_frames,
            self.probed_frames
        );
        out!("misses by level: {:?} of {} ticks", self.misses_by_level, self.ticks);
        out!(
            "tick: p50 {:.1} ms, p99 {:.1} ms, max {:.1} ms",
            self.frame_ms_p50,
            self.frame_ms_p99,
            self.frame_ms_max
        );
        if self.teleports > 0 {
            out!(
                "teleport to light of level 0: p50 {}, p99 {} ({} of {} before the next)",
                milliseconds(self.teleport_to_light_ms_p50),
                milliseconds(self.teleport_to_light_ms_p99),
                self.teleports_lit,
                self.teleports
            );
        }
        out!(
            "tiles {:.2} MB/s; read from disk {:.2} MB/s ({:.2} bytes a byte of tiles)",
            self.tile_mb_s,
            self.read_mb_s,
            self.read_amplification
        );
        out!(
            "memory: first lap {:.0} MB, last lap {:.0} MB; drift {:.1e}",
            self.rss_first_lap_bytes as f64 / 1e6,
            self.rss_last_lap_bytes as f64 / 1e6,
            self.drift_rel
        );
        out!("memory by lap, MB, when most was resident:");
        for (name, of) in LapMemory::COLUMNS {
            let megabytes: Vec<String> =
                self.memory.iter().map(|lap| format!("{:6.1}", of(lap) as f64 / 1e6)).collect();
            out!("  {name:<22}{}", megabytes.join(" "));
        }
    }
}
