//! Draws from rows of the multibounce matrix: all bounces at once, in colour, without feedback.
//!
//! ```text
//! I = H (E + rho g) + g        weight of j: mean over channels of H_ij; what a draw of j brings: H_ij / weight * (E_j + rho_j g_j)
//! ```
//!
//! Rows of form factors have no colour, rows of `H` have three. One table serves all channels: a draw carries the tint of its
//! item, so colours stay together and a third of the draws does. The sources' second way to sample; it needs the matrix.

use super::Light;
use crate::backend::Slot;
use crate::local_matrix::LocalMatrix;
use crate::tables::draw::{Spread, random};
use crate::tables::{BuildRoom, RowTable, TableError};

/// A row of the multibounce matrix to draw from.
#[derive(Debug, Clone, Default)]
pub struct ColouredRow<T> {
    table: T,
    slots: Vec<u32>,
    /// Of each item: its channels over their mean.
    tints: Vec<Light>,
}

impl<T: RowTable> ColouredRow<T> {
    /// The row of `slot`; taken slots are its items. O(slots).
    ///
    /// # Errors
    /// [`TableError`]: the matrix has gone wrong.
    pub fn new(matrix: &LocalMatrix, slot: Slot, room: &mut BuildRoom) -> Result<Self, TableError> {
        let (mut row, mut weights) = (Self::default(), Vec::new());
        for other in matrix.taken_slots() {
            let shares = [0, 1, 2].map(|channel| matrix.entry(channel, slot, other));
            let mean = (shares[0] + shares[1] + shares[2]) / 3.0;
            if mean > 0.0 {
                row.slots.push(other.0);
                row.tints.push([shares[0] / mean, shares[1] / mean, shares[2] / mean, 0.0]);
                weights.push(mean);
            }
        }
        row.table.rebuild(&weights, room)?;
        Ok(row)
    }

    /// Irradiance from `samples` draws with key `key`; `first` is `E + rho g` by slot, `outside` is `g` of this row.
    #[must_use]
    pub fn drawn(&self, first: &[Light], outside: &Light, key: u32, samples: u32, spread: Spread) -> Light {
        let mut sum = [0.0f32; 4];
        if !self.slots.is_empty() {
            for sample in 0..samples {
                let item = self.table.draw(random(key, sample, samples, spread));
                let (tint, light) = (&self.tints[item], &first[self.slots[item] as usize]);
                for channel in 0..3 {
                    sum[channel] += tint[channel] * light[channel];
                }
            }
        }
        let scale = self.table.total() / samples as f32;
        std::array::from_fn(|channel| sum[channel] * scale + outside[channel])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::Backend;
    use crate::bench::Streamed;
    use crate::closed_box::ClosedBox;
    use crate::cpu::CpuBackend;
    use crate::tables::draw::row_key;
    use crate::tables::{AliasTable, CdfTable};
    use earthshine_world::Rgb;

    const COUNT: u32 = 90;

    /// Mean light of some rows over many frames of draws, and what the matrix says.
    fn means<T: RowTable>(spread: Spread) -> (Vec<Rgb>, Vec<Rgb>) {
        let mut streamed = Streamed::new(ClosedBox::new(COUNT as usize, 4), COUNT as usize, 4);
        let mut backend = CpuBackend::new(COUNT).expect("a small matrix");
        backend.apply(&streamed.enter(COUNT as usize)).expect("free slots");
        let slots = streamed.taken();
        let direct: Vec<Rgb> = (0..COUNT).map(|i| Rgb::new(1.0, (i % 3) as f32, (i % 5) as f32)).collect();
        let outside = vec![Rgb::new(0.3, 0.2, 0.1); COUNT as usize];
        backend.set_sources(&slots, &direct, &outside).expect("taken slots");
        backend.step().expect("the CPU steps");
        let mut exact = vec![Rgb::ZERO; COUNT as usize];
        backend.read_irradiance(&slots, &mut exact).expect("taken slots");
        let first: Vec<Light> = slots
            .iter()
            .map(|&slot| {
                let at = slot.0 as usize;
                let reflectance = backend.matrix().reflectance(slot);
                crate::solver::light(direct[at] + reflectance * outside[at])
            })
            .collect();
        let mean = |&slot: &Slot| {
            let row = ColouredRow::<T>::new(backend.matrix(), slot, &mut BuildRoom::default());
            let (row, at) = (row.expect("a sound matrix"), slot.0 as usize);
            let frames = (0..2000).map(|frame| {
                let key = row_key(1, frame, slot.0);
                crate::solver::rgb(row.drawn(&first, &crate::solver::light(outside[at]), key, 16, spread))
            });
            frames.sum::<Rgb>() / 2000.0
        };
        (slots.iter().step_by(9).map(mean).collect(), exact.into_iter().step_by(9).collect())
    }

    #[test]
    fn draws_of_matrix_rows_are_the_matrix_on_average_in_every_channel() {
        for (means, exact) in
            [means::<AliasTable>(Spread::Independent), means::<CdfTable>(Spread::Systematic)]
        {
            for (mean, exact) in means.iter().zip(&exact) {
                assert!(((*mean - *exact) / *exact).abs().max_element() < 0.02, "{mean} {exact}");
            }
        }
    }
}
