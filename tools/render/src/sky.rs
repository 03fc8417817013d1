//! What escaping paths see: the six lobes of the light rig, or the whole environment map in their place.
//!
//! A map is looked at on purpose as well as met by chance, balanced like emissive triangles: texels are chosen by
//! their radiance times their solid angle, directions within one evenly, so the density of a direction is its
//! radiance over that of the whole sphere. Lobes are smooth; chance alone serves them.

use crate::path::{EmitterSampling, PathTracer};
use crate::sampling::PathStream;
use crate::tracer::off_surface;
use earthshine_scene::EnvironmentMap;
use earthshine_world::{Rgb, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// A map with the chances of its texels.
#[derive(Debug)]
pub struct Environment {
    map: Arc<EnvironmentMap>,
    /// Running sum of the rows' chances; the last is one. Empty where the map is black.
    rows: Vec<f32>,
    /// The same for the texels of each row.
    columns: Vec<f32>,
    /// Radiance, channels added, over the whole sphere, cd/m2 sr.
    flux: f64,
}

/// A direction that was looked in on purpose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Unit.
    pub direction: Vec3,
    /// What the map has there, cd/m2.
    pub radiance: Rgb,
    /// Chance per solid angle of the direction, 1/sr.
    pub density: f32,
}

impl Environment {
    /// Prepares `map`.
    #[must_use]
    pub fn new(map: Arc<EnvironmentMap>) -> Self {
        let mut rows = Vec::with_capacity(map.height() as usize);
        let mut columns = Vec::with_capacity(map.width() as usize * map.height() as usize);
        let mut flux = 0.0;
        let mut fluxes = Vec::with_capacity(map.height() as usize);
        for row in 0..map.height() {
            let values = (0..map.width()).map(|column| f64::from(map.texel(column, row).element_sum()));
            let whole: f64 = values.clone().sum();
            let mut running = 0.0;
            columns.extend(values.map(|value| {
                running += value;
                if whole > 0.0 { (running / whole) as f32 } else { 0.0 }
            }));
            flux += whole * map.solid_angle_sr(row);
            fluxes.push(flux);
        }
        if flux > 0.0 {
            rows.extend(fluxes.iter().map(|sum| (sum / flux) as f32));
        }
        Self { map, rows, columns, flux }
    }

    /// The map.
    #[must_use]
    pub fn map(&self) -> &EnvironmentMap {
        &self.map
    }

    /// A direction by its light: `chances` choose the texel, `place` where in it. `None` where the map is black.
    #[must_use]
    pub fn look(&self, chances: (f32, f32), place: (f32, f32)) -> Option<Look> {
        let row = chosen(&self.rows, chances.0)?;
        let width = self.map.width() as usize;
        let column = chosen(&self.columns[row * width..][..width], chances.1)? as u32;
        let radiance = self.map.texel(column, row as u32);
        let density = self.density_of(radiance);
        (density > 0.0).then(|| Look {
            direction: self.map.direction_in(column, row as u32, place),
            radiance,
            density,
        })
    }

    /// Chance per solid angle that [`Self::look`] takes unit `direction`, 1/sr.
    #[must_use]
    pub fn density(&self, direction: Vec3) -> f32 {
        self.density_of(self.map.radiance(direction))
    }

    fn density_of(&self, radiance: Rgb) -> f32 {
        if self.flux > 0.0 { (f64::from(radiance.element_sum()) / self.flux) as f32 } else { 0.0 }
    }
}

/// The first place whose running sum exceeds `chance`.
fn chosen(sums: &[f32], chance: f32) -> Option<usize> {
    let place = sums.partition_point(|&sum| sum <= chance);
    // Rounding may leave the last sum a hair below one.
    (!sums.is_empty()).then(|| place.min(sums.len() - 1))
}

impl PathTracer<'_> {
    /// What an escaping path sees along unit `direction`, cd/m2.
    pub(crate) fn sky_radiance(&self, direction: Vec3) -> Rgb {
        self.tracer
            .environment()
            .map_or_else(|| self.rig.sky.radiance(direction), |sky| sky.map().radiance(direction))
    }

    /// Balance weight of having escaped along `direction` by chance, from a surface facing `normal`.
    pub(crate) fn escape_weight(&self, direction: Vec3, normal: Vec3) -> f32 {
        let Some(sky) = self.looked_at_sky() else { return 1.0 };
        let by_chance = direction.dot(normal).max(0.0) / PI;
        let on_purpose = sky.density(direction);
        if by_chance + on_purpose > 0.0 { by_chance / (by_chance + on_purpose) } else { 0.0 }
    }

    /// One look at the environment from a surface: what it brings, with its balance weight, lx.
    pub(crate) fn looked_up_sky(
        &self,
        position: Vec3,
        normal: Vec3,
        stream: &mut PathStream,
        rays: &mut u64,
    ) -> Rgb {
        let Some(sky) = self.looked_at_sky() else { return Rgb::ZERO };
        let (chances, place) = (stream.pair(), stream.pair());
        let Some(look) = sky.look(chances, place) else { return Rgb::ZERO };
        let cosine = normal.dot(look.direction);
        if cosine <= 0.0 {
            return Rgb::ZERO;
        }
        *rays += 1;
        if self.tracer.is_blocked(off_surface(position, normal), look.direction, f32::INFINITY) {
            return Rgb::ZERO;
        }
        // L cos / density, times density / (density + other): the density itself cancels.
        look.radiance * (cosine / (look.density + cosine / PI))
    }

    fn looked_at_sky(&self) -> Option<&Environment> {
        self.tracer.environment().filter(|_| self.emitter_sampling == EmitterSampling::Balanced)
    }
}
