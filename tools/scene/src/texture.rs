//! Decoded images and how they are sampled.

/// How coordinates beyond 0..1 are folded back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// Tiles.
    #[default]
    Repeat,
    /// Tiles, every other one flipped.
    MirroredRepeat,
    /// The edge goes on.
    ClampToEdge,
}

/// An image in linear light with its sampler and transform.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    /// Texels along u.
    pub width: u32,
    /// Texels along v.
    pub height: u32,
    /// Row by row, linear RGB and alpha, 0..=255 in sRGB encoding for colour: see [`Self::sample`].
    pub texels: Vec<[u8; 4]>,
    /// Along u and v.
    pub wrap: [Wrap; 2],
    /// Nearest instead of bilinear.
    pub nearest: bool,
    /// `KHR_texture_transform` as a 2 x 3 matrix, row by row.
    pub transform: [f32; 6],
}
impl Texture {
    /// Linear RGB and alpha at texture coordinates `uv`.
    #[must_use]
    pub fn sample(&self, uv: [f32; 2]) -> [f32; 4] {
        // Placeholder until the importer lands in the next commit.
        let _ = uv;
        [1.0; 4]
    }
}
