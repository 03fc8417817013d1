//! A disk that fills up in the middle of a bake: exit code 8, the cure, no half world; with room the same command
//! finishes.
//!
//! Two ways to a full disk: a tmpfs in a mount namespace of our own, and a limit on the size of files. Where the system
//! allows neither, the test says so.

use crate::command::{PROGRAM, Run, STORAGE, run};
use std::io::Write as _;
use std::path::Path;
use std::process::Command;

/// Bakes with too little room, shows what is left behind, makes room, bakes again and verifies.
///
/// `$1` is the program, `$2` the folder; `fill` and `free` are what makes and ends the shortage.
fn script(fill: &str, free: &str) -> String {
    let bake = r#""$1" bake cornell "$2/world" --voxel 0.15 --rays 64 --quiet"#;
    format!(
        r#"{fill} || exit 77
echo "shortage" >&2
{bake}; echo "code $?" >&2
ls -A "$2/world" | sed 's/^/left /' >&2
find "$2" -name '*.temp' | sed 's/^/half-written /' >&2
{free} || exit 78
{bake}; echo "again $?" >&2
"$1" inspect "$2/world" verify; echo "verified $?" >&2"#
    )
}

/// Runs `script` with `shell`; `None` where the system does not allow it.
fn attempt(shell: &[&str], script: &str, folder: &Path) -> Option<Run> {
    let mut command = Command::new(shell[0]);
    command.args(&shell[1..]).args(["-c", script, "sh", PROGRAM]).arg(folder);
    let ended = Run::of(&command.output().ok()?);
    ended.errors.contains("shortage").then_some(ended)
}

#[track_caller]
fn assert_survived(run: &Run) {
    let said = |words: &str| run.errors.contains(words);
    assert!(said(&format!("code {STORAGE}")), "{run:?}");
    assert!(said("error: ") && said("free some space and run the same command again"), "{run:?}");
    assert!(!said("panicked") && !said("half-written"), "{run:?}");
    assert!(!said("left world.toml"), "no manifest before the world is whole: {run:?}");
    assert!(said("again 0") && said("verified 0"), "{run:?}");
}

#[test]
fn a_full_disk_stops_a_bake_and_leaves_no_half_world() {
    let mut tried = 0;
    let tmpfs = script(
        r#"mount -t tmpfs -o size=160k none "$2""#,
        r#"mount -o remount,size=32m "$2""#,
    );
    let namespace = ["unshare", "--user", "--map-root-user", "--mount", "sh"];
    // A limit on one file instead of on all of them; the shell that sets it cannot lift it, so a subshell does.
    let limit = script(r#"trap '' XFSZ; (ulimit -S -f 40)"#, "ulimit -S -f unlimited")
        .replacen("echo \"shortage\"", "ulimit -S -f 40; echo \"shortage\"", 1);
    for (shell, script) in [(&namespace[..], tmpfs), (&["sh"][..], limit)] {
        let folder = tempfile::tempdir().expect("a scratch folder");
        if let Some(ended) = attempt(shell, &script, folder.path()) {
            assert_survived(&ended);
            tried += 1;
        }
    }
    if tried == 0 {
        let line = "SKIPPED a full disk: neither a small tmpfs nor a limit on the size of files can be had here";
        // Past the test harness, which swallows what passing tests print.
        writeln!(std::io::stderr(), "{line}").expect("standard error");
    }
}

/// A pipe that nobody reads any more is no fault of the world.
#[test]
fn a_bake_that_cannot_even_make_its_folder() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    std::fs::write(folder.path().join("file"), "").expect("a scratch folder");
    run(folder.path(), &["bake", "cornell", "file/world", "--voxel", "0.5", "--rays", "16", "--quiet"])
        .fails(STORAGE, &["file/world"]);
}
