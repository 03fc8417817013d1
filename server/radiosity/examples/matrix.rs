//! Temporary.
use earthshine_radiosity::bench::*;
fn main() {
    let a: Vec<u32> = std::env::args().skip(1).map(|a| a.parse().unwrap()).collect();
    let t = std::time::Instant::now();
    let clock = || t.elapsed().as_secs_f64();
    let f = measure_matrix(MatrixBenchParams { m: a[0], swaps: a[1], block: a[2], seed: 1, clock: &clock }).unwrap();
    println!("{f:#?} total {:.1}s", clock());
}
