//! A disk that fills up while a tile is written: an error with its cure, and nothing left behind.
//!
//! The writing happens in a child process, in a mount namespace with a tmpfs of 64 KiB; where that is
//! not allowed, under a limit on the size of files. Where neither works the test says so and does nothing.

use earthshine_tiles::{TileError, write_atomic};
use std::path::Path;
use std::process::{Command, Output};

const FOLDER: &str = "EARTHSHINE_TEST_SMALL_DISK";

#[test]
fn a_full_disk_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let tmpfs =
        "mount -t tmpfs -o size=64k none \"$1\" || exit 77; exec \"$0\" --exact --ignored child --nocapture";
    let limit = "trap '' XFSZ; ulimit -f 64 || exit 77; exec \"$0\" --exact --ignored child --nocapture";
    let mut namespace = Command::new("unshare");
    namespace.args(["--user", "--map-root-user", "--mount", "sh", "-c", tmpfs]);
    let mut limited = Command::new("sh");
    limited.args(["-c", limit]);
    for command in [&mut namespace, &mut limited] {
        let run = command.arg(std::env::current_exe().unwrap()).arg(folder.path()).env(FOLDER, folder.path());
        let Ok(Output { status, stdout, stderr }) = run.output() else { continue };
        let said = format!("{}{}", String::from_utf8_lossy(&stdout), String::from_utf8_lossy(&stderr));
        if said.contains("child: wrote until the disk was full") {
            assert!(status.success(), "{said}");
            return;
        }
        assert!(!said.contains("panicked"), "{said}");
    }
    println!("SKIPPED: neither a small tmpfs nor a file size limit can be had here");
}

#[test]
#[ignore = "runs as the child of the test above"]
fn child() {
    let Some(folder) = std::env::var_os(FOLDER) else { return };
    let folder = Path::new(&folder);
    let kept = folder.join("kept.tile");
    write_atomic(&kept, &[1; 9000]).unwrap();
    for path in [kept.clone(), folder.join("new.tile")] {
        let error = write_atomic(&path, &vec![2; 1 << 20]).expect_err("a MiB on a disk of 64 KiB");
        assert!(matches!(error, TileError::Io { action: "write", .. }), "{error}");
        assert!(error.to_string().contains("free some space"), "{error}");
    }
    assert_eq!(std::fs::read(&kept).unwrap(), [1; 9000], "the old file is whole");
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 1, "no temporary file stays");
    write_atomic(&folder.join("small.tile"), &[3; 9000]).expect("there is room again");
    println!("child: wrote until the disk was full");
}
