//! `earthshine gen`: deterministic worlds to bake, as .glb.

use crate::output::out;
use crate::progress_bars;
use clap::Args;
use earthshine_gen::{GenOptions, WorldKind};
use std::path::PathBuf;

/// Arguments of `earthshine gen`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine gen cornell cornell.glb
  earthshine gen town town.glb --triangles 1000000 --seed 7
  earthshine gen town town.glb --km 4 --triangles 10M
  earthshine gen furnace box.glb --reflectance 0.8")]
pub(crate) struct GenArguments {
    /// cornell, furnace, two-rooms, study, corridor or town.
    kind: WorldKind,
    /// File to write.
    output: PathBuf,
    #[command(flatten)]
    shape: ShapeArguments,
    /// Print what was made as JSON.
    #[arg(long)]
    json: bool,
    /// No progress bar.
    #[arg(long, short)]
    quiet: bool,
}

/// What a generated world depends on; shared with every command that takes a world's name.
#[derive(Args, Clone, Default)]
pub(crate) struct ShapeArguments {
    /// Every random number hangs on it.
    #[arg(long)]
    seed: Option<u64>,
    /// Furnace: reflectance of all walls, 0 to 0.98.
    #[arg(long)]
    reflectance: Option<f32>,
    /// Corridor: length, m.
    #[arg(long)]
    length: Option<f32>,
    /// Town: edge of the square it covers, m.
    #[arg(long)]
    size: Option<f32>,
    /// Town: the same in km.
    #[arg(long, conflicts_with = "size")]
    km: Option<f32>,
    /// Town: triangles wanted, instances counted; as 250000, 250k or 10M. Where they do not suffice for houses
    /// everywhere, some blocks are parks.
    #[arg(long, value_parser = count)]
    triangles: Option<u64>,
    /// Town: no instancing; every triangle is in the file.
    #[arg(long)]
    flatten: bool,
}

impl ShapeArguments {
    /// A town of that many triangles and that size, where given.
    pub(crate) fn of(triangles: Option<u64>, size: Option<f32>) -> Self {
        Self { triangles, size, ..Self::default() }
    }

    pub(crate) fn options(&self) -> GenOptions {
        let mut options = GenOptions::default();
        options.seed = self.seed.unwrap_or(options.seed);
        options.furnace_reflectance = self.reflectance.unwrap_or(options.furnace_reflectance);
        options.corridor_length_m = self.length.unwrap_or(options.corridor_length_m);
        options.town_size_m = self.size.or(self.km.map(|km| km * 1000.0)).unwrap_or(options.town_size_m);
        options.town_triangles = self.triangles.or(options.town_triangles);
        options.flatten = self.flatten || options.flatten;
        options
    }
}

/// A number, perhaps of thousands or millions.
pub(crate) fn count(text: &str) -> Result<u64, String> {
    let (number, unit) = match text.as_bytes().last() {
        Some(b'k' | b'K') => (&text[..text.len() - 1], 1e3),
        Some(b'm' | b'M') => (&text[..text.len() - 1], 1e6),
        _ => (text, 1.0),
    };
    let count = number.parse::<f64>().ok().map(|number| number * unit);
    let whole = count.filter(|count| (1.0..1e15).contains(count) && count.fract() == 0.0);
    whole.map(|count| count as u64).ok_or_else(|| format!("{text:?} is no count: write 250000, 250k or 10M"))
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &GenArguments) -> anyhow::Result<()> {
    let bar = progress_bars::counted("gen", "cells", 0, arguments.quiet || arguments.json);
    let glb = earthshine_gen::generate(arguments.kind, &arguments.shape.options(), &|done, total| {
        bar.set_length(total);
        bar.set_position(done);
    })?;
    bar.finish_and_clear();
    glb.write(&arguments.output)?;
    let (triangles, bytes, lights) = (glb.triangles, glb.bytes.len(), glb.lights);
    if arguments.json {
        let summary = serde_json::json!({
            "kind": arguments.kind.to_string(), "triangles": triangles, "file_bytes": bytes, "lights": lights,
        });
        out!("{summary}");
    } else {
        let megabytes = bytes as f64 / 1e6;
        out!("{}: {triangles} triangles, {lights} lights, {megabytes:.1} MB", arguments.output.display());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_have_units() {
        assert_eq!((count("250"), count("2.5k"), count("10M")), (Ok(250), Ok(2500), Ok(10_000_000)));
        for wrong in ["", "M", "-1", "0", "1.5", "many", "nan"] {
            assert!(count(wrong).is_err(), "{wrong}");
        }
    }
}
