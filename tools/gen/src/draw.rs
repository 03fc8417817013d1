//! Random choices of a world: each is a hash of (seed, place, use, index), never the next of a sequence.
//!
//! Adding a choice therefore changes no other one.

use earthshine_world::random::{Purpose, hash, unit_f32};

/// What a random number decides.
#[derive(Debug, Clone, Copy)]
#[repr(u32)]
pub(crate) enum Use {
    Paint = 1,
    Pillar,
    Furniture,
    BlockKind,
    HouseSize,
    HouseShape,
    RoomShape,
    RoomPaint,
    RoomLamp,
    Tree,
    Car,
    Square,
    Foliage,
    Stone,
    Goods,
}

/// The choices of one place of one world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Draw {
    seed: u64,
    place: u64,
}

impl Draw {
    /// Choices of the whole world.
    pub(crate) fn of_world(seed: u64) -> Self {
        Self { seed, place: u64::MAX }
    }

    /// Choices of one cell.
    pub(crate) fn of_cell(seed: u64, (x, z): (i32, i32)) -> Self {
        Self { seed, place: (u64::from(x.cast_unsigned()) << 32) | u64::from(z.cast_unsigned()) }
    }

    fn bits(self, what: Use, index: u32) -> u64 {
        hash(self.seed, Purpose::WorldShape, self.place, ((what as u64) << 32) | u64::from(index))
    }

    /// In `[least, most)`.
    pub(crate) fn between(self, what: Use, index: u32, least: f32, most: f32) -> f32 {
        least + (most - least) * unit_f32(self.bits(what, index))
    }

    /// In `0..count`.
    pub(crate) fn below(self, what: Use, index: u32, count: u32) -> u32 {
        (((self.bits(what, index) >> 32) * u64::from(count)) >> 32) as u32
    }

    /// True with `probability`.
    pub(crate) fn chance(self, what: Use, index: u32, probability: f32) -> bool {
        unit_f32(self.bits(what, index)) < probability
    }

    /// One of `choices`, which are at least one.
    pub(crate) fn pick<T: Copy>(self, what: Use, index: u32, choices: &[T]) -> T {
        choices[self.below(what, index, choices.len() as u32) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_stay_in_range_and_differ_by_place_and_use() {
        let draw = Draw::of_cell(3, (-1, 2));
        assert!((0..1000).all(|i| draw.below(Use::Paint, i, 7) < 7));
        assert!((0..7).all(|wanted| (0..1000).any(|i| draw.below(Use::Paint, i, 7) == wanted)));
        assert_ne!(draw.bits(Use::Paint, 0), draw.bits(Use::Pillar, 0));
        assert_ne!(draw.bits(Use::Paint, 0), Draw::of_cell(3, (2, -1)).bits(Use::Paint, 0));
    }
}
