//! Decoded images and how they are sampled. Decoding itself is in `images`.

/// How coordinates beyond 0..1 are folded back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
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
    /// `KHR_texture_transform` as a 2 x 3 matrix, row by row. The importer leaves it the identity and applies a
    /// material's transform to the texture coordinates instead, so that materials share texels.
    pub transform: [f32; 6],
}

impl Texture {
    /// The transform that changes nothing.
    pub const IDENTITY: [f32; 6] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

    /// Linear RGB and alpha at texture coordinates `uv`; (0, 0) is the upper left corner of the first texel.
    ///
    /// Coordinates that are not finite read the first texel; a texture without texels is white.
    #[must_use]
    pub fn sample(&self, uv: [f32; 2]) -> [f32; 4] {
        let [u, v] = transformed(&self.transform, uv);
        let u = Span::along(u, self.width, self.wrap[0]);
        let v = Span::along(v, self.height, self.wrap[1]);
        if self.nearest {
            return self.linear(u.nearest, v.nearest);
        }
        let corners = [
            (self.linear(u.first, v.first), (1.0 - u.part) * (1.0 - v.part)),
            (self.linear(u.second, v.first), u.part * (1.0 - v.part)),
            (self.linear(u.first, v.second), (1.0 - u.part) * v.part),
            (self.linear(u.second, v.second), u.part * v.part),
        ];
        std::array::from_fn(|k| corners.iter().map(|(texel, weight)| texel[k] * weight).sum())
    }

    fn linear(&self, column: usize, row: usize) -> [f32; 4] {
        let texel = self.texels.get(row * self.width as usize + column);
        texel.map_or([1.0; 4], |&[red, green, blue, alpha]| {
            let [red, green, blue] = [red, green, blue].map(linear_of_srgb);
            [red, green, blue, f32::from(alpha) / 255.0]
        })
    }
}

/// `uv` through a 2 x 3 matrix, row by row.
pub(crate) fn transformed(matrix: &[f32; 6], [u, v]: [f32; 2]) -> [f32; 2] {
    let &[a, b, c, d, e, f] = matrix;
    [a * u + b * v + c, d * u + e * v + f]
}

/// Linear light of an 8-bit sRGB value, 0..=1.
#[must_use]
pub fn linear_of_srgb(value: u8) -> f32 {
    LINEAR_OF_SRGB[value as usize]
}

/// Where a coordinate falls along one side of a texture.
#[derive(Debug, Clone, Copy)]
struct Span {
    /// The texel it lies in.
    nearest: usize,
    /// The texel whose centre is before it.
    first: usize,
    /// The texel whose centre is behind it.
    second: usize,
    /// Share of the second.
    part: f32,
}

impl Span {
    fn along(coordinate: f32, size: u32, wrap: Wrap) -> Self {
        let last = size.saturating_sub(1) as i64;
        let coordinate = if coordinate.is_finite() { coordinate } else { 0.0 };
        let folded = match wrap {
            Wrap::Repeat => coordinate - coordinate.floor(),
            Wrap::MirroredRepeat => 1.0 - (coordinate.rem_euclid(2.0) - 1.0).abs(),
            Wrap::ClampToEdge => coordinate.clamp(0.0, 1.0),
        };
        let place = folded * size as f32;
        let before = (place - 0.5).floor();
        // Only tiling reaches over the edge; a mirror image has the same texel behind it, as a clamped edge does.
        let inside = |texel: i64| match wrap {
            Wrap::Repeat if texel < 0 => last,
            Wrap::Repeat if texel > last => 0,
            _ => texel.clamp(0, last),
        };
        Self {
            nearest: (place as i64).clamp(0, last) as usize,
            first: inside(before as i64) as usize,
            second: inside(before as i64 + 1) as usize,
            part: place - 0.5 - before,
        }
    }
}

static LINEAR_OF_SRGB: [f32; 256] = {
    let mut table = [0.0; 256];
    let mut value = 0;
    while value < 256 {
        table[value] = srgb_decoded(value as f64 / 255.0) as f32;
        value += 1;
    }
    table
};

/// IEC 61966-2-1. `x^2.4 = x^2 * (x^2)^(1/5)`, with the root by Newton, as constants have no `powf`.
const fn srgb_decoded(encoded: f64) -> f64 {
    if encoded <= 0.04045 {
        return encoded / 12.92;
    }
    let base = (encoded + 0.055) / 1.055;
    let square = base * base;
    let mut root = 1.0;
    let mut step = 0;
    while step < 40 {
        root = (4.0 * root + square / (root * root * root * root)) / 5.0;
        step += 1;
    }
    square * root
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two by two: black, white over white, black with a hole.
    fn checker(wrap: Wrap, nearest: bool) -> Texture {
        let texels = vec![[0, 0, 0, 255], [255, 255, 255, 255], [255, 255, 255, 255], [0, 0, 0, 0]];
        Texture { width: 2, height: 2, texels, wrap: [wrap; 2], nearest, transform: Texture::IDENTITY }
    }

    fn red(texture: &Texture, u: f32, v: f32) -> f32 {
        texture.sample([u, v])[0]
    }

    #[test]
    fn the_table_is_the_srgb_curve() {
        for value in 0..=255u8 {
            let encoded = f64::from(value) / 255.0;
            let decoded =
                if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) };
            assert!((f64::from(linear_of_srgb(value)) - decoded).abs() < 1e-7, "{value}");
        }
        assert_eq!(linear_of_srgb(255), 1.0);
    }

    #[test]
    fn bilinear_mixes_linear_light_between_texel_centres() {
        let texture = checker(Wrap::ClampToEdge, false);
        assert_eq!(red(&texture, 0.25, 0.25), 0.0);
        assert_eq!(red(&texture, 0.75, 0.25), 1.0);
        assert!((red(&texture, 0.5, 0.25) - 0.5).abs() < 1e-6);
        assert!((red(&texture, 0.375, 0.25) - 0.25).abs() < 1e-6);
        assert!((texture.sample([0.5, 0.5])[3] - 0.75).abs() < 1e-6);
    }

    #[test]
    fn wrapping_continues_the_image_as_named() {
        let repeat = checker(Wrap::Repeat, false);
        assert!((red(&repeat, 0.0, 0.25) - 0.5).abs() < 1e-6, "the seam mixes both edges");
        assert!((red(&repeat, -3.625, 0.25) - red(&repeat, 0.375, 0.25)).abs() < 1e-5);
        let mirrored = checker(Wrap::MirroredRepeat, false);
        assert_eq!(red(&mirrored, 0.0, 0.25), 0.0, "the seam has the same texel on both sides");
        assert_eq!(red(&mirrored, 1.25, 0.25), 1.0);
        assert_eq!(red(&mirrored, -0.75, 0.25), 1.0);
        assert_eq!(red(&mirrored, -1.75, 0.25), 0.0);
        let clamped = checker(Wrap::ClampToEdge, false);
        assert_eq!(red(&clamped, 7.0, 0.0), 1.0);
        assert_eq!(red(&clamped, -7.0, 0.0), 0.0);
    }

    #[test]
    fn nearest_takes_one_texel() {
        let texture = checker(Wrap::Repeat, true);
        assert_eq!(red(&texture, 0.49, 0.1), 0.0);
        assert_eq!(red(&texture, 0.51, 0.1), 1.0);
        assert_eq!(red(&texture, 1.49, 0.1), 0.0);
        assert_eq!(texture.sample([0.9, 0.9])[3], 0.0);
    }

    #[test]
    fn odd_coordinates_read_something() {
        for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
            for nearest in [false, true] {
                let texture = checker(wrap, nearest);
                for odd in [f32::NAN, f32::INFINITY, -f32::INFINITY, f32::MAX, f32::MIN, -1e-30] {
                    assert!(texture.sample([odd, odd]).iter().all(|part| (0.0..=1.0).contains(part)));
                }
            }
        }
    }

    #[test]
    fn the_transform_comes_before_the_wrapping() {
        let texture = Texture { transform: [2.0, 0.0, 0.5, 0.0, 1.0, 0.0], ..checker(Wrap::Repeat, true) };
        assert_eq!(red(&texture, 0.1, 0.1), 1.0);
    }
}
