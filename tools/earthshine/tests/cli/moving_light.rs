//! Tables, solvers and moving light: `bench alias`, `bench temporal`, `render --animation`, `serve --solver`.

use crate::command::{CONFIGURATION, USAGE, cornell_world, run};

fn desk() -> tempfile::TempDir {
    let desk = tempfile::tempdir().expect("a scratch folder");
    cornell_world(desk.path());
    desk
}

#[test]
fn tables_are_measured_on_a_worlds_rows() {
    let desk = desk();
    let small = ["bench", "alias", "--world", "world", "--rows", "64", "--items", "100", "--plot", "error"];
    let found = run(desk.path(), &[&small[..], &["--json"]].concat()).succeeds().json();
    assert!(found["build_mitems_s_core"].as_f64() > Some(1.0), "{found}");
    assert!(found["max_mass_error_bins"].as_f64().is_some_and(|error| error < 0.04), "{found}");
    let errors = |kind: &str| {
        let errors = found["rmse_by_k"][kind].as_array().expect("errors by k").clone();
        errors.iter().map(|error| error.as_f64().expect("a number")).collect::<Vec<_>>()
    };
    for kind in ["alias", "alias_systematic", "cdf_systematic"] {
        // From one draw to 128 the error falls by more than five.
        let errors = errors(kind);
        assert!(errors.len() == 8 && errors[7] < 0.2 * errors[0], "{kind}: {errors:?}");
    }
    let waste = found["rebuild_waste"]["wasted_share"].as_f64();
    assert!(waste.is_some_and(|share| (0.0..1.0).contains(&share)), "{found}");
    assert!(desk.path().join("error.svg").is_file() && desk.path().join("error.png").is_file());
}

#[test]
fn solvers_are_measured_on_a_step_of_light() {
    let desk = desk();
    let base = ["bench", "temporal", "--world", "world", "--frames", "400"];
    let with = |more: &[&str]| run(desk.path(), &[&base[..], more].concat());
    let found =
        with(&["--solver", "hybrid,progressive,gather", "--json", "--plot", "step"]).succeeds().json();
    assert_eq!((&found["solver"], &found["k"]), (&"hybrid".into(), &32.into()), "{found}");
    assert!(found["frames_to_90"].as_u64().is_some_and(|frames| frames <= 6), "{found}");
    assert!(found["steady_rel_rmse"].as_f64().is_some_and(|error| error < 0.01), "{found}");
    assert!(found["ns_per_patch_frame"].as_f64() > Some(0.0), "{found}");
    assert!(found["speedup_over_dense"].as_f64() > Some(0.0), "{found}");
    assert_eq!(found["solvers"].as_array().map(Vec::len), Some(3));
    assert!(desk.path().join("step.svg").is_file());
    // Rows are drawn by shares, and a lamp is a small share of much light: it takes more draws than elsewhere.
    let coloured = ["--solver", "alias", "--multibounce", "--history-weight", "0", "--k", "128", "--json"];
    let found = with(&coloured).succeeds().json();
    assert_eq!(found["drawn_rows"], "multibounce", "{found}");
    assert!(found["steady_rel_rmse"].as_f64().is_some_and(|error| error < 1.0), "{found}");
    let table = with(&["--solver", "cdf", "--adaptive"]).succeeds().output;
    assert!(table.contains("to 90 %") && table.contains("cdf"), "{table}");
    with(&["--solver", "magic"]).fails(USAGE, &["magic", "progressive"]);
    with(&["--k", "0"]).fails(USAGE, &["samples_per_row is 0"]);
    with(&["--history-weight", "1"]).fails(USAGE, &["history_weight is 1"]);
}

#[test]
fn moving_light_is_drawn_by_solvers_side_by_side() {
    let desk = desk();
    let base = ["render", "cornell", "--width", "48", "--height", "32", "--samples", "1", "--out", "moving"];
    let with = |more: &[&str]| run(desk.path(), &[&base[..], more].concat());
    for animation in ["sun", "switch", "lamp"] {
        let short = ["--animation", animation, "--frames", "6", "--picture-every", "3"];
        let given = [&short[..], &["--world", "world", "--json"]].concat();
        let found = with(&given).succeeds().json();
        assert_eq!((&found["pictures"], &found["solvers"][1]), (&2.into(), &"alias".into()), "{found}");
        let gif = std::fs::read(desk.path().join("moving/animation.gif")).expect("an animation");
        assert!(gif.starts_with(b"GIF89a") && gif.len() > 1000);
        assert!(desk.path().join("moving/strip.png").is_file());
    }
    with(&["--animation", "sun"]).fails(USAGE, &["--animation needs --world"]);
    with(&["--world", "world", "--solvers", "cdf"]).fails(USAGE, &["need --animation"]);
    with(&["--world", "world", "--animation", "sun", "--solvers", "magic"]).fails(USAGE, &["magic"]);
    with(&["--world", "world", "--animation", "sun", "--exr"]).fails(USAGE, &["leave --exr and --view out"]);
    with(&["--world", "world", "--animation", "lamp", "--sun-path", "day.toml"])
        .fails(USAGE, &["--sun-path needs --animation sun"]);
}

#[test]
fn a_service_refuses_solvers_that_cannot_be() {
    let desk = desk();
    let with = |more: &[&str]| run(desk.path(), &[&["serve", "world"][..], more].concat());
    with(&["--solver", "magic"]).fails(USAGE, &["magic", "hybrid"]);
    with(&["--set", "engine.solver.samples_per_row=0"])
        .fails(CONFIGURATION, &["solver.samples_per_row", "between 1 and 4096"]);
    with(&["--set", "engine.solver.history_weight=1"])
        .fails(CONFIGURATION, &["solver.history_weight", "below 1"]);
    with(&["--set", "engine.solver.by_level=3"]).fails(CONFIGURATION, &["by_level"]);
}
