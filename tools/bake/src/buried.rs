//! Buried points: those that see mostly the back faces of single-sided surfaces (floor under a box, inside
//! of a wall). They get no patch: their light would leak through interpolation.

use crate::sample::SurfaceSample;
use earthshine_trace::SceneTracer;
use earthshine_trace::hemisphere::{cosine_direction, spread_pair};
use earthshine_world::Vec3;
use earthshine_world::random::{Purpose, hash, unit_pair};

/// A point is buried when more than this share of its rays ends on back faces.
const BURIED_SHARE: f32 = 0.5;

/// Rays after which a clear case is decided.
const FIRST_RAYS: u32 = 8;

/// Whether `sample` is buried. `rays` is the most that are cast; most points need [`FIRST_RAYS`].
#[must_use]
pub fn is_buried(
    tracer: &SceneTracer<'_>,
    sample: &SurfaceSample,
    rays: u32,
    off_surface_m: f32,
    key: u64,
    seed: u64,
) -> bool {
    let (shift_u, shift_v) = unit_pair(hash(seed, Purpose::BuriedTest, key, 0));
    let origin = sample.position + sample.normal * off_surface_m;
    let mut back = 0;
    for index in 0..rays {
        let (u, v) = spread_pair(index, shift_u, shift_v);
        let direction = cosine_direction(sample.normal, u, v);
        back += u32::from(sees_back(tracer, origin, direction));
        if index + 1 == FIRST_RAYS && (back == 0 || back == FIRST_RAYS) {
            return back > 0;
        }
    }
    back as f32 > rays as f32 * BURIED_SHARE
}

fn sees_back(tracer: &SceneTracer<'_>, origin: Vec3, direction: Vec3) -> bool {
    let scene = tracer.scene();
    tracer.closest(origin, direction, 0.0, f32::INFINITY).is_some_and(|hit| {
        !hit.front && !scene.materials[scene.material_of[hit.triangle] as usize].double_sided
    })
}
