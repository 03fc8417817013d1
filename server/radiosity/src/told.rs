//! [`Told`]: what the host was told of each slot's light, and so what is news to it.
//!
//! For backends whose light is in main memory: they compare to the bit. A device compares the codes that will be
//! published (`earthshine-gpu`'s `news`).

use crate::backend::Slot;
use earthshine_world::Rgb;

/// The light of each slot as it was told last; not a number where nothing was told of the patch that is there.
#[derive(Debug, Clone, Default)]
pub struct Told(Vec<Rgb>);

impl Told {
    /// Nothing told of any of `slots` slots.
    #[must_use]
    pub fn new(slots: usize) -> Self {
        Self(vec![Rgb::NAN; slots])
    }

    /// Another patch comes into `slot`, or none is there any more.
    pub fn forget(&mut self, slot: usize) {
        self.0[slot] = Rgb::NAN;
    }

    /// As [`Self::forget`], of all slots.
    pub fn forget_all(&mut self) {
        self.0.fill(Rgb::NAN);
    }

    /// Appends those of `lights` to `news` that differ from what was told, and takes them for told. O(slots given).
    pub fn tell(&mut self, lights: impl Iterator<Item = (Slot, Rgb)>, news: &mut Vec<(Slot, Rgb)>) {
        for (slot, light) in lights {
            let told = &mut self.0[slot.0 as usize];
            // What is no number differs from everything.
            if *told != light {
                *told = light;
                news.push((slot, light));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_from_what_was_told_is_news_and_a_newcomer_always_is() {
        let mut told = Told::new(3);
        let tell = |told: &mut Told, lights: [f32; 3]| {
            let mut news = Vec::new();
            told.tell((0..3).map(|slot| (Slot(slot), Rgb::splat(lights[slot as usize]))), &mut news);
            news.iter().map(|&(slot, light)| (slot.0, light.x)).collect::<Vec<_>>()
        };
        assert_eq!(tell(&mut told, [0.0, 1.0, 2.0]), [(0, 0.0), (1, 1.0), (2, 2.0)], "darkness is news, too");
        assert_eq!(tell(&mut told, [0.0, 1.0, 2.0]), []);
        assert_eq!(tell(&mut told, [0.0, 1.0f32.next_up(), 2.0]), [(1, 1.0f32.next_up())]);
        told.forget(2);
        assert_eq!(tell(&mut told, [0.0, 1.0f32.next_up(), 2.0]), [(2, 2.0)]);
        told.forget_all();
        assert_eq!(tell(&mut told, [0.0, 1.0, 2.0]).len(), 3);
    }
}
