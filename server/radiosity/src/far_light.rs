//! Far light: what reaches the resident patches from those that are not, through their coarse parents.
//!
//! ```text
//! g = F_far B_coarse + sky             far columns, each with the exitance of its parent
//! I = H (E + R g) + g                  far light is one more source and bounces among the residents
//! ```
//!
//! This is the whole-level form of it, for proofs and benches: rows of everything, one subset resident. The engine
//! keeps the same sums slot by slot. It knows parents as numbers only: who is whose is the pyramid's business.

use crate::gather::{GatherLimits, GatherReport, Sources, SparseRows, SparseRowsError, gather};
use earthshine_world::Rgb;
use rayon::prelude::*;

/// Some patches of a level, and the rows among them.
#[derive(Debug, Clone)]
pub struct ResidentSet {
    patches: Vec<u32>,
    is_resident: Vec<bool>,
    rows: SparseRows,
}

impl ResidentSet {
    /// `patches` of `all`, in this order from now on.
    ///
    /// # Errors
    /// [`SparseRowsError::Column`] if there is no such patch; none is named twice, or its light would count twice.
    pub fn new(all: &SparseRows, patches: Vec<u32>) -> Result<Self, SparseRowsError> {
        const OUTSIDE: u32 = u32::MAX;
        let mut slots = vec![OUTSIDE; all.row_count()];
        for (slot, &patch) in patches.iter().enumerate() {
            match slots.get_mut(patch as usize) {
                Some(free) if *free == OUTSIDE => *free = slot as u32,
                _ => {
                    return Err(SparseRowsError::Column {
                        entry: slot,
                        column: patch,
                        rows: all.row_count(),
                    });
                }
            }
        }
        let (mut starts, mut columns, mut shares) = (vec![0], Vec::new(), Vec::new());
        for &patch in &patches {
            let (of_row, shares_of_row) = all.row(patch as usize);
            for (&column, &share) in of_row.iter().zip(shares_of_row) {
                if slots[column as usize] != OUTSIDE {
                    columns.push(slots[column as usize]);
                    shares.push(share);
                }
            }
            starts.push(columns.len());
        }
        let is_resident = slots.iter().map(|&slot| slot != OUTSIDE).collect();
        Ok(Self { patches, is_resident, rows: SparseRows::new(starts, columns, shares)? })
    }

    /// The patches, in the order of everything that this type returns.
    #[must_use]
    pub fn patches(&self) -> &[u32] {
        &self.patches
    }

    /// Whether `patch` is one of them.
    ///
    /// # Panics
    /// If there is no such patch.
    #[must_use]
    pub fn contains(&self, patch: u32) -> bool {
        self.is_resident[patch as usize]
    }

    /// Share of each row that leads to patches which are not resident.
    #[must_use]
    pub fn far_shares(&self, all: &SparseRows) -> Vec<f32> {
        self.far_sums(all, |_| Rgb::ONE).into_iter().map(|sum| sum.x).collect()
    }

    /// `F_far B`: what arrives from the patches that are not resident if each sends `exitance` (by patch of the whole
    /// level: its parent's), lx.
    ///
    /// # Panics
    /// If `exitance` has not one value a patch of the level.
    #[must_use]
    pub fn far_irradiance(&self, all: &SparseRows, exitance: &[Rgb]) -> Vec<Rgb> {
        assert_eq!(exitance.len(), all.row_count(), "one value a patch");
        self.far_sums(all, |column| exitance[column as usize])
    }

    fn far_sums(&self, all: &SparseRows, of: impl Fn(u32) -> Rgb + Sync) -> Vec<Rgb> {
        self.patches
            .par_iter()
            .map(|&patch| {
                let (columns, shares) = all.row(patch as usize);
                let mut sum = Rgb::ZERO.as_dvec3();
                for (&column, &share) in columns.iter().zip(shares) {
                    if !self.is_resident[column as usize] {
                        sum += of(column).as_dvec3() * f64::from(share);
                    }
                }
                sum.as_vec3()
            })
            .collect()
    }

    /// `I = H (E + R g) + g` among the residents, by iterated gathers, lx. Every argument is in the set's own order.
    ///
    /// # Panics
    /// If an argument has not one value a resident.
    #[must_use]
    pub fn solve(&self, sources: Sources<'_>, limits: GatherLimits) -> (Vec<Rgb>, GatherReport) {
        let mut irradiance = vec![Rgb::ZERO; self.patches.len()];
        let report = gather(&self.rows, sources, &mut irradiance, limits);
        (irradiance, report)
    }

    /// The values of `all` that belong to residents.
    ///
    /// # Panics
    /// If `all` has not one value a patch of the level.
    #[must_use]
    pub fn pick<T: Copy>(&self, all: &[T]) -> Vec<T> {
        assert_eq!(all.len(), self.is_resident.len(), "one value a patch");
        self.patches.iter().map(|&patch| all[patch as usize]).collect()
    }
}

/// Means over each parent's children, weighted by area: exitance of a coarse patch from that of fine ones.
///
/// # Panics
/// If the slices differ in length, or a parent is not below `parent_count`.
#[must_use]
pub fn mean_over_children(values: &[Rgb], areas: &[f32], parents: &[u32], parent_count: usize) -> Vec<Rgb> {
    assert_eq!((values.len(), areas.len()), (parents.len(), parents.len()), "one parent a patch");
    let mut sums = vec![(Rgb::ZERO.as_dvec3(), 0.0f64); parent_count];
    for ((value, &area), &parent) in values.iter().zip(areas).zip(parents) {
        let (sum, total) = &mut sums[parent as usize];
        *sum += value.as_dvec3() * f64::from(area);
        *total += f64::from(area);
    }
    sums.into_iter()
        .map(|(sum, total)| if total > 0.0 { (sum / total).as_vec3() } else { Rgb::ZERO })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::{Backend, Slot, Update};
    use crate::closed_box::ClosedBox;
    use crate::cpu::CpuBackend;

    const COUNT: usize = 240;
    const LIMITS: GatherLimits = GatherLimits { tolerance: 1e-7, iterations_max: 2000 };

    fn room() -> (ClosedBox, SparseRows, Vec<Rgb>, Vec<Rgb>) {
        let room = ClosedBox::new(COUNT, 5);
        let (mut starts, mut columns, mut shares) = (vec![0], Vec::new(), Vec::new());
        for i in 0..room.len() {
            for j in (0..room.len()).filter(|&j| room.form_factor(i, j) > 0.0) {
                columns.push(j as u32);
                shares.push(room.form_factor(i, j));
            }
            starts.push(columns.len());
        }
        let rows = SparseRows::new(starts, columns, shares).expect("rows of a box");
        let exitance = (0..room.len()).map(|i| Rgb::new(i as f32 % 7.0, 1.0, (i % 3) as f32)).collect();
        let reflectance = (0..room.len()).map(|i| room.reflectance(i)).collect();
        (room, rows, exitance, reflectance)
    }

    fn whole(rows: &SparseRows, exitance: &[Rgb], reflectance: &[Rgb]) -> Vec<Rgb> {
        let mut irradiance = vec![Rgb::ZERO; rows.row_count()];
        let dark = vec![Rgb::ZERO; rows.row_count()];
        let sources = Sources { direct_exitance: exitance, reflectance, outside_irradiance: &dark };
        assert!(gather(rows, sources, &mut irradiance, LIMITS).converged);
        irradiance
    }

    /// Goal: the formula itself. Method: every far patch sends its own true exitance, so that nothing is
    /// approximated: residents must have the light of the whole box, by gathers and by the local matrix.
    #[test]
    fn with_true_exitance_far_light_is_the_whole_solve() {
        let (room, rows, exitance, reflectance) = room();
        let truth = whole(&rows, &exitance, &reflectance);
        let leaving: Vec<Rgb> = (0..room.len()).map(|i| exitance[i] + reflectance[i] * truth[i]).collect();
        let set =
            ResidentSet::new(&rows, (0..room.len() as u32).step_by(3).rev().collect()).expect("a subset");
        let far = set.far_irradiance(&rows, &leaving);
        let (direct, own) = (set.pick(&exitance), set.pick(&reflectance));
        let sources = Sources { direct_exitance: &direct, reflectance: &own, outside_irradiance: &far };
        let (gathered, report) = set.solve(sources, LIMITS);
        assert!(report.converged);

        let mut backend = CpuBackend::new(set.patches().len() as u32).expect("a small matrix");
        for (slot, &patch) in set.patches().iter().enumerate() {
            let (mut row, mut column) = (Vec::new(), Vec::new());
            for (other, &with) in set.patches()[..slot].iter().enumerate() {
                row.push((Slot(other as u32), room.form_factor(patch as usize, with as usize)));
                column.push((Slot(other as u32), room.form_factor(with as usize, patch as usize)));
            }
            let (reflectance, area) = (own[slot], room.area(patch as usize));
            let add = Update::Add { slot: Slot(slot as u32), reflectance, area, row, column };
            backend.apply(&[add]).expect("a free slot");
        }
        let slots: Vec<Slot> = (0..set.patches().len() as u32).map(Slot).collect();
        backend.set_sources(&slots, &direct, &far).expect("finite light");
        backend.step().expect("the CPU steps");
        let mut stepped = vec![Rgb::ZERO; slots.len()];
        backend.read_irradiance(&slots, &mut stepped).expect("taken slots");
        for (slot, expected) in set.pick(&truth).into_iter().enumerate() {
            assert!((gathered[slot] - expected).length() < 1e-4 * expected.length(), "gathered {slot}");
            assert!((stepped[slot] - expected).length() < 1e-4 * expected.length(), "stepped {slot}");
        }
    }

    #[test]
    fn far_shares_are_what_is_not_resident() {
        let (room, rows, ..) = room();
        let set = ResidentSet::new(&rows, vec![7, 3]).expect("a pair");
        let far = set.far_shares(&rows);
        let expected = 1.0 - room.form_factor(7, 3) - room.form_factor(7, 7);
        assert!((far[0] - expected).abs() < 1e-5, "{far:?}, {expected}");
        assert!(set.contains(3) && !set.contains(4));
        assert!(ResidentSet::new(&rows, vec![3, 3]).is_err());
        assert!(ResidentSet::new(&rows, vec![COUNT as u32]).is_err());
    }

    #[test]
    fn a_parent_sends_what_its_children_send_together() {
        let values = [Rgb::splat(1.0), Rgb::splat(4.0), Rgb::splat(9.0)];
        let means = mean_over_children(&values, &[2.0, 1.0, 5.0], &[1, 1, 0], 3);
        assert_eq!(means, [Rgb::splat(9.0), Rgb::splat(2.0), Rgb::ZERO]);
    }
}
