//! Habits of this repository: `cargo xtask ci | tidy | bless | bench`.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a command-line tool for its developers")]

mod bench;
mod ci;
mod imports;
mod tidy;

use anyhow::{Context as _, Result, bail};
use clap::{Parser, Subcommand};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

#[derive(Parser)]
#[command(about = "Habits of this repository", after_help = "Example: cargo xtask ci")]
struct Arguments {
    #[command(subcommand)]
    habit: Habit,
}

#[derive(Subcommand)]
enum Habit {
    /// Everything that must hold before a change lands: format, lints, tests, documentation, tidy.
    Ci {
        /// Everything but the tests, for callers that have just run them.
        #[arg(long)]
        skip_tests: bool,
    },
    /// Import table, module headers, file lengths, banned words.
    Tidy,
    /// Rewrites golden files from what the code does now; read the diff before committing it.
    Bless,
    /// Runs every bench suite that needs no world of its own and prints its JSON.
    Bench,
}

fn main() -> ExitCode {
    let root = root();
    let result = match Arguments::parse().habit {
        Habit::Ci { skip_tests } => ci::run(&root, skip_tests),
        Habit::Tidy => tidy::run(&root),
        Habit::Bless => bless(&root),
        Habit::Bench => bench::run(&root),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// The workspace's root: two folders above this package. Where cargo runs it from, not where it was compiled: a copied
/// target folder must not check the tree it was copied from.
fn root() -> PathBuf {
    let package = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
    Path::new(&package).ancestors().nth(2).expect("xtask lies in tools/xtask").to_owned()
}

/// Runs `cargo` with `arguments` at the root and fails where it fails.
fn cargo(root: &Path, arguments: &[&str], environment: &[(&str, &str)]) -> Result<()> {
    println!("cargo {}", arguments.join(" "));
    let status = Command::new(env!("CARGO"))
        .args(arguments)
        .envs(environment.iter().copied())
        .current_dir(root)
        .status()
        .context("cargo could not be started")?;
    if !status.success() {
        bail!("cargo {} failed", arguments.join(" "));
    }
    Ok(())
}

fn bless(root: &Path) -> Result<()> {
    cargo(root, &["test", "--release", "--workspace", "golden"], &[("BLESS", "1")])
}
