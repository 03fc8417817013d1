//! Diffuse materials: what a surface reflects and what it emits.

use earthshine_world::Rgb;

/// Position of a material in its world's list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct MaterialId(pub u16);

/// A diffuse surface; emission leaves its front.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Unique within its world.
    pub name: String,
    /// Diffuse, 0..=0.98 a channel.
    pub reflectance: Rgb,
    /// cd/m2.
    pub emitted_radiance: Rgb,
    /// Whether both faces are fronts.
    pub double_sided: bool,
}

impl Material {
    /// A surface that only reflects.
    #[must_use]
    pub fn reflecting(name: impl Into<String>, reflectance: Rgb) -> Self {
        Self { name: name.into(), reflectance, emitted_radiance: Rgb::ZERO, double_sided: false }
    }

    /// A lamp: reflects `reflectance` and emits `emitted_radiance`, cd/m2.
    #[must_use]
    pub fn emitting(name: impl Into<String>, reflectance: Rgb, emitted_radiance: Rgb) -> Self {
        Self { emitted_radiance, ..Self::reflecting(name, reflectance) }
    }
}
