//! The demo's one page: figures and pictures, no scripts, nothing from elsewhere.

use super::{PictureSummary, Summary};

/// The page as text.
pub(super) fn html(summary: &Summary) -> String {
    let mut page = String::from(
        "<!doctype html><meta charset=utf-8><title>Earthshine demo</title>\
         <style>body{font:16px/1.5 system-ui;margin:2em auto;max-width:62em;padding:0 1em}\
         img{max-width:100%}td{padding:.1em 1em .1em 0}</style><h1>Earthshine: what the demo did</h1>\
         <p>A town was generated and baked, a server streamed its indirect light to a client that walked down a \
         street under a moving sun, and the light that the client held was drawn beside a path tracer's.</p><table>",
    );
    let mut row = |name: &str, value: String| {
        page.push_str(&format!("<tr><td>{name}<td>{value}"));
    };
    let (bake, flight) = (&summary.bake, &summary.flight);
    row("triangles", bake.triangles.to_string());
    row("patches, form factors", format!("{}, {}", bake.patches, bake.nonzeros));
    row(
        "world on disk",
        format!(
            "{:.1} MB, {:.2} bytes a form factor",
            bake.world_bytes as f64 / 1e6,
            bake.tile_bytes_per_nonzero
        ),
    );
    row("bake", format!("{:.1} s, {:.2} M rays/s a core", bake.seconds, bake.mrays_s_core));
    row(
        "flight",
        format!("{:.1} s, {} frames, {:.2} MB/s", flight.duration_s, flight.frames, flight.bytes_per_s / 1e6),
    );
    let milliseconds = |value: Option<f64>| value.map_or("-".to_owned(), |ms| format!("{ms:.1} ms"));
    row(
        "camera to light",
        format!("p50 {}, p99 {}", milliseconds(flight.latency_ms_p50), milliseconds(flight.latency_ms_p99)),
    );
    row("frames without light near the camera", format!("{} of {}", flight.misses, flight.probed_frames));
    row("wall time", format!("{:.0} s", summary.seconds));
    if let Some(bytes) = summary.peak_rss_bytes {
        row("peak memory", format!("{:.0} MB", bytes as f64 / 1e6));
    }
    page.push_str("</table>");
    summary.pictures.iter().for_each(|picture| section(&mut page, picture));
    page
}

fn section(page: &mut String, picture: &PictureSummary) {
    let errors = crate::compare::described(&picture.indirect);
    page.push_str(&format!(
        "<h2>{:.1} s into the flight</h2><p>Indirect light against the path tracer, sRGB at one exposure: {errors}. \
         {:.1} % of the surfaces in view had no light in the client's volume (beyond the resident patches).</p>\
         <img src=\"{}\" alt=\"direct, indirect, full, reference, difference\">",
        picture.flight_time_s,
        picture.uncovered_share * 100.0,
        picture.file
    ));
}
