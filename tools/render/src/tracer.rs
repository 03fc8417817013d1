//! A scene as the reference sees it: rays (`earthshine-trace`), emitters to look at, what back faces do, and the
//! environment map around it where there is one.

use crate::emitters::Emitters;
use crate::sky::Environment;
use earthshine_scene::{EnvironmentMap, Scene};
use earthshine_world::{Rgb, Vec3};
use std::sync::Arc;

pub use earthshine_trace::Hit;

/// How far a ray starts from its surface, as a share of the largest coordinate: some tens of roundings.
const OFFSET_SHARE: f32 = 4e-6;

/// Which faces reflect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sides {
    /// Front faces, and back faces of double-sided materials; other back faces are black.
    One,
    /// Both, as offline renderers do.
    #[default]
    Two,
}

/// A place on a surface, as seen by whoever hit it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertex {
    /// m.
    pub position: Vec3,
    /// Unit geometric normal of the side that was hit.
    pub normal: Vec3,
    /// Diffuse reflectance of that side under the tracer's [`Sides`].
    pub reflectance: Rgb,
    /// What that side emits at emission scale one, cd/m2.
    pub emitted_radiance: Rgb,
}

/// A scene ready for paths.
#[derive(Debug)]
pub struct SceneTracer<'scene> {
    rays: earthshine_trace::SceneTracer<'scene>,
    sides: Sides,
    emitters: Emitters,
    environment: Option<Environment>,
}

impl<'scene> SceneTracer<'scene> {
    /// Builds the tree; both sides reflect.
    #[must_use]
    pub fn new(scene: &'scene Scene) -> Self {
        Self::with_sides(scene, Sides::Two)
    }

    /// Builds the tree; `sides` says what back faces do.
    #[must_use]
    pub fn with_sides(scene: &'scene Scene, sides: Sides) -> Self {
        let rays = earthshine_trace::SceneTracer::new(scene);
        Self { rays, sides, emitters: Emitters::of(scene), environment: None }
    }

    /// Puts `map` around the scene: paths see it in place of the light rig's sky. `None` leaves that sky.
    #[must_use]
    pub fn under(mut self, map: Option<Arc<EnvironmentMap>>) -> Self {
        self.environment = map.map(Environment::new);
        self
    }

    /// The map around the scene, if there is one.
    #[must_use]
    pub fn environment(&self) -> Option<&Environment> {
        self.environment.as_ref()
    }

    /// What is traced.
    #[must_use]
    pub fn scene(&self) -> &'scene Scene {
        self.rays.scene()
    }

    /// Emissive triangles, to look at on purpose.
    #[must_use]
    pub fn emitters(&self) -> &Emitters {
        &self.emitters
    }

    /// The closest crossing with `distance_min < distance < distance_max` that is not a hole.
    #[must_use]
    pub fn closest(
        &self,
        origin: Vec3,
        direction: Vec3,
        distance_min: f32,
        distance_max: f32,
    ) -> Option<Hit> {
        self.rays.closest(origin, direction, distance_min, distance_max)
    }

    /// Whether anything but holes lies between `origin` and `distance` along `direction`.
    #[must_use]
    pub fn is_blocked(&self, origin: Vec3, direction: Vec3, distance: f32) -> bool {
        self.rays.is_blocked(origin, direction, distance)
    }

    /// What `hit` found: place, facing normal, material.
    #[must_use]
    pub fn vertex(&self, hit: &Hit) -> Vertex {
        let surface = self.rays.surface(hit);
        let black = self.sides == Sides::One && self.is_back(hit);
        Vertex {
            position: point_on(&self.scene().triangles[hit.triangle], hit.u, hit.v),
            normal: self.rays.normal(hit),
            reflectance: if black { Rgb::ZERO } else { surface.reflectance },
            emitted_radiance: surface.emitted_radiance,
        }
    }

    /// Whether a hit is on the back of something that has but one side.
    #[must_use]
    pub fn is_back(&self, hit: &Hit) -> bool {
        self.rays.is_back(hit)
    }
}

/// The point of a triangle at barycentric `(u, v)`: closer to the plane than origin plus distance.
#[must_use]
pub fn point_on(corners: &[Vec3; 3], u: f32, v: f32) -> Vec3 {
    corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v
}

/// `position` moved off its surface along `normal`, so that a ray from there does not meet it again.
#[must_use]
pub fn off_surface(position: Vec3, normal: Vec3) -> Vec3 {
    position + normal * offset_at(position)
}

/// How far [`off_surface`] moves a point, m.
#[must_use]
pub fn offset_at(position: Vec3) -> f32 {
    position.abs().max_element().max(1.0) * OFFSET_SHARE
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{SceneBuilder, grey};

    #[test]
    fn the_closest_surface_wins_and_knows_its_side() {
        let mut builder = SceneBuilder::default();
        let material = builder.material(grey(0.5));
        builder.quad(Vec3::new(-1.0, 1.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, material);
        builder.quad(Vec3::new(-1.0, 3.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, material);
        let scene = builder.scene;
        let tracer = SceneTracer::new(&scene);
        let up = tracer.closest(Vec3::new(0.2, 0.0, 0.3), -Vec3::NEG_Y, 0.0, f32::INFINITY).expect("a hit");
        assert!((up.distance - 1.0).abs() < 1e-6);
        assert!(up.front, "X cross Z faces down");
        let vertex = tracer.vertex(&up);
        assert!((vertex.position - Vec3::new(0.2, 1.0, 0.3)).length() < 1e-6);
        assert_eq!(vertex.normal, Vec3::NEG_Y);
        let beyond =
            tracer.closest(Vec3::new(0.2, 0.0, 0.3), Vec3::Y, 1.5, f32::INFINITY).expect("the other");
        assert!((beyond.distance - 3.0).abs() < 1e-6 && !beyond.front);
        assert!(tracer.is_blocked(Vec3::ZERO, Vec3::Y, 2.0));
        assert!(!tracer.is_blocked(Vec3::ZERO, Vec3::Y, 0.9));
        assert_eq!(tracer.closest(Vec3::ZERO, Vec3::NEG_Y, 0.0, f32::INFINITY), None);
    }

    #[test]
    fn holes_let_rays_through() {
        let mut builder = SceneBuilder::default();
        let mut hole = grey(0.5);
        hole.base_colour[3] = 0.25;
        hole.alpha_cutoff = Some(0.5);
        let hole = builder.material(hole);
        builder.quad(Vec3::new(-1.0, 1.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, hole);
        let tracer = SceneTracer::new(&builder.scene);
        assert!(!tracer.is_blocked(Vec3::ZERO, Vec3::Y, 2.0));
        assert_eq!(tracer.closest(Vec3::ZERO, Vec3::Y, 0.0, 2.0), None);
    }

    #[test]
    fn one_sided_backs_are_black_unless_the_material_has_two() {
        let mut builder = SceneBuilder::default();
        let single = builder.material(grey(0.5));
        let mut both = grey(0.5);
        both.double_sided = true;
        let both = builder.material(both);
        builder.quad(Vec3::new(-1.0, 1.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, single);
        builder.quad(Vec3::new(9.0, 1.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, both);
        let reflectance = |sides: Sides, x: f32| {
            let tracer = SceneTracer::with_sides(&builder.scene, sides);
            let hit = tracer.closest(Vec3::new(x, 0.0, 0.0), Vec3::Y, 0.0, 9.0).expect("a hit");
            tracer.vertex(&hit).reflectance.x
        };
        assert_eq!([reflectance(Sides::Two, 0.0), reflectance(Sides::One, 0.0)], [0.5, 0.0]);
        assert_eq!(reflectance(Sides::One, 10.0), 0.5);
    }

    #[test]
    fn an_empty_scene_is_open() {
        let scene = Scene::default();
        let tracer = SceneTracer::new(&scene);
        assert!(!tracer.is_blocked(Vec3::ZERO, Vec3::X, 1.0));
        assert_eq!(tracer.closest(Vec3::ZERO, Vec3::X, 0.0, 1.0), None);
    }
}
