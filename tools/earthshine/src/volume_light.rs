//! Light at points read from a volume, and points to read it at.

use anyhow::Context as _;
use earthshine_render::SceneTracer;
use earthshine_render::csv::ReferencePoint;
use earthshine_volume::{Volume, lookup};
use earthshine_world::random::{Purpose, hash, unit_f32, unit_pair};
use earthshine_world::{Rgb, Vec3};
use std::io::Write as _;
use std::path::Path;

/// Irradiance by the lookup rule, lx; `None` where no volume (finest first) has any.
pub(crate) fn at(volumes: &[Volume], position: Vec3, normal: Vec3) -> Option<Rgb> {
    lookup(volumes, position, normal).map(|found| found.irradiance)
}

/// Points on front faces, uniform by area, that see out: not under a box, not inside a wall.
pub(crate) fn random_places(tracer: &SceneTracer<'_>, count: usize, seed: u64) -> Vec<(Vec3, Vec3)> {
    let scene = tracer.scene();
    let mut cumulated = Vec::with_capacity(scene.triangles.len());
    let mut area = 0.0f64;
    for [a, b, c] in &scene.triangles {
        area += f64::from((b - a).cross(c - a).length()) * 0.5;
        cumulated.push(area);
    }
    let mut places = Vec::with_capacity(count);
    // A scene that is all buried gives up after this many tries.
    for index in 0..count as u64 * 64 {
        if places.len() == count {
            break;
        }
        let along = f64::from(unit_f32(hash(seed, Purpose::MeasurePoint, index, 0))) * area;
        let triangle = cumulated.partition_point(|&sum| sum <= along).min(scene.triangles.len() - 1);
        let (u, v) = unit_pair(hash(seed, Purpose::MeasurePoint, index, 1));
        let (root, [a, b, c]) = (u.sqrt(), scene.triangles[triangle]);
        let position = a + (b - a) * (root * (1.0 - v)) + (c - a) * (root * v);
        let normal = scene.normal(triangle);
        if sees_out(tracer, position, normal, seed, index) {
            places.push((position, normal));
        }
    }
    places
}

/// Whether most of a few directions end on front faces or in the open.
fn sees_out(tracer: &SceneTracer<'_>, position: Vec3, normal: Vec3, seed: u64, index: u64) -> bool {
    const RAYS: u64 = 16;
    let origin = position + normal * 1e-4;
    let back = (0..RAYS).filter(|ray| {
        let pair = unit_pair(hash(seed, Purpose::MeasurePoint, index, 2 + ray));
        let direction = earthshine_render::sampling::cosine_direction(normal, pair);
        tracer.closest(origin, direction, 0.0, f32::INFINITY).is_some_and(|hit| !hit.front)
    });
    back.count() as u64 * 2 < RAYS
}

/// Reference and measured light beside each other, one line a point; uncovered points have empty fields.
pub(crate) fn write_csv(
    path: &Path,
    reference: &[ReferencePoint],
    measured: &[Option<Rgb>],
) -> anyhow::Result<()> {
    let about = || format!("{}", path.display());
    let mut file = std::io::BufWriter::new(std::fs::File::create(path).with_context(about)?);
    writeln!(file, "x,y,z,nx,ny,nz,r,g,b,measured_r,measured_g,measured_b").with_context(about)?;
    for (point, light) in reference.iter().zip(measured) {
        let (p, n, i) = (point.position, point.normal, point.irradiance);
        let light = light.map_or(",,".to_owned(), |l| format!("{},{},{}", l.x, l.y, l.z));
        writeln!(file, "{},{},{},{},{},{},{},{},{},{light}", p.x, p.y, p.z, n.x, n.y, n.z, i.x, i.y, i.z)
            .with_context(about)?;
    }
    file.flush().with_context(about)
}
