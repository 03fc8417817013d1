//! The figures for people: with units, each beside what it is compared with.

use super::Figures;
use crate::bench::Report;
use crate::output::out;

/// Prints the table. `against` names the reference.
pub(super) fn print(report: &Report<Figures>, against: &str) {
    let figures = &report.figures;
    let errors = &figures.errors;
    let percent = |share: f64| format!("{:.2} %", share * 100.0);
    let all = errors.points + errors.uncovered;
    out!(
        "{}: voxels of {} m, detail {}, {} rays and {} points a patch, {} points a voxel face",
        report.scene,
        figures.voxel_edge_m,
        figures.detail,
        figures.rays_per_patch,
        figures.points_per_patch,
        figures.samples_per_voxel_face
    );
    out!("light served ({}, {}) against {against}\n", report.solver, report.backend);
    let noise = format!("of the reference there; its own noise is {}", percent(errors.reference_noise_rel));
    let mean = format!("of the mean reference, {:.4} lx", figures.mean_reference);
    let of_points = format!("of {} points", errors.points);
    let of_lit = format!("of {} points; to {} no light comes", errors.points - errors.unlit, errors.unlit);
    let rate = |bytes: u64| format!("{} bytes a patch", bytes / figures.patches.max(1));
    let rows = [
        ("median error", percent(errors.median_rel), noise),
        ("90th percentile", percent(errors.p90_rel), String::new()),
        ("99th percentile", percent(errors.p99_rel), String::new()),
        ("RMSE", percent(errors.rel_rmse), mean.clone()),
        ("bias", format!("{:+.2} %", errors.bias * 100.0), mean),
        ("beyond a factor of two", percent(errors.beyond_factor_two), of_points),
        ("the same, lit points", percent(errors.beyond_factor_two_lit), of_lit),
        ("uncovered", errors.uncovered.to_string(), format!("of {all} points; not in the errors above")),
        ("patches", figures.patches.to_string(), String::new()),
        ("world", format!("{:.3} MB", figures.world_bytes as f64 / 1e6), rate(figures.world_bytes)),
        ("absorbed", percent(figures.absorbed_share_mean), "of a row's rays, mean over rows".to_owned()),
        ("bake", figures.bake_seconds.map_or("-".to_owned(), seconds), "--world skips it".to_owned()),
        ("solve", seconds(figures.solve_seconds), "all bounces, whole world".to_owned()),
        ("reference", seconds(figures.reference_seconds), "tracing or reading it".to_owned()),
    ];
    for (name, value, compared_with) in rows {
        out!("{name:>24}  {value:>12}  {compared_with}");
    }
}

fn seconds(value: f64) -> String {
    format!("{value:.2} s")
}
