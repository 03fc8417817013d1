//! The one list of checks, the same here and in `.ci/run`.

use crate::{cargo, tidy};
use anyhow::Result;
use std::path::Path;

/// Runs every check in order of how fast it fails.
pub(crate) fn run(root: &Path, skip_tests: bool) -> Result<()> {
    cargo(root, &["fmt", "--all", "--check"], &[])?;
    tidy::run(root)?;
    cargo(root, &["clippy", "--release", "--workspace", "--all-targets", "--", "-D", "warnings"], &[])?;
    if !skip_tests {
        cargo(root, &["test", "--release", "--workspace"], &[])?;
    }
    cargo(
        root,
        &["doc", "--release", "--workspace", "--no-deps", "--document-private-items"],
        &[("RUSTDOCFLAGS", "-D warnings")],
    )
}
