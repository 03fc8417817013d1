//! Follows a ray down a tree of `obvhs`, with the widest instructions that the machine has.
//!
//! `obvhs` tests the eight boxes of a node four at a time and turns their bytes into numbers one by one, as machines without
//! AVX2 have to. Where a machine has it all eight are tested at once here, by the same sums:
//! of finite numbers, bit for bit the same boxes are met (tested below), in the same order.

use glam::UVec2;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ray::Ray;

/// How a node's boxes are tested.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Follower {
    /// By `obvhs`.
    Portable,
    /// Eight at once.
    #[cfg(target_arch = "x86_64")]
    Wide(wide::Wide),
}

impl Follower {
    /// The fastest of this machine.
    pub(crate) fn available() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(wide) = wide::Wide::available() {
            return Self::Wide(wide);
        }
        Self::Portable
    }

    /// Gives `leaf` the place of every leaf of `tree` whose box `ray` meets; it may shorten the ray. Ends early where `leaf`
    /// says so, and says whether it did.
    #[inline]
    pub(crate) fn follow(self, tree: &CwBvh, ray: &mut Ray, leaf: impl FnMut(u32, &mut Ray) -> bool) -> bool {
        match self {
            Self::Portable => portable(tree, ray, leaf),
            #[cfg(target_arch = "x86_64")]
            Self::Wide(wide) => wide.follow(tree, ray, leaf),
        }
    }
}

fn portable(tree: &CwBvh, ray: &mut Ray, mut leaf: impl FnMut(u32, &mut Ray) -> bool) -> bool {
    let mut state = tree.new_traversal(ray.direction);
    let mut node: &CwBvhNode;
    obvhs::traverse!(tree, node, state, node.intersect_ray(ray, state.oct_inv4), {
        if leaf(state.primitive_id, ray) {
            return true;
        }
    });
    false
}

/// By AVX2.
#[cfg(target_arch = "x86_64")]
mod wide {
    use super::{CwBvh, CwBvhNode, Ray, UVec2};
    use glam::Vec3A;
    use std::arch::x86_64::*;

    /// Proof that the machine has AVX2 and what came with it.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Wide(());

    /// Where the planes of boxes begin in a node, in eights of bytes: lower, then upper ones, axis by axis.
    const PLANES: usize = 4;
    /// Boxes that end nearer are skipped, as `obvhs` does.
    const NEAREST: f32 = 1e-4;

    impl Wide {
        pub(super) fn available() -> Option<Self> {
            let has_all = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("lzcnt")
                && is_x86_feature_detected!("popcnt");
            has_all.then_some(Self(()))
        }

        #[inline]
        pub(super) fn follow(
            self,
            tree: &CwBvh,
            ray: &mut Ray,
            leaf: impl FnMut(u32, &mut Ray) -> bool,
        ) -> bool {
            // SAFETY: `self` exists, so the processor has these instructions.
            unsafe { follow(tree, ray, leaf) }
        }

        /// As [`CwBvhNode::intersect_ray`].
        #[cfg(test)]
        pub(super) fn met(self, node: &CwBvhNode, ray: &Ray, octant: u32) -> u32 {
            // SAFETY: `self` exists, so the processor has these instructions.
            unsafe { met(node, ray, upper_first(ray), octant) }
        }
    }

    #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
    fn follow(tree: &CwBvh, ray: &mut Ray, mut leaf: impl FnMut(u32, &mut Ray) -> bool) -> bool {
        let mut state = tree.new_traversal(ray.direction);
        let mut node: &CwBvhNode;
        let upper_first = upper_first(ray);
        obvhs::traverse!(tree, node, state, met(node, ray, upper_first, state.oct_inv4), {
            if leaf(state.primitive_id, ray) {
                return true;
            }
        });
        false
    }

    /// Along which axes a ray comes to the upper planes first: 1 for those.
    fn upper_first(ray: &Ray) -> [usize; 3] {
        ray.direction.to_array().map(|along| usize::from(along < 0.0))
    }

    /// What of `node` the ray meets, in the bits of [`CwBvhNode::intersect_ray`].
    #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
    #[inline]
    fn met(node: &CwBvhNode, ray: &Ray, upper_first: [usize; 3], octant: u32) -> u32 {
        let scale = (node.compute_extent() * ray.inv_direction).to_array();
        let origin = ((Vec3A::from(node.p) - ray.origin) * ray.inv_direction).to_array();
        let eights: &[[u8; 8]; 10] = bytemuck::cast_ref(node);
        let (mut near, mut far) = (_mm256_set1_ps(NEAREST), _mm256_set1_ps(ray.tmax));
        for axis in 0..3 {
            let (scale, origin) = (_mm256_set1_ps(scale[axis]), _mm256_set1_ps(origin[axis]));
            let distances = |upper: usize| {
                let planes = widened(eights[PLANES + 2 * axis + (upper & 1)]);
                _mm256_add_ps(_mm256_mul_ps(_mm256_cvtepi32_ps(planes), scale), origin)
            };
            near = _mm256_max_ps(near, distances(upper_first[axis]));
            far = _mm256_min_ps(far, distances(upper_first[axis] ^ 1));
        }
        let is_met = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far));
        let (bits, places) = node.get_child_and_index_bits(octant);
        let bits = _mm256_sllv_epi32(widened(bits.to_le_bytes()), widened(places.to_le_bytes()));
        let eight = _mm256_and_si256(bits, is_met);
        let four = _mm_or_si128(_mm256_castsi256_si128(eight), _mm256_extracti128_si256::<1>(eight));
        let two = _mm_or_si128(four, _mm_unpackhi_epi64(four, four));
        let one = _mm_or_si128(two, _mm_shuffle_epi32::<1>(two));
        _mm_cvtsi128_si32(one).cast_unsigned()
    }

    #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
    #[inline]
    fn widened(bytes: [u8; 8]) -> __m256i {
        _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(i64::from_le_bytes(bytes)))
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::build_tree;
    use earthshine_light::ray_triangle::ray;
    use earthshine_world::Vec3;
    use earthshine_world::random::{Purpose, hash, unit_f32};
    use obvhs::aabb::Aabb;

    fn draw(index: u64, part: u64) -> Vec3 {
        let one = |axis| unit_f32(hash(3, Purpose::RowRay, index, 3 * part + axis));
        Vec3::new(one(0), one(1), one(2))
    }

    /// Goal: eight boxes at once are the boxes that `obvhs` meets, for rays from inside and outside, along axes, short and long.
    #[test]
    fn the_same_boxes_are_met() {
        let Some(wide) = wide::Wide::available() else { return };
        let boxes: Vec<Aabb> = (0..3000)
            .map(|index| {
                let low = 20.0 * draw(index, 0) - 10.0;
                Aabb { min: low.into(), max: (low + 0.7 * draw(index, 1)).into() }
            })
            .collect();
        let tree = build_tree(&boxes);
        let (mut met, mut missed) = (0, 0);
        for index in 0..400 {
            let direction =
                if index % 4 == 0 { Vec3::AXES[index as usize / 4 % 3] } else { 2.0 * draw(index, 3) - 1.0 };
            let direction = (if index % 8 == 0 { -direction } else { direction }).normalize_or(Vec3::X);
            let length = if index % 3 == 0 { 2.0 } else { f32::INFINITY };
            let ray = ray(24.0 * draw(index, 2) - 12.0, direction, 0.0, length);
            let octant = tree.new_traversal(ray.direction).oct_inv4;
            for node in &tree.nodes {
                let expected = node.intersect_ray(&ray, octant);
                assert_eq!(wide.met(node, &ray, octant), expected, "{ray:?} {node:?}");
                *(if expected == 0 { &mut missed } else { &mut met }) += 1;
            }
        }
        assert!(met > 1000 && missed > 1000, "{met} met, {missed} missed");
    }

    /// Goal: a machine without AVX2 finds the same leaves in the same order.
    #[test]
    fn both_ways_come_by_the_same_leaves() {
        let boxes: Vec<Aabb> = (0..500)
            .map(|index| {
                let low = 4.0 * draw(index, 0);
                Aabb { min: low.into(), max: (low + 0.5).into() }
            })
            .collect();
        let tree = build_tree(&boxes);
        for index in 0..100 {
            let ways = [Follower::Portable, Follower::available()].map(|follower| {
                let mut ray =
                    ray(4.0 * draw(index, 1), (draw(index, 2) - 0.5).normalize_or(Vec3::X), 0.0, 9.0);
                let mut leaves = Vec::new();
                let is_ended = follower.follow(&tree, &mut ray, |leaf, ray| {
                    leaves.push(leaf);
                    ray.tmax *= 0.97;
                    leaves.len() == 12
                });
                (leaves, is_ended)
            });
            assert_eq!(ways[0], ways[1]);
        }
    }
}
