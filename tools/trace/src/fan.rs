//! Fans: rays from one place over the hemisphere about a normal, by the cosine, that a device can make by itself.
//!
//! A fan says in 48 bytes what takes 32 for each of its rays. The pairs of numbers behind the directions are those of
//! [`spread_pair`]; [`RayFan::query`] is the one rule for rays cast here, and the twin of
//! `shaders/wgsl/kernels/make_rays.wgsl`, whose sines differ in the last bits.

use crate::caster::Query;
use crate::hemisphere::{cosine_direction, spread_pair};
use earthshine_world::Vec3;

/// Rays from one place, by consecutive pairs of one shifted R2 sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayFan {
    /// m.
    pub origin: Vec3,
    /// Unit.
    pub normal: Vec3,
    /// Of the sequence.
    pub shift: (f32, f32),
    /// Number of the first ray's pair.
    pub first_pair: u32,
    /// Rays.
    pub ray_count: u32,
}

/// The rays of a question.
#[derive(Debug, Clone, PartialEq)]
pub enum Rays {
    /// One by one.
    Made(Vec<Query>),
    /// For the device to make.
    Fans(Vec<RayFan>),
}

impl RayFan {
    /// Ray `ray` of the fan.
    #[must_use]
    pub fn query(&self, ray: u32) -> Query {
        let (u, v) = spread_pair(self.first_pair.wrapping_add(ray), self.shift.0, self.shift.1);
        let direction = cosine_direction(self.normal, u, v);
        Query { origin: self.origin, direction, distance_max: f32::INFINITY }
    }
}

impl Rays {
    /// How many there are.
    #[must_use]
    pub fn count(&self) -> usize {
        match self {
            Self::Made(rays) => rays.len(),
            Self::Fans(fans) => fans.iter().map(|fan| fan.ray_count as usize).sum(),
        }
    }

    /// All of them, one by one.
    #[must_use]
    pub fn queries(&self) -> Vec<Query> {
        match self {
            Self::Made(rays) => rays.clone(),
            Self::Fans(fans) => {
                fans.iter().flat_map(|fan| (0..fan.ray_count).map(|ray| fan.query(ray))).collect()
            }
        }
    }

    /// Puts `others` behind them.
    ///
    /// # Panics
    /// If they are of the other kind, unless there are none yet.
    pub fn append(&mut self, others: Self) {
        match (&mut *self, others) {
            (Self::Made(rays), Self::Made(others)) => rays.extend(others),
            (Self::Fans(fans), Self::Fans(others)) => fans.extend(others),
            (_, others) => {
                assert!(self.count() == 0, "rays of one question are of one kind");
                *self = others;
            }
        }
    }
}

impl Default for Rays {
    fn default() -> Self {
        Self::Fans(Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fan_goes_on_where_another_ends() {
        let shift = (0.2, 0.9);
        let fan = |first_pair: u32, ray_count: u32| {
            let (origin, normal) = (Vec3::ONE, Vec3::Y);
            Rays::Fans(vec![RayFan { origin, normal, shift, first_pair, ray_count }])
        };
        let mut rays = Rays::default();
        rays.append(fan(u32::MAX, 3));
        rays.append(fan(2, 0));
        rays.append(fan(2, 2));
        let whole = fan(u32::MAX, 5).queries();
        assert_eq!((rays.count(), rays.queries()), (5, whole.clone()));
        assert!(whole.iter().all(|ray| ray.direction.y > 0.0 && ray.direction.is_normalized()));
    }
}
