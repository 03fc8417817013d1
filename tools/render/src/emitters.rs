//! Which emissive triangle a path looks at on purpose, and how likely that was.
//!
//! A triangle is chosen in proportion to the light it sends out. Textured emission is estimated at a few
//! places: a poor estimate costs noise, never truth, because hits and looks share one density.

use crate::sampling::triangle_point;
use earthshine_scene::Scene;

/// Places a textured triangle's emission is looked up at.
const LOOKUPS: usize = 16;

/// Emissive triangles with their chances.
#[derive(Debug, Default)]
pub struct Emitters {
    triangles: Vec<u32>,
    /// Running sum of chances; the last is one.
    cumulative: Vec<f32>,
    /// Chance per m2 of every triangle of the scene, empty if none emits.
    density: Vec<f32>,
}

impl Emitters {
    /// Collects the emissive triangles of `scene`.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let mut chosen: Vec<(u32, f64, f32)> = Vec::new();
        for (index, corners) in scene.triangles.iter().enumerate() {
            let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
            let power = f64::from(area) * f64::from(mean_radiance(scene, index));
            if power > 0.0 && power.is_finite() {
                chosen.push((index as u32, power, area));
            }
        }
        let total: f64 = chosen.iter().map(|(_, power, _)| power).sum();
        if chosen.is_empty() {
            return Self::default();
        }
        let mut running = 0.0;
        let mut emitters = Self { density: vec![0.0; scene.triangles.len()], ..Self::default() };
        for (triangle, power, area) in chosen {
            running += power / total;
            emitters.triangles.push(triangle);
            emitters.cumulative.push(running as f32);
            emitters.density[triangle as usize] = (power / total) as f32 / area;
        }
        emitters
    }

    /// Whether nothing emits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// How many triangles emit.
    #[must_use]
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// The triangle that `chance` in `[0, 1)` falls on; `None` if nothing emits.
    #[must_use]
    pub fn choose(&self, chance: f32) -> Option<usize> {
        let place = self.cumulative.partition_point(|&sum| sum <= chance);
        // Rounding may leave the last sum a hair below one.
        let place = place.min(self.triangles.len().checked_sub(1)?);
        Some(self.triangles[place] as usize)
    }

    /// Chance per area of a point of `triangle` under [`Self::choose`] and a uniform point, 1/m2.
    #[must_use]
    pub fn density(&self, triangle: usize) -> f32 {
        self.density.get(triangle).copied().unwrap_or(0.0)
    }
}

/// Both faces' emitted radiance, channels added, mean over the triangle.
fn mean_radiance(scene: &Scene, triangle: usize) -> f32 {
    let material = &scene.materials[scene.material_of[triangle] as usize];
    if material.emitted_radiance.max_element() <= 0.0 {
        return 0.0;
    }
    let sees_texture = material.emissive_texture.is_some() || material.alpha_cutoff.is_some();
    let lookups = if sees_texture { LOOKUPS } else { 1 };
    let at = |k: usize| {
        let step = k as f32 + 0.5;
        let (u, v) = triangle_point((step / lookups as f32, (step * 0.618_034).fract()));
        let emitted = |front: bool| {
            let surface = scene.surface(triangle, u, v, front);
            if surface.is_hole { 0.0 } else { surface.emitted_radiance.element_sum() }
        };
        emitted(true) + emitted(false)
    };
    (0..lookups).map(at).sum::<f32>() / lookups as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{SceneBuilder, glowing, grey};
    use earthshine_world::Vec3;

    #[test]
    fn chances_follow_the_light_sent_out() {
        let mut builder = SceneBuilder::default();
        let dark = builder.material(grey(0.5));
        let dim = builder.material(glowing(0.0, 1.0));
        let bright = builder.material(glowing(0.0, 6.0));
        builder.quad(Vec3::ZERO, Vec3::X, Vec3::Y, dark);
        builder.quad(Vec3::Z, Vec3::X * 2.0, Vec3::Y, dim);
        builder.quad(Vec3::Z * 2.0, Vec3::X, Vec3::Y, bright);
        let emitters = Emitters::of(&builder.scene);
        assert_eq!(emitters.len(), 4);
        let density = |triangle| emitters.density(triangle);
        assert_eq!(density(0), 0.0);
        assert!((density(2) - 0.125).abs() < 1e-6, "{}", density(2));
        assert!((density(4) - 0.75).abs() < 1e-6);
        assert_eq!(emitters.choose(0.0), Some(2));
        assert_eq!(emitters.choose(0.3), Some(4));
        assert_eq!(emitters.choose(0.999_999), Some(5));
        assert_eq!(Emitters::default().choose(0.5), None);
    }
}
