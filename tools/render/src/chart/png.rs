//! A drawing as pixels, with smooth edges.

use super::layout::{Anchor, Drawing, Mark};
use crate::glyphs;
use image::{Rgb, RgbImage};

/// The picture.
#[must_use]
pub fn to_image(drawing: &Drawing) -> RgbImage {
    let mut image = RgbImage::from_pixel(drawing.width as u32, drawing.height as u32, Rgb([255; 3]));
    for mark in &drawing.marks {
        match mark {
            Mark::Line { ends, colour, width } => stroke(&mut image, *ends, *colour, 0.5 * width),
            Mark::Dot { at, colour, radius } => stroke(&mut image, [*at; 2], *colour, *radius),
            Mark::Text { at, anchor, colour, text } => {
                let width = f64::from(glyphs::ADVANCE_PIXELS) * text.chars().count() as f64;
                let left = match anchor {
                    Anchor::Start => at.0,
                    Anchor::Middle => at.0 - 0.5 * width,
                    Anchor::End => at.0 - width,
                };
                let top = at.1 - 0.5 * f64::from(glyphs::LINE_PIXELS);
                glyphs::draw_in(&mut image, left.max(0.0) as u32, top.max(0.0) as u32, text, Rgb(*colour));
            }
        }
    }
    image
}

/// Everything within `radius` of a segment.
fn stroke(image: &mut RgbImage, [a, b]: [(f64, f64); 2], colour: [u8; 3], radius: f64) {
    let range = |from: f64, to: f64, end: u32| {
        let low = (from.min(to) - radius - 1.0).max(0.0) as u32;
        low..((from.max(to) + radius + 2.0).max(0.0) as u32).min(end)
    };
    let along = (b.0 - a.0, b.1 - a.1);
    let length_squared = along.0 * along.0 + along.1 * along.1;
    for y in range(a.1, b.1, image.height()) {
        for x in range(a.0, b.0, image.width()) {
            let from = (f64::from(x) + 0.5 - a.0, f64::from(y) + 0.5 - a.1);
            let at = (from.0 * along.0 + from.1 * along.1) / length_squared.max(f64::MIN_POSITIVE);
            let at = at.clamp(0.0, 1.0);
            let distance = (from.0 - at * along.0).hypot(from.1 - at * along.1);
            let covered = (radius + 0.5 - distance).clamp(0.0, 1.0);
            if covered > 0.0 {
                for (channel, ink) in image.get_pixel_mut(x, y).0.iter_mut().zip(colour) {
                    *channel =
                        (f64::from(*channel) * (1.0 - covered) + f64::from(ink) * covered).round() as u8;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_dots_and_letters_leave_ink_where_they_are() {
        let marks = vec![
            Mark::Line { ends: [(10.0, 10.5), (90.0, 10.5)], colour: [255, 0, 0], width: 2.0 },
            Mark::Dot { at: (50.0, 40.0), colour: [0, 0, 255], radius: 5.0 },
            Mark::Text { at: (50.0, 70.0), anchor: Anchor::Middle, colour: [0; 3], text: "T".to_owned() },
            Mark::Line { ends: [(-50.0, -50.0), (200.0, -10.0)], colour: [0; 3], width: 2.0 },
        ];
        let image = to_image(&Drawing { width: 100.0, height: 80.0, marks });
        assert_eq!(image.get_pixel(50, 10).0, [255, 0, 0]);
        assert_eq!(image.get_pixel(5, 10).0, [255; 3]);
        assert_eq!(image.get_pixel(50, 40).0, [0, 0, 255]);
        assert_eq!(image.get_pixel(58, 40).0, [255; 3]);
        let is_ink = |y: u32| (40..60).any(|x| image.get_pixel(x, y).0 == [0; 3]);
        assert!((62..78).any(is_ink));
        assert_eq!(image.get_pixel(99, 0).0, [255; 3], "what lies outside leaves nothing");
    }
}
