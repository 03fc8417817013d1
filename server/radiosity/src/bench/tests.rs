//! The bench itself: that it measures what it says.

use super::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Goal: DESIGN's promise, error at most 1e-5 where the sources' update is off by tens of percent.
/// Method: the bench, 2,000 swaps of 120 slots in blocks of 7, a clock that only counts.
#[test]
fn exact_updates_stay_exact_and_truncated_ones_do_not() {
    let ticks = AtomicU32::new(0);
    let clock = || f64::from(ticks.fetch_add(1, Ordering::Relaxed));
    let figures =
        measure_matrix(MatrixBenchParams { m: 120, swaps: 2_000, block: 7, seed: 1, clock: &clock })
            .expect("a small bench");
    assert!(figures.exact_error_rel < 1e-5 && figures.exact_frobenius_rel < 1e-5, "{figures:?}");
    assert!(figures.drift_rel < 1e-5 && figures.repairs == 0, "{figures:?}");
    assert!(figures.truncated_error_rel > 0.1, "{figures:?}");
    assert!((2e-5..2e-3).contains(&figures.halved_error_rel), "{figures:?}");
    let swaps: Vec<u32> = figures.curve.iter().map(|point| point.swaps).collect();
    assert_eq!(swaps, [10, 100, 1_000, 2_000]);
    assert!((figures.timing.add_ms - 1_000.0 / 7.0).abs() < 1e-9, "one tick for seven patches");
    assert_eq!(figures.one_core.threads, 1);
    assert!((1..=30).contains(&figures.timing.seen_columns), "{}", figures.timing.seen_columns);
}

#[test]
fn a_bench_of_nothing_is_an_error() {
    let params = MatrixBenchParams { m: 0, swaps: 1, block: 1, seed: 1, clock: &|| 0.0 };
    assert_eq!(measure_matrix(params), Err(MatrixBenchError::Capacity(CapacityError::Zero)));
}
