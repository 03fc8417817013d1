//! `earthshine demo`: generates a town, bakes it, serves it, flies a camera under a moving sun, and draws what came.

mod page;

use crate::fly::{print_report, sun_path};
use crate::lights_wire;
use crate::machine;
use crate::output::out;
use crate::progress_bars::BakeBars;
use crate::scene_source::{self, SceneSource};
use crate::view::{Comparison, ViewArguments};
use anyhow::Context as _;
use clap::Args;
use earthshine_bake::{BakeOptions, BakeSummary};
use earthshine_client::Lights;
use earthshine_fly::{FlyFrame, FlyOptions, FlyReport, Path as FlyPath};
use earthshine_gen::GenOptions;
use earthshine_render::SceneTracer;
use earthshine_render::metrics::PictureErrors;
use earthshine_render::picture::PictureOptions;
use earthshine_server::{Config, Server};
use earthshine_tiles::BakeParameters;
use earthshine_world::{Grid, Vec3};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Arguments of `earthshine demo`.
#[derive(Args)]
#[command(after_help = "Example:
  earthshine demo --out demo-out --seconds 20
Open demo-out/index.html afterwards. Needs nothing but this program; takes two to three minutes on two cores.")]
pub(crate) struct DemoArguments {
    /// Folder for the world and the pictures.
    #[arg(long, default_value = "demo-out")]
    out: PathBuf,
    /// Length of the flight, s.
    #[arg(long, default_value_t = 20.0)]
    seconds: f32,
    /// Edge of a voxel, m.
    #[arg(long, default_value_t = 2.0)]
    voxel: f32,
    /// Paths a pixel of the reference pictures.
    #[arg(long, default_value_t = 32)]
    samples: u32,
    /// Print the summary as JSON.
    #[arg(long)]
    json: bool,
}

/// Everything the page and `--json` tell.
#[derive(serde::Serialize)]
struct Summary {
    bake: BakeSummary,
    flight: FlyReport,
    pictures: Vec<PictureSummary>,
    seconds: f64,
    peak_rss_bytes: Option<u64>,
}

#[derive(serde::Serialize)]
struct PictureSummary {
    file: String,
    flight_time_s: f32,
    indirect: PictureErrors,
    uncovered_share: f64,
}

/// When pictures are taken, as shares of the flight.
const PICTURE_TIMES: [f32; 2] = [0.45, 0.97];

/// Runs the subcommand.
pub(crate) fn run(arguments: &DemoArguments) -> anyhow::Result<()> {
    let started = Instant::now();
    std::fs::create_dir_all(&arguments.out).with_context(|| arguments.out.display().to_string())?;
    let say = |text: &str| eprintln!("{:>5.0} s  {text}", started.elapsed().as_secs_f64());
    say("generating a town");
    let source = scene_source::load_generated("town", None, false, &GenOptions::default())?;
    say(&format!("baking {} triangles", source.scene.triangles.len()));
    let world = arguments.out.join("town.world");
    let bake = bake(&source, &world, arguments.voxel)?;
    say("serving, and flying a camera through it under a moving sun");
    let (flight, frames) = serve_and_fly(arguments, &world, &source)?;
    say("drawing what the client received, beside a path-traced reference");
    let pictures = draw(arguments, &source, &frames)?;
    let peak_rss_bytes = machine::peak_rss_bytes();
    let summary =
        Summary { bake, flight, pictures, seconds: started.elapsed().as_secs_f64(), peak_rss_bytes };
    let page = arguments.out.join("index.html");
    std::fs::write(&page, page::html(&summary)).with_context(|| page.display().to_string())?;
    if arguments.json {
        out!("{}", serde_json::to_string(&summary)?);
        return Ok(());
    }
    print_report(&summary.flight);
    for picture in &summary.pictures {
        out!("{}: indirect light {}", picture.file, crate::compare::described(&picture.indirect));
    }
    out!("{:.0} s in all; open {}", summary.seconds, page.display());
    Ok(())
}

fn bake(source: &SceneSource, world: &Path, voxel_edge_m: f32) -> anyhow::Result<BakeSummary> {
    let parameters = BakeParameters {
        grid: Grid { voxel_edge_m, chunk_edge_voxels: 16 },
        rays_per_patch: 512,
        ..BakeParameters::default()
    };
    let options =
        BakeOptions { overwrite: true, ..BakeOptions::new(&source.name, parameters, source.lights.clone()) };
    let bars = BakeBars::new(false);
    let summary = earthshine_bake::bake(&source.scene, world, &options, &bars)?;
    bars.finish();
    Ok(summary)
}

/// Serves `world` on a free port of this machine while a client flies.
fn serve_and_fly(
    arguments: &DemoArguments,
    world: &Path,
    source: &SceneSource,
) -> anyhow::Result<(FlyReport, Vec<FlyFrame>)> {
    let mut config = Config { world: world.to_owned(), ..Config::default() };
    config.listen.set_port(0);
    config.admin_listen.set_port(0);
    let runtime = tokio::runtime::Runtime::new().context("the asynchronous runtime could not start")?;
    runtime.block_on(async {
        let server = Server::bind(config).await?;
        let uri = format!("http://{}", server.local_addr());
        let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
        let serving = tokio::spawn(server.run(async { drop(stopped.await) }));
        let options = flight(arguments, &uri, source);
        let mut frames = Vec::new();
        let report = earthshine_fly::fly(&options, std::future::pending(), |frame| frames.push(frame)).await;
        if stop.send(()).is_err() {
            eprintln!("the server stopped by itself; its own error follows");
        }
        serving.await.context("the server's task")??;
        Ok((report?, frames))
    })
}

fn flight(arguments: &DemoArguments, uri: &str, source: &SceneSource) -> FlyOptions {
    let bounds = source.scene.bounds();
    // Along a street, at eye height.
    let eye = 1.7;
    let centre = bounds.centre();
    let reach = 12.0;
    let path = FlyPath::Line {
        from: Vec3::new(centre.x, eye, centre.z - reach),
        to: Vec3::new(centre.x, eye, centre.z + reach),
        speed: 2.0 * reach / arguments.seconds.max(1.0),
    };
    let mut options = FlyOptions::new(uri, path);
    options.duration = Duration::from_secs_f32(arguments.seconds.clamp(1.0, 600.0));
    options.lights = Some(sky_lit(&lights_wire::to_client(&source.lights)));
    options.sun = Some(sun_path());
    options.picture_times_s = PICTURE_TIMES.map(|share| share * arguments.seconds).to_vec();
    options
}

/// The town's own lamps under a blue sky.
fn sky_lit(lights: &Lights) -> Lights {
    Lights { sky: [Vec3::new(3_000.0, 4_000.0, 6_000.0); 6], ..lights.clone() }
}

fn draw(
    arguments: &DemoArguments,
    source: &SceneSource,
    frames: &[FlyFrame],
) -> anyhow::Result<Vec<PictureSummary>> {
    let tracer = SceneTracer::new(&source.scene);
    let view = ViewArguments::sized(320, 180);
    let mut pictures = Vec::new();
    for frame in frames {
        let rig = frame.lights.as_ref().map_or_else(|| source.lights.clone(), lights_wire::from_client);
        let camera = view.pinhole_at(frame.camera.position, frame.camera.forward)?;
        let lookup = |position, normal| frame.light.lookup(position, normal).map(|found| found.irradiance);
        let options = PictureOptions { camera, samples: 8, seed: 1 };
        let comparison = Comparison::take(&tracer, &rig, &options, arguments.samples, &lookup)?;
        let file = format!("sheet_{}.png", frame.picture);
        comparison.write_sheet(&arguments.out.join(&file))?;
        pictures.push(PictureSummary {
            file,
            flight_time_s: frame.time_s,
            indirect: comparison.indirect_errors()?,
            uncovered_share: comparison.service.uncovered_share,
        });
    }
    Ok(pictures)
}
