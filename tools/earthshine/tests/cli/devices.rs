//! Graphics adapters: `gpu` lists them, `bench gpu` measures one, and what happens where there is none.

use crate::command::{CONFIGURATION, OTHER, Run, USAGE, cornell_world, program, run};
use crate::main_path::Served;
use serde_json::Value;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;

/// An adapter of this machine, one that computes on the CPU if there is any; or none with the reason printed. None is a
/// failure where CI says so.
fn adapter_or_skip(folder: &Path) -> Option<Value> {
    let listing = run(folder, &["gpu", "--json"]).succeeds().json();
    let adapters = listing["adapters"].as_array().expect("a list");
    let usable = || adapters.iter().filter(|adapter| adapter["unusable"].is_null());
    let found = usable().find(|adapter| adapter["kind"] == "software").or_else(|| usable().next());
    if found.is_none() {
        assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "{listing}");
        writeln!(std::io::stderr(), "SKIPPED a test of `bench gpu`: there is no graphics adapter")
            .expect("standard error");
    }
    found.cloned()
}

/// The program where no driver is found.
fn without_drivers(folder: &Path) -> Command {
    let mut command = program(folder);
    for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        command.env(name, "/nonexistent");
    }
    command.env("WGPU_BACKEND", "vulkan");
    command
}

fn run_without_drivers(folder: &Path, arguments: &[&str]) -> Run {
    let output = without_drivers(folder).args(arguments).output().expect("the program starts");
    Run::of(&output)
}

#[track_caller]
fn positive(of: &Value, key: &str) -> f64 {
    let found = of[key].as_f64().unwrap_or_else(|| panic!("{key} is no number in {of}"));
    assert!(found.is_finite() && found > 0.0, "{key} is {found}");
    found
}

/// Goal: one command prints every figure that is asked of a device, and none of a device that computes something else.
/// Method: tiny sizes; all keys are there, light is the CPU's.
#[test]
fn a_device_is_measured_and_every_figure_printed() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let Some(adapter) = adapter_or_skip(folder.path()) else { return };
    let name = adapter["name"].as_str().expect("a name");
    let tiny = "--block-m 64 --product-m 96 --rows 8 --items 300 --patches 300 --links 20 --k 8 --rays 4096 --town 60 \
                --lit-patches 200 --points 2 --lights 2 --rebuilt-rows 4 --receivers 100 --receiver-columns 16 \
                --news-frames 4 --rounds 2 --json";
    let arguments: Vec<&str> =
        ["bench", "gpu", "--adapter", name].into_iter().chain(tiny.split(' ')).collect();
    let figures = run(folder.path(), &arguments).succeeds().json();
    for (key, expected) in [("suite", "gpu"), ("backend", "gpu"), ("solver", "matrix"), ("adapter", name)] {
        assert_eq!(figures[key], expected, "{key}");
    }
    for key in ["scene", "version", "machine"] {
        assert!(!figures[key].is_null(), "{key}");
    }
    for (key, expected) in [("seed", 1), ("block_m", 64), ("product_m", 96), ("rows", 8), ("items", 300)] {
        assert_eq!(figures[key].as_u64(), Some(expected), "{key}");
    }
    for key in [
        "seconds",
        "step_ms",
        "alias_step_ms",
        "cdf_build_ms",
        "alias_gitems_s",
        "block_patch_us",
        "product_ms",
        "product_gb_s",
        "copy_gb_s",
        "product_share_of_copy",
        "frame_ms",
        "direct_ms",
        "gather_ms",
        "mrays_s",
        "cpu_mrays_s",
        "open_ms",
        "vram_bytes",
    ] {
        positive(&figures, key);
    }
    let worse = positive(&figures, "add_patch_us").max(positive(&figures, "remove_patch_us"));
    assert_eq!(positive(&figures, "block_patch_us"), worse);
    if adapter["has_timestamps"] == true {
        positive(&figures, "add_patch_device_us");
        positive(&figures, "remove_patch_device_us");
    }
    for (key, most) in [
        ("irradiance_error_rel", 1e-4),
        ("product_drift_rel", 1e-4),
        ("gather_error_rel", 1e-4),
        // A shadow ray along an edge may pass it the other way.
        ("direct_error_rel", 2e-2),
        ("rays_elsewhere", 2e-3),
    ] {
        let error = figures[key].as_f64().unwrap_or_else(|| panic!("{key} is no number in {figures}"));
        assert!((0.0..most).contains(&error), "{key} is {error}");
    }
    // Other light comes back, light at rest does not.
    assert!(positive(&figures, "gather_changed_bytes") > 10.0 * positive(&figures, "gather_settled_bytes"));
    check_passes(&figures, adapter["has_timestamps"] == true);
}

/// Goal: a whole bake on a device is measured beside the CPU's, and finds as much. That it finds the same is held by the tests
/// of `ray_device.rs`.
#[test]
fn a_bake_on_a_device_is_measured_beside_the_cpu_s() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let Some(adapter) = adapter_or_skip(folder.path()) else { return };
    let name = adapter["name"].as_str().expect("a name");
    let bake =
        ["bench", "bake", "--scene", "cornell", "--voxel", "0.5", "--rays", "64", "--detail", "1", "--json"];
    let figures =
        run(folder.path(), &[&bake[..], &["--gpu", "--gpu-adapter", name]].concat()).succeeds().json();
    assert_eq!((&figures["backend"], &figures["adapter"]), (&"gpu".into(), &name.into()));
    for key in
        ["patches", "nonzeros", "rays", "device_rays", "mrays_s", "cpu_mrays_s", "cpu_seconds", "world_bytes"]
    {
        positive(&figures, key);
    }
    assert!(figures["device_failure"].is_null(), "{figures}");
    let off = figures["nonzeros_off_rel"].as_f64().expect("a share");
    assert!(off < 0.01, "{off}");
    let alone = run(folder.path(), &bake).succeeds().json();
    assert!(alone["backend"] == "cpu" && alone["cpu_seconds"].is_null(), "{alone}");
    run(folder.path(), &[&bake[..], &["--gpu-adapter", name]].concat()).fails(USAGE, &["--gpu"]);
}

/// Where a device has timestamps, every pass that a figure stands for is listed with what it moves, or why that is unknown.
fn check_passes(figures: &Value, has_timestamps: bool) {
    assert_eq!(figures["has_timestamps"], has_timestamps);
    let passes = figures["passes"].as_array().expect("a list");
    if !has_timestamps {
        assert!(passes.is_empty(), "{passes:?}");
        return;
    }
    for pass in passes {
        positive(pass, "ms");
        let is_known = pass["unknown"].is_null();
        assert!(is_known == pass["bytes"].is_f64() && is_known == pass["flops"].is_f64(), "{pass}");
    }
    let names: Vec<&str> = passes.iter().filter_map(|pass| pass["name"].as_str()).collect();
    for name in [
        "copy",
        "multiply_tiles",
        "sum_tiles",
        "rank_update",
        "gather_columns",
        "solve_block",
        "build_alias",
        "build_cdf",
        "draw_alias",
        "draw_cdf",
        "trace_closest",
        "light_points",
        "gather_receivers",
    ] {
        assert!(names.contains(&name), "{name} is not among {names:?}");
    }
}

#[test]
fn adapters_are_listed_with_what_fits() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let listing = run(folder.path(), &["gpu", "--json"]).succeeds().json();
    let sizes: Vec<f64> = listing["memory"]
        .as_array()
        .expect("a table")
        .iter()
        .map(|of| positive(of, "device_bytes") / positive(of, "slots").powi(2))
        .collect();
    assert!(sizes.len() >= 4 && sizes.iter().all(|of| (8.0..13.0).contains(of)), "{sizes:?}");
    for key in ["receiver_bytes_max", "tree_triangle_bytes", "tree_node_bytes"] {
        positive(&listing, key);
    }
    let rows = listing["memory"][0]["row_bytes"].as_u64().expect("bytes");
    assert!((1 << 20..64 << 20).contains(&rows), "{rows}");
    let Some(adapter) = adapter_or_skip(folder.path()) else { return };
    for key in ["binding_bytes_max", "buffer_bytes_max", "slots_unsplit_max", "slots_max", "open_ms"] {
        positive(&adapter, key);
    }
    for key in ["name", "driver", "api", "kind"] {
        assert!(adapter[key].is_string(), "{key} of {adapter}");
    }
    let told = run(folder.path(), &["gpu"]).succeeds().output;
    assert!(told.contains(adapter["name"].as_str().expect("a name")) && told.contains("patches"), "{told}");
    let lacking = run(folder.path(), &["bench", "gpu", "--adapter", "an adapter that nobody has"]);
    lacking.fails(OTHER, &["an adapter that nobody has", "earthshine gpu"]);
}

/// Goal: no driver is no error of who lists, a refusal with a cure of who asks for a device, and the CPU for who leaves it
/// open, said once.
#[test]
fn where_there_is_no_driver_the_cpu_computes_or_it_is_said() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let here = folder.path();
    cornell_world(here);
    let listed = run_without_drivers(here, &["gpu"]).succeeds().output;
    assert!(listed.contains("no graphics adapter"), "{listed}");
    let listing = run_without_drivers(here, &["gpu", "--json"]).succeeds().json();
    assert_eq!(listing["adapters"].as_array().map(Vec::len), Some(0), "{listing}");
    let cure = ["no graphics adapter", "Vulkan", "cpu"];
    run_without_drivers(here, &["bench", "gpu"]).fails(OTHER, &cure);
    run_without_drivers(here, &["serve", "world", "--backend", "gpu"]).fails(CONFIGURATION, &cure);
    let served = Served::start_by(without_drivers(here), &["--backend", "auto"]);
    let (code, errors) = served.terminate();
    assert_eq!(code, Some(0), "{errors}");
    let said = errors.lines().filter(|line| line.contains("computing on the CPU")).count();
    assert_eq!(said, 1, "{errors}");
}
