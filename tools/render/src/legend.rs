//! What the colours of a picture mean, drawn below it.

use crate::glyphs;
use image::{Rgb, RgbImage};

/// Height of a strip of colour, pixels.
const STRIP_PIXELS: u32 = 14;
const PAPER: Rgb<u8> = Rgb([24; 3]);
const INK: Rgb<u8> = Rgb([230; 3]);

/// `picture` with a strip of `colour(-1..=1)` below it, `low`, `middle` and `high` under its ends and centre, and `lines`.
/// Paper is added to the right where the words are wider than the picture.
#[must_use]
pub fn with_scale(
    picture: &RgbImage,
    colour: impl Fn(f32) -> [u8; 3],
    [low, middle, high]: [&str; 3],
    lines: &[String],
) -> RgbImage {
    let text_lines = lines.len() as u32 + 1;
    let widest = lines.iter().map(|line| text_width(line)).max().unwrap_or(0);
    let mut image = extended(picture, widest, STRIP_PIXELS + text_lines * glyphs::LINE_PIXELS);
    let (width, top) = (image.width(), picture.height());
    for y in 0..STRIP_PIXELS {
        for x in 0..width {
            let at = 2.0 * (x as f32 + 0.5) / width as f32 - 1.0;
            image.put_pixel(x, top + y, Rgb(colour(at)));
        }
    }
    let y = top + STRIP_PIXELS;
    glyphs::draw_in(&mut image, 0, y, low, INK);
    glyphs::draw_in(&mut image, (width / 2).saturating_sub(text_width(middle) / 2), y, middle, INK);
    glyphs::draw_in(&mut image, width.saturating_sub(text_width(high)), y, high, INK);
    for (index, line) in (1u32..).zip(lines) {
        glyphs::draw_in(&mut image, 0, y + index * glyphs::LINE_PIXELS, line, INK);
    }
    image
}

/// `picture` with one line below it a key: a patch of its colour and its name. Paper is added to the right where the
/// names are wider than the picture.
#[must_use]
pub fn with_keys(picture: &RgbImage, keys: &[([u8; 3], String)]) -> RgbImage {
    let indent = 3 * glyphs::ADVANCE_PIXELS;
    let widest = keys.iter().map(|(_, name)| indent + text_width(name)).max().unwrap_or(0);
    let mut image = extended(picture, widest, keys.len() as u32 * glyphs::LINE_PIXELS);
    for (index, (colour, name)) in (0u32..).zip(keys) {
        let y = picture.height() + index * glyphs::LINE_PIXELS;
        for dy in 2..glyphs::LINE_PIXELS - 2 {
            for x in 0..(2 * glyphs::ADVANCE_PIXELS).min(image.width()) {
                image.put_pixel(x, y + dy, Rgb(*colour));
            }
        }
        glyphs::draw_in(&mut image, indent, y, name, INK);
    }
    image
}

fn text_width(text: &str) -> u32 {
    text.chars().count() as u32 * glyphs::ADVANCE_PIXELS
}

fn extended(picture: &RgbImage, width: u32, below: u32) -> RgbImage {
    let mut image = RgbImage::from_pixel(picture.width().max(width), picture.height() + below, PAPER);
    image::imageops::replace(&mut image, picture, 0, 0);
    image
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::difference::false_colour;

    #[test]
    fn the_strip_runs_from_one_end_of_the_scale_to_the_other() {
        let picture = RgbImage::from_pixel(200, 10, Rgb([1, 2, 3]));
        let image = with_scale(&picture, false_colour, ["-50 %", "0", "+50 %"], &["LINE".to_owned()]);
        assert_eq!(image.get_pixel(5, 5).0, [1, 2, 3]);
        let long = with_scale(&picture, false_colour, ["", "", ""], &["A LINE OF MORE THAN THIS".to_owned()]);
        assert!(long.width() > 200 && long.get_pixel(250, 5) == &PAPER);
        let blue_to_red = [image.get_pixel(0, 12).0, image.get_pixel(199, 12).0];
        assert!(blue_to_red[0][2] > 240 && blue_to_red[1][0] > 240, "{blue_to_red:?}");
        let inked = |from: u32, to: u32, y: u32| {
            (from..to).any(|x| (y..y + 18).any(|y| image.get_pixel(x, y) == &INK))
        };
        assert!(inked(0, 60, 24) && inked(80, 120, 24) && inked(140, 200, 24) && inked(0, 60, 42));
    }

    #[test]
    fn every_key_has_its_colour_and_name() {
        let picture = RgbImage::new(100, 10);
        let keys = [([255, 0, 0], "A".to_owned()), ([0, 255, 0], "B".to_owned())];
        let image = with_keys(&picture, &keys);
        assert_eq!(image.height(), 10 + 2 * glyphs::LINE_PIXELS);
        assert_eq!(image.get_pixel(5, 10 + 9).0, [255, 0, 0]);
        assert_eq!(image.get_pixel(5, 10 + glyphs::LINE_PIXELS + 9).0, [0, 255, 0]);
    }
}
