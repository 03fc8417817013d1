//! All the way, as the README tells it: gen, bake, inspect, serve, fly, and a signal at the end.

use crate::command::{files, program, run};
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A server that is stopped by hand, or with the test.
pub(crate) struct Served {
    child: Child,
    uri: String,
    /// Its operators' port, HOST:PORT.
    admin: String,
}

impl Served {
    /// Starts `serve world` on free ports and waits until it says where.
    fn start(folder: &Path) -> Self {
        Self::start_by(program(folder), &[])
    }

    /// As [`Self::start`], by `command` and with more arguments.
    pub(crate) fn start_by(mut command: Command, more: &[&str]) -> Self {
        command.args(["serve", "world", "--listen", "127.0.0.1:0", "--admin-listen", "127.0.0.1:0"]);
        command.args(more);
        let mut child =
            command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts");
        let mut output = BufReader::new(child.stdout.take().expect("a pipe"));
        let mut address = || {
            let mut said = String::new();
            output.read_line(&mut said).expect("a line");
            let uri = said.split_whitespace().find(|word| word.starts_with("http://"));
            uri.unwrap_or_else(|| panic!("no address in {said:?}")).trim_end_matches(',').to_owned()
        };
        let (uri, admin) = (address(), address());
        let admin = admin.trim_start_matches("http://").trim_end_matches("/metrics").to_owned();
        // The pipe stays open: a server whose words nobody hears is another test.
        child.stdout = Some(output.into_inner());
        Self { child, uri, admin }
    }

    /// Sends SIGTERM and waits for the end: exit code and last words.
    pub(crate) fn terminate(mut self) -> (Option<i32>, String) {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).expect("a running process");
        let deadline = Instant::now() + Duration::from_secs(20);
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("a child") {
                break status;
            }
            assert!(Instant::now() < deadline, "the server does not end");
            std::thread::sleep(Duration::from_millis(10));
        };
        let mut errors = String::new();
        self.child.stderr.take().expect("a pipe").read_to_string(&mut errors).expect("text");
        (status.code(), errors)
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

#[test]
fn from_a_seed_to_a_flight() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let here = folder.path();
    let made = run(here, &["gen", "two-rooms", "rooms.glb", "--seed", "3", "--json"]).succeeds().json();
    assert!(made["triangles"].as_u64() > Some(50), "{made}");
    let bake = ["bake", "rooms.glb", "world", "--voxel", "0.75", "--rays", "64", "--detail", "1", "--json"];
    let baked = run(here, &bake).succeeds().json();
    let patches = baked["patches"].as_u64().expect("a count");
    let again = run(here, &bake).succeeds().json();
    assert_eq!((&again["up_to_date"], again["patches"].as_u64()), (&true.into(), Some(patches)));
    let inspected = run(here, &["inspect", "world", "--json"]).succeeds().json();
    assert_eq!(inspected["patches"].as_u64(), Some(patches));
    assert_eq!(run(here, &["inspect", "world", "verify", "--json"]).succeeds().json()["faults"], 0);

    let served = Served::start(here);
    let flown = run(here, &["fly", "--server", &served.uri, "--seconds", "1", "--rate", "30", "--json"])
        .succeeds()
        .json();
    assert!(
        flown["camera_updates"].as_u64() > Some(10) && flown["last_patches"].as_u64() > Some(0),
        "{flown}"
    );
    let by_solvers =
        ["--solvers", "hybrid,gather", "--admin", &served.admin, "--moving-sun", "--pictures", "2"];
    let pictures = ["--scene", "rooms.glb", "--out", "day", "--width", "32", "--height", "24"];
    let short = ["fly", "--server", &served.uri, "--seconds", "1", "--json"];
    let flown = run(here, &[&short[..], &by_solvers, &pictures].concat()).succeeds().json();
    let names = [0, 1].map(|flight| flown["flights"][flight]["solver"].clone());
    assert_eq!(names, ["hybrid", "gather"], "{flown}");
    assert!(std::fs::read(here.join("day/animation.gif")).expect("an animation").starts_with(b"GIF89a"));
    assert!(here.join("day/strip.png").is_file());
    let after = run(here, &["solver", "--admin", &served.admin]).succeeds().output;
    assert!(after.contains("by_level = []"), "put back: {after}");
    let (code, last_words) = served.terminate();
    assert_eq!(code, Some(0), "{last_words}");
    assert!(!last_words.contains("panicked"), "{last_words}");
}

/// Goal: a bake's bytes know nothing of where they were made. Method: the same scene under two names and paths, from
/// two working folders, by relative and by absolute paths; only the scene's name in the manifest may differ.
#[test]
fn paths_and_working_folders_do_not_reach_the_bytes() {
    let [near, far] = [(); 2].map(|()| tempfile::tempdir().expect("a scratch folder"));
    std::fs::create_dir_all(far.path().join("deep/down")).expect("a scratch folder");
    run(near.path(), &["gen", "cornell", "box.glb", "--quiet"]).succeeds();
    std::fs::copy(near.path().join("box.glb"), far.path().join("deep/Other Name.glb")).expect("a copy");
    let quality = ["--voxel", "0.4", "--rays", "48", "--detail", "1", "--quiet"];
    run(near.path(), &[&["bake", "box.glb", "world"][..], &quality].concat()).succeeds();
    let absolute = far.path().join("elsewhere/a world");
    let absolute = absolute.to_str().expect("a plain path");
    let arguments = [&["bake", "../Other Name.glb", absolute][..], &quality].concat();
    run(&far.path().join("deep/down"), &arguments).succeeds();

    let [mut near, mut far] = [files(&near.path().join("world")), files(Path::new(absolute))];
    let scene = |world: &mut std::collections::BTreeMap<String, Vec<u8>>, name: &str| {
        let manifest = world.remove("world.toml").expect("a manifest");
        let manifest = String::from_utf8(manifest).expect("text");
        let line = format!("scene = \"{name}\"");
        assert!(manifest.contains(&line), "{manifest}");
        manifest.replace(&line, "")
    };
    assert_eq!(scene(&mut near, "box.glb"), scene(&mut far, "Other Name.glb"));
    assert!(near.len() > 1 && near == far, "{:?} and {:?}", near.keys(), far.keys());
}
