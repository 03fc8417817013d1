//! Who may import whom: the table in ARCHITECTURE.md, held against the manifests.

use anyhow::{Context as _, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Package name without its prefix to the packages of ours that it may use.
type Table = BTreeMap<String, BTreeSet<String>>;

/// Sentences about every package whose manifest and row in the table differ.
pub(crate) fn faults(root: &Path) -> Result<Vec<String>> {
    let architecture = std::fs::read_to_string(root.join("ARCHITECTURE.md")).context("ARCHITECTURE.md")?;
    let allowed = table(&architecture);
    let mut faults = Vec::new();
    for (package, manifest) in manifests(root)? {
        let Some(allowed) = allowed.get(&package) else {
            faults.push(format!("{package} has no row in ARCHITECTURE.md's import table"));
            continue;
        };
        let used = ours(&manifest, "dependencies");
        for extra in used.difference(allowed) {
            faults.push(format!(
                "{package} imports {extra}, which ARCHITECTURE.md's import table does not allow"
            ));
        }
        for missing in allowed.difference(&used) {
            faults.push(format!("{package} may import {missing} but does not: take it out of the table"));
        }
        faults.extend(foreign_faults(&package, &manifest));
    }
    Ok(faults)
}

/// Crates that only some packages may name, and those packages.
const RESERVED: &[(&str, &[&str])] = &[
    ("wgpu", &["gpu"]),
    ("tokio", &["server", "client", "fly", "cli", "tests"]),
    ("memmap2", &["tiles"]),
    ("zstd", &["tiles"]),
    ("gltf", &["scene"]),
    ("tonic", &["protocol", "client", "server", "tests"]),
];

fn foreign_faults(package: &str, manifest: &toml::Table) -> Vec<String> {
    let names = manifest.get("dependencies").and_then(toml::Value::as_table);
    RESERVED
        .iter()
        .filter(|(reserved, users)| {
            names.is_some_and(|names| names.contains_key(*reserved)) && !users.contains(&package)
        })
        .map(|(reserved, users)| format!("{package} names {reserved}, which belongs to {users:?}"))
        .collect()
}

/// Rows `| package | folder | imports |` of the table that follows the heading "Who may import whom".
fn table(architecture: &str) -> Table {
    architecture
        .lines()
        .skip_while(|line| !line.contains("Who may import whom"))
        .skip(1)
        .take_while(|line| !line.starts_with('#'))
        .filter_map(|line| {
            let cells: Vec<&str> = line.trim().trim_matches('|').split('|').map(str::trim).collect();
            let [package, _folder, imports] = cells.try_into().ok()?;
            let imports = imports.split([',', ' ']).filter(|word| !word.is_empty() && *word != "-");
            Some((package.to_owned(), imports.map(str::to_owned).collect()))
        })
        .collect()
}

/// Every member's manifest by short package name; the command itself is `cli`.
fn manifests(root: &Path) -> Result<Vec<(String, toml::Table)>> {
    let workspace: toml::Table = std::fs::read_to_string(root.join("Cargo.toml"))?.parse()?;
    let members = workspace["workspace"]["members"].as_array().context("workspace.members is a list")?;
    members
        .iter()
        .filter_map(toml::Value::as_str)
        .map(|member| {
            let path = root.join(member).join("Cargo.toml");
            let manifest: toml::Table =
                std::fs::read_to_string(&path).with_context(|| path.display().to_string())?.parse()?;
            let name = manifest["package"]["name"].as_str().context("package.name is a string")?;
            Ok((short(name), manifest))
        })
        .collect()
}

fn short(name: &str) -> String {
    name.strip_prefix("earthshine-").unwrap_or("cli").to_owned()
}

fn ours(manifest: &toml::Table, section: &str) -> BTreeSet<String> {
    manifest
        .get(section)
        .and_then(toml::Value::as_table)
        .map(|names| {
            names.keys().filter(|name| name.starts_with("earthshine-")).map(|name| short(name)).collect()
        })
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manifests_agree_with_the_table() {
        let faults = faults(&crate::root()).expect("readable manifests");
        assert!(faults.is_empty(), "{faults:#?}");
    }

    #[test]
    fn rows_are_read_up_to_the_next_heading() {
        let text = "## Who may import whom\n| a | x/a | - |\n| b | x/b | a, c |\n## Next\n| d | x | a |";
        let table = table(text);
        assert_eq!(table.len(), 2);
        assert!(table["a"].is_empty() && table["b"].contains("c"));
    }
}
