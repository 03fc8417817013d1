//! From linear pictures to files: exposure and sRGB for PNG, untouched for EXR, and back.
//!
//! Pictures that are compared share one stated exposure; nothing here adapts to what it shows unless
//! asked through [`key_exposure`].

use crate::picture::Picture;
use earthshine_world::Rgb;
use image::{DynamicImage, ImageFormat, Rgb32FImage, RgbImage};
use std::path::{Path, PathBuf};

/// Where [`key_exposure`] puts the geometric mean: middle grey.
const MIDDLE_GREY: f64 = 0.18;
/// Rec. 709 weights of linear RGB.
const LUMINANCE: Rgb = Rgb::new(0.2126, 0.7152, 0.0722);

/// A picture could not be written or read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct ImageFileError {
    path: PathBuf,
    /// Whether it was to be written.
    pub is_writing: bool,
    source: image::ImageError,
}

/// Luminance of a linear colour.
#[must_use]
pub fn luminance(rgb: Rgb) -> f32 {
    rgb.dot(LUMINANCE)
}

/// Radiance times `exposure`, clipped at one, sRGB-encoded to 8 bits.
#[must_use]
pub fn exposed(picture: &Picture, exposure: f32) -> RgbImage {
    RgbImage::from_fn(picture.width(), picture.height(), |x, y| {
        image::Rgb((picture.at(x, y) * exposure).to_array().map(srgb_byte))
    })
}

/// The exposure that shows `picture` with its geometric mean at middle grey; black pixels do not count.
/// One for a black picture.
#[must_use]
pub fn key_exposure(picture: &Picture) -> f32 {
    let logs: Vec<f64> = picture
        .pixels()
        .iter()
        .map(|&pixel| f64::from(luminance(pixel)))
        .filter(|&light| light > 0.0)
        .map(f64::ln)
        .collect();
    if logs.is_empty() {
        return 1.0;
    }
    let mean = (logs.iter().sum::<f64>() / logs.len() as f64).exp();
    (MIDDLE_GREY / mean) as f32
}

/// The sRGB transfer curve: linear 0..=1 to encoded 0..=255, clipped; NaN is black.
#[must_use]
pub fn srgb_byte(linear: f32) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let encoded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

/// Writes an 8-bit picture as PNG; the file appears whole or not at all.
///
/// # Errors
/// The file cannot be written.
pub fn write_png(path: &Path, picture: &RgbImage) -> Result<(), ImageFileError> {
    save(path, &DynamicImage::ImageRgb8(picture.clone()), ImageFormat::Png)
}

/// Writes linear radiance as 32-bit OpenEXR; the file appears whole or not at all.
///
/// # Errors
/// The file cannot be written.
pub fn write_exr(path: &Path, picture: &Picture) -> Result<(), ImageFileError> {
    let value = |x, y| image::Rgb(picture.at(x, y).to_array());
    let image = Rgb32FImage::from_fn(picture.width(), picture.height(), value);
    save(path, &DynamicImage::ImageRgb32F(image), ImageFormat::OpenExr)
}

/// Reads a linear picture (OpenEXR or Radiance HDR).
///
/// # Errors
/// The file cannot be read or is no picture.
pub fn read_linear(path: &Path) -> Result<Picture, ImageFileError> {
    let image = open(path)?.into_rgb32f();
    let pixels = image.pixels().map(|pixel| Rgb::from_array(pixel.0)).collect();
    Ok(Picture::new(image.width(), image.height(), pixels))
}

/// Reads an 8-bit sRGB picture.
///
/// # Errors
/// The file cannot be read or is no picture.
pub fn read_srgb(path: &Path) -> Result<RgbImage, ImageFileError> {
    Ok(open(path)?.into_rgb8())
}

fn open(path: &Path) -> Result<DynamicImage, ImageFileError> {
    image::open(path).map_err(|source| ImageFileError { path: path.into(), is_writing: false, source })
}

fn save(path: &Path, image: &DynamicImage, format: ImageFormat) -> Result<(), ImageFileError> {
    let mut unfinished = path.as_os_str().to_owned();
    unfinished.push(".part");
    image
        .save_with_format(&unfinished, format)
        .and_then(|()| std::fs::rename(&unfinished, path).map_err(image::ImageError::IoError))
        .map_err(|source| ImageFileError { path: path.into(), is_writing: true, source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_follows_the_srgb_curve() {
        assert_eq!([0.0, 1.0, 7.0, -1.0, f32::NAN].map(srgb_byte), [0, 255, 255, 0, 0]);
        assert_eq!(srgb_byte(0.214_041_14), 128, "half of the encoded range");
        assert_eq!(srgb_byte(0.002), 7, "the straight foot");
    }

    #[test]
    fn exposure_scales_before_encoding() {
        let picture = Picture::new(2, 1, vec![Rgb::splat(10.0), Rgb::splat(1000.0)]);
        let image = exposed(&picture, 1e-3);
        assert_eq!((image.get_pixel(0, 0).0, image.get_pixel(1, 0).0), ([srgb_byte(0.01); 3], [255; 3]));
        assert!((key_exposure(&picture) - 0.0018).abs() < 1e-6);
        assert_eq!(key_exposure(&Picture::new(1, 1, vec![Rgb::ZERO])), 1.0);
    }

    #[test]
    fn files_hold_what_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let picture = Picture::new(2, 2, vec![Rgb::new(1e5, 0.3, 0.0), Rgb::ONE, Rgb::ZERO, Rgb::splat(2.5)]);
        let (exr, png) = (folder.path().join("a.exr"), folder.path().join("a.png"));
        write_exr(&exr, &picture).unwrap();
        assert_eq!(read_linear(&exr).unwrap(), picture);
        write_png(&png, &exposed(&picture, 0.5)).unwrap();
        assert_eq!(read_srgb(&png).unwrap(), exposed(&picture, 0.5));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
        let missing = read_srgb(&folder.path().join("b.png")).unwrap_err().to_string();
        assert!(missing.contains("b.png"), "{missing}");
    }
}
