//! How different two pictures are: RMSE, PSNR, SSIM, FLIP.
//!
//! All on 8-bit sRGB pictures of one stated exposure, data range 1. SSIM punishes noise and forgives
//! wrong energy, so nothing is accepted on it alone; light at points comes first
//! ([`crate::compare_points`](mod@crate::compare_points)). What noise of the reference costs is left out in
//! [`crate::noiseless`].

use crate::image_file::luminance;
use crate::picture::Picture;
use image::RgbImage;
use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8, FlipPool};

/// Pixels along SSIM's window.
pub const SSIM_WINDOW: usize = 11;
/// Standard deviation of SSIM's Gaussian weights, pixels.
pub const SSIM_SIGMA: f64 = 1.5;
/// SSIM's two stabilisers, for data range 1.
pub(crate) const SSIM_STABILISERS: [f64; 2] = [0.01 * 0.01, 0.03 * 0.03];
/// Rec. 709 weights of the encoded channels, for SSIM's grey.
const GREY: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// How far a picture is from its reference.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct PictureErrors {
    /// Mean squared difference over all channels, encoded values 0..=1.
    pub mse: f64,
    /// Its root.
    pub rmse: f64,
    /// `-10 log10(mse)`, dB; `None` for identical pictures.
    pub psnr_db: Option<f64>,
    /// Mean structural similarity of the grey pictures: Gaussian window 11, sigma 1.5, full windows only.
    pub ssim: f64,
    /// Mean FLIP error at 67 pixels a degree, 0 for identical pictures, at most 1.
    pub flip: f64,
}

/// How far the light itself of a linear picture is off, at pixels where the reference has any.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct LinearErrors {
    /// Sum of luminance against the reference's, minus one.
    pub bias: f64,
    /// Median of `|measured - reference| / reference`, luminance. The reference's noise is in it.
    pub median_rel: f64,
}

/// Two pictures that do not cover each other, or are too small for a window.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SizeError {
    /// Different sizes.
    #[error("the pictures are {0} x {1} and {2} x {3} pixels; only equal sizes can be compared")]
    Differ(u32, u32, u32, u32),
    /// No full window fits.
    #[error("{0} x {1} pixels are less than SSIM's window of {SSIM_WINDOW} x {SSIM_WINDOW}; ask for more")]
    TooSmall(u32, u32),
}

impl SizeError {
    pub(crate) fn check(one: (u32, u32), other: (u32, u32)) -> Result<(), Self> {
        if one == other { Ok(()) } else { Err(Self::Differ(one.0, one.1, other.0, other.1)) }
    }
}

/// Compares two 8-bit sRGB pictures of the same exposure.
///
/// # Errors
/// The pictures differ in size or are smaller than SSIM's window.
pub fn compare_pictures(measured: &RgbImage, reference: &RgbImage) -> Result<PictureErrors, SizeError> {
    check_sizes(measured, reference)?;
    let mse = mean_squared_difference(measured.as_raw(), reference.as_raw());
    Ok(PictureErrors {
        mse,
        rmse: mse.sqrt(),
        psnr_db: (mse > 0.0).then(|| -10.0 * mse.log10()),
        ssim: ssim(&grey(measured), &grey(reference), measured.width() as usize),
        flip: flip(measured, reference),
    })
}

/// Whether the pictures cover each other, and a window fits.
pub(crate) fn check_sizes(measured: &RgbImage, reference: &RgbImage) -> Result<(), SizeError> {
    SizeError::check(measured.dimensions(), reference.dimensions())?;
    check_window(measured.width(), measured.height())
}

/// Whether SSIM's window fits into pictures of that size: for who has them still to make.
///
/// # Errors
/// It does not.
pub fn check_window(width: u32, height: u32) -> Result<(), SizeError> {
    let fits = (width as usize).min(height as usize) >= SSIM_WINDOW;
    if fits { Ok(()) } else { Err(SizeError::TooSmall(width, height)) }
}

/// Compares linear luminance pixel by pixel; zeros where the reference is black.
///
/// # Errors
/// The pictures differ in size.
pub fn linear_errors(measured: &Picture, reference: &Picture) -> Result<LinearErrors, SizeError> {
    let size = |picture: &Picture| (picture.width(), picture.height());
    SizeError::check(size(measured), size(reference))?;
    let (mut found, mut right, mut relative) = (0.0, 0.0, Vec::new());
    for (&one, &other) in measured.pixels().iter().zip(reference.pixels()) {
        let (one, other) = (f64::from(luminance(one)), f64::from(luminance(other)));
        if other > 0.0 {
            found += one;
            right += other;
            relative.push((one - other).abs() / other);
        }
    }
    if relative.is_empty() {
        return Ok(LinearErrors { bias: 0.0, median_rel: 0.0 });
    }
    relative.sort_by(f64::total_cmp);
    Ok(LinearErrors { bias: found / right - 1.0, median_rel: relative[relative.len() / 2] })
}

/// FLIP's per-pixel error in its own (magma) colours.
///
/// # Errors
/// The pictures differ in size.
pub fn flip_picture(measured: &RgbImage, reference: &RgbImage) -> Result<RgbImage, SizeError> {
    SizeError::check(measured.dimensions(), reference.dimensions())?;
    let coloured = flip_map(measured, reference).apply_color_lut(&nv_flip::magma_lut());
    let bytes = coloured.to_vec();
    let width = measured.width();
    Ok(RgbImage::from_fn(width, measured.height(), |x, y| {
        let first = 3 * (y as usize * width as usize + x as usize);
        image::Rgb([bytes[first], bytes[first + 1], bytes[first + 2]])
    }))
}

fn flip(measured: &RgbImage, reference: &RgbImage) -> f64 {
    f64::from(FlipPool::from_image(&flip_map(measured, reference)).mean())
}

fn flip_map(measured: &RgbImage, reference: &RgbImage) -> nv_flip::FlipImageFloat {
    let wrap = |image: &RgbImage| FlipImageRgb8::with_data(image.width(), image.height(), image.as_raw());
    nv_flip::flip(wrap(reference), wrap(measured), DEFAULT_PIXELS_PER_DEGREE)
}

fn mean_squared_difference(one: &[u8], other: &[u8]) -> f64 {
    let squares = one.iter().zip(other).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2));
    squares.sum::<f64>() / (255.0 * 255.0 * one.len() as f64)
}

/// Luma of the encoded channels, 0..=1.
pub(crate) fn grey(image: &RgbImage) -> Vec<f64> {
    let value = |pixel: &image::Rgb<u8>| {
        pixel.0.iter().zip(GREY).map(|(&channel, weight)| f64::from(channel) * weight).sum::<f64>() / 255.0
    };
    image.pixels().map(value).collect()
}

/// Mean SSIM over the places where the whole window fits, as Wang et al. (2004) define it.
fn ssim(one: &[f64], other: &[f64], width: usize) -> f64 {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).collect::<Vec<f64>>();
    let blurred = |values: &[f64]| blur(values, width);
    let (mean_one, mean_other) = (blurred(one), blurred(other));
    let squares_one = blurred(&product(one, one));
    let squares_other = blurred(&product(other, other));
    let products = blurred(&product(one, other));
    let [c1, c2] = SSIM_STABILISERS;
    let mut sum = 0.0;
    for index in 0..mean_one.len() {
        let (a, b) = (mean_one[index], mean_other[index]);
        let variances = squares_one[index] - a * a + squares_other[index] - b * b;
        let covariance = products[index] - a * b;
        sum += (2.0 * a * b + c1) * (2.0 * covariance + c2) / ((a * a + b * b + c1) * (variances + c2));
    }
    sum / mean_one.len() as f64
}

/// Gaussian means where the whole window fits: `SSIM_WINDOW - 1` fewer along each edge.
pub(crate) fn blur(values: &[f64], width: usize) -> Vec<f64> {
    let weights = window();
    let mean = |run: &mut dyn Iterator<Item = f64>| run.zip(&weights).map(|(v, w)| v * w).sum::<f64>();
    let across: Vec<f64> = values
        .chunks_exact(width)
        .flat_map(|row| row.windows(SSIM_WINDOW).map(|run| mean(&mut run.iter().copied())))
        .collect();
    let width = width - (SSIM_WINDOW - 1);
    let height = across.len() / width - (SSIM_WINDOW - 1);
    (0..width * height)
        .map(|start| mean(&mut across[start..].iter().step_by(width).take(SSIM_WINDOW).copied()))
        .collect()
}

/// Gaussian weights of a window along one axis; their sum is one.
pub(crate) fn window() -> [f64; SSIM_WINDOW] {
    let centre = (SSIM_WINDOW / 2) as f64;
    let mut weights = [0.0; SSIM_WINDOW];
    for (index, weight) in weights.iter_mut().enumerate() {
        *weight = (-0.5 * ((index as f64 - centre) / SSIM_SIGMA).powi(2)).exp();
    }
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::random::{Purpose, hash};

    fn noise(width: u32, height: u32, seed: u64) -> RgbImage {
        let byte = |x: u32, y: u32| (hash(seed, Purpose::MeasurePoint, x.into(), y.into()) >> 56) as u8;
        RgbImage::from_fn(width, height, |x, y| image::Rgb([byte(x, y); 3]))
    }

    #[test]
    fn identical_pictures_have_no_error() {
        let picture = noise(32, 24, 1);
        let errors = compare_pictures(&picture, &picture).unwrap();
        assert_eq!((errors.mse, errors.rmse, errors.psnr_db), (0.0, 0.0, None));
        assert!((errors.ssim - 1.0).abs() < 1e-9 && errors.flip.abs() < 1e-6, "{errors:?}");
    }

    #[test]
    fn a_constant_offset_has_closed_forms() {
        let flat = |value: u8| RgbImage::from_pixel(32, 24, image::Rgb([value; 3]));
        let errors = compare_pictures(&flat(102), &flat(51)).unwrap();
        assert!((errors.mse - 0.04).abs() < 1e-9 && (errors.rmse - 0.2).abs() < 1e-9);
        assert!((errors.psnr_db.unwrap() - 13.9794).abs() < 1e-3);
        // Flat pictures leave SSIM's luminance term alone.
        let expected = (2.0 * 0.4 * 0.2 + 1e-4) / (0.16 + 0.04 + 1e-4);
        assert!((errors.ssim - expected).abs() < 1e-9, "{}", errors.ssim);
        assert!(errors.flip > 0.05 && errors.flip < 1.0, "{}", errors.flip);
    }

    #[test]
    fn linear_errors_are_bias_and_median() {
        use earthshine_world::Rgb;
        let picture = |values: [f32; 4]| Picture::new(2, 2, values.map(Rgb::splat).to_vec());
        let reference = picture([1.0, 2.0, 4.0, 0.0]);
        let errors = linear_errors(&picture([1.1, 2.4, 4.4, 9.0]), &reference).unwrap();
        assert!((errors.bias - (7.9 / 7.0 - 1.0)).abs() < 1e-6, "{errors:?}");
        assert!((errors.median_rel - 0.1).abs() < 1e-6, "{errors:?}");
        let dark = picture([0.0; 4]);
        assert_eq!(linear_errors(&reference, &dark).unwrap(), LinearErrors { bias: 0.0, median_rel: 0.0 });
    }

    #[test]
    fn an_inverted_picture_is_anti_similar_and_other_noise_is_not_similar() {
        let picture = noise(48, 48, 1);
        let mut inverted = picture.clone();
        inverted.pixels_mut().for_each(|pixel| pixel.0 = pixel.0.map(|value| 255 - value));
        assert!(compare_pictures(&inverted, &picture).unwrap().ssim < -0.5);
        assert!(compare_pictures(&noise(48, 48, 2), &picture).unwrap().ssim.abs() < 0.2);
    }

    #[test]
    fn ssim_of_one_window_is_its_definition() {
        let (one, other) = (grey(&noise(11, 11, 3)), grey(&noise(11, 11, 4)));
        let weights = window();
        let mean = |value: &dyn Fn(usize) -> f64| {
            (0..121).map(|i| weights[i % 11] * weights[i / 11] * value(i)).sum::<f64>()
        };
        let (a, b) = (mean(&|i| one[i]), mean(&|i| other[i]));
        let variance = |values: &[f64], centre: f64| mean(&|i| (values[i] - centre).powi(2));
        let covariance = mean(&|i| (one[i] - a) * (other[i] - b));
        let [c1, c2] = SSIM_STABILISERS;
        let expected = (2.0 * a * b + c1) * (2.0 * covariance + c2)
            / ((a * a + b * b + c1) * (variance(&one, a) + variance(&other, b) + c2));
        assert!((ssim(&one, &other, 11) - expected).abs() < 1e-12);
    }

    #[test]
    fn sizes_that_do_not_match_are_named() {
        let differ = compare_pictures(&noise(32, 24, 1), &noise(32, 25, 1)).unwrap_err();
        assert_eq!(differ, SizeError::Differ(32, 24, 32, 25));
        assert!(differ.to_string().contains("32 x 24 and 32 x 25"));
        assert_eq!(compare_pictures(&noise(10, 24, 1), &noise(10, 24, 1)), Err(SizeError::TooSmall(10, 24)));
        assert!(flip_picture(&noise(8, 8, 1), &noise(9, 8, 1)).is_err());
        assert_eq!(flip_picture(&noise(8, 8, 1), &noise(8, 8, 2)).unwrap().dimensions(), (8, 8));
    }
}
