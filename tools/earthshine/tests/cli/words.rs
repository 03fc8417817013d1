//! Commands that measure light, with words that cannot be: what is wrong is said, and before anything else is done.

use crate::command::{INPUT, STORAGE, USAGE, desk, run};
use std::fs;

const POINT: &str = "x,y,z,nx,ny,nz,r,g,b,sr,sg,sb\n0.3,0,0.3,0,1,0,0.4,0.4,0.4,0,0,0\n";
const ACCURACY: &str = "bench accuracy --scene cornell";
const REFERENCE: &str = "bench reference --scene cornell --reference light.csv";
const SPHERE: &str = "bench sphere --scene cornell";
const REFINEMENT: &str = "bench refinement --scene cornell";
const PICTURES: &str = "bench pictures cornell --voxel 0.5 --rays 32 --detail 1";
const BUILDERS: &str = "bench builders --scene cornell";
const ESTIMATORS: &str = "bench estimators --scene cornell";

/// Goal: no number that has no meaning is measured with. Method: each command's numbers, one wrong at a time.
#[test]
fn numbers_without_meaning_are_refused_by_name() {
    let desk = desk();
    fs::write(desk.path().join("light.csv"), POINT).expect("a scratch folder");
    for (command, wrong, words) in [
        (ACCURACY, "--noise=nan", "a share of the light, 0 or more"),
        (ACCURACY, "--noise=-1", "a share of the light, 0 or more"),
        (ACCURACY, "--point-count 999999999999", "at most 1000000 points"),
        (ACCURACY, "--voxel nan", "voxel edge = NaN: must be a length"),
        (ACCURACY, "--row-error nan", "row error = NaN: must be 0"),
        (ACCURACY, "--builder clustered --cluster-distance nan", "cluster distance = NaN: must be 0"),
        (
            ACCURACY,
            "--row-error 0.1 --min-rays 100 --max-rays 10",
            "least and most rays = 100 and 10: must be 1",
        ),
        (ACCURACY, "--sweep voxel=0.5,1e30", "must be a length above 0.0001 m"),
        (REFERENCE, "--noise=inf", "a share of the light, 0 or more"),
        (REFERENCE, "--paths 0", "--paths"),
        (REFERENCE, "--point-count 0", "ask for 1 or more"),
        (SPHERE, "--radius nan", "above 0 and finite"),
        (SPHERE, "--radius=-1", "above 0 and finite"),
        (SPHERE, "--frames 1", "2..=10000"),
        (SPHERE, "--sphere-points 0", "1..=10000"),
        (SPHERE, "--way 0,1,0;0,1,0", "by two places or more"),
        (SPHERE, "--voxel 0", "voxel edge = 0"),
        (REFINEMENT, "--pixel-rays 4,0", "0 rays a pixel"),
        (REFINEMENT, "--near-samples 0", "0 rays a pixel"),
        (REFINEMENT, "--voxel nan", "voxel edge = NaN"),
        (PICTURES, "--reference-samples 0", "0 samples a pixel"),
        (PICTURES, "--refine-samples 0", "0 rays a pixel"),
        (BUILDERS, "--point-count 0", "ask for 1 or more"),
        (BUILDERS, "--noise nan", "a share of the light"),
        (BUILDERS, "--voxel nan", "voxel edge = NaN"),
        (ESTIMATORS, "--rows 0", "--rows"),
        (ESTIMATORS, "--reference-rays 0", "--reference-rays"),
        (ESTIMATORS, "--targets 0.1,nan", "above 0 and below 1"),
        (ESTIMATORS, "--voxel nan", "voxel edge = NaN"),
        ("render cornell", "--exposure nan", "above 0 and finite"),
        ("render cornell", "--samples 0", "0 samples a pixel"),
        ("render cornell --method progressive", "--shots 0", "--shots"),
        ("compare pictures a.png b.png", "--exposure 0", "above 0 and finite"),
    ] {
        let words_given: Vec<&str> = command.split(' ').chain(wrong.split(' ')).collect();
        let run = run(desk.path(), &words_given).fails(USAGE, &[words]);
        assert!(!run.errors.contains("BakeMethod"), "no innards: {run:?}");
    }
}

/// Goal: nobody waits for a reference or a bake whose result has no place to go, or that fails for words already said.
/// Method: what is written first must not be there after the failure.
#[test]
fn what_makes_work_vain_is_found_out_first() {
    let desk = desk();
    fs::write(desk.path().join("light.csv"), POINT).expect("a scratch folder");
    fs::write(desk.path().join("empty.csv"), POINT.lines().next().expect("a header"))
        .expect("a scratch folder");
    let traced = "--point-count 4 --noise 0.5 --write-reference first.csv";
    let moved = "--frames 2 --sphere-points 2 --noise 0.5 --reference-out first.csv";
    let small = "--width 24 --height 16 --reference-samples 2 --out first.csv";
    for (command, wrong, code, words) in [
        (format!("{ACCURACY} {traced}"), "--voxel nan", USAGE, "voxel edge"),
        (format!("{ACCURACY} {traced}"), "--sweep rays=32,4000000000", USAGE, "rays per patch"),
        (format!("{ACCURACY} {traced}"), "--out nowhere/light.csv", STORAGE, "nowhere/light.csv"),
        (format!("{ACCURACY} {traced}"), "--report nowhere/causes.csv", STORAGE, "nowhere/causes.csv"),
        (format!("{ACCURACY} {traced}"), "--sweep rays=32 --sweep-out nowhere/s", STORAGE, "nowhere/s.csv"),
        (format!("{ACCURACY} {traced}"), "--world nowhere", crate::command::WORLD, "nowhere is not a world"),
        (format!("{SPHERE} {moved}"), "--voxel nan", USAGE, "voxel edge"),
        (format!("{PICTURES} {small}"), "missing.glb", INPUT, "missing.glb: there is no such file"),
        (
            format!("{PICTURES} {small}"),
            "cornell;lights=none.json",
            INPUT,
            "none.json: there is no such file",
        ),
    ] {
        let words_given: Vec<&str> = command.split(' ').chain(wrong.split(' ')).collect();
        run(desk.path(), &words_given).fails(code, &[words]);
        assert!(
            fs::metadata(desk.path().join("first.csv")).is_err(),
            "{words_given:?}: the reference came first"
        );
    }
    // The same of commands that write at their end alone: a bake would have said so.
    for (command, wrong, code, words) in [
        (REFERENCE, "--out nowhere/ours.csv", STORAGE, "nowhere/ours.csv"),
        (SPHERE, "--reference-out nowhere/ours.csv", STORAGE, "nowhere/ours.csv"),
        (SPHERE, "--reference light.csv", INPUT, "light.csv is of another way"),
        (BUILDERS, "--reference empty.csv", INPUT, "empty.csv: there are no points"),
        (REFINEMENT, "--width 8 --height 8", INPUT, "less than SSIM's window"),
        ("bench pictures cornell", "--width 8", INPUT, "less than SSIM's window"),
        ("bench pictures cornell", "--out light.csv", STORAGE, "light.csv"),
        ("render cornell", "--out light.csv", STORAGE, "light.csv"),
        ("render cornell --method screen-space", "--width 8", INPUT, "less than SSIM's window"),
    ] {
        let words_given: Vec<&str> = command.split(' ').chain(wrong.split(' ')).collect();
        let run = run(desk.path(), &words_given).fails(code, &[words]);
        assert!(!run.errors.contains("rays"), "nothing was baked: {run:?}");
    }
    assert_eq!(fs::read_to_string(desk.path().join("light.csv")).expect("kept"), POINT);
}
