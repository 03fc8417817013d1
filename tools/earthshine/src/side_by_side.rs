//! Pictures of the same moments under several names: an animation with all of them side by side, and a strip.

use anyhow::Context as _;
use earthshine_render::{image_file, sheet};
use image::RgbImage;
use image::codecs::gif::{GifEncoder, Repeat};
use std::path::{Path, PathBuf};

/// Pictures of the strip, at most.
const STRIP_PICTURES: usize = 6;
/// Time a picture is shown, ms.
const PICTURE_MS: u32 = 100;
/// Speed of the encoder's search for colours, 1 (best) to 30.
const GIF_SPEED: i32 = 10;

/// Pictures of one name, in the order of time.
#[derive(Debug)]
pub(crate) struct Reel<'a> {
    /// What they are labelled with.
    pub(crate) name: &'a str,
    /// As many as the others have, at one exposure.
    pub(crate) pictures: Vec<RgbImage>,
}

/// Writes `animation.gif` and `strip.png` into `folder`; returns their paths. Moments that not all have are left out.
pub(crate) fn write(folder: &Path, reels: &[Reel<'_>]) -> anyhow::Result<[PathBuf; 2]> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let count = reels.iter().map(|reel| reel.pictures.len()).min().unwrap_or(0);
    anyhow::ensure!(count > 0, "{}: there are no pictures to write", folder.display());
    let together = |at: usize| -> anyhow::Result<RgbImage> {
        let labelled: Vec<(&str, &RgbImage)> =
            reels.iter().map(|reel| (reel.name, &reel.pictures[at])).collect();
        Ok(sheet::sheet(&labelled, reels.len())?)
    };
    let gif = folder.join("animation.gif");
    // In memory first: the encoder writes its end where it is dropped, and a fault of a file would be lost there.
    let mut bytes = Vec::new();
    let mut encoder = GifEncoder::new_with_speed(&mut bytes, GIF_SPEED);
    encoder.set_repeat(Repeat::Infinite)?;
    for at in 0..count {
        let picture = image::DynamicImage::ImageRgb8(together(at)?).into_rgba8();
        let delay = image::Delay::from_numer_denom_ms(PICTURE_MS, 1);
        encoder.encode_frame(image::Frame::from_parts(picture, 0, 0, delay))?;
    }
    drop(encoder);
    std::fs::write(&gif, &bytes).with_context(|| gif.display().to_string())?;
    let shown = count.min(STRIP_PICTURES);
    let moments: Vec<usize> = (0..shown).map(|at| at * (count - 1) / (shown - 1).max(1)).collect();
    let labelled: Vec<(&str, &RgbImage)> = reels
        .iter()
        .flat_map(|reel| moments.iter().map(move |&at| (reel.name, &reel.pictures[at])))
        .collect();
    let strip = folder.join("strip.png");
    image_file::write_png(&strip, &sheet::sheet(&labelled, shown)?)?;
    Ok([gif, strip])
}
