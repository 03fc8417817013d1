//! One random path: an unbiased sample of the light that arrives at a point from surfaces and sky.
//!
//! The first arrival of lamps and sun is not in it, their every bounce is. Paths end by Russian roulette.
//! At each vertex lamps are asked directly; emissive triangles are both looked at and hit by chance,
//! the two weighted by the balance heuristic so that each ray of light is counted once. An environment map is treated
//! like them ([`crate::sky`]).

use crate::sampling::{PathStream, cosine_direction, triangle_point};
use crate::tracer::{SceneTracer, Vertex, off_surface, offset_at, point_on};
use earthshine_light::arrival;
use earthshine_world::{LightRig, Rgb, Vec3};
use std::f32::consts::{FRAC_1_PI, PI};

/// From this bounce on a path survives with the chance of its throughput.
const ROULETTE_FROM: u32 = 4;
/// Paths end here whatever their luck: at the highest reflectance 1e-9 of the light would still go on.
const BOUNCES_MAX: u32 = 1024;
/// Up to this many lamps all are asked at every vertex; of more, one in proportion to what it would bring.
const LAMPS_ASKED_MAX: usize = 4;

/// How light from emissive triangles and environment maps is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum EmitterSampling {
    /// By chance hits alone: noisy with small emitters; to be compared with.
    Hits,
    /// Looked at on purpose and hit by chance, balanced.
    #[default]
    Balanced,
}

/// Everything a path needs to know.
#[derive(Debug, Clone, Copy)]
pub struct PathTracer<'a> {
    /// The scene.
    pub tracer: &'a SceneTracer<'a>,
    /// Its light; an environment map of the tracer takes the place of its sky.
    pub rig: &'a LightRig,
    /// How emissive triangles are found.
    pub emitter_sampling: EmitterSampling,
}

/// Light along one path and what it cost.
#[derive(Debug, Clone, Copy, Default)]
pub struct PathLight {
    /// A sample of the irradiance, lx.
    pub irradiance: Rgb,
    /// Rays traced, shadow rays among them.
    pub rays: u64,
}

impl PathTracer<'_> {
    /// A sample of the irradiance at `position` facing `normal` (unit), its first direction from `first`.
    #[must_use]
    pub fn sample(
        &self,
        position: Vec3,
        normal: Vec3,
        first: (f32, f32),
        stream: &mut PathStream,
    ) -> PathLight {
        let mut light = PathLight::default();
        let mut throughput = Rgb::ONE;
        let (mut position, mut normal, mut pair) = (position, normal, first);
        for bounce in 0..BOUNCES_MAX {
            if self.looks_at_emitters() {
                light.irradiance +=
                    throughput * self.emitter_irradiance(position, normal, stream, &mut light.rays);
            }
            light.irradiance += throughput * self.looked_up_sky(position, normal, stream, &mut light.rays);
            let direction = cosine_direction(normal, pair);
            let origin = off_surface(position, normal);
            light.rays += 1;
            let Some(hit) = self.tracer.closest(origin, direction, 0.0, f32::INFINITY) else {
                let weight = self.escape_weight(direction, normal);
                light.irradiance += throughput * (PI * weight) * self.sky_radiance(direction);
                break;
            };
            let vertex = self.tracer.vertex(&hit);
            if vertex.emitted_radiance != Rgb::ZERO {
                let weight = self.hit_weight(hit.triangle, hit.distance, direction, normal, vertex.normal);
                light.irradiance +=
                    throughput * vertex.emitted_radiance * (PI * weight * self.rig.emission_scale);
            }
            throughput *= vertex.reflectance;
            if throughput == Rgb::ZERO {
                break;
            }
            light.irradiance += throughput * self.lamp_irradiance(&vertex, stream, &mut light.rays);
            let (chance, _) = stream.pair();
            let Some(kept) = survive(throughput, bounce, chance) else { break };
            throughput = kept;
            (position, normal, pair) = (vertex.position, vertex.normal, stream.pair());
        }
        light
    }

    fn looks_at_emitters(&self) -> bool {
        self.emitter_sampling == EmitterSampling::Balanced
            && self.rig.emission_scale > 0.0
            && !self.tracer.emitters().is_empty()
    }

    /// Radiance that `vertex` reflects, all bounces, cd/m2: a sample. Its own emission is not in it.
    pub(crate) fn reflected_radiance(&self, vertex: &Vertex, stream: &mut PathStream) -> Rgb {
        if vertex.reflectance == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let lamps = self.lamp_irradiance(vertex, stream, &mut 0);
        let first = stream.pair();
        let surroundings = self.sample(vertex.position, vertex.normal, first, stream).irradiance;
        vertex.reflectance * FRAC_1_PI * (lamps + surroundings)
    }

    /// What emissive surfaces bring to `position`, lx: a sample by one look and one ray.
    pub(crate) fn emitter_sample(&self, position: Vec3, normal: Vec3, stream: &mut PathStream) -> Rgb {
        if self.tracer.emitters().is_empty() {
            return Rgb::ZERO;
        }
        let looked = self.looked_irradiance(position, normal, stream);
        let direction = cosine_direction(normal, stream.pair());
        let origin = off_surface(position, normal);
        let Some(hit) = self.tracer.closest(origin, direction, 0.0, f32::INFINITY) else { return looked };
        let vertex = self.tracer.vertex(&hit);
        if vertex.emitted_radiance == Rgb::ZERO {
            return looked;
        }
        let weight = self.hit_weight(hit.triangle, hit.distance, direction, normal, vertex.normal);
        looked + vertex.emitted_radiance * (PI * weight * self.rig.emission_scale)
    }

    /// What emissive surfaces bring to `position` by one look at one of them, lx: to be added to hits by
    /// chance with [`Self::hit_weight`].
    pub(crate) fn looked_irradiance(&self, position: Vec3, normal: Vec3, stream: &mut PathStream) -> Rgb {
        if self.looks_at_emitters() {
            self.emitter_irradiance(position, normal, stream, &mut 0)
        } else {
            Rgb::ZERO
        }
    }

    /// Balance weight of having hit an emitter by chance.
    pub(crate) fn hit_weight(
        &self,
        triangle: usize,
        distance: f32,
        direction: Vec3,
        from: Vec3,
        at: Vec3,
    ) -> f32 {
        if !self.looks_at_emitters() {
            return 1.0;
        }
        let by_chance = direction.dot(from).max(0.0) / PI;
        let cosine = direction.dot(at).abs().max(f32::MIN_POSITIVE);
        let on_purpose = self.tracer.emitters().density(triangle) * distance * distance / cosine;
        if by_chance + on_purpose > 0.0 { by_chance / (by_chance + on_purpose) } else { 0.0 }
    }

    /// One look at one point of one emitter: what it brings to `position`, with its balance weight.
    fn emitter_irradiance(
        &self,
        position: Vec3,
        normal: Vec3,
        stream: &mut PathStream,
        rays: &mut u64,
    ) -> Rgb {
        let (chance, _) = stream.pair();
        let (u, v) = triangle_point(stream.pair());
        let Some(triangle) = self.tracer.emitters().choose(chance) else { return Rgb::ZERO };
        let scene = self.tracer.scene();
        let target = point_on(&scene.triangles[triangle], u, v);
        let offset = target - position;
        let Some(direction) = offset.try_normalize() else { return Rgb::ZERO };
        let target_normal = scene.normal(triangle);
        let front = target_normal.dot(direction) < 0.0;
        let (cosine, target_cosine) = (normal.dot(direction), target_normal.dot(direction).abs());
        if cosine <= 0.0 || target_cosine <= 0.0 {
            return Rgb::ZERO;
        }
        let surface = scene.surface(triangle, u, v, front);
        if surface.is_hole || surface.emitted_radiance == Rgb::ZERO {
            return Rgb::ZERO;
        }
        *rays += 1;
        let facing = if front { target_normal } else { -target_normal };
        if !self.sees(off_surface(position, normal), off_surface(target, facing)) {
            return Rgb::ZERO;
        }
        let on_purpose = self.tracer.emitters().density(triangle) * offset.length_squared() / target_cosine;
        // L cos / density, times density / (density + other): the density itself cancels.
        let balanced = cosine / (on_purpose + cosine / PI);
        surface.emitted_radiance * (self.rig.emission_scale * balanced)
    }

    pub(crate) fn sees(&self, from: Vec3, to: Vec3) -> bool {
        let distance = (to - from).length();
        (to - from)
            .try_normalize()
            .is_none_or(|direction| !self.tracer.is_blocked(from, direction, distance - offset_at(to)))
    }

    /// What sun and lamps bring to `vertex` directly, lx.
    #[must_use]
    pub fn lamp_irradiance(&self, vertex: &Vertex, stream: &mut PathStream, rays: &mut u64) -> Rgb {
        let lights = &self.rig.lights;
        if lights.is_empty() {
            return Rgb::ZERO;
        }
        let disc = stream.pair();
        let arriving = lights.iter().filter_map(|light| arrival(light, vertex.position, vertex.normal, disc));
        if lights.len() <= LAMPS_ASKED_MAX {
            return arriving.map(|found| self.unshadowed_share(vertex, &found, rays)).sum();
        }
        let total: f32 = arriving.clone().map(|found| found.irradiance.element_sum()).sum();
        let mut left = stream.pair().0 * total;
        for found in arriving {
            let strength = found.irradiance.element_sum();
            left -= strength;
            if left < 0.0 {
                return self.unshadowed_share(vertex, &found, rays) * (total / strength);
            }
        }
        Rgb::ZERO
    }

    fn unshadowed_share(&self, vertex: &Vertex, found: &earthshine_light::Arrival, rays: &mut u64) -> Rgb {
        *rays += 1;
        let origin = off_surface(vertex.position, vertex.normal);
        let reach = found.distance_m - 2.0 * offset_at(vertex.position);
        if self.tracer.is_blocked(origin, found.towards, reach) { Rgb::ZERO } else { found.irradiance }
    }
}

/// The throughput a path goes on with, made up for those that ended; `None` if it ends.
fn survive(throughput: Rgb, bounce: u32, chance: f32) -> Option<Rgb> {
    if bounce < ROULETTE_FROM {
        return Some(throughput);
    }
    let survival = throughput.max_element().min(1.0);
    (chance < survival).then(|| throughput / survival)
}
