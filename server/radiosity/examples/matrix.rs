//! Temporary.
use earthshine_radiosity::bench::*;
fn main() {
    let a: Vec<u32> = std::env::args().skip(1).map(|a| a.parse().unwrap()).collect();
    let t = std::time::Instant::now();
    let wall = || t.elapsed().as_secs_f64();
    let cpu = || {
        std::fs::read_dir("/proc/self/task")
            .unwrap()
            .map(|d| {
                let s = std::fs::read_to_string(d.unwrap().path().join("schedstat")).unwrap();
                s.split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-9
            })
            .sum::<f64>()
    };
    let clock: &dyn Fn() -> f64 = if a[3] == 1 { &cpu } else { &wall };
    let f = measure_matrix(MatrixBenchParams { m: a[0], swaps: a[1], block: a[2], seed: 1, clock }).unwrap();
    println!(
        "swap {:.2} patch {:.3} add {:.3} remove {:.3} product {:.2} copy {:.2} total {:.1}s",
        f.swap_ms,
        f.block_patch_ms,
        f.block_add_ms,
        f.block_remove_ms,
        f.product_gb_s,
        f.copy_gb_s,
        wall()
    );
}
