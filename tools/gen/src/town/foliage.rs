//! Trees: an octagonal trunk and a crown of lumps or cones, with tufts of leaves where detail is wanted.
//!
//! About 4.5 m high and 3 m wide before they are scaled.

use super::paint::Paint;
use super::prop::Prop;
use crate::draw::{Draw, Use};
use crate::mesh::Mesh;
use crate::solids::{Lump, blob, octahedron, taper};
use earthshine_world::Vec3;

/// Tree number `variant` of the town: broad, tall and conifer by turns.
pub(crate) fn tree(variant: u8, tufts: u32, draw: Draw) -> Mesh {
    let mut mesh = Mesh::default();
    let first = u32::from(variant) * 4;
    let leaf = if variant < Prop::TREES / 2 { Paint::LeafLight } else { Paint::LeafDark };
    let lumps: Vec<Lump> = match variant % 3 {
        0 => broad(first, draw),
        1 => vec![lump(Vec3::Y * 3.1, Vec3::new(0.85, 1.9, 0.85), 1, first)],
        _ => Vec::new(),
    };
    taper(&mut mesh, Paint::Bark.id(), Vec3::Y * -0.06, if lumps.is_empty() { 1.2 } else { 2.3 }, 0.17, 0.11);
    for lump in &lumps {
        blob(&mut mesh, leaf.id(), lump, draw);
    }
    if lumps.is_empty() {
        conifer(&mut mesh);
    } else {
        for tuft in 0..tufts {
            leaves(&mut mesh, leaf, &lumps, draw, u32::from(variant) << 16 | tuft);
        }
    }
    mesh
}

fn lump(centre: Vec3, radii: Vec3, subdivisions: u32, number: u32) -> Lump {
    Lump { centre, radii, roughness: 0.1, subdivisions, number }
}

fn broad(first: u32, draw: Draw) -> Vec<Lump> {
    let side = |i: u32| draw.between(Use::Tree, first * 8 + i, 0.35, 0.6);
    vec![
        lump(Vec3::Y * 3.1, Vec3::new(1.1, 1.15, 1.1), 1, first),
        lump(Vec3::new(side(0), 2.7, side(1)), Vec3::splat(0.75), 1, first + 1),
        lump(Vec3::new(-side(2), 2.9, side(3) - 0.5), Vec3::splat(0.7), 1, first + 2),
        lump(Vec3::new(side(4) - 0.5, 2.6, -side(5)), Vec3::splat(0.7), 1, first + 3),
    ]
}

fn conifer(mesh: &mut Mesh) {
    for (y, height, radius) in [(0.8, 1.7, 1.3), (1.7, 1.6, 1.05), (2.6, 1.5, 0.75), (3.4, 1.2, 0.45)] {
        taper(mesh, Paint::Needle.id(), Vec3::Y * y, height, radius, 0.0);
    }
}

/// One tuft, half sunk into the surface of one of the lumps.
fn leaves(mesh: &mut Mesh, leaf: Paint, lumps: &[Lump], draw: Draw, index: u32) {
    let lump = lumps[index as usize % lumps.len()];
    let part = |k: u32| draw.between(Use::Tree, 1 << 30 | index << 2 | k, -1.0, 1.0);
    let direction = Vec3::new(part(0), part(1), part(2)).normalize_or(Vec3::Y);
    let radius = 0.11 + 0.04 * part(3);
    octahedron(mesh, leaf.id(), lump.centre + direction * lump.radii * 0.97, radius);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Street trees, scaled by 1.1, stay 0.3 m clear of eaves 2.1 m away.
    const CROWN_RADIUS_M: f32 = 1.55;

    #[test]
    fn crowns_stay_within_their_radius_and_tufts_add_eight_triangles_each() {
        for seed in 0..20 {
            for variant in 0..Prop::TREES {
                let draw = Draw::of_world(seed);
                let (plain, lush) = (tree(variant, 0, draw), tree(variant, 100, draw));
                let bounds = lush.bounds();
                let widest = bounds.max.max(-bounds.min);
                assert!(widest.x.max(widest.z) <= CROWN_RADIUS_M, "tree {variant} of {seed}: {widest}");
                let added = if variant % 3 == 2 { 0 } else { 800 };
                assert_eq!(lush.triangles() - plain.triangles(), added);
            }
        }
    }
}
