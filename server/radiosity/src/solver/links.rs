//! Form factors between resident patches that grow and shrink in place: [`LinkRows`].
//!
//! A link of row `i` is `(j, F_ij)`. By reciprocity row `j` has a link to `i`, so a column is read off its own row:
//! `F_ij = A_j F_ji / A_i`, and who leaves is struck from the rows it names.

use crate::tables::masses;
use earthshine_world::Rgb;
use rayon::prelude::*;

/// Rows that a task sums at least.
const ROWS_A_TASK: usize = 64;

/// One form factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// The column's slot.
    pub slot: u32,
    /// `F_ij`, 0..=1.
    pub share: f32,
}

/// Rows, areas and reflectances of the patches in their slots.
#[derive(Debug, Clone)]
pub struct LinkRows {
    rows: Vec<Vec<Link>>,
    /// m2; 0 where a slot is free.
    areas: Vec<f32>,
    reflectance: Vec<Rgb>,
    /// Sums of rows, what is left of one; not a number where the row has changed since.
    outside_shares: Vec<f32>,
    /// How often each slot has been left.
    tenancies: Vec<u32>,
    link_count: usize,
    taken_count: usize,
}

impl LinkRows {
    /// Nobody, in `capacity` slots.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self {
            rows: vec![Vec::new(); capacity],
            areas: vec![0.0; capacity],
            reflectance: vec![Rgb::ZERO; capacity],
            outside_shares: vec![f32::NAN; capacity],
            tenancies: vec![0; capacity],
            link_count: 0,
            taken_count: 0,
        }
    }

    /// Slots, taken or not.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.rows.len()
    }

    /// Patches in slots.
    #[must_use]
    pub fn taken_count(&self) -> usize {
        self.taken_count
    }

    /// Links of all rows.
    #[must_use]
    pub fn link_count(&self) -> usize {
        self.link_count
    }

    /// Memory of the rows, room for more links included, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.rows.iter().map(|row| row.capacity() * size_of::<Link>()).sum()
    }

    /// Whether a patch holds `slot`.
    #[must_use]
    pub fn is_taken(&self, slot: usize) -> bool {
        self.areas[slot] > 0.0
    }

    /// m2; 0 for a free slot.
    #[must_use]
    pub fn area(&self, slot: usize) -> f32 {
        self.areas[slot]
    }

    /// Of the patch in `slot`.
    #[must_use]
    pub fn reflectance(&self, slot: usize) -> Rgb {
        self.reflectance[slot]
    }

    /// Tells the patch in `slot` from those that held the slot before it.
    #[must_use]
    pub fn tenancy(&self, slot: usize) -> u32 {
        self.tenancies[slot]
    }

    /// Links of the patch in `slot`.
    #[must_use]
    pub fn row(&self, slot: usize) -> &[Link] {
        &self.rows[slot]
    }

    /// What of the row of `slot` does not lead to residents: `F_0 = 1 - sum`, fed by what is far and by the sky. Rounding
    /// may carry it below zero: tables count that and take zero. The twin of the shaders' parallel sum, in its order: lanes of 256, then a tree.
    #[must_use]
    pub fn outside_share(&self, slot: usize, shares: &mut Vec<f32>) -> f32 {
        left_of(&self.rows[slot], shares)
    }

    /// [`Self::outside_share`] of every slot; rows that have not changed since the last call are not summed again.
    pub(crate) fn outside_shares(&mut self) -> &[f32] {
        let rows = &self.rows;
        let shares = self.outside_shares.par_iter_mut().with_min_len(ROWS_A_TASK).enumerate();
        shares.for_each_init(Vec::new, |room, (slot, share)| {
            if share.is_nan() {
                *share = left_of(&rows[slot], room);
            }
        });
        &self.outside_shares
    }

    /// A patch enters a free slot. `row` names slots, itself included; twice named, shares add up. Free slots are passed
    /// over: whoever a batch names may have been refused in it.
    pub fn add(&mut self, slot: usize, area: f32, reflectance: Rgb, row: impl Iterator<Item = (usize, f32)>) {
        self.areas[slot] = area;
        self.reflectance[slot] = reflectance;
        self.taken_count += 1;
        let mut own = std::mem::take(&mut self.rows[slot]);
        for (other, share) in row.filter(|&(other, share)| share > 0.0 && self.areas[other] > 0.0) {
            match own.iter_mut().rev().take(4).find(|link| link.slot == other as u32) {
                Some(link) => link.share += share,
                None => own.push(Link { slot: other as u32, share }),
            }
        }
        for link in own.iter().filter(|link| link.slot != slot as u32) {
            let other = link.slot as usize;
            self.rows[other].push(Link { slot: slot as u32, share: link.share * area / self.areas[other] });
            self.outside_shares[other] = f32::NAN;
            self.link_count += 1;
        }
        self.link_count += own.len();
        self.rows[slot] = own;
        self.outside_shares[slot] = f32::NAN;
    }

    /// All patches leave.
    pub(crate) fn clear(&mut self) {
        self.rows.iter_mut().for_each(Vec::clear);
        self.areas.fill(0.0);
        self.reflectance.fill(Rgb::ZERO);
        self.outside_shares.fill(f32::NAN);
        (self.link_count, self.taken_count) = (0, 0);
    }

    /// The patch in `slot` leaves. Returns its links.
    pub(crate) fn remove(&mut self, slot: usize) -> Vec<Link> {
        let own = std::mem::take(&mut self.rows[slot]);
        for link in own.iter().filter(|link| link.slot != slot as u32) {
            let row = &mut self.rows[link.slot as usize];
            let before = row.len();
            row.retain(|back| back.slot != slot as u32);
            self.link_count -= before - row.len();
            self.outside_shares[link.slot as usize] = f32::NAN;
        }
        self.link_count -= own.len();
        self.areas[slot] = 0.0;
        self.outside_shares[slot] = f32::NAN;
        self.reflectance[slot] = Rgb::ZERO;
        self.tenancies[slot] = self.tenancies[slot].wrapping_add(1);
        self.taken_count -= 1;
        own
    }
}

fn left_of(row: &[Link], shares: &mut Vec<f32>) -> f32 {
    shares.clear();
    shares.extend(row.iter().map(|link| link.share));
    1.0 - masses::total_of(shares)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_box::ClosedBox;

    /// Goal: rows stay reciprocal and counted. Method: a room filled, thinned and filled again.
    #[test]
    fn rows_follow_who_comes_and_goes() {
        let room = ClosedBox::new(60, 4);
        let mut rows = LinkRows::new(60);
        let enter = |rows: &mut LinkRows, i: usize| {
            let there: Vec<(usize, f32)> = (0..60)
                .filter(|&j| j == i || rows.is_taken(j))
                .map(|j| (j, room.form_factor(i, j)))
                .collect();
            rows.add(i, room.area(i), room.reflectance(i), there.into_iter());
        };
        (0..60).for_each(|i| enter(&mut rows, i));
        (0..60).step_by(3).for_each(|i| drop(rows.remove(i)));
        assert_eq!(rows.taken_count(), 40);
        (0..60).step_by(6).for_each(|i| enter(&mut rows, i));
        let mut count = 0;
        for i in 0..60 {
            for link in rows.row(i) {
                let j = link.slot as usize;
                assert!(rows.is_taken(j) && (link.share - room.form_factor(i, j)).abs() < 1e-6, "{i} {j}");
                count += 1;
            }
        }
        assert_eq!(count, rows.link_count());
        let seen: f32 = rows.row(1).iter().map(|link| link.share).sum();
        assert!((rows.outside_share(1, &mut Vec::new()) - (1.0 - seen)).abs() < 1e-6);
        // Kept sums follow as well.
        rows.outside_shares();
        rows.remove(4);
        let kept = rows.outside_shares().to_vec();
        for (slot, &kept) in kept.iter().enumerate() {
            assert_eq!(kept, rows.outside_share(slot, &mut Vec::new()), "{slot}");
        }
    }

    /// Goal: whoever names a free slot plants nothing in it.
    #[test]
    fn free_slots_are_passed_over() {
        let mut rows = LinkRows::new(2);
        rows.add(0, 1.0, Rgb::ONE, [(0, 0.25), (1, 0.5)].into_iter());
        assert_eq!((rows.link_count(), rows.row(0).len()), (1, 1));
        rows.add(1, 1.0, Rgb::ONE, [].into_iter());
        assert!(rows.row(1).is_empty());
    }
}
