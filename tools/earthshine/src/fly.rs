//! `earthshine fly`: a camera path through the client library, with latencies, misses and pictures.

use crate::connect::ConnectArguments;
use crate::exit_code::WrongUse;
use crate::fly_solvers;
use crate::lights_wire;
use crate::operators::{OperatorArguments, Operators};
use crate::output::out;
use crate::scene_source;
use crate::view::{ViewArguments, vector, write_layers};
use crate::writable;
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use earthshine_client::{ClientOptions, World};
use earthshine_fly::{
    FlyFrame, FlyOptions, FlyReport, Path, SunCourse, SunFile, SunLight, SunPath, SunPathError,
};
use earthshine_render::picture::{LightSource, PictureOptions, render};
use earthshine_render::{SceneTracer, image_file};
use earthshine_world::light::STRENGTH_WARNING;
use earthshine_world::{LightRig, Vec3};
use std::path::{Path as FilePath, PathBuf};
use std::time::Duration;

/// Arguments of `earthshine fly`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine fly                                     (an orbit around the world, 20 s)
  earthshine fly --path line --from -50,2,0 --to 50,2,0 --speed 10
  earthshine fly --path recorded --file walk.json --out pictures --scene town.glb
  earthshine fly --path teleports --every 2 --json
  earthshine fly --server https://light.example:7461 --ca-certificate ca.pem
  earthshine fly --sun-path config/day.example.toml --seconds 60
  earthshine fly --sun-path config/day.example.toml --solvers hybrid,alias --pictures 24 --out day --scene town.glb
                                                     (the same day by two solvers: day/animation.gif, day/strip.png)")]
pub(crate) struct FlyArguments {
    #[command(flatten)]
    connect: ConnectArguments,
    #[command(flatten)]
    route: RouteArguments,
    /// Length of the flight, s.
    #[arg(long, default_value_t = 20.0)]
    seconds: f32,
    /// Camera updates a second.
    #[arg(long, default_value_t = 60.0)]
    rate: f32,
    /// Moves the sun from east to west during the flight.
    #[arg(long, conflicts_with = "sun_path")]
    moving_sun: bool,
    /// Moves sun and sky as this TOML file says (config/day.example.toml).
    #[arg(long)]
    sun_path: Option<PathBuf>,
    /// Flies once by each of these solvers, which the server is switched to through --admin, and draws them side by side;
    /// needs --out.
    #[arg(long, value_delimiter = ',', requires = "out", value_name = "NAMES")]
    solvers: Vec<String>,
    #[command(flatten)]
    operators: OperatorArguments,
    /// Writes pictures of the flight into this folder; needs --scene.
    #[arg(long, requires = "scene")]
    out: Option<PathBuf>,
    /// The scene that was baked, to draw pictures of.
    #[arg(long)]
    scene: Option<String>,
    /// How many pictures.
    #[arg(long, default_value_t = 4)]
    pictures: u32,
    #[command(flatten)]
    view: ViewArguments,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Route {
    Orbit,
    Line,
    Recorded,
    Teleports,
}

#[derive(Args)]
struct RouteArguments {
    /// What the camera does.
    #[arg(long, value_enum, default_value = "orbit")]
    path: Route,
    /// Recorded: path file, JSON or TOML.
    #[arg(long)]
    file: Option<PathBuf>,
    /// Line: start. Default: one side of the world.
    #[arg(long, value_parser = vector, allow_hyphen_values = true)]
    from: Option<Vec3>,
    /// Line: end. Default: the other side.
    #[arg(long, value_parser = vector, allow_hyphen_values = true)]
    to: Option<Vec3>,
    /// Line: m/s. Orbit: along the circle.
    #[arg(long, default_value_t = 5.0)]
    speed: f32,
    /// Orbit: m. Default: a quarter of the world's smaller side.
    #[arg(long)]
    radius: Option<f32>,
    /// Teleports: rest at each place, s.
    #[arg(long, default_value_t = 2.0)]
    every: f32,
    /// Teleports: which places.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Writes the path that was flown, to fly it again with --path recorded.
    #[arg(long)]
    record: Option<PathBuf>,
}

impl RouteArguments {
    fn path(&self, world: &World) -> anyhow::Result<Path> {
        let (low, high) = (world.bounds_min, world.bounds_max);
        let (centre, size) = ((low + high) * 0.5, high - low);
        let eye = low.y + (size.y * 0.5).min(1.7);
        Ok(match self.path {
            Route::Orbit => {
                let radius = self.radius.unwrap_or(size.x.min(size.z) * 0.25).max(1e-3);
                let period_s = std::f32::consts::TAU * radius / self.speed;
                Path::Orbit { centre: Vec3::new(centre.x, eye, centre.z), radius, height: 0.0, period_s }
            }
            Route::Line => Path::Line {
                from: self.from.unwrap_or(Vec3::new(low.x, eye, centre.z)),
                to: self.to.unwrap_or(Vec3::new(high.x, eye, centre.z)),
                speed: self.speed,
            },
            Route::Recorded => match &self.file {
                Some(file) => Path::load(file)?,
                None => return Err(WrongUse("--path recorded needs --file").into()),
            },
            Route::Teleports => Path::Teleports {
                seed: self.seed,
                bounds_min: Vec3::new(low.x, eye, low.z),
                bounds_max: Vec3::new(high.x, eye, high.z),
                every_s: self.every,
            },
        })
    }
}

/// A sun that crosses the sky from east to west, as bright as a clear day's.
pub(crate) fn sun_path() -> SunPath {
    SunPath {
        course: SunCourse::Straight { azimuth_deg: [20.0, 160.0], elevation_deg: [25.0, 55.0] },
        light: SunLight::Constant { illuminance: Vec3::new(100_000.0, 96_000.0, 90_000.0) },
        rate_hz: 2.0,
    }
}

// One bound for suns and for other lights; the flight knows clients alone, so that it cannot look into the server.
const _: () = assert!(SunLight::ILLUMINANCE_WARNING_LX.to_bits() == STRENGTH_WARNING.to_bits());

/// Reads a sun path, and says on standard error what is probably not meant.
pub(crate) fn load_sun(file: &FilePath) -> Result<SunPath, SunPathError> {
    let SunFile { sun, warning } = SunFile::load(file)?;
    if let Some(warning) = warning {
        eprintln!("warning: {warning}");
    }
    Ok(sun)
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &FlyArguments) -> anyhow::Result<()> {
    let duration = Duration::try_from_secs_f32(arguments.seconds)
        .map_err(|_out_of_range| WrongUse("--seconds has to be a number, 0 or more"))?;
    writable::ensure_files(&arguments.route.record)?;
    if let Some(folder) = &arguments.out {
        writable::ensure_folder(folder)?;
    }
    let sun = match &arguments.sun_path {
        Some(file) => Some(load_sun(file)?),
        None => arguments.moving_sun.then(sun_path),
    };
    let runtime = tokio::runtime::Runtime::new().context("the asynchronous runtime could not start")?;
    let server = &arguments.connect.server;
    let credentials = arguments.connect.credentials()?;
    let asking = ClientOptions { credentials: credentials.clone(), ..ClientOptions::default() };
    let world = runtime.block_on(earthshine_client::world(server, &asking))?;
    let path = arguments.route.path(&world)?;
    let mut options = FlyOptions::new(server, path);
    options.client.credentials = credentials;
    options.duration = duration;
    options.rate_hz = arguments.rate;
    if sun.is_some() {
        options.lights = Some(world.lights.clone());
        options.sun = sun;
    }
    if arguments.out.is_some() {
        let step = arguments.seconds / arguments.pictures.max(1) as f32;
        options.picture_times_s = (1..=arguments.pictures).map(|i| step * (i as f32 - 0.25)).collect();
    }
    if !arguments.solvers.is_empty() {
        return compare_solvers(arguments, &runtime, &options, &world);
    }
    let mut frames = Vec::new();
    // Ctrl-C lands: what was measured until then is reported. A signal that cannot be caught ends the process.
    let landing = async { drop(tokio::signal::ctrl_c().await) };
    let report = runtime.block_on(earthshine_fly::fly(&options, landing, |frame| frames.push(frame)))?;
    if let Some(file) = &arguments.route.record {
        recorded(&options.path, arguments.seconds, arguments.rate).save(file)?;
    }
    if let (Some(folder), Some(scene)) = (&arguments.out, &arguments.scene) {
        draw(&frames, folder, scene, &lights_wire::from_client(&world.lights), &arguments.view)?;
    }
    if arguments.json {
        out!("{}", serde_json::to_string(&report)?);
    } else {
        print_report(&report);
    }
    Ok(())
}

/// The flight by every solver that is named.
fn compare_solvers(
    arguments: &FlyArguments,
    runtime: &tokio::runtime::Runtime,
    options: &FlyOptions,
    world: &World,
) -> anyhow::Result<()> {
    let operators = Operators {
        address: arguments.operators.admin.clone(),
        bearer_token: options.client.credentials.bearer_token.clone(),
    };
    let flights = runtime.block_on(fly_solvers::fly_by(options, &arguments.solvers, &operators))?;
    let (Some(folder), Some(scene)) = (&arguments.out, &arguments.scene) else {
        return Err(WrongUse("--solvers needs --out and --scene").into());
    };
    let own_lights = lights_wire::from_client(&world.lights);
    let files = fly_solvers::draw(&flights, folder, scene, &own_lights, &arguments.view)?;
    if arguments.json {
        let flown: Vec<_> = flights
            .iter()
            .map(|flight| serde_json::json!({ "solver": flight.solver, "report": flight.report }))
            .collect();
        out!("{}", serde_json::json!({ "flights": flown, "files": files }));
        return Ok(());
    }
    for flight in &flights {
        out!("{}:", flight.solver);
        print_report(&flight.report);
    }
    out!("{}, {}", files[0].display(), files[1].display());
    Ok(())
}

/// Ten keys a second of what `path` does.
fn recorded(path: &Path, seconds: f32, rate: f32) -> Path {
    let step = 1.0 / rate.clamp(1.0, 10.0);
    let keys = (0..=(seconds / step) as u32)
        .map(|index| {
            let time_s = index as f32 * step;
            let camera = path.camera(time_s);
            earthshine_fly::Key { time_s, position: camera.position, forward: camera.forward }
        })
        .collect();
    Path::Recorded { keys }
}

/// Pictures with more unlit surface than this are remarked on.
const UNCOVERED_WARNING_PERCENT: f64 = 2.0;

/// Draws what each kept frame's light looks like.
fn draw(
    frames: &[FlyFrame],
    folder: &std::path::Path,
    scene: &str,
    own_lights: &LightRig,
    view: &ViewArguments,
) -> anyhow::Result<()> {
    let source = scene_source::load(scene, None, false)?;
    let tracer = SceneTracer::new(&source.scene);
    for frame in frames {
        let rig = frame.lights.as_ref().map_or_else(|| own_lights.clone(), lights_wire::from_client);
        let camera = view.pinhole_at(frame.camera.position, frame.camera.forward)?;
        let lookup = |position, normal| frame.light.lookup(position, normal).map(|found| found.irradiance);
        let options = PictureOptions { camera, samples: 8, seed: 1 };
        let layers = render(&tracer, &rig, &options, LightSource::Lookup(&lookup))?;
        let uncovered = layers.uncovered_share * 100.0;
        if uncovered > UNCOVERED_WARNING_PERCENT {
            eprintln!(
                "warning: picture {}: {uncovered:.0} % of the surfaces in view lie beyond the resident patches and \
                 are drawn without indirect light; raise engine.resident_patches_max or the bake's --voxel",
                frame.picture
            );
        }
        let prefix = format!("flight_{:02}_", frame.picture);
        write_layers(folder, &prefix, &layers, image_file::key_exposure(&layers.full), false)?;
    }
    Ok(())
}

/// The report in a few lines.
pub(crate) fn print_report(report: &FlyReport) {
    let milliseconds = |value: Option<f64>| value.map_or("-".to_owned(), |ms| format!("{ms:.1} ms"));
    out!(
        "{:.1} s, {} frames ({:.1} a second), {:.2} MB/s",
        report.duration_s,
        report.frames,
        report.frames_per_s,
        report.bytes_per_s / 1e6
    );
    out!(
        "camera to light: p50 {}, p99 {}; first light after {}",
        milliseconds(report.latency_ms_p50),
        milliseconds(report.latency_ms_p99),
        milliseconds(report.first_light_ms)
    );
    out!(
        "misses: {} of {} frames; dark probes {} of {}",
        report.misses,
        report.probed_frames,
        report.dark_probes,
        report.probes
    );
    if let (Some(quality), Some(far), Some(stale)) = (report.quality, report.far_share, report.stale_share) {
        out!(
            "light of lit probes rests on {:.1} % of what is around them, {:.1} % from coarse levels; {:.1} % of it waits for new direct light",
            quality * 1e2,
            far * 1e2,
            stale * 1e2
        );
    }
    if let (Some(radius), Some(speed), Some(violations)) =
        (report.promised_radius_m, report.promised_speed_m_s, report.promise_violations)
        && radius > 0.0
    {
        out!(
            "promised: light of level 0 within {radius:.1} m at up to {speed:.1} m/s; broken in {violations} ticks, \
             missing in {} frames",
            report.incomplete_frames
        );
    }
    if report.teleports > 0 {
        out!(
            "teleports: {} of {} lit, p50 {}, p99 {}",
            report.teleports_lit,
            report.teleports,
            milliseconds(report.teleport_to_light_ms_p50),
            milliseconds(report.teleport_to_light_ms_p99)
        );
    }
    if let Some(warning) = &report.warning {
        out!("warning: {warning}");
    }
}
