//! A disk that fills up in the middle of a bake: exit code 8, the cure, no half world; with room the same command
//! finishes.
//!
//! Two ways to a full disk: a tmpfs in a mount namespace of our own, and a limit on the size of files. Where the system
//! allows neither, the test says so.

use crate::command::{PROGRAM, Run, STORAGE, run};
use std::io::Write as _;
use std::path::Path;
use std::process::Command;

/// More than enough for the world that is baked here.
const ROOM_KIB: u32 = 32_768;

/// Bakes with too little room, shows what is left behind, makes room, bakes again and verifies.
///
/// `$1` is the program, `$2` the folder; `fill` and `free` are what makes and ends the shortage. All stages of a bake, by few rays: it is
/// baked twice a disk.
fn script(fill: &str, free: &str) -> String {
    let few = "--rays 64 --detail-rays 32 --detail-columns 16 --receiver-rays 64 --samples-per-face 16 --points-per-patch 16";
    let bake = format!(r#""$1" bake cornell "$2/world" --voxel 0.15 {few} --quiet"#);
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

/// Whether the bake ran out of room; if it did, all that is promised of that.
#[track_caller]
fn ran_out(run: &Run) -> bool {
    let said = |words: &str| run.errors.contains(words);
    assert!(said("again 0") && said("verified 0"), "with room it is finished: {run:?}");
    assert!(!said("panicked") && !said("half-written"), "{run:?}");
    if said("code 0") {
        return false;
    }
    assert!(said(&format!("code {STORAGE}")), "{run:?}");
    assert!(said("error: ") && said("free some space and run the same command again"), "{run:?}");
    assert!(!said("left world.toml"), "no manifest before the world is whole: {run:?}");
    true
}

/// Goal: at whatever point the room ends, the bake ends well. Method: disks of growing size until one is large enough;
/// the smallest ends while rows are traced, the largest while tiles are written.
#[test]
fn a_full_disk_stops_a_bake_and_leaves_no_half_world() {
    let namespace = ["unshare", "--user", "--map-root-user", "--mount", "sh"];
    let mut kibibytes = 160;
    let mut shortages = 0;
    while kibibytes < ROOM_KIB {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let mount = format!(r#"mount -t tmpfs -o size={kibibytes}k none "$2""#);
        let script = script(&mount, &format!(r#"mount -o remount,size={ROOM_KIB}k "$2""#));
        let Some(ended) = attempt(&namespace, &script, folder.path()) else { break };
        if !ran_out(&ended) {
            break;
        }
        shortages += 1;
        kibibytes += kibibytes / 4;
    }
    // Blocks of 512 bytes or a KiB, as the shell has it; only the soft limit, so that it can be lifted again.
    let script = script("trap '' XFSZ; ulimit -S -f 40", "ulimit -S -f unlimited");
    let folder = tempfile::tempdir().expect("a scratch folder");
    if let Some(ended) = attempt(&["sh"], &script, folder.path()) {
        assert!(ran_out(&ended), "{ended:?}");
        shortages += 1;
    }
    if shortages == 0 {
        let line =
            "SKIPPED a full disk: neither a small tmpfs nor a limit on the size of files can be had here";
        // Past the test harness, which swallows what passing tests print.
        writeln!(std::io::stderr(), "{line}").expect("standard error");
    }
}

#[test]
fn a_folder_that_cannot_be_made() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    std::fs::write(folder.path().join("file"), "").expect("a scratch folder");
    run(folder.path(), &["bake", "cornell", "file/world", "--voxel", "0.5", "--rays", "16", "--quiet"])
        .fails(STORAGE, &["file/world"]);
}
