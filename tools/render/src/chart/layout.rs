//! Charts to lines, dots and letters in pixels from the upper left.

use super::{Axis, Chart, Scale};

/// Size of one chart, its labels included, pixels.
const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 420.0;
/// Around the plotting area: left, right, top, bottom.
const MARGINS: [f64; 4] = [110.0, 24.0, 52.0, 66.0];
/// Of a line of text.
const TEXT_LINE: f64 = 18.0;
const DOT_RADIUS: f64 = 4.0;
/// Ticks an axis has at most.
const TICKS_MAX: usize = 7;
/// Room beyond the outermost points, as a share of the axis.
const SLACK: f64 = 0.06;

/// Of series, in turn: told apart by the colour-blind too (Okabe and Ito, 2008).
pub(crate) const COLOURS: [[u8; 3]; 6] =
    [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167], [230, 159, 0], [86, 180, 233]];
pub(crate) const INK: [u8; 3] = [40; 3];
pub(crate) const GRID: [u8; 3] = [222; 3];

/// Where a text's given place is in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// Its left end.
    Start,
    /// Its middle.
    Middle,
    /// Its right end.
    End,
}

/// One thing to draw.
#[derive(Debug, Clone, PartialEq)]
pub enum Mark {
    /// A straight line.
    Line {
        /// Ends.
        ends: [(f64, f64); 2],
        /// RGB.
        colour: [u8; 3],
        /// Pixels.
        width: f64,
    },
    /// A filled circle.
    Dot {
        /// Centre.
        at: (f64, f64),
        /// RGB.
        colour: [u8; 3],
        /// Pixels.
        radius: f64,
    },
    /// A line of text.
    Text {
        /// Middle of its height.
        at: (f64, f64),
        /// What `at` is horizontally.
        anchor: Anchor,
        /// RGB.
        colour: [u8; 3],
        /// What it says.
        text: String,
    },
}

/// Marks on white paper, in the order they are drawn.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Drawing {
    /// Pixels.
    pub width: f64,
    /// Pixels.
    pub height: f64,
    /// What is on it.
    pub marks: Vec<Mark>,
}

/// Lays `charts` out side by side; `None` where no chart has a point.
#[must_use]
pub fn lay_out(charts: &[Chart]) -> Option<Drawing> {
    let mut drawing = Drawing { width: WIDTH * charts.len() as f64, height: HEIGHT, marks: Vec::new() };
    let mut is_empty = true;
    for (index, chart) in charts.iter().enumerate() {
        is_empty &= drawing.add(chart, WIDTH * index as f64).is_none();
    }
    (!is_empty).then_some(drawing)
}

/// One axis over the pixels `from..to`.
struct Ruler {
    scale: Scale,
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Ruler {
    fn new(axis: &Axis, values: impl Iterator<Item = f64>, [from, to]: [f64; 2]) -> Option<Self> {
        let (low, high) = values
            .filter_map(|value| placed(axis.scale, value))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            return None;
        }
        // One value alone lies in the middle of something.
        let room = if high > low { (high - low) * SLACK } else { low.abs().max(1.0) * 0.2 };
        Some(Self { scale: axis.scale, low: low - room, high: high + room, from, to })
    }

    fn pixel(&self, value: f64) -> Option<f64> {
        let at = (placed(self.scale, value)? - self.low) / (self.high - self.low);
        Some(self.from + at * (self.to - self.from))
    }

    /// Round numbers within, few enough to read.
    fn ticks(&self) -> Vec<f64> {
        match self.scale {
            Scale::Linear => {
                let rough = (self.high - self.low) / TICKS_MAX as f64;
                let power = 10f64.powf(rough.log10().floor());
                let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|step| *step >= rough);
                let step = step.unwrap_or(10.0 * power);
                let first = (self.low / step).ceil() as i64;
                (first..=first + TICKS_MAX as i64)
                    .map(|index| index as f64 * step)
                    .filter(|value| *value <= self.high)
                    .collect()
            }
            Scale::Logarithmic => {
                let decades = self.low.floor() as i32..=self.high.ceil() as i32;
                let of = |digits: &[f64]| -> Vec<f64> {
                    decades
                        .clone()
                        .flat_map(|decade| digits.iter().map(move |digit| digit * 10f64.powi(decade)))
                        .filter(|value| (self.low..=self.high).contains(&value.log10()))
                        .collect()
                };
                let choices: [&[f64]; 4] =
                    [&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0], &[1.0, 2.0, 3.0, 5.0], &[1.0, 3.0], &[1.0]];
                let all = choices.map(of);
                let fitting = all.iter().find(|ticks| ticks.len() <= TICKS_MAX).unwrap_or(&all[3]);
                let every = fitting.len().div_ceil(TICKS_MAX).max(1);
                fitting.iter().copied().step_by(every).collect()
            }
        }
    }
}

fn placed(scale: Scale, value: f64) -> Option<f64> {
    match scale {
        Scale::Linear => value.is_finite().then_some(value),
        Scale::Logarithmic => (value.is_finite() && value > 0.0).then(|| value.log10()),
    }
}

/// A number as short as its size allows, with thousands and millions as `k` and `M`.
#[must_use]
pub fn short(value: f64) -> String {
    let (scaled, unit) = match value.abs() {
        size if size >= 1e9 => (value / 1e9, "G"),
        size if size >= 1e6 => (value / 1e6, "M"),
        size if size >= 1e3 => (value / 1e3, "k"),
        _ => (value, ""),
    };
    let rounded = format!("{scaled:.6}");
    let digits = rounded.trim_end_matches('0').trim_end_matches('.');
    format!("{}{unit}", if digits == "-0" { "0" } else { digits })
}

impl Drawing {
    fn text(&mut self, at: (f64, f64), anchor: Anchor, colour: [u8; 3], text: &str) {
        self.marks.push(Mark::Text { at, anchor, colour, text: text.to_owned() });
    }

    fn line(&mut self, ends: [(f64, f64); 2], colour: [u8; 3], width: f64) {
        self.marks.push(Mark::Line { ends, colour, width });
    }

    /// Draws one chart from `left` on; `None` where it has no point.
    fn add(&mut self, chart: &Chart, left: f64) -> Option<()> {
        let [before, after, above, below] = MARGINS;
        let (x0, x1) = (left + before, left + WIDTH - after);
        let legend = if chart.series.len() > 1 { chart.series.len() as f64 * TEXT_LINE } else { 0.0 };
        let (y0, y1) = (above + legend, HEIGHT - below);
        let points = || chart.series.iter().flat_map(|series| &series.points);
        self.text((left + WIDTH / 2.0, TEXT_LINE), Anchor::Middle, INK, &chart.title);
        let x = Ruler::new(&chart.x, points().map(|point| point.0), [x0, x1])?;
        let y = Ruler::new(&chart.y, points().map(|point| point.1), [y1, y0])?;
        for tick in x.ticks() {
            let at = x.pixel(tick)?;
            self.line([(at, y0), (at, y1)], GRID, 1.0);
            self.text((at, y1 + TEXT_LINE), Anchor::Middle, INK, &short(tick));
        }
        for tick in y.ticks() {
            let at = y.pixel(tick)?;
            self.line([(x0, at), (x1, at)], GRID, 1.0);
            self.text((x0 - 8.0, at), Anchor::End, INK, &short(tick));
        }
        self.line([(x0, y1), (x1, y1)], INK, 1.0);
        self.line([(x0, y0), (x0, y1)], INK, 1.0);
        self.text((f64::midpoint(x0, x1), HEIGHT - TEXT_LINE), Anchor::Middle, INK, &chart.x.label);
        self.text((left + 8.0, y0 - TEXT_LINE / 2.0), Anchor::Start, INK, &chart.y.label);
        for (index, series) in chart.series.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            let places: Vec<(f64, f64)> = series
                .points
                .iter()
                .filter_map(|point| Some((x.pixel(point.0)?, y.pixel(point.1)?)))
                .collect();
            for pair in places.windows(2) {
                self.line([pair[0], pair[1]], colour, 2.0);
            }
            self.marks.extend(places.iter().map(|&at| Mark::Dot { at, colour, radius: DOT_RADIUS }));
            if chart.series.len() > 1 {
                let at = above + (index as f64 - 0.5) * TEXT_LINE;
                self.text((x1, at), Anchor::End, colour, &series.name);
            }
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::Series;

    fn chart(scale: Scale, points: Vec<(f64, f64)>) -> Chart {
        let axis = |label: &str| Axis { label: label.to_owned(), scale };
        let series = vec![Series { name: "median".to_owned(), points }];
        Chart { title: "error".to_owned(), x: axis("patches"), y: axis("error, %"), series }
    }

    fn dots(drawing: &Drawing) -> Vec<(f64, f64)> {
        let at = |mark: &Mark| if let Mark::Dot { at, .. } = mark { Some(*at) } else { None };
        drawing.marks.iter().filter_map(at).collect()
    }

    #[test]
    fn equal_ratios_are_equal_distances_on_logarithmic_axes() {
        let points = vec![(1e3, 8.0), (1e4, 4.0), (1e5, 2.0)];
        let dots = dots(&lay_out(&[chart(Scale::Logarithmic, points)]).unwrap());
        assert!((dots[1].0 - dots[0].0 - (dots[2].0 - dots[1].0)).abs() < 1e-9);
        assert!((dots[1].1 - dots[0].1 - (dots[2].1 - dots[1].1)).abs() < 1e-9);
        assert!(dots[0].0 < dots[2].0 && dots[0].1 < dots[2].1, "right is more, up is more");
    }

    #[test]
    fn ticks_are_round_few_and_inside() {
        for (low, high) in [(0.03, 0.05), (1.0, 9e6), (2.0, 3.0), (1e-9, 1e9)] {
            for scale in [Scale::Linear, Scale::Logarithmic] {
                let axis = Axis { label: String::new(), scale };
                let ruler = Ruler::new(&axis, [low, high].into_iter(), [0.0, 100.0]).unwrap();
                let ticks = ruler.ticks();
                assert!((1..=TICKS_MAX + 1).contains(&ticks.len()), "{low}..{high} {scale:?}: {ticks:?}");
                let inside = |tick: &f64| (-1e-6..=100.0 + 1e-6).contains(&ruler.pixel(*tick).unwrap());
                assert!(ticks.iter().all(inside), "{ticks:?}");
            }
        }
        assert_eq!(
            ["0", "1.5k", "20M", "-0.03"],
            [0.0, 1500.0, 2e7, -0.03].map(short).each_ref().map(|s| &**s)
        );
    }

    #[test]
    fn what_has_no_place_is_left_out() {
        let points = vec![(0.0, 1.0), (-1.0, 2.0), (f64::NAN, 1.0), (10.0, 1.0)];
        assert_eq!(dots(&lay_out(&[chart(Scale::Logarithmic, points.clone())]).unwrap()).len(), 1);
        assert_eq!(dots(&lay_out(&[chart(Scale::Linear, points)]).unwrap()).len(), 3);
        assert_eq!(lay_out(&[chart(Scale::Linear, vec![])]), None);
        assert_eq!(lay_out(&[]), None);
    }
}
