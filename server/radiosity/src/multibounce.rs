//! The multibounce matrix `H = F (Id - R F)^-1` of a whole scene, in `f64`: slow, plain, the oracle.
//!
//! Exitance in, irradiance out; the receiver's reflectance is not in it. The sources also write a matrix
//! that holds it (their chapter 3); the add and remove of the local matrix fit this one.
//! By pushing the inverse through, `H = (Id - F R)^-1 F`: one solve with `F` on the right.

use crate::dense::{DenseError, DenseMatrix, LuFactors};

/// `Id - F R`.
///
/// # Errors
/// [`DenseError::Memory`].
///
/// # Panics
/// If there is not one reflectance a patch.
pub fn system(form_factors: &DenseMatrix, reflectance: &[f64]) -> Result<DenseMatrix, DenseError> {
    let n = form_factors.rows();
    assert_eq!((form_factors.columns(), reflectance.len()), (n, n), "one reflectance a patch");
    DenseMatrix::from_fn(n, n, |i, j| f64::from(u8::from(i == j)) - form_factors.row(i)[j] * reflectance[j])
}

/// All bounces at once, by elimination.
///
/// # Errors
/// [`DenseError::Singular`] if a closed loop loses no light; [`DenseError::Memory`].
///
/// # Panics
/// If there is not one reflectance a patch.
pub fn multibounce(form_factors: &DenseMatrix, reflectance: &[f64]) -> Result<DenseMatrix, DenseError> {
    let factors = LuFactors::new(system(form_factors, reflectance)?)?;
    let mut matrix = form_factors.clone();
    factors.solve(&mut matrix);
    Ok(matrix)
}

/// The first `bounces` terms of `F + F R F + F R F R F + ...`: light that has met 0, 1, 2 ... mirrors on its way.
///
/// # Errors
/// [`DenseError::Memory`].
///
/// # Panics
/// If there is not one reflectance a patch.
pub fn series(
    form_factors: &DenseMatrix,
    reflectance: &[f64],
    bounces: u32,
) -> Result<DenseMatrix, DenseError> {
    let n = form_factors.rows();
    assert_eq!((form_factors.columns(), reflectance.len()), (n, n), "one reflectance a patch");
    let mut matrix = DenseMatrix::zeros(n, n)?;
    for _ in 0..bounces {
        let mut next = form_factors.clone();
        for i in 0..n {
            for (k, reflectance) in reflectance.iter().enumerate() {
                let factor = form_factors.row(i)[k] * reflectance;
                for (entry, term) in next.row_mut(i).iter_mut().zip(matrix.row(k)) {
                    *entry += factor * term;
                }
            }
        }
        matrix = next;
    }
    Ok(matrix)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_box::ClosedBox;

    /// Goal: energy is kept. Method: a closed box of one reflectance and one emission is uniformly bright,
    /// `B = E / (1 - rho)`, so `I = E / (1 - rho)` less the residue of the box's row sums.
    #[test]
    fn a_white_furnace_is_uniform() {
        let room = ClosedBox::new(150, 3);
        let form_factors = room.dense_form_factors().expect("small");
        for reflectance in [0.0, 0.5, 0.8] {
            let matrix = multibounce(&form_factors, &[reflectance; 150]).expect("regular");
            for irradiance in matrix.multiply(&[1.0; 150]) {
                let exitance = 1.0 + reflectance * irradiance;
                assert!((exitance * (1.0 - reflectance) - 1.0).abs() < 1e-4, "{reflectance}: {exitance}");
            }
        }
    }

    #[test]
    fn the_series_converges_to_the_solve() {
        let room = ClosedBox::new(60, 4);
        let form_factors = room.dense_form_factors().expect("small");
        let reflectance: Vec<f64> = (0..60).map(|i| 0.2 + 0.01 * f64::from(i)).collect();
        let solved = multibounce(&form_factors, &reflectance).expect("regular");
        let distance =
            |bounces| series(&form_factors, &reflectance, bounces).expect("small").relative_distance(&solved);
        assert!(distance(1) > 0.2 && distance(5) < distance(1) && distance(80) < 1e-8, "{}", distance(80));
    }
}
