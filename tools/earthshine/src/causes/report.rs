//! The ranking for people and for programs.

use super::ranking::{RankedPoint, Ranking};
use super::{Cause, Explained};
use crate::output::out;
use anyhow::Context as _;
use std::path::Path;

/// Lines of the table of the worst points, and of voxels.
const WORST_POINTS: usize = 20;
const WORST_VOXELS: usize = 10;

/// Prints causes, the worst voxels and the worst points.
pub(crate) fn print_table(ranking: &Ranking<'_>) {
    // Adding zero makes minus zero plus zero.
    let percent = |share: f64| format!("{:.1} %", share * 100.0 + 0.0);
    out!("\ncauses of error, by the share of squared error of the points they explain best");
    out!(
        "{:16} {:>6} {:>9} {:>9} {:>9} {:>8}  meaning",
        "cause",
        "points",
        "squared",
        "relative",
        "part",
        "bias"
    );
    for share in ranking.causes.iter().filter(|share| share.points > 0 || share.part_of_squared_error != 0.0)
    {
        out!(
            "{:16} {:>6} {:>9} {:>9} {:>9} {:>+7.2}%  {}",
            share.cause.name(),
            share.points,
            percent(share.squared_error_share),
            percent(share.relative_error_share),
            percent(share.part_of_squared_error),
            share.bias * 100.0,
            share.cause.meaning()
        );
    }
    out!("\nworst voxels");
    out!("{:>20} {:>6} {:>9} {:>9}  cause", "voxel", "points", "squared", "mean rel");
    for voxel in ranking.voxels.iter().take(WORST_VOXELS) {
        let [x, y, z] = voxel.voxel;
        out!(
            "{:>20} {:>6} {:>9} {:>9}  {}",
            format!("{x},{y},{z}"),
            voxel.points,
            percent(voxel.squared_error_share),
            percent(voxel.mean_relative_error),
            voxel.cause.name()
        );
    }
    out!("\nworst points (lx; relative to the reference)");
    out!(
        "{:>26} {:>10} {:>10} {:>9} {:>8}  cause",
        "position, m",
        "served",
        "reference",
        "relative",
        "squared"
    );
    for point in ranking.points.iter().take(WORST_POINTS) {
        let explained = point.explained;
        let p = explained.position;
        out!(
            "{:>26} {:>10.4} {:>10.4} {:>9} {:>8}  {}: {}",
            format!("{:.3},{:.3},{:.3}", p.x, p.y, p.z),
            explained.served,
            explained.reference,
            format!("{:+.1} %", point.relative_error * 100.0),
            percent(point.squared_error_share),
            point.cause.name(),
            evidence(explained, point.cause)
        );
    }
}

/// What was seen that speaks for `cause`.
fn evidence(explained: &Explained, cause: Cause) -> String {
    let seen = &explained.evidence;
    let percent = |share: f64| format!("{:.0} %", share * 100.0);
    let part = explained.parts.of(cause) / explained.error();
    let words = match cause {
        Cause::ThinWall => format!(
            "{} of what is read is out of sight, {:.4} lx there, {:.4} here",
            percent(seen.behind_wall_share),
            seen.behind_wall_light,
            seen.gathered
        ),
        Cause::HiddenPoints => format!("{} of what is read is hidden", percent(seen.hidden_share)),
        Cause::MixedNormals => format!("{} of what is read faces elsewhere", percent(seen.turned_share)),
        Cause::VoxelDetail => {
            let [low, high] = seen.plain_light_range;
            format!("reads {low:.4} to {high:.4} lx, {:.4} here", seen.gathered)
        }
        Cause::LookupFallback => {
            format!("{} of the weight goes to other directions", percent(seen.fallback_share))
        }
        Cause::SmallPatch => format!("{} of the weight on tiny patches", percent(seen.small_share)),
        Cause::Air => format!("{:.4} lx by rays from here", seen.gathered),
        Cause::TooFewRays => format!("row noise {:.4} lx", seen.row_noise),
        Cause::RowBalance => format!(
            "rows are off by {:.4} lx, noise {:.4}",
            explained.parts.of(Cause::TooFewRays) + explained.parts.of(Cause::RowBalance),
            seen.row_noise
        ),
        Cause::NoPatchSeen => format!("{} of rays end without a patch", percent(seen.no_patch_share)),
        Cause::EmitterEdge | Cause::LampEdge | Cause::ReflectanceMix => {
            format!("{:+.4} lx from smeared patches", explained.parts.of(cause))
        }
        Cause::FarLight => format!("{:+.4} lx at what is seen", explained.parts.of(cause)),
        Cause::Noise => format!("reference noise {:.4} lx", explained.reference_noise),
    };
    format!("{words} ({} of the error)", percent(part))
}

/// Refuses a path that [`write()`] would refuse, before the work is done.
///
/// # Errors
/// Its ending is neither .csv nor .json.
pub(crate) fn check_path(path: &Path) -> anyhow::Result<()> {
    match path.extension().and_then(|kind| kind.to_str()) {
        Some("json" | "csv") => Ok(()),
        _ => Err(crate::exit_code::WrongUse("--report needs a file that ends in .csv or .json").into()),
    }
}

/// Writes the ranking as JSON, or as CSV: points to `path`, voxels beside it as `NAME_voxels.csv`.
///
/// # Errors
/// The path has another ending, or cannot be written.
pub(crate) fn write(path: &Path, ranking: &Ranking<'_>, uncovered: &[usize]) -> anyhow::Result<()> {
    let save =
        |path: &Path, text: String| std::fs::write(path, text).with_context(|| path.display().to_string());
    check_path(path)?;
    if path.extension().is_some_and(|kind| kind == "json") {
        return save(path, serde_json::to_string_pretty(&json(ranking, uncovered))?);
    }
    save(path, points_csv(ranking))?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    save(&path.with_file_name(format!("{stem}_voxels.csv")), voxels_csv(ranking))
}

fn json(ranking: &Ranking<'_>, uncovered: &[usize]) -> serde_json::Value {
    let points: Vec<_> = ranking.points.iter().map(point_json).collect();
    serde_json::json!({
        "causes": ranking.causes,
        "voxels": ranking.voxels,
        "points": points,
        "uncovered_points": uncovered,
    })
}

fn point_json(point: &RankedPoint<'_>) -> serde_json::Value {
    let explained = point.explained;
    let parts: serde_json::Map<String, serde_json::Value> =
        Cause::ALL.iter().map(|&cause| (cause.name().to_owned(), explained.parts.of(cause).into())).collect();
    serde_json::json!({
        "point": explained.index,
        "position": explained.position.to_array(),
        "normal": explained.normal.to_array(),
        "voxel": explained.voxel.to_array(),
        "served": explained.served,
        "reference": explained.reference,
        "reference_noise": explained.reference_noise,
        "relative_error": point.relative_error,
        "squared_error_share": point.squared_error_share,
        "cause": point.cause,
        "parts": parts,
        "evidence": explained.evidence,
    })
}

fn points_csv(ranking: &Ranking<'_>) -> String {
    let mut text =
        "rank,point,x,y,z,nx,ny,nz,voxel_x,voxel_y,voxel_z,served,reference,reference_noise,relative_error,\
         squared_error_share,cause"
            .to_owned();
    for cause in Cause::ALL {
        text.push(',');
        text.push_str(&cause.name().replace('-', "_"));
    }
    for (rank, point) in ranking.points.iter().enumerate() {
        let explained = point.explained;
        let (p, n, v) = (explained.position, explained.normal, explained.voxel);
        text += &format!(
            "\n{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
            rank + 1,
            explained.index,
            p.x,
            p.y,
            p.z,
            n.x,
            n.y,
            n.z,
            v.x,
            v.y,
            v.z,
            explained.served,
            explained.reference,
            explained.reference_noise,
            point.relative_error,
            point.squared_error_share,
            point.cause.name()
        );
        for cause in Cause::ALL {
            text += &format!(",{}", explained.parts.of(cause));
        }
    }
    text.push('\n');
    text
}

fn voxels_csv(ranking: &Ranking<'_>) -> String {
    let mut text = "rank,x,y,z,points,squared_error_share,mean_relative_error,cause\n".to_owned();
    for (rank, voxel) in ranking.voxels.iter().enumerate() {
        let [x, y, z] = voxel.voxel;
        let (points, squared, relative) =
            (voxel.points, voxel.squared_error_share, voxel.mean_relative_error);
        text += &format!("{},{x},{y},{z},{points},{squared},{relative},{}\n", rank + 1, voxel.cause.name());
    }
    text
}
