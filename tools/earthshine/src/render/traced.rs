//! The path-traced reference, alone or beside a world's light.

use super::Task;
use crate::error_view::{ErrorView, View};
use crate::output::out;
use crate::view::{Comparison, write_layers};
use crate::volume_light;
use crate::whole_world::WholeWorld;
use earthshine_render::image_file;
use earthshine_render::metrics::{SSIM_SIGMA, SSIM_WINDOW};
use earthshine_render::picture::LightSource;
use std::path::Path;

/// Writes the reference.
pub(super) fn reference(task: &Task<'_>) -> anyhow::Result<()> {
    let arguments = task.arguments;
    let layers = task.reference()?;
    let exposure = arguments.exposure.unwrap_or_else(|| image_file::key_exposure(&layers.full));
    write_layers(&arguments.out, "reference_", &layers, exposure, arguments.exr)?;
    out!("{}: reference_{{direct,indirect,full}}, exposure {exposure:e}", arguments.out.display());
    Ok(())
}

/// Writes the light of the world in `folder`, the reference, and what is between them.
pub(super) fn served(task: &Task<'_>, folder: &Path) -> anyhow::Result<()> {
    let arguments = task.arguments;
    let world = WholeWorld::load(folder)?;
    let light = world.solve(&task.source.lights);
    let volumes = world.volumes(&light)?;
    if arguments.shown != View::Light {
        let view = ErrorView {
            tracer: task.tracer,
            source: task.source,
            world: &world,
            light: &light,
            volumes: &volumes,
            camera: task.options.camera,
            samples: arguments.samples,
            seed: arguments.seed,
            quiet: arguments.json,
        };
        return view.write(arguments.shown, &arguments.out, arguments.json);
    }
    let lookup = |position, normal| volume_light::at(&volumes, position, normal);
    let service = task.lookup_layers("served", LightSource::Lookup(&lookup))?;
    let reference = task.reference()?;
    let exposure = arguments.exposure.unwrap_or_else(|| image_file::key_exposure(&reference.full));
    let comparison = Comparison { service, reference, exposure };
    write_layers(&arguments.out, "service_", &comparison.service, exposure, arguments.exr)?;
    write_layers(&arguments.out, "reference_", &comparison.reference, exposure, arguments.exr)?;
    comparison.write_sheet(&arguments.out.join("sheet.png"))?;
    let errors = comparison.indirect_errors()?;
    let uncovered_share = comparison.service.uncovered_share;
    if arguments.json {
        let figures = serde_json::json!({
            "exposure": exposure, "uncovered_share": uncovered_share, "indirect": errors,
            "ssim_window_pixels": SSIM_WINDOW, "ssim_sigma_pixels": SSIM_SIGMA,
        });
        out!("{figures}");
    } else {
        out!("{}: service_*, reference_*, sheet.png; exposure {exposure:e}", arguments.out.display());
        out!("indirect light, sRGB at that exposure: {}", crate::compare::described(&errors));
        out!("{:.2} % of the surfaces in view have no light in the world", uncovered_share * 100.0);
    }
    Ok(())
}
