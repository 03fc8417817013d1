//! Where the camera stands when nobody said: the first place from which a small picture is lit.

use crate::view::ViewArguments;
use earthshine_render::SceneTracer;
use earthshine_render::camera::Pinhole;
use earthshine_render::picture::{LightSource, PictureOptions, render};
use earthshine_world::{Bounds, LightRig, Vec3};

/// Pixels of a probing picture.
const PROBE: (u32, u32) = (24, 16);
/// Paths a pixel of it.
const PROBE_SAMPLES: u32 = 4;
/// A place is good if this share of its pixels is lit.
const LIT_SHARE: f64 = 0.95;
/// Eye height, m, in scenes of at least twice that.
const EYE_HEIGHT_M: f32 = 1.7;

/// The camera as told, or where it sees most light among [`places`].
pub(crate) fn pinhole(
    view: &ViewArguments,
    tracer: &SceneTracer<'_>,
    rig: &LightRig,
) -> anyhow::Result<Pinhole> {
    let bounds = tracer.scene().bounds();
    if let Some(position) = view.position() {
        return view.pinhole_from(position, &bounds);
    }
    let probe = view.resized(PROBE.0, PROBE.1);
    let places = places(&bounds, view.fov_deg());
    let mut best = (places[0], 0.0);
    for place in places {
        let camera = probe.pinhole_from(place, &bounds)?;
        let options = PictureOptions { camera, samples: PROBE_SAMPLES, seed: 0 };
        let picture = render(tracer, rig, &options, LightSource::Reference)?.full;
        let lit = picture.pixels().iter().filter(|pixel| pixel.max_element() > 0.0).count();
        let share = lit as f64 / picture.pixels().len() as f64;
        if share > best.1 {
            best = (place, share);
        }
        if share >= LIT_SHARE {
            break;
        }
    }
    view.pinhole_from(best.0, &bounds)
}

/// Four places a quarter of the way in from the corners at eye height, four in front of the sides.
fn places(bounds: &Bounds, fov_deg: f32) -> Vec<Vec3> {
    let (size, centre) = (bounds.size(), bounds.centre());
    let eye = bounds.min.y + (0.5 * size.y).min(EYE_HEIGHT_M);
    let inside = [(0.25, 0.25), (0.75, 0.75), (0.75, 0.25), (0.25, 0.75)]
        .map(|(x, z)| Vec3::new(bounds.min.x + x * size.x, eye, bounds.min.z + z * size.z));
    // Far enough to have the near side within the picture from bottom to top.
    let back = 0.55 * size.max_element() / (0.5 * fov_deg.to_radians()).tan();
    let outside = [Vec3::Z, Vec3::X, Vec3::NEG_Z, Vec3::NEG_X]
        .map(|side| centre + side * (0.5 * size.dot(side.abs()) + back));
    inside.into_iter().chain(outside).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_source;

    fn lit_share(scene: &str) -> f64 {
        let source = scene_source::load(scene, None, false).unwrap();
        let tracer = SceneTracer::new(&source.scene);
        let camera = pinhole(&ViewArguments::sized(24, 16), &tracer, &source.lights).unwrap();
        let options = PictureOptions { camera, samples: 16, seed: 1 };
        let picture = render(&tracer, &source.lights, &options, LightSource::Reference).unwrap().full;
        picture.pixels().iter().filter(|pixel| pixel.max_element() > 0.0).count() as f64 / (24.0 * 16.0)
    }

    #[test]
    fn boxes_and_rooms_are_seen_from_where_there_is_light() {
        for scene in ["cornell", "furnace", "two-rooms", "study"] {
            assert!(lit_share(scene) > 0.5, "{scene}: {}", lit_share(scene));
        }
    }
}
