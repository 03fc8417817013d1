//! What no compiler checks: headers, lengths, words, the import table.

use crate::imports;
use anyhow::{Result, bail};
use std::path::{Path, PathBuf};

/// No source file is longer; a file is one subject.
const LINES_MAX: usize = 500;

/// Words that must not stand in sources, and why. Split so that this file does not accuse itself.
const BANNED: &[(&str, &str, &str)] = &[
    ("keep in ", "sync", "write the test that holds it instead"),
    ("must match ", "the", "write the test that holds it instead"),
    ("FIX", "ME", "open an issue and name it, or mend it"),
    ("todo", "!(", "finish it"),
];

/// Fails with every fault found.
pub(crate) fn run(root: &Path) -> Result<()> {
    let faults = faults(root)?;
    if faults.is_empty() {
        println!("tidy: nothing to mend");
        return Ok(());
    }
    for fault in &faults {
        eprintln!("{fault}");
    }
    bail!("{} things to tidy", faults.len())
}

fn faults(root: &Path) -> Result<Vec<String>> {
    let mut faults = imports::faults(root)?;
    for folder in ["server", "client-lib", "shaders", "tools", "tests"] {
        for path in sources(&root.join(folder))? {
            let text = std::fs::read_to_string(&path)?;
            let name = path.strip_prefix(root).unwrap_or(&path).display().to_string();
            faults.extend(source_faults(&name, &text));
        }
    }
    faults.extend(clippy_faults(root)?);
    Ok(faults)
}

fn source_faults(name: &str, text: &str) -> Vec<String> {
    let mut faults = Vec::new();
    let is_rust = name.ends_with(".rs");
    if is_rust && !text.starts_with("//!") {
        faults.push(format!("{name}: does not start with //! (what it is, what it is not, where to start)"));
    }
    let lines = text.lines().count();
    if lines > LINES_MAX {
        faults.push(format!("{name}: {lines} lines, more than {LINES_MAX}: does it still have one subject?"));
    }
    for (number, line) in text.lines().enumerate() {
        for (first, second, cure) in BANNED {
            if line.contains(&format!("{first}{second}")) {
                faults.push(format!("{name}:{}: \"{first}{second}\": {cure}", number + 1));
            }
        }
    }
    faults
}

/// A nested clippy.toml replaces the root's: each must repeat the root's bans.
fn clippy_faults(root: &Path) -> Result<Vec<String>> {
    let read = |path: PathBuf| -> Result<Option<toml::Table>> {
        match std::fs::read_to_string(&path) {
            Ok(text) => Ok(Some(text.parse()?)),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error.into()),
        }
    };
    let bans = |table: &toml::Table| -> Vec<String> {
        let methods = table.get("disallowed-methods").and_then(toml::Value::as_array);
        methods.into_iter().flatten().map(|ban| ban["path"].to_string()).collect()
    };
    let common = bans(&read(root.join("clippy.toml"))?.unwrap_or_default());
    let mut faults = Vec::new();
    for folder in ["server/world", "server/radiosity", "server/engine"] {
        let Some(nested) = read(root.join(folder).join("clippy.toml"))? else { continue };
        let nested = bans(&nested);
        for ban in common.iter().filter(|ban| !nested.contains(ban)) {
            faults.push(format!("{folder}/clippy.toml lacks the root's ban of {ban}"));
        }
    }
    Ok(faults)
}

fn sources(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder)? {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs" || e == "wgsl" || e == "proto") {
                found.push(path);
            }
        }
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_repository_is_tidy() {
        let faults = faults(&crate::root()).expect("readable sources");
        assert!(faults.is_empty(), "{faults:#?}");
    }

    #[test]
    fn a_bare_file_and_a_long_one_are_found() {
        assert_eq!(source_faults("a.rs", "fn main() {}").len(), 1);
        assert_eq!(source_faults("a.wgsl", &"\n".repeat(LINES_MAX + 1)).len(), 1);
    }
}
