//! What the camera sees, one surface a pixel: where it is and where it faces. No light, no filtering.

use crate::camera::Pinhole;
use crate::tracer::{SceneTracer, Vertex};
use rayon::prelude::*;

/// The surface in the middle of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Texel {
    /// Place, facing normal, material.
    pub vertex: Vertex,
    /// From the camera, m.
    pub distance_m: f32,
    /// Edge of the pixel at that distance, square to the view, m.
    pub footprint_m: f32,
}

/// The surfaces of a picture, row by row; `None` where the camera sees the sky.
#[derive(Debug, Clone)]
pub struct GBuffer {
    camera: Pinhole,
    texels: Vec<Option<Texel>>,
}

impl GBuffer {
    /// One ray through the middle of every pixel.
    #[must_use]
    pub fn trace(tracer: &SceneTracer<'_>, camera: &Pinhole) -> Self {
        let width = camera.width();
        let texel = |index: u32| {
            let (x, y) = ((index % width) as f32 + 0.5, (index / width) as f32 + 0.5);
            let hit = tracer.closest(camera.position(), camera.direction(x, y), 0.0, f32::INFINITY)?;
            let footprint_m = hit.distance * camera.pixel_angle();
            Some(Texel { vertex: tracer.vertex(&hit), distance_m: hit.distance, footprint_m })
        };
        let texels = (0..width * camera.height()).into_par_iter().map(texel).collect();
        Self { camera: *camera, texels }
    }

    /// From its texels.
    ///
    /// # Panics
    /// If there is not one texel a pixel.
    #[must_use]
    pub fn new(camera: Pinhole, texels: Vec<Option<Texel>>) -> Self {
        assert_eq!(texels.len(), camera.width() as usize * camera.height() as usize, "one texel a pixel");
        Self { camera, texels }
    }

    /// Through which it was seen.
    #[must_use]
    pub fn camera(&self) -> &Pinhole {
        &self.camera
    }

    /// Row by row from the upper left.
    #[must_use]
    pub fn texels(&self) -> &[Option<Texel>] {
        &self.texels
    }

    /// The texel of pixel `(x, y)`; `None` outside the picture too.
    #[must_use]
    pub fn at(&self, x: i64, y: i64) -> Option<(usize, &Texel)> {
        let inside = (0..i64::from(self.camera.width())).contains(&x)
            && (0..i64::from(self.camera.height())).contains(&y);
        if !inside {
            return None;
        }
        let index = (y * i64::from(self.camera.width()) + x) as usize;
        self.texels[index].as_ref().map(|texel| (index, texel))
    }
}
