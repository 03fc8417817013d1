//! `earthshine`: one command for worlds, light and measurements.
//!
//! Each subcommand is a module that parses its arguments and calls a library; results go to standard output,
//! progress and logs to standard error. Exit codes are in [`exit_code`].

#![expect(clippy::print_stderr, reason = "a command-line tool")]

mod bake;
mod bench;
mod causes;
mod cluster_light;
mod compare;
mod connect;
mod defaults;
mod demo;
mod end_words;
mod error_view;
mod exit_code;
mod fly;
mod fly_solvers;
mod generate;
mod gpu;
mod inspect;
mod lights_wire;
mod machine;
mod memory;
mod method;
mod numbers;
mod operators;
mod output;
mod progress_bars;
mod quality;
mod ray_device;
mod reference_light;
mod render;
mod same_scene;
mod scene_source;
mod serve;
mod side_by_side;
mod solver;
mod solver_world;
mod view;
mod volume_light;
mod whole_world;
mod writable;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Streams dynamic diffuse global illumination for worlds larger than memory.
#[derive(Parser)]
#[command(version, about, after_help = exit_code::HELP)]
struct Arguments {
    /// Log filter, as in `RUST_LOG`: error, warn, info, debug, or target=level.
    #[arg(long, global = true, env = "EARTHSHINE_LOG", default_value = "warn")]
    log: String,
    /// Logs as JSON lines.
    #[arg(long, global = true, env = "EARTHSHINE_LOG_JSON")]
    log_json: bool,
    /// Worker threads; 0 for one a core.
    #[arg(long, global = true, env = "EARTHSHINE_THREADS", default_value_t = 0)]
    threads: usize,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Generates a world to bake: Cornell box, furnace, two rooms, corridor, town.
    Gen(generate::GenArguments),
    /// Bakes a glTF scene into a world folder.
    Bake(bake::BakeArguments),
    /// Says what is in a world, and whether it is sound.
    Inspect(inspect::InspectArguments),
    /// Serves a world until SIGTERM or Ctrl-C.
    Serve(earthshine_server::ServeArgs),
    /// Says how a running server solves light, or changes it.
    Solver(solver::SolverArguments),
    /// Lists graphics adapters: what each can do, and how many patches fit.
    Gpu(gpu::GpuArguments),
    /// Flies a camera through a served world: latencies, misses, pictures.
    Fly(fly::FlyArguments),
    /// Draws a scene: path-traced, by a world's light, in screen space, by progressive refinement.
    Render(render::RenderArguments),
    /// Compares pictures, or a world's light with a reference at points.
    Compare(compare::CompareArguments),
    /// All of it on a generated town, in one go.
    Demo(demo::DemoArguments),
    /// Measures, and prints one JSON object.
    Bench(bench::BenchArguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if let Err(error) = start_logging(&arguments).and_then(|()| start_threads(arguments.threads)) {
        eprintln!("error: {error:#}");
        return ExitCode::from(exit_code::USAGE);
    }
    let result = match arguments.command {
        Command::Gen(command) => generate::run(&command),
        Command::Bake(command) => bake::run(&command),
        Command::Inspect(command) => inspect::run(&command),
        Command::Serve(command) => serve::run(command),
        Command::Solver(command) => solver::run(&command),
        Command::Gpu(command) => gpu::run(&command),
        Command::Fly(command) => fly::run(&command),
        Command::Render(command) => render::run(&command),
        Command::Compare(command) => compare::run(&command),
        Command::Demo(command) => demo::run(&command),
        Command::Bench(command) => bench::run(&command),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", exit_code::described(&error));
            ExitCode::from(exit_code::of(&error))
        }
    }
}

fn start_logging(arguments: &Arguments) -> anyhow::Result<()> {
    let filter = tracing_subscriber::EnvFilter::try_new(&arguments.log)
        .map_err(|error| anyhow::anyhow!("--log {:?}: {error}", arguments.log))?;
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    if arguments.log_json {
        builder.json().init();
    } else {
        builder.init();
    }
    Ok(())
}

fn start_threads(threads: usize) -> anyhow::Result<()> {
    Ok(rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?)
}
