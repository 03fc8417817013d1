//! Pictures by other methods than the path tracer: in screen space, and by progressive refinement.

use crate::command::{INPUT, USAGE, cornell_world, desk, run};
use std::fs;

/// A Cornell box in 24 x 16 pixels.
const PICTURE: [&str; 14] = [
    "render",
    "cornell",
    "--width",
    "24",
    "--height",
    "16",
    "--samples",
    "64",
    "--camera",
    "0,1,3",
    "--target",
    "0,1,0",
    "--json",
    "--method",
];

fn number(found: &serde_json::Value, pointer: &str) -> f64 {
    found.pointer(pointer).and_then(serde_json::Value::as_f64).unwrap_or_else(|| panic!("{pointer}: {found}"))
}

/// Goal: few rays a pixel make the picture that paths make, with and without a world's light, each variant on its own.
#[test]
fn screen_space_pictures_come_near_the_reference() {
    let desk = desk();
    cornell_world(desk.path());
    let screen_space = |more: &[&str]| run(desk.path(), &[&PICTURE[..], &["screen-space"], more].concat());
    let found = screen_space(&["--far-samples", "16", "--out", "own"]).succeeds().json();
    for name in ["gathered", "unrefined", "refined"] {
        let of = |key: &str| number(&found, &format!("/indirect/{name}/{key}"));
        assert!(of("linear/bias").abs() < 0.1 && of("linear/median_rel") < 0.25, "{name}: {found}");
        assert!(of("picture/ssim") > 0.8, "{name}: {found}");
        assert!(desk.path().join(format!("own/{name}_indirect.png")).is_file());
    }
    assert!(desk.path().join("own/sheet.png").is_file());
    assert_eq!((&found["far_samples"], &found["near_samples"]), (&16.into(), &16.into()));
    let served = screen_space(&["--world", "world", "--out", "served"]).succeeds().json();
    let bias = |name: &str| number(&served, &format!("/indirect/{name}/linear/bias")).abs();
    assert!(bias("unrefined") < 0.5 && bias("refined") < 0.15, "{served}");
    let ssim = |name: &str| number(&served, &format!("/indirect/{name}/picture/ssim"));
    assert!(ssim("refined") > ssim("unrefined"), "voxels of half a metre are coarse: {served}");
    screen_space(&["--far-samples", "0"]).fails(USAGE, &["0 rays a pixel"]);
    screen_space(&["--radius=-1"]).fails(USAGE, &["near radius of -1 m"]);
    run(desk.path(), &[&PICTURE[..], &["path-traced", "--radius", "1"]].concat())
        .fails(USAGE, &["--method screen-space"]);
}

/// Goal: an option that a way of rendering does not heed is refused, not ignored. Method: short rays are the screen's own,
/// which light of a world has no use for; its rays are taken, and so are the screen's short ones.
#[test]
fn short_rays_are_the_screens_own() {
    let desk = desk();
    cornell_world(desk.path());
    let with = |more: &[&str]| run(desk.path(), &[&PICTURE[..], &["screen-space"], more].concat());
    with(&["--world", "world", "--near-samples", "4"]).fails(USAGE, &["--near-samples", "--far-samples"]);
    with(&["--world", "world", "--far-samples", "4"]).succeeds();
    with(&["--near-samples", "4"]).succeeds();
}

/// Goal: a sequence of pictures converges to the reference, and no power is lost on the way.
#[test]
fn progressive_pictures_shoot_the_power_asked_for_and_keep_its_balance() {
    let desk = desk();
    let coarse = ["progressive", "--patch-area", "0.1", "--splits", "0", "--until", "80", "--out", "frames"];
    let found = run(desk.path(), &[&PICTURE[..], &coarse].concat()).succeeds().json();
    let share = number(&found, "/shot_share");
    assert!((0.8..0.85).contains(&share), "{found}");
    let [given, unshot, absorbed, escaped] =
        ["given", "unshot", "absorbed", "escaped"].map(|name| number(&found, &format!("/power_lm/{name}")));
    assert!((given - unshot - absorbed - escaped).abs() < 1e-6 * given, "{found}");
    assert!((1.0 - unshot / given - share).abs() < 1e-6, "{found}");
    assert!(number(&found, "/indirect/linear/median_rel") < 0.4, "{found}");

    // A picture after the first, second, fourth .. shot, and the last.
    let (frames, shots) = (number(&found, "/frames") as u32, number(&found, "/shots") as u64);
    assert_eq!(frames, shots.ilog2() + 2, "{found}");
    let brightness = |number: u32| {
        let path = desk.path().join(format!("frames/frame_{number:04}.png"));
        let picture = image::open(path).expect("a frame").to_rgb8();
        picture.as_raw().iter().map(|&value| u64::from(value)).sum::<u64>()
    };
    assert!(brightness(1) < brightness(frames / 2) && brightness(frames / 2) < brightness(frames));
    assert!(!desk.path().join(format!("frames/frame_{:04}.png", frames + 1)).is_file());

    let log = fs::read_to_string(desk.path().join("frames/progress.csv")).expect("a log");
    let percents: Vec<f64> = log
        .lines()
        .skip(1)
        .map(|line| line.split(',').nth(2).expect("a percent").parse().expect("a number"))
        .collect();
    assert_eq!(percents.len() as u64, shots + 1);
    assert!(percents.windows(2).all(|pair| pair[0] <= pair[1]), "power shot never falls: {percents:?}");
    assert!((percents[percents.len() - 1] - 100.0 * share).abs() < 1e-6);
    let plot = fs::read_to_string(desk.path().join("frames/progress.svg")).expect("a plot");
    assert!(plot.contains("% of the given power"));
    for wrong in ["0", "101"] {
        run(desk.path(), &[&PICTURE[..], &["progressive", "--until", wrong]].concat())
            .fails(USAGE, &["--until"]);
    }
}

/// Goal: the method is compared by rays a pixel, in its own right and over served light.
#[test]
fn refinement_is_measured_by_rays_a_pixel() {
    let desk = desk();
    let size = ["--width", "72", "--height", "48", "--camera", "0,1,3", "--target", "0,1,0"];
    let coarse = ["--voxel", "0.5", "--rays", "64", "--detail", "1", "--reference-samples", "256"];
    let bench = |scene: &str, more: &[&str]| {
        run(desk.path(), &[&["bench", "refinement", "--scene", scene][..], &size, &coarse, more].concat())
    };
    let found = bench("cornell", &["--pixel-rays", "4,32", "--json"]).succeeds().json();
    let ssim = |pointer: &str| number(&found, &format!("{pointer}/ssim"));
    assert_eq!(found["by_rays"].as_array().map(Vec::len), Some(2));
    assert!(ssim("/by_rays/1/gathered") > ssim("/by_rays/0/gathered"), "less noise: {found}");
    assert!(
        ssim("/by_rays/0/filtered") > ssim("/by_rays/0/gathered"),
        "the filter takes noise away: {found}"
    );
    assert!(ssim("/by_rays/1/served_refined") > ssim("/served"), "{found}");
    let table = bench("cornell", &["--pixel-rays", "4", "--markdown"]).succeeds().output;
    assert!(table.lines().count() == 3 && table.contains("| cornell | 4 |"), "{table}");
    bench("missing.glb", &[]).fails(INPUT, &["missing.glb"]);
    bench("cornell", &["--pixel-rays", "0"]).fails(USAGE, &["0 rays a pixel"]);
}
