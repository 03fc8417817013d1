//! What is known of resident patches whoever computes their light: rows of form factors, and where light comes from.

use super::Light;
use super::links::LinkRows;

/// Rows and sources, by slot. Light in free slots is none.
#[derive(Debug, Clone)]
pub struct Residents {
    /// Who is there, and who sees whom.
    pub links: LinkRows,
    /// Direct exitance, lm/m2.
    pub direct: Vec<Light>,
    /// Irradiance from outside the resident set, lx.
    pub outside: Vec<Light>,
    /// What of it is the sky's, lx.
    pub sky: Vec<Light>,
    /// The sky's share of the row, 0..=1.
    pub sky_shares: Vec<f32>,
}

impl Residents {
    /// Nobody, in `capacity` slots.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        let dark = vec![[0.0; 4]; capacity];
        Self {
            links: LinkRows::new(capacity),
            direct: dark.clone(),
            outside: dark.clone(),
            sky: dark,
            sky_shares: vec![0.0; capacity],
        }
    }

    /// The patch in `slot` leaves.
    pub fn remove(&mut self, slot: usize) {
        self.links.remove(slot);
        for light in [&mut self.direct, &mut self.outside, &mut self.sky] {
            light[slot] = [0.0; 4];
        }
        self.sky_shares[slot] = 0.0;
    }

    /// All patches leave.
    pub(crate) fn clear(&mut self) {
        self.links.clear();
        for light in [&mut self.direct, &mut self.outside, &mut self.sky] {
            light.fill([0.0; 4]);
        }
        self.sky_shares.fill(0.0);
    }
}
