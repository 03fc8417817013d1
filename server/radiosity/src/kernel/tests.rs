//! Every kernel on every instruction set of this machine against the plain loop.

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

#[test]
fn gathered_columns_are_the_plain_product() {
    let matrix = numbers(3, ROWS * STRIDE);
    let columns: Vec<u32> = (0..STRIDE as u32).filter(|j| j % 3 != 1).collect();
    let panel = numbers(4, columns.len() * f32::TILE);
    let mut expected = vec![0.0f64; ROWS * f32::TILE];
    for (i, lane) in (0..ROWS).flat_map(|i| (0..f32::TILE).map(move |lane| (i, lane))) {
        let terms = columns.iter().enumerate().map(|(k, &j)| {
            f64::from(matrix[i * STRIDE + j as usize]) * f64::from(panel[k * f32::TILE + lane])
        });
        expected[i * f32::TILE + lane] = terms.sum();
    }
    for set in InstructionSet::available() {
        let mut out = vec![9.0f32; ROWS * f32::TILE];
        let kernel = GatherColumns {
            matrix: &matrix,
            stride: STRIDE,
            columns: &columns,
            panel: &panel,
            out: &mut out,
        };
        f32::dispatch(set, kernel);
        assert_close(&out, &expected, set);
    }
}

#[test]
fn scattered_rows_are_the_plain_product() {
    let matrix = numbers(5, ROWS * STRIDE);
    let rows: Vec<u32> = (0..ROWS as u32).filter(|i| i % 31 != 4).collect();
    let coefficients = numbers(6, DEPTH * rows.len());
    let mut expected = vec![0.0f64; DEPTH * STRIDE];
    for (b, j) in (0..DEPTH).flat_map(|b| (0..STRIDE - 32).map(move |j| (b, j))) {
        let terms = rows.iter().enumerate().map(|(k, &i)| {
            f64::from(coefficients[k * DEPTH + b]) * f64::from(matrix[i as usize * STRIDE + j + 32])
        });
        expected[b * STRIDE + j] = terms.sum();
    }
    let expected: Vec<f32> = expected.iter().map(|&value| value as f32).collect();
    let expected: Vec<f64> = packed(&expected, STRIDE, DEPTH, 2).iter().map(|&v| f64::from(v)).collect();
    for set in InstructionSet::available() {
        let mut out = vec![0.0f32; 2 * DEPTH * f32::TILE];
        let kernel = ScatterRows {
            matrix: &matrix,
            stride: STRIDE,
            first_column: 32,
            rows: &rows,
            coefficients: &coefficients,
            depth: DEPTH,
            out: &mut out,
        };
        f32::dispatch(set, kernel);
        assert_close(&out, &expected, set);
    }
}

#[test]
fn row_products_skip_dark_tiles() {
    let matrix = numbers(7, ROWS * STRIDE);
    let mut vector = numbers(8, STRIDE);
    vector[32..64].fill(0.0);
    vector[96..].fill(0.0);
    let runs = [0..1, 2..3];
    let expected: Vec<f64> = (0..ROWS)
        .map(|i| (0..STRIDE).map(|j| f64::from(matrix[i * STRIDE + j]) * f64::from(vector[j])).sum())
        .collect();
    for set in InstructionSet::available() {
        let mut out = vec![7.0f64; ROWS];
        let kernel =
            RowProducts { matrix: &matrix, stride: STRIDE, vector: &vector, runs: &runs, out: &mut out };
        f32::dispatch(set, kernel);
        let out: Vec<f32> = out.iter().map(|&value| value as f32).collect();
        assert_close(&out, &expected, set);
    }
}
