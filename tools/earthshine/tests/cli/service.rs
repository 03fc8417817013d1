//! `serve` and `fly` that cannot start: exit codes 5, 6 and 7, with the key, the address and the cure by name.

use crate::command::{ADDRESS, CONFIGURATION, CONNECTION, USAGE, cornell_world, files, run};
use std::net::TcpListener;

#[test]
fn a_configuration_with_an_unknown_key() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    cornell_world(folder.path());
    let path = folder.path().join("mine.toml");
    for (text, words) in [
        ("tick_rate_hz = 30.0\ntick_rat_hz = 60.0\n", ["mine.toml:2", "tick_rat_hz"]),
        ("[engine]\nresident_patches = 9\n", ["mine.toml:2", "resident_patches"]),
        ("tick_rate_hz = \"fast\"\n", ["mine.toml:1", "fast"]),
        ("tick_rate_hz = \n", ["mine.toml:1", "mine.toml"]),
        ("tick_rate_hz = -1.0\n", ["tick_rate_hz = -1", "tick_rate_hz"]),
    ] {
        std::fs::write(&path, text).expect("a scratch folder");
        run(folder.path(), &["serve", "world", "--config", "mine.toml"]).fails(CONFIGURATION, &words);
    }
    run(folder.path(), &["serve", "world", "--config", "yours.toml"]).fails(CONFIGURATION, &["yours.toml"]);
    run(folder.path(), &["serve", "world", "--set", "engine.resident=9"])
        .fails(CONFIGURATION, &["--set engine.resident=9", "resident"]);
}

#[test]
fn a_certificate_that_is_none() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    cornell_world(folder.path());
    std::fs::write(folder.path().join("mine.toml"), "[tls]\ncert = \"mine.toml\"\nkey = \"server.key\"\n")
        .expect("a scratch folder");
    run(folder.path(), &["serve", "world", "--config", "mine.toml"])
        .fails(CONFIGURATION, &["tls.cert", "mine.toml", "no certificate in it"]);
}

#[test]
fn a_port_in_use() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    cornell_world(folder.path());
    let before = files(folder.path());
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = taken.local_addr().expect("an address").to_string();
    let listen = ["serve", "world", "--listen", &address, "--admin-listen", "127.0.0.1:0"];
    run(folder.path(), &listen).fails(ADDRESS, &[&address, "in use", "`listen`"]);
    let admin = ["serve", "world", "--listen", "127.0.0.1:0", "--admin-listen", &address];
    run(folder.path(), &admin).fails(ADDRESS, &[&address, "in use", "`admin_listen`"]);
    assert_eq!(files(folder.path()), before);
}

#[test]
fn nobody_to_fly_to() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    // Bound and let go again: nobody listens there now.
    let gone = TcpListener::bind("127.0.0.1:0").expect("a free port").local_addr().expect("an address");
    let server = format!("http://{gone}");
    run(folder.path(), &["fly", "--server", &server, "--seconds", "1"])
        .fails(CONNECTION, &[&gone.port().to_string()]);
}

#[test]
fn nobody_to_operate() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let gone = TcpListener::bind("127.0.0.1:0").expect("a free port").local_addr().expect("an address");
    let admin = gone.to_string();
    run(folder.path(), &["solver", "hybrid", "--admin", &admin]).fails(CONNECTION, &[&admin, "serve"]);
    run(folder.path(), &["solver", "--set", "samples"]).fails(USAGE, &["KEY=VALUE"]);
    run(folder.path(), &["fly", "--solvers", "hybrid"]).fails(USAGE, &["--out"]);
}

#[test]
fn a_command_that_is_none() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    run(folder.path(), &["bke"]).fails(USAGE, &["bke"]);
    run(folder.path(), &["gen", "village", "village.glb"]).fails(USAGE, &["village"]);
    run(folder.path(), &["bake", "cornell", "world", "--voxel", "-1"]).fails(USAGE, &["-1"]);
    run(folder.path(), &["bake", "cornell", "world", "--rays", "0"]).fails(USAGE, &["rays"]);
    assert!(files(folder.path()).is_empty());
}
