//! The same flight by several solvers of one server, one after the other, and their pictures side by side.

use crate::lights_wire;
use crate::operators::Operators;
use crate::scene_source;
use crate::side_by_side::{self, Reel};
use crate::solver::by_level;
use crate::view::ViewArguments;
use anyhow::Context as _;
use earthshine_fly::{FlyFrame, FlyOptions, FlyReport};
use earthshine_render::picture::{LightSource, PictureOptions, render};
use earthshine_render::{SceneTracer, image_file};
use earthshine_world::LightRig;
use image::RgbImage;
use std::path::{Path, PathBuf};

/// Places within a pixel.
const SAMPLES: u32 = 4;

/// A flight by one solver.
pub(crate) struct SolvedFlight {
    pub(crate) solver: String,
    pub(crate) report: FlyReport,
    frames: Vec<FlyFrame>,
}

/// Flies once for each of `solvers`. The server solves as before afterwards, whatever happened.
///
/// # Errors
/// The operators' port or the flight.
pub(crate) async fn fly_by(
    options: &FlyOptions,
    solvers: &[String],
    operators: &Operators,
) -> anyhow::Result<Vec<SolvedFlight>> {
    let before = operators.solver().await?;
    let flights = flights(options, solvers, operators).await;
    let restored = operators.change_solver(&before).await;
    let flights = flights?;
    restored.context("the flights are over, but the server's solvers could not be put back")?;
    Ok(flights)
}

async fn flights(
    options: &FlyOptions,
    solvers: &[String],
    operators: &Operators,
) -> anyhow::Result<Vec<SolvedFlight>> {
    let mut flights = Vec::new();
    for solver in solvers {
        operators.change_solver(&by_level(&[solver])).await?;
        let mut frames = Vec::new();
        let landing = async { drop(tokio::signal::ctrl_c().await) };
        let report = earthshine_fly::fly(options, landing, |frame| frames.push(frame)).await?;
        flights.push(SolvedFlight { solver: solver.clone(), report, frames });
    }
    Ok(flights)
}

/// Draws all flights at one exposure, that of the first picture; returns the files written into `folder`.
///
/// # Errors
/// The scene, or the files.
pub(crate) fn draw(
    flights: &[SolvedFlight],
    folder: &Path,
    scene: &str,
    own_lights: &LightRig,
    view: &ViewArguments,
) -> anyhow::Result<[PathBuf; 2]> {
    let source = scene_source::load(scene, None, false)?;
    let tracer = SceneTracer::new(&source.scene);
    let mut exposure = None;
    let mut picture = |frame: &FlyFrame| -> anyhow::Result<RgbImage> {
        let rig = frame.lights.as_ref().map_or_else(|| own_lights.clone(), lights_wire::from_client);
        let camera = view.pinhole_at(frame.camera.position, frame.camera.forward)?;
        let lookup = |position, normal| frame.light.lookup(position, normal).map(|found| found.irradiance);
        let options = PictureOptions { camera, samples: SAMPLES, seed: 1 };
        let layers = render(&tracer, &rig, &options, LightSource::Lookup(&lookup))?;
        let exposure = *exposure.get_or_insert_with(|| image_file::key_exposure(&layers.full));
        Ok(image_file::exposed(&layers.full, exposure))
    };
    let mut reels = Vec::new();
    for flight in flights {
        let pictures = flight.frames.iter().map(&mut picture).collect::<anyhow::Result<Vec<_>>>()?;
        reels.push(Reel { name: &flight.solver, pictures });
    }
    side_by_side::write(folder, &reels)
}
