//! Environment maps from Radiance .hdr and OpenEXR files.
//!
//! The format is told by content, never by name. A Radiance file's pixels are divided by the exposure and colour correction
//! that it says it was multiplied by. Everything that is refused names its cure.

use crate::{EnvironmentMap, resource};
use earthshine_world::Rgb;
use image::codecs::hdr::{HdrDecoder, HdrMetadata};
use image::codecs::openexr::OpenExrDecoder;
use image::{DynamicImage, ImageDecoder, ImageFormat};
use std::io::Cursor;
use std::path::Path;

/// Most pixels of a map: 8192 x 4096 and some.
const ENVIRONMENT_PIXELS_MAX: u64 = 1 << 26;

/// A file's map, and whether its shape is that of a panorama.
#[derive(Debug)]
pub(crate) struct EnvironmentFile {
    pub(crate) map: EnvironmentMap,
    /// A sentence for people where the picture is not twice as wide as high.
    pub(crate) warning: Option<String>,
}

/// Reads the map at `path`; its pixels times `scale` are radiance in cd/m2.
///
/// # Errors
/// Why not, and what to do, for a message.
pub(crate) fn read(path: &Path, scale: f32, rotation_deg: f32) -> Result<EnvironmentFile, String> {
    let bytes = resource::read_file(path).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => {
            "there is no such file; its path is relative to the lights file".to_owned()
        }
        _ => format!("cannot be read: {error}"),
    })?;
    let (image, exposure) = decode(&bytes)?;
    let image = image.into_rgb32f();
    let (width, height) = image.dimensions();
    let radiance = image.pixels().map(|pixel| Rgb::from_array(pixel.0) * scale / exposure).collect();
    let map = EnvironmentMap::new(width, height, radiance, f64::from(rotation_deg).to_radians());
    let map = map.map_err(|error| format!("{error}; repair them and save the picture again"))?;
    let warning = (u64::from(width) != 2 * u64::from(height)).then(|| {
        format!(
            "it is {width} x {height} pixels, not twice as wide as high: it is stretched over the whole sphere; \
             is it an equirectangular panorama?"
        )
    });
    Ok(EnvironmentFile { map, warning })
}

/// The picture, and what its pixels were multiplied by.
fn decode(bytes: &[u8]) -> Result<(DynamicImage, Rgb), String> {
    let damaged = |error: image::ImageError| format!("{error}; copy or export it again");
    // Older programs write `#?RGBE`.
    if bytes.starts_with(b"#?") {
        let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(damaged)?;
        let exposure = exposure(bytes, &decoder.metadata())?;
        return Ok((within_bounds(decoder)?, exposure));
    }
    match image::guess_format(bytes) {
        Ok(ImageFormat::OpenExr) => {
            let decoder = OpenExrDecoder::with_alpha_preference(Cursor::new(bytes), Some(false));
            Ok((within_bounds(decoder.map_err(damaged)?)?, Rgb::ONE))
        }
        Ok(other) => Err(format!(
            "it is {other:?}, which ends at white and holds no radiance; save it as Radiance .hdr or OpenEXR"
        )),
        Err(_) => Err("it is neither Radiance .hdr nor OpenEXR; save the panorama as one of them".to_owned()),
    }
}

/// What a Radiance file says its pixels were multiplied by: all lines `EXPOSURE` and `COLORCORR` together.
fn exposure(bytes: &[u8], metadata: &HdrMetadata) -> Result<Rgb, String> {
    let header = bytes.split(|&byte| byte == b'\n').take_while(|line| !line.is_empty());
    for line in header.map(String::from_utf8_lossy) {
        // The decoder passes over lines that it cannot read.
        let is_number = |word: &str| word.parse::<f32>().is_ok();
        let value = line.strip_prefix("EXPOSURE=").or_else(|| line.strip_prefix("COLORCORR="));
        if value.is_some_and(|value| value.trim().is_empty() || !value.split_whitespace().all(is_number)) {
            return Err(format!("its header says `{line}`, which is no exposure: repair the header"));
        }
    }
    let [red, green, blue] = metadata.color_correction.map_or([1.0; 3], |(r, g, b)| [r, g, b]);
    let exposure = Rgb::new(red, green, blue) * metadata.exposure.unwrap_or(1.0);
    if exposure.is_finite() && exposure.min_element() > 0.0 {
        Ok(exposure)
    } else {
        Err(format!("its header says an exposure of {exposure}; it must be above zero: repair the header"))
    }
}

fn within_bounds(decoder: impl ImageDecoder) -> Result<DynamicImage, String> {
    let (width, height) = decoder.dimensions();
    if u64::from(width) * u64::from(height) > ENVIRONMENT_PIXELS_MAX {
        return Err(format!(
            "{width} x {height} pixels, more than the limit of {ENVIRONMENT_PIXELS_MAX}; scale it down (the \
             service keeps six values of it)"
        ));
    }
    DynamicImage::from_decoder(decoder).map_err(|error| format!("{error}; copy or export it again"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::Vec3;
    use image::{Rgb32FImage, RgbImage};

    fn read_bytes(bytes: &[u8]) -> Result<EnvironmentFile, String> {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("sky");
        std::fs::write(&path, bytes).expect("a scratch folder");
        read(&path, 2.0, 90.0)
    }

    fn encoded(image: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.into().write_to(&mut bytes, format).expect("in memory");
        bytes.into_inner()
    }

    fn panorama(first: f32) -> DynamicImage {
        let texel = |x, y| image::Rgb(if (x, y) == (0, 0) { [first; 3] } else { [4.0, 0.5, 0.25] });
        Rgb32FImage::from_fn(8, 4, texel).into()
    }

    #[test]
    fn both_formats_are_read_scaled_and_turned() {
        for format in [ImageFormat::Hdr, ImageFormat::OpenExr] {
            let found = read_bytes(&encoded(panorama(64.0), format)).expect("a map");
            assert_eq!((found.map.width(), found.map.height(), &found.warning), (8, 4, &None));
            assert_eq!(found.map.texel(3, 3), Rgb::new(8.0, 1.0, 0.5));
            assert_eq!(found.map.texel(0, 0), Rgb::splat(128.0));
            // The left edge is -X; a quarter turn takes it to +Z.
            let left = Vec3::new(-0.05, 1.0, 0.2).normalize_or_zero();
            assert_eq!(found.map.radiance(left), Rgb::splat(128.0));
        }
        let mut old = encoded(panorama(1.0), ImageFormat::Hdr);
        let rest = old.split_off(b"#?RADIANCE".len());
        let old = [&b"#?RGBE"[..], &rest].concat();
        assert!(read_bytes(&old).is_ok());
    }

    #[test]
    fn what_a_file_was_exposed_by_is_taken_back() {
        let plain = encoded(panorama(64.0), ImageFormat::Hdr);
        let with = |lines: &str| {
            let head = b"#?RADIANCE\n".len();
            read_bytes(&[&plain[..head], lines.as_bytes(), &plain[head..]].concat())
        };
        let found = with("EXPOSURE=4\nEXPOSURE=0.5\nCOLORCORR=1 2 0.5\n").expect("a map");
        assert_eq!(found.map.texel(3, 3), Rgb::new(4.0, 0.25, 0.5));
        for lines in [
            "EXPOSURE=0\n",
            "EXPOSURE=-1\n",
            "EXPOSURE=inf\n",
            "EXPOSURE=1,5\n",
            "EXPOSURE=\n",
            "COLORCORR=1 0 1\n",
        ] {
            let cause = with(lines).expect_err("no exposure");
            assert!(cause.contains("exposure") && cause.contains("repair the header"), "{lines}: {cause}");
        }
    }

    #[test]
    fn other_pictures_are_refused_with_a_cure() {
        let eight_bits = DynamicImage::from(RgbImage::new(8, 4));
        for (format, name) in [(ImageFormat::Png, "Png"), (ImageFormat::Jpeg, "Jpeg")] {
            let cause = read_bytes(&encoded(eight_bits.clone(), format)).expect_err("no radiance");
            assert!(cause.contains(name) && cause.contains("save it as Radiance .hdr or OpenEXR"), "{cause}");
        }
        let cause = read_bytes(b"a sunny day").expect_err("no picture");
        assert!(cause.contains("neither Radiance .hdr nor OpenEXR"), "{cause}");
    }

    #[test]
    fn pixels_that_cannot_be_are_named() {
        for (first, word) in [(-1.0, "negative"), (f32::NAN, "not a number"), (f32::INFINITY, "infinite")] {
            let cause = read_bytes(&encoded(panorama(first), ImageFormat::OpenExr)).expect_err("bad pixels");
            let place = cause.contains("column 0, row 0") && cause.contains("repair them");
            assert!(cause.contains(word) && place, "{cause}");
        }
    }

    #[test]
    fn damage_and_size_are_errors_and_shape_a_warning() {
        for format in [ImageFormat::Hdr, ImageFormat::OpenExr] {
            let whole = encoded(panorama(1.0), format);
            for length in 0..whole.len() {
                // Radiance files may end in a comment; what matters is that nothing panics.
                let _told = read_bytes(&whole[..length]).is_err_and(|cause| !cause.is_empty());
            }
        }
        let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 40000\n";
        let cause = read_bytes(huge).expect_err("too large");
        assert!(cause.contains("40000 x 20000") && cause.contains("scale it down"), "{cause}");
        let square = Rgb32FImage::from_pixel(4, 4, image::Rgb([1.0; 3]));
        let warning = read_bytes(&encoded(square, ImageFormat::Hdr)).expect("a map").warning;
        assert!(warning.is_some_and(|text| text.contains("4 x 4") && text.contains("equirectangular")));
    }
}
