//! Triangles by material, and where copies of them stand. Metres, counter-clockwise seen from the front.

use crate::material::MaterialId;
use earthshine_world::{Bounds, Vec3};
use glam::Quat;
use std::collections::BTreeMap;

/// The triangles of one material.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surface {
    /// Corners, m.
    pub positions: Vec<Vec3>,
    /// Unit, one a corner.
    pub normals: Vec<Vec3>,
    /// Three a triangle.
    pub indices: Vec<u32>,
}

/// Triangles of any number of materials.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// In the order of the materials.
    pub surfaces: BTreeMap<MaterialId, Surface>,
}

/// Where a copy of a mesh stands: scaled, turned, then moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// m.
    pub translation: Vec3,
    /// Unit.
    pub rotation: Quat,
    /// The same along every axis.
    pub scale: f32,
}

impl Placement {
    /// Moved, not turned.
    #[must_use]
    pub fn at(translation: Vec3) -> Self {
        Self { translation, rotation: Quat::IDENTITY, scale: 1.0 }
    }

    /// Turned about +Y by `quarters` right angles (+Z towards +X), then moved.
    #[must_use]
    pub fn quarter_turned(translation: Vec3, quarters: u32) -> Self {
        const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;
        // No sine and cosine: they differ in the last bit between platforms, and worlds must not.
        let (y, w) = [(0.0, 1.0), (HALF, HALF), (1.0, 0.0), (-HALF, HALF)][quarters as usize % 4];
        Self { rotation: Quat::from_xyzw(0.0, y, 0.0, w), ..Self::at(translation) }
    }

    /// Turned about +Y by the angle whose half has the tangent `half_tangent`, scaled, then moved.
    #[must_use]
    pub fn turned(translation: Vec3, half_tangent: f32, scale: f32) -> Self {
        let w = 1.0 / (1.0 + half_tangent * half_tangent).sqrt();
        Self { translation, rotation: Quat::from_xyzw(0.0, half_tangent * w, 0.0, w), scale }
    }

    /// Where `point` of the mesh comes to lie.
    #[must_use]
    pub fn apply(&self, point: Vec3) -> Vec3 {
        self.rotation * (point * self.scale) + self.translation
    }
}

impl Surface {
    /// Appends corners with their normals, and triangles that count from the first of them.
    pub fn push(&mut self, positions: &[Vec3], normals: &[Vec3], triangles: &[[u32; 3]]) {
        let first = self.positions.len() as u32;
        self.positions.extend_from_slice(positions);
        self.normals.extend_from_slice(normals);
        self.indices.extend(triangles.iter().flatten().map(|index| first + index));
    }

    /// Number of triangles.
    #[must_use]
    pub fn triangles(&self) -> u64 {
        self.indices.len() as u64 / 3
    }

    /// Corners of every triangle.
    pub fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> + '_ {
        self.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(|i| self.positions[i as usize]))
    }
}

impl Mesh {
    /// The surface of `material`, made if it is the first use.
    pub fn surface(&mut self, material: MaterialId) -> &mut Surface {
        self.surfaces.entry(material).or_default()
    }

    /// A flat convex polygon, counter-clockwise seen from its front.
    pub fn polygon(&mut self, material: MaterialId, corners: &[Vec3]) {
        let (a, b, c) = (corners[0], corners[1], corners[2]);
        let normal = (b - a).cross(c - a).normalize_or(Vec3::Y);
        let fan: Vec<[u32; 3]> = (2..corners.len() as u32).map(|i| [0, i - 1, i]).collect();
        self.surface(material).push(corners, &vec![normal; corners.len()], &fan);
    }

    /// Appends a copy of `other`.
    pub fn append(&mut self, other: &Self, placement: &Placement) {
        for (&material, surface) in &other.surfaces {
            let target = self.surface(material);
            let first = target.positions.len() as u32;
            target.positions.extend(surface.positions.iter().map(|&p| placement.apply(p)));
            target.normals.extend(surface.normals.iter().map(|&n| placement.rotation * n));
            target.indices.extend(surface.indices.iter().map(|index| first + index));
        }
    }

    /// Number of triangles.
    #[must_use]
    pub fn triangles(&self) -> u64 {
        self.surfaces.values().map(Surface::triangles).sum()
    }

    /// Corners of every triangle, material by material.
    pub fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> + '_ {
        self.surfaces.values().flat_map(Surface::corners)
    }

    /// Box around everything, m.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for &position in self.surfaces.values().flat_map(|surface| &surface.positions) {
            bounds.grow(position);
        }
        bounds
    }
}

/// What a closed mesh encloses and how far it is from closed.
#[cfg(test)]
pub(crate) mod oracle {
    use super::{Mesh, Vec3};

    /// Volume by the divergence theorem, m3: positive where fronts face outward.
    pub(crate) fn volume(mesh: &Mesh) -> f64 {
        mesh.corners().map(|[a, b, c]| a.as_dvec3().dot(b.as_dvec3().cross(c.as_dvec3())) / 6.0).sum()
    }

    /// Length of the sum of all area vectors, m2: zero for closed meshes.
    pub(crate) fn gap(mesh: &Mesh) -> f64 {
        let area = |[a, b, c]: [Vec3; 3]| (b - a).as_dvec3().cross((c - a).as_dvec3()) / 2.0;
        mesh.corners().map(area).sum::<glam::DVec3>().length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_right_angles_and_keep_fronts() {
        let mut quad = Mesh::default();
        quad.polygon(MaterialId(0), &[Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y]);
        for (quarters, towards) in [(0, Vec3::Z), (1, Vec3::X), (2, Vec3::NEG_Z), (3, Vec3::NEG_X)] {
            let mut turned = Mesh::default();
            turned.append(&quad, &Placement::quarter_turned(Vec3::splat(5.0), quarters));
            assert_eq!(turned.triangles(), 2);
            for (corners, normal) in turned.corners().zip(&turned.surfaces[&MaterialId(0)].normals) {
                let [a, b, c] = corners;
                assert!(((b - a).cross(c - a) - towards).length() < 1e-5);
                assert!((*normal - towards).length() < 1e-6);
            }
        }
    }
}
