//! Benches that need nothing but this repository; each prints one JSON object.

use crate::cargo;
use anyhow::Result;
use std::path::Path;

/// Arguments after `earthshine bench`, one suite a line.
const SUITES: &[&str] =
    &["accuracy --scene furnace", "accuracy --scene cornell", "matrix", "bake --scene town"];

/// Runs them one after another: two benches at once measure each other.
pub(crate) fn run(root: &Path) -> Result<()> {
    for suite in SUITES {
        let mut arguments = vec!["run", "--release", "--quiet", "--", "bench"];
        arguments.extend(suite.split(' '));
        arguments.push("--json");
        cargo(root, &arguments, &[])?;
    }
    Ok(())
}
