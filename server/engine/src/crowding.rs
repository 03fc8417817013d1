//! How crowded a world is: how many patches lie how near to each other at its most crowded places.
//!
//! It is measured once, by the shell, which reads tiles; [`crate::promise`] makes of it what can be promised.

use earthshine_world::Vec3;

/// How crowded a world is: for each radius (m, ascending) the most patches of a level that lie within it of one place.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Crowding {
    radii_m: Vec<f32>,
    most_patches: Vec<u32>,
}

impl Crowding {
    /// Radii looked at.
    const RADII: usize = 96;
    /// The smallest and the largest of them, in voxels.
    const REACH_VOXELS: [f32; 2] = [0.5, 512.0];

    /// Nobody anywhere, for a world with voxels of `voxel_edge_m`.
    #[must_use]
    pub fn new(voxel_edge_m: f32) -> Self {
        let [from, to] = Self::REACH_VOXELS;
        let step = (to / from).powf(1.0 / (Self::RADII - 1) as f32);
        let radii_m = (0..Self::RADII).map(|at| voxel_edge_m * from * step.powi(at as i32)).collect();
        Self { radii_m, most_patches: vec![0; Self::RADII] }
    }

    /// Looks around each of `places` at `patches` (m). O(places x patches).
    pub fn look(&mut self, places: &[Vec3], patches: &[Vec3]) {
        for &place in places {
            let mut counts = vec![0u32; self.radii_m.len()];
            for patch in patches {
                let distance = patch.distance(place);
                if let Some(count) = counts.get_mut(self.radii_m.partition_point(|&radius| radius < distance))
                {
                    *count += 1;
                }
            }
            let mut within = 0;
            for (most, count) in self.most_patches.iter_mut().zip(counts) {
                within += count;
                *most = (*most).max(within);
            }
        }
    }

    /// The largest radius looked at for which `holds(radius, most patches within it)`, and for all smaller ones; zero for none.
    pub(crate) fn reach(&self, holds: impl Fn(f32, f32) -> bool) -> f32 {
        let radii = self.radii_m.iter().zip(&self.most_patches);
        radii
            .take_while(|&(&radius, &most)| holds(radius, most as f32))
            .last()
            .map_or(0.0, |(&radius, _)| radius)
    }

    /// The most patches within `radius_m` of one place.
    pub(crate) fn most_within(&self, radius_m: f32) -> f32 {
        let at = self.radii_m.partition_point(|&radius| radius < radius_m);
        self.most_patches.get(at).or(self.most_patches.last()).map_or(0.0, |&most| most as f32)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::f32::consts::PI;

    /// A plane with a patch every metre.
    pub(crate) fn plane() -> Crowding {
        let mut crowding = Crowding::new(1.0);
        let patches: Vec<Vec3> = (-60i16..60)
            .flat_map(|x| (-60i16..60).map(move |z| Vec3::new(f32::from(x), 0.0, f32::from(z))))
            .collect();
        crowding.look(&[Vec3::ZERO, Vec3::X * 55.0], &patches);
        crowding
    }

    #[test]
    fn crowding_counts_what_lies_within_at_the_most_crowded_place() {
        let crowding = plane();
        for radius in [3.0f32, 10.0, 40.0] {
            let found = crowding.most_within(radius);
            let disc = PI * radius * radius;
            assert!((0.85..1.35).contains(&(found / disc)), "{found} within {radius} m");
        }
        let far = crowding.reach(|_, most| most <= 2048.0);
        assert!((far / (2048.0 / PI).sqrt() - 1.0).abs() < 0.1, "{far}");
    }
}
