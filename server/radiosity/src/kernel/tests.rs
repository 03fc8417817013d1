//! The shared kernel on every instruction set of this machine against the plain loop.

use super::*;
use earthshine_world::random::{Purpose, hash, unit_f32};

const STRIDE: usize = 112;
const ROWS: usize = 72;
const DEPTH: usize = 16;

fn numbers(seed: u64, count: usize) -> Vec<f32> {
    (0..count as u64).map(|i| unit_f32(hash(seed, Purpose::Simulation, i, 0)) - 0.5).collect()
}

fn assert_close(actual: &[f32], expected: &[f64], set: InstructionSet) {
    for (at, (&actual, &expected)) in actual.iter().zip(expected).enumerate() {
        assert!((f64::from(actual) - expected).abs() < 1e-5, "{set:?} at {at}: {actual} for {expected}");
    }
}

/// `[rows][columns]` to tiles of `TILE` columns.
fn packed(matrix: &[f32], stride: usize, rows: usize, tiles: usize) -> Vec<f32> {
    let mut out = Vec::new();
    for tile in 0..tiles {
        for row in 0..rows {
            out.extend_from_slice(&matrix[row * stride + tile * f32::TILE..][..f32::TILE]);
        }
    }
    out
}

#[test]
fn rank_update_is_the_plain_product() {
    let (coefficients, panel) = (numbers(1, ROWS * DEPTH), numbers(2, DEPTH * STRIDE));
    let panels = packed(&panel, STRIDE, DEPTH, 2);
    let mut expected: Vec<f64> = vec![0.25; ROWS * STRIDE];
    for (i, j) in (0..ROWS).flat_map(|i| (32..96).map(move |j| (i, j))) {
        expected[i * STRIDE + j] += (0..DEPTH)
            .map(|k| f64::from(coefficients[i * DEPTH + k]) * f64::from(panel[k * STRIDE + j - 32]))
            .sum::<f64>();
    }
    for set in InstructionSet::available() {
        let mut out = vec![0.25f32; ROWS * STRIDE];
        let kernel = RankUpdate {
            out: &mut out,
            stride: STRIDE,
            first_column: 32,
            coefficients: &coefficients,
            coefficient_stride: DEPTH,
            depth: DEPTH,
            panels: &panels,
            panel_stride: DEPTH * f32::TILE,
        };
        f32::dispatch(set, kernel);
        assert_close(&out, &expected, set);
    }
}
