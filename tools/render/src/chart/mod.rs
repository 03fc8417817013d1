//! Line charts as SVG and PNG: figures of benches against each other.
//!
//! One layout ([`layout`]) serves both files. Letters come from the crate's own glyphs or, in SVG, from the viewer: no
//! font file, no system font, the same bytes on every machine. Not a plotting library: lines with dots on linear or
//! logarithmic axes is all there is.

pub mod layout;
mod png;
mod svg;

pub use png::to_image;
pub use svg::to_svg;

use crate::image_file::{ImageFileError, write_png};
use std::path::{Path, PathBuf};

/// How numbers lie along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By their logarithm; numbers that are not above zero are left out.
    Logarithmic,
}

/// One axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// What it shows, with its unit.
    pub label: String,
    /// How.
    pub scale: Scale,
}

/// Dots joined by a line.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// For the legend.
    pub name: String,
    /// `(x, y)`; what is not finite is left out.
    pub points: Vec<(f64, f64)>,
}

/// One diagram.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Above it.
    pub title: String,
    /// Along the bottom.
    pub x: Axis,
    /// Along the left.
    pub y: Axis,
    /// At most as many as there are colours; further ones begin anew.
    pub series: Vec<Series>,
}

/// A chart could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// No chart, or no point to draw.
    #[error(
        "there is nothing to draw: no point of any series is a finite number above zero where its axis asks for one"
    )]
    Empty,
    /// The PNG.
    #[error(transparent)]
    Png(#[from] ImageFileError),
    /// The SVG.
    #[error("{}: {source}", path.display())]
    Svg {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// Writes `charts` side by side to `stem`.svg and `stem`.png and returns both paths.
///
/// # Errors
/// There is nothing to draw, or a file cannot be written.
pub fn write_both(stem: &Path, charts: &[Chart]) -> Result<[PathBuf; 2], ChartError> {
    let drawing = layout::lay_out(charts).ok_or(ChartError::Empty)?;
    let named = |ending: &str| {
        let mut name = stem.as_os_str().to_owned();
        name.push(ending);
        PathBuf::from(name)
    };
    let (svg, png) = (named(".svg"), named(".png"));
    std::fs::write(&svg, to_svg(&drawing)).map_err(|source| ChartError::Svg { path: svg.clone(), source })?;
    write_png(&png, &to_image(&drawing))?;
    Ok([svg, png])
}
