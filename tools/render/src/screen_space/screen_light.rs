//! Irradiance of every pixel's surface as a lookup by position and normal: bilinear, but not across edges.

use super::g_buffer::{GBuffer, Texel};
use earthshine_world::{Rgb, Vec3};

/// A place reads pixels this far around where it falls when none of the four nearest is on its surface.
const SEARCH_PIXELS: i64 = 2;
/// Below it a weight is nothing.
const WEIGHT_MIN: f32 = 1e-3;

/// Light of a picture's surfaces.
#[derive(Debug)]
pub struct ScreenLight<'a> {
    /// The surfaces.
    pub buffer: &'a GBuffer,
    /// Irradiance, one a pixel, lx.
    pub irradiance: &'a [Rgb],
}

impl ScreenLight<'_> {
    /// Irradiance at `position` for unit `normal`, lx; `None` where the picture has no such surface.
    #[must_use]
    pub fn at(&self, position: Vec3, normal: Vec3) -> Option<Rgb> {
        let (x, y) = self.buffer.camera().project(position)?;
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x.floor() as i64, y.floor() as i64);
        let (right_share, lower_share) = (x - x.floor(), y - y.floor());
        let nearest = (0..4).map(|k: i64| {
            let (dx, dy) = (k % 2, k / 2);
            let share = |step: i64, share: f32| if step == 1 { share } else { 1.0 - share };
            (left + dx, top + dy, share(dx, right_share) * share(dy, lower_share))
        });
        self.mean(nearest, position, normal).or_else(|| {
            let rows = -SEARCH_PIXELS..=SEARCH_PIXELS + 1;
            let around = rows.clone().flat_map(|dy| rows.clone().map(move |dx| (left + dx, top + dy, 1.0)));
            self.mean(around, position, normal)
        })
    }

    fn mean(
        &self,
        pixels: impl Iterator<Item = (i64, i64, f32)>,
        position: Vec3,
        normal: Vec3,
    ) -> Option<Rgb> {
        let mut sum = (Rgb::ZERO, 0.0);
        for (x, y, share) in pixels {
            if let Some((index, texel)) = self.buffer.at(x, y) {
                let weight = share * likeness(texel, position, normal);
                sum = (sum.0 + weight * self.irradiance[index], sum.1 + weight);
            }
        }
        (sum.1 > WEIGHT_MIN).then(|| sum.0 / sum.1)
    }
}

/// One on the same plane, falling to nothing where normals part by 45 degrees or planes by two pixels.
fn likeness(texel: &Texel, position: Vec3, normal: Vec3) -> f32 {
    let facing = normal.dot(texel.vertex.normal);
    let height = texel.vertex.normal.dot(position - texel.vertex.position).abs() / texel.footprint_m;
    ((facing - 0.7) / 0.3).clamp(0.0, 1.0) * (1.0 - 0.5 * height).clamp(0.0, 1.0)
}
