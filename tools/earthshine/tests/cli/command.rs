//! Running the program: its exit code and its words.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

/// As documented by `earthshine --help`.
pub(crate) const OTHER: i32 = 1;
pub(crate) const USAGE: i32 = 2;
pub(crate) const INPUT: i32 = 3;
pub(crate) const WORLD: i32 = 4;
pub(crate) const CONFIGURATION: i32 = 5;
pub(crate) const ADDRESS: i32 = 6;
pub(crate) const CONNECTION: i32 = 7;
pub(crate) const STORAGE: i32 = 8;
pub(crate) const FAULTS: i32 = 9;

/// Where the program is.
pub(crate) const PROGRAM: &str = env!("CARGO_BIN_EXE_earthshine");

/// How a run ended.
#[derive(Debug)]
pub(crate) struct Run {
    pub(crate) code: Option<i32>,
    pub(crate) output: String,
    pub(crate) errors: String,
}

/// The program in `folder`, with an environment that sets nothing for it.
pub(crate) fn program(folder: &Path) -> Command {
    let mut command = Command::new(PROGRAM);
    command.current_dir(folder);
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("EARTHSHINE_") {
            command.env_remove(name);
        }
    }
    command
}

/// Runs the program in `folder` to its end.
pub(crate) fn run(folder: &Path, arguments: &[&str]) -> Run {
    Run::of(&program(folder).args(arguments).output().expect("the program starts"))
}

impl Run {
    pub(crate) fn of(output: &Output) -> Self {
        Self {
            code: output.status.code(),
            output: String::from_utf8_lossy(&output.stdout).into_owned(),
            errors: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }

    /// It did what it was asked for.
    #[track_caller]
    pub(crate) fn succeeds(self) -> Self {
        assert_eq!(self.code, Some(0), "{self:?}");
        self
    }

    /// It refused with `code`, in words that hold all of `words`, and did not panic.
    #[track_caller]
    pub(crate) fn fails(self, code: i32, words: &[&str]) -> Self {
        assert_eq!(self.code, Some(code), "{self:?}");
        assert!(self.errors.contains("error: "), "{self:?}");
        assert!(!self.errors.contains("panicked") && !self.errors.contains("RUST_BACKTRACE"), "{self:?}");
        for word in words {
            assert!(self.errors.contains(word), "{word:?} is not in {self:?}");
        }
        self
    }

    pub(crate) fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.output).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }
}

/// A bake that takes a moment.
pub(crate) fn bake<'a>(scene: &'a str, world: &'a str) -> [&'a str; 11] {
    ["bake", scene, world, "--voxel", "0.5", "--rays", "32", "--detail", "1", "--quiet", "--overwrite"]
}

/// A scratch folder of a test, gone at its end.
pub(crate) fn desk() -> tempfile::TempDir {
    tempfile::tempdir().expect("a scratch folder")
}

/// A small sound world called `world` in `folder`: a Cornell box.
pub(crate) fn cornell_world(folder: &Path) {
    let coarse = ["--voxel", "0.5", "--rays", "32", "--chunk-voxels", "4", "--detail", "1", "--quiet"];
    run(folder, &[&["bake", "cornell", "world"][..], &coarse].concat()).succeeds();
}

/// Everything in a folder: name from there to bytes.
pub(crate) fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inner) = folders.pop() {
        for entry in std::fs::read_dir(&inner).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).expect("inside").display().to_string();
                found.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    found
}
