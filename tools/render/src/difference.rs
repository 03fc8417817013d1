//! Differences in false colours: blue is too dark, red too bright, black is right.
//!
//! The scale is the caller's and is drawn under the picture: without it colours say nothing.

use crate::glyphs;
use crate::image_file::luminance;
use crate::metrics::SizeError;
use crate::picture::Picture;
use image::RgbImage;

/// Signed difference of luminance, at full colour from `full_scale` cd/m2 on, with its scale below.
///
/// # Errors
/// The pictures differ in size.
pub fn difference(measured: &Picture, reference: &Picture, full_scale: f32) -> Result<RgbImage, SizeError> {
    let size = |picture: &Picture| (picture.width(), picture.height());
    SizeError::check(size(measured), size(reference))?;
    let (width, height) = size(measured);
    let mut image = RgbImage::new(width, height + glyphs::LINE_PIXELS);
    let pairs = measured.pixels().iter().zip(reference.pixels());
    for (pixel, (&found, &right)) in image.pixels_mut().zip(pairs) {
        pixel.0 = false_colour((luminance(found) - luminance(right)) / full_scale);
    }
    let scale = format!("+-{full_scale:.3} CD/M2");
    glyphs::draw(&mut image, 0, height, &scale);
    Ok(image)
}

/// -1 is full blue, 0 black, 1 full red, with light blue and yellow half way so that the eye can count.
#[must_use]
pub fn false_colour(signed: f32) -> [u8; 3] {
    let signed = if signed.is_nan() { 0.0 } else { signed.clamp(-1.0, 1.0) };
    let strength = signed.abs();
    let main = (strength * 255.0).round() as u8;
    let second = ((1.0 - (2.0 * strength - 1.0).abs()) * 128.0).round() as u8;
    if signed < 0.0 { [0, second, main] } else { [main, second, 0] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::Rgb;

    #[test]
    fn dark_is_blue_bright_is_red_and_right_is_black() {
        let reference = Picture::new(3, 1, vec![Rgb::splat(10.0); 3]);
        let measured = Picture::new(3, 1, vec![Rgb::splat(5.0), Rgb::splat(10.0), Rgb::splat(99.0)]);
        let image = difference(&measured, &reference, 5.0).unwrap();
        assert_eq!(image.get_pixel(0, 0).0, [0, 0, 255]);
        assert_eq!(image.get_pixel(1, 0).0, [0, 0, 0]);
        assert_eq!(image.get_pixel(2, 0).0, [255, 0, 0]);
        assert_eq!(false_colour(0.5), [128, 128, 0]);
        assert_eq!(false_colour(f32::NAN), [0, 0, 0]);
    }

    #[test]
    fn the_scale_is_drawn_below() {
        let picture = Picture::new(200, 1, vec![Rgb::ONE; 200]);
        let image = difference(&picture, &picture, 5.0).unwrap();
        assert!(image.rows().skip(1).flatten().any(|pixel| pixel.0 != [0; 3]));
        let other = Picture::new(1, 1, vec![Rgb::ONE]);
        assert!(difference(&picture, &other, 5.0).is_err());
    }
}
