//! Elements: the sides of a scene's triangles cut into patches of bounded area, and those into leaves on demand.
//!
//! Patches shoot, leaves receive (Cohen's substructuring). Every side of a triangle is a quadtree: its inner
//! nodes halve edges, a patch is a node small enough to shoot, a leaf one that was not split. No light is computed
//! here; leaves carry what the solver puts on them.

use super::ProgressiveError;
use super::form_factor::{area, centre, quartered};
use earthshine_world::{Rgb, Vec3};
use glam::DVec3;

/// No node is deeper: edges 1/4096 of the triangle's.
const DEPTH_MAX: u32 = 12;
/// Marks a node without children.
const NONE: u32 = u32::MAX;

/// What one side of a triangle is.
#[derive(Debug, Clone, Copy)]
pub struct Side {
    /// Counter-clockwise seen from this side.
    pub corners: [Vec3; 3],
    /// Unit, of this side.
    pub normal: Vec3,
}

/// A receiver: part of a patch.
#[derive(Debug, Clone, Copy)]
pub struct Leaf {
    /// Counter-clockwise seen from its side.
    pub corners: [Vec3; 3],
    /// Unit.
    pub normal: Vec3,
    /// m2.
    pub area: f32,
    /// The patch it belongs to.
    pub patch: u32,
    /// Splits below that patch.
    pub depth: u32,
    /// Diffuse.
    pub reflectance: Rgb,
    /// All light that arrived from surfaces and sky, lx.
    pub irradiance: Rgb,
    /// Exitance that was not shot yet, lm/m2.
    pub unshot: Rgb,
    node: u32,
}

/// A shooter.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Counter-clockwise seen from its side.
    pub corners: [Vec3; 3],
    /// Unit.
    pub normal: Vec3,
    /// m2.
    pub area: f32,
    /// Its leaves.
    pub leaves: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    first_child: u32,
    patch: u32,
    leaf: u32,
}

/// All of a scene's patches and leaves.
#[derive(Debug)]
pub struct Elements {
    /// Shooters.
    pub patches: Vec<Patch>,
    /// Receivers.
    pub leaves: Vec<Leaf>,
    nodes: Vec<Node>,
    leaves_max: usize,
}

impl Elements {
    /// Cuts `sides` into patches of at most `area_max_m2`; side `s` is node `s`.
    ///
    /// # Errors
    /// There would be more than `leaves_max`.
    pub fn cut(sides: &[Side], area_max_m2: f32, leaves_max: usize) -> Result<Self, ProgressiveError> {
        let mut elements = Self { patches: Vec::new(), leaves: Vec::new(), nodes: Vec::new(), leaves_max };
        let nothing = Node { first_child: NONE, patch: NONE, leaf: NONE };
        elements.nodes.resize(sides.len(), nothing);
        for (root, side) in sides.iter().enumerate() {
            elements.cut_side(root as u32, side, area_max_m2, 0)?;
        }
        Ok(elements)
    }

    fn cut_side(
        &mut self,
        node: u32,
        side: &Side,
        area_max_m2: f32,
        depth: u32,
    ) -> Result<(), ProgressiveError> {
        if area(&side.corners) > area_max_m2 && depth < DEPTH_MAX {
            let first = self.add_children(node);
            for (k, corners) in (0..).zip(quartered(side.corners)) {
                self.cut_side(first + k, &Side { corners, ..*side }, area_max_m2, depth + 1)?;
            }
            return Ok(());
        }
        if self.leaves.len() >= self.leaves_max {
            return Err(ProgressiveError::TooMany { elements_max: self.leaves_max, area_m2: area_max_m2 });
        }
        let (patch, leaf) = (self.patches.len() as u32, self.leaves.len() as u32);
        let area = area(&side.corners);
        self.nodes[node as usize].patch = patch;
        self.nodes[node as usize].leaf = leaf;
        let (corners, normal) = (side.corners, side.normal);
        self.patches.push(Patch { corners, normal, area, leaves: vec![leaf] });
        let (irradiance, unshot, reflectance) = (Rgb::ZERO, Rgb::ZERO, Rgb::ZERO);
        self.leaves.push(Leaf {
            corners,
            normal,
            area,
            patch,
            depth: 0,
            reflectance,
            irradiance,
            unshot,
            node,
        });
        Ok(())
    }

    fn add_children(&mut self, node: u32) -> u32 {
        let first = self.nodes.len() as u32;
        self.nodes[node as usize].first_child = first;
        let patch = self.nodes[node as usize].patch;
        self.nodes.extend([Node { first_child: NONE, patch, leaf: NONE }; 4]);
        first
    }

    /// Whether [`Self::split`] has room left.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.leaves.len() + 3 <= self.leaves_max
    }

    /// Splits `leaf` into four that inherit its light; the first takes its place.
    pub fn split(&mut self, leaf: u32) -> [u32; 4] {
        let whole = self.leaves[leaf as usize];
        let first = self.add_children(whole.node);
        self.nodes[whole.node as usize].leaf = NONE;
        let parts = quartered(whole.corners);
        std::array::from_fn(|k| {
            let node = first + k as u32;
            let part =
                Leaf { corners: parts[k], area: area(&parts[k]), depth: whole.depth + 1, node, ..whole };
            let place = if k == 0 { leaf } else { self.leaves.len() as u32 };
            if k == 0 {
                self.leaves[leaf as usize] = part;
            } else {
                self.leaves.push(part);
                self.patches[whole.patch as usize].leaves.push(place);
            }
            self.nodes[node as usize].leaf = place;
            place
        })
    }

    /// The leaf at barycentric `weights` (of a [`Side`]'s corners) of side `root`, and the weights of its own corners.
    #[must_use]
    pub fn leaf_at(&self, root: u32, weights: [f32; 3]) -> Option<(u32, [f32; 3])> {
        let (node, weights) = self.descend(root, weights, |node| node.first_child == NONE);
        let leaf = self.nodes[node as usize].leaf;
        (leaf != NONE).then_some((leaf, weights))
    }

    /// The patch there.
    #[must_use]
    pub fn patch_at(&self, root: u32, weights: [f32; 3]) -> u32 {
        let (node, _) = self.descend(root, weights, |node| node.patch != NONE);
        self.nodes[node as usize].patch
    }

    fn descend(&self, root: u32, mut weights: [f32; 3], ends: impl Fn(&Node) -> bool) -> (u32, [f32; 3]) {
        let mut node = root;
        while !ends(&self.nodes[node as usize]) {
            let largest = (0..3).find(|&k| weights[k] >= 0.5);
            let child = largest.unwrap_or(3);
            weights = match largest {
                Some(corner) => {
                    std::array::from_fn(|k| 2.0 * weights[k] - if k == corner { 1.0 } else { 0.0 })
                }
                // The middle part has the edges' midpoints as corners, each opposite to the corner of its number.
                None => weights.map(|weight| 1.0 - 2.0 * weight),
            };
            node = self.nodes[node as usize].first_child + child as u32;
        }
        (node, weights)
    }

    /// Exitance of `patch` that was not shot, mean over it, lm/m2.
    #[must_use]
    pub fn unshot_exitance(&self, patch: u32) -> Rgb {
        let patch = &self.patches[patch as usize];
        let power: DVec3 = patch.leaves.iter().map(|&leaf| self.leaves[leaf as usize].unshot_power()).sum();
        (power / f64::from(patch.area)).as_vec3()
    }
}

impl Leaf {
    /// lm (the channels' own kind of it).
    #[must_use]
    pub fn unshot_power(&self) -> DVec3 {
        self.unshot.as_dvec3() * f64::from(self.area)
    }

    /// Places whose mean stands for the leaf: the centres of the parts it would split into.
    #[must_use]
    pub fn places(&self) -> [Vec3; 4] {
        quartered(self.corners).map(|part| centre(&part))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn side() -> Side {
        Side { corners: [Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 2.0], normal: Vec3::Z }
    }

    #[test]
    fn patches_are_small_enough_and_cover_the_side() {
        let elements = Elements::cut(&[side(), side()], 0.3, 1000).unwrap();
        assert!(elements.patches.iter().all(|patch| patch.area <= 0.3));
        let total: f32 = elements.patches.iter().map(|patch| patch.area).sum();
        assert!((total - 8.0).abs() < 1e-5 && elements.patches.len() == 32, "{total}");
        let refused = Elements::cut(&[side(), side()], 0.3, 31).unwrap_err();
        assert!(matches!(refused, ProgressiveError::TooMany { elements_max: 31, .. }));
    }

    #[test]
    fn a_place_finds_the_leaf_that_holds_it() {
        let mut elements = Elements::cut(&[side()], 1.0, 1000).unwrap();
        elements.split(1);
        let inside = elements.split(3);
        elements.split(inside[3]);
        for i in 0..50u32 {
            let (a, b) = ((f64::from(i) * 0.618).fract() as f32, (f64::from(i) * 0.755).fract() as f32);
            let root = a.sqrt();
            let weights = [1.0 - root, root * (1.0 - b), root * b];
            let [p, q, r] = side().corners;
            let place = p * weights[0] + q * weights[1] + r * weights[2];
            let (leaf, own) = elements.leaf_at(0, weights).expect("a leaf");
            let leaf = &elements.leaves[leaf as usize];
            let [p, q, r] = leaf.corners;
            assert!((p * own[0] + q * own[1] + r * own[2] - place).length() < 1e-4);
            assert!(own.iter().all(|&weight| weight > -1e-4), "{own:?}");
            assert_eq!(elements.patch_at(0, weights), leaf.patch);
        }
    }

    #[test]
    fn splitting_keeps_light_and_area() {
        let mut elements = Elements::cut(&[side()], 1.0, 7).unwrap();
        elements.leaves[2].unshot = Rgb::splat(5.0);
        let patch = elements.leaves[2].patch;
        let before = elements.unshot_exitance(patch);
        let parts = elements.split(2);
        assert_eq!(parts[0], 2);
        assert!((elements.unshot_exitance(patch) - before).length() < 1e-5);
        let area: f32 = elements.patches[patch as usize]
            .leaves
            .iter()
            .map(|&leaf| elements.leaves[leaf as usize].area)
            .sum();
        assert!((area - elements.patches[patch as usize].area).abs() < 1e-6);
        assert!(!elements.has_room(), "seven leaves are the limit");
    }
}
