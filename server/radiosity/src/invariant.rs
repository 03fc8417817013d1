//! What every set of form factors must obey, each under its own name.
//!
//! The bake and `inspect` call these; the error says which invariant, where and by how much.

/// A broken invariant.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Violation {
    /// A share below zero, above one, or not a number.
    #[error("share {share} of row {row}, column {column} is not within 0..=1")]
    Share {
        /// Row.
        row: usize,
        /// Column.
        column: usize,
        /// The offender.
        share: f32,
    },
    /// Patches, sky and absorbed do not add up to one.
    #[error("row {row} sums to {sum}, not to 1")]
    RowSum {
        /// Row.
        row: usize,
        /// What it sums to.
        sum: f64,
    },
    /// `A_i F_ij` differs from `A_j F_ji`.
    #[error("patches {row} and {column} exchange {forth} m2 one way and {back} m2 the other")]
    Reciprocity {
        /// `i`.
        row: usize,
        /// `j`.
        column: usize,
        /// `A_i F_ij`, m2.
        forth: f64,
        /// `A_j F_ji`, m2.
        back: f64,
    },
}

/// How far a row may be from one.
pub const ROW_SUM_TOLERANCE: f64 = 1e-3;

/// Every share of `shares` (column, share) is within 0..=1.
///
/// # Errors
/// [`Violation::Share`], the first.
pub fn shares_are_shares(
    row: usize,
    shares: impl IntoIterator<Item = (usize, f32)>,
) -> Result<(), Violation> {
    match shares.into_iter().find(|(_, share)| !(0.0..=1.0).contains(share)) {
        Some((column, share)) => Err(Violation::Share { row, column, share }),
        None => Ok(()),
    }
}

/// `sum` of row `row`, all parts of it, is one within [`ROW_SUM_TOLERANCE`].
///
/// # Errors
/// [`Violation::RowSum`], also for a sum that is not a number.
pub fn row_sums_to_one(row: usize, sum: f64) -> Result<(), Violation> {
    if (sum - 1.0).abs() <= ROW_SUM_TOLERANCE { Ok(()) } else { Err(Violation::RowSum { row, sum }) }
}

/// `A_i F_ij = A_j F_ji` within `tolerance` of the larger; `forth` and `back` are (area m2, share).
///
/// # Errors
/// [`Violation::Reciprocity`], also for numbers that are none.
pub fn exchange_is_mutual(
    row: usize,
    column: usize,
    forth: (f32, f32),
    back: (f32, f32),
    tolerance: f64,
) -> Result<(), Violation> {
    let exchange = |(area, share): (f32, f32)| f64::from(area) * f64::from(share);
    let (forth, back) = (exchange(forth), exchange(back));
    if (forth - back).abs() <= tolerance * forth.max(back) {
        Ok(())
    } else {
        Err(Violation::Reciprocity { row, column, forth, back })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_invariant_is_named_when_it_breaks() {
        assert_eq!(shares_are_shares(1, [(0, 0.0), (1, 1.0)]), Ok(()));
        let error = shares_are_shares(1, [(0, 0.5), (7, -0.1)]).expect_err("negative");
        assert_eq!(error, Violation::Share { row: 1, column: 7, share: -0.1 });
        assert!(shares_are_shares(1, [(0, f32::NAN)]).is_err());
        assert!(row_sums_to_one(0, 1.0009).is_ok() && row_sums_to_one(0, 1.0011).is_err());
        assert!(row_sums_to_one(0, f64::NAN).is_err());
        assert!(exchange_is_mutual(0, 1, (2.0, 0.1), (1.0, 0.2), 1e-6).is_ok());
        let error = exchange_is_mutual(0, 1, (2.0, 0.1), (1.0, 0.3), 1e-2).expect_err("one-sided");
        assert!(error.to_string().contains("0 and 1 exchange 0.2"), "{error}");
    }
}
