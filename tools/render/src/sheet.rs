//! Labelled pictures side by side in one: what a person looks at first.

use crate::glyphs;
use image::RgbImage;

/// Pixels around and between pictures.
const GAP_PIXELS: u32 = 8;
/// Grey of the sheet.
const PAPER: [u8; 3] = [24; 3];

/// A sheet that cannot be laid out.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SheetError {
    /// Nothing to show.
    #[error("a sheet needs at least one picture and one column")]
    Empty,
    /// Too many pixels.
    #[error("the sheet would be {0} x {1} pixels, more than {EDGE_PIXELS_MAX} along an edge")]
    TooLarge(u64, u64),
}

/// Most pixels along an edge of a sheet.
pub const EDGE_PIXELS_MAX: u64 = 32_768;

/// Lays `pictures` out in rows of `columns`, each under its label. Cells have the size of the largest.
///
/// Labels are drawn in capitals; what does not fit is cut off.
///
/// # Errors
/// There is nothing to lay out, or the sheet would be too large.
pub fn sheet(pictures: &[(&str, &RgbImage)], columns: usize) -> Result<RgbImage, SheetError> {
    if pictures.is_empty() || columns == 0 {
        return Err(SheetError::Empty);
    }
    let columns = columns.min(pictures.len());
    let rows = pictures.len().div_ceil(columns);
    let cell_width = pictures.iter().map(|(_, picture)| picture.width()).max().unwrap_or(0) + GAP_PIXELS;
    let cell_height = pictures.iter().map(|(_, picture)| picture.height()).max().unwrap_or(0)
        + GAP_PIXELS
        + glyphs::LINE_PIXELS;
    let edge = |cells: usize, cell: u32| cells as u64 * u64::from(cell) + u64::from(GAP_PIXELS);
    let (width, height) = (edge(columns, cell_width), edge(rows, cell_height));
    if width.max(height) > EDGE_PIXELS_MAX {
        return Err(SheetError::TooLarge(width, height));
    }
    let mut image = RgbImage::from_pixel(width as u32, height as u32, image::Rgb(PAPER));
    for (index, (label, picture)) in pictures.iter().enumerate() {
        let x = GAP_PIXELS + (index % columns) as u32 * cell_width;
        let y = GAP_PIXELS + (index / columns) as u32 * cell_height;
        let fitting = ((cell_width - GAP_PIXELS) / glyphs::ADVANCE_PIXELS) as usize;
        let label: String = label.chars().take(fitting).collect();
        glyphs::draw(&mut image, x, y, &label);
        image::imageops::replace(&mut image, *picture, x.into(), (y + glyphs::LINE_PIXELS).into());
    }
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_lie_under_their_labels_in_rows() {
        let red = RgbImage::from_pixel(40, 30, image::Rgb([255, 0, 0]));
        let blue = RgbImage::from_pixel(20, 10, image::Rgb([0, 0, 255]));
        let image = sheet(&[("direct", &red), ("b", &blue), ("a label too long to fit", &red)], 2).unwrap();
        let (cell_width, cell_height) = (40 + GAP_PIXELS, 30 + GAP_PIXELS + glyphs::LINE_PIXELS);
        assert_eq!(image.dimensions(), (2 * cell_width + GAP_PIXELS, 2 * cell_height + GAP_PIXELS));
        let below_label = GAP_PIXELS + glyphs::LINE_PIXELS;
        assert_eq!(image.get_pixel(GAP_PIXELS, below_label).0, [255, 0, 0]);
        assert_eq!(image.get_pixel(GAP_PIXELS + cell_width, below_label).0, [0, 0, 255]);
        assert_eq!(image.get_pixel(GAP_PIXELS, below_label + cell_height).0, [255, 0, 0]);
        let label_is_drawn = (0..40).any(|x| image.get_pixel(GAP_PIXELS + x, GAP_PIXELS + 4).0 != PAPER);
        assert!(label_is_drawn);
    }

    #[test]
    fn nothing_and_too_much_are_refused() {
        let picture = RgbImage::new(4000, 1);
        assert_eq!(sheet(&[], 2), Err(SheetError::Empty));
        assert_eq!(sheet(&[("a", &picture)], 0), Err(SheetError::Empty));
        let many = vec![("a", &picture); 20];
        assert!(matches!(sheet(&many, 20), Err(SheetError::TooLarge(..))));
    }
}
