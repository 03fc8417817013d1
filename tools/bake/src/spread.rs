//! How the rays of one row spread over the unit square that directions are made from.
//!
//! Pairs of numbers by index; what is done with them is the caster's business. Consecutive runs of R2 and Sobol
//! pairs are as well spread as the whole, so that every sample of a patch sees its own share of the hemisphere
//! evenly; the stratified cells come in a random order instead.

use earthshine_tiles::RaySpread;
use earthshine_trace::hemisphere::spread_pair;
use earthshine_world::random::{Purpose, hash, unit_pair};

/// The pairs of one row.
#[derive(Debug, Clone, Copy)]
pub struct Spread {
    kind: RaySpread,
    seed: u64,
    key: u64,
    shift: (f32, f32),
    /// Columns and rows of the grid of cells; one of each where there is none.
    cells: (u32, u32),
}

impl Spread {
    /// `count` pairs, their random part by `seed` and `key`. More may be asked for, except of a stratified spread,
    /// which then repeats its cells.
    #[must_use]
    pub fn new(kind: RaySpread, count: u32, seed: u64, key: u64) -> Self {
        let columns = f64::from(count.max(1)).sqrt().ceil() as u32;
        let cells = (columns, count.max(1).div_ceil(columns));
        Self { kind, seed, key, shift: unit_pair(hash(seed, Purpose::RowRay, key, 0)), cells }
    }

    /// What consecutive pairs of the R2 sequence are shifted by, if that is all there is to them.
    #[must_use]
    pub fn shift(&self) -> Option<(f32, f32)> {
        (self.kind == RaySpread::R2).then_some(self.shift)
    }

    /// Pair `index`, each number in `[0, 1)`.
    #[must_use]
    pub fn pair(&self, index: u32) -> (f32, f32) {
        let random = || hash(self.seed, Purpose::RowRay, self.key, 1 + u64::from(index));
        match self.kind {
            RaySpread::R2 => spread_pair(index, self.shift.0, self.shift.1),
            RaySpread::White => unit_pair(random()),
            RaySpread::Stratified => {
                let (columns, rows) = self.cells;
                let scramble = hash(self.seed, Purpose::RowRay, self.key, 0) as u32;
                let cell = permuted(index % (columns * rows), columns * rows, scramble);
                let (u, v) = unit_pair(random());
                let within = |cell: u32, offset: f32, count: u32| {
                    ((cell as f32 + offset) / count as f32).min(1.0 - f32::EPSILON)
                };
                (within(cell % columns, u, columns), within(cell / columns, v, rows))
            }
            RaySpread::Sobol => {
                let bits = hash(self.seed, Purpose::RowRay, self.key, 0);
                let first = scrambled(index.reverse_bits(), bits as u32);
                let second = scrambled(sobol_second(index), (bits >> 32) as u32);
                (unit(first), unit(second))
            }
        }
    }
}

fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / (1u32 << 24) as f32)
}

/// The second dimension of Sobol's sequence: direction numbers `v_k = v_(k-1) ^ (v_(k-1) >> 1)`.
fn sobol_second(mut index: u32) -> u32 {
    let (mut value, mut direction) = (0, 1u32 << 31);
    while index != 0 {
        if index & 1 == 1 {
            value ^= direction;
        }
        index >>= 1;
        direction ^= direction >> 1;
    }
    value
}

/// Owen's scrambling by a hash in which no bit depends on a lower one (S. Laine, T. Karras 2011; constants of
/// B. Burley, Practical Hash-based Owen Scrambling, 2020).
fn scrambled(value: u32, seed: u32) -> u32 {
    let mut x = value.reverse_bits();
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// Where `index` comes in a random order of `0..count` (A. Kensler, Correlated Multi-Jittered Sampling, 2013).
fn permuted(index: u32, count: u32, seed: u32) -> u32 {
    let mask = count.next_power_of_two().wrapping_sub(1).max(1);
    let mut i = index;
    loop {
        i ^= seed;
        i = i.wrapping_mul(0xe170_893d);
        i ^= seed >> 16;
        i ^= (i & mask) >> 4;
        i ^= seed >> 8;
        i = i.wrapping_mul(0x0929_eb3f);
        i ^= seed >> 23;
        i ^= (i & mask) >> 1;
        i = i.wrapping_mul(1 | seed >> 27);
        i = i.wrapping_mul(0x6935_fa69);
        i ^= (i & mask) >> 11;
        i = i.wrapping_mul(0x74dc_b303);
        i ^= (i & mask) >> 2;
        i = i.wrapping_mul(0x9e50_1cc3);
        i ^= (i & mask) >> 2;
        i = i.wrapping_mul(0xc860_a3df);
        i &= mask;
        i ^= i >> 5;
        if i < count {
            return ((u64::from(i) + u64::from(seed)) % u64::from(count)) as u32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: [RaySpread; 4] = [RaySpread::R2, RaySpread::Sobol, RaySpread::Stratified, RaySpread::White];

    #[test]
    fn all_spreads_are_uniform() {
        for kind in KINDS {
            let spread = Spread::new(kind, 4096, 3, 77);
            let (mut sum, mut product) = ([0.0f64; 2], 0.0f64);
            for index in 0..4096 {
                let (u, v) = spread.pair(index);
                assert!((0.0..1.0).contains(&u) && (0.0..1.0).contains(&v), "{kind:?}");
                sum = [sum[0] + f64::from(u), sum[1] + f64::from(v)];
                product += f64::from(u) * f64::from(v);
            }
            for mean in [sum[0] / 4096.0 - 0.5, sum[1] / 4096.0 - 0.5, product / 4096.0 - 0.25] {
                assert!(mean.abs() < 0.015, "{kind:?}: {mean}");
            }
        }
    }

    #[test]
    fn every_cell_of_a_grid_gets_its_one_ray() {
        // Sobol: any aligned run of 64 is a net, scrambled or not.
        let runs = [(RaySpread::Sobol, 0), (RaySpread::Sobol, 192), (RaySpread::Stratified, 0)];
        for (kind, first) in runs {
            let spread = Spread::new(kind, 64, 5, 11);
            let mut seen = [0u32; 64];
            for index in first..first + 64 {
                let (u, v) = spread.pair(index);
                seen[(u * 8.0) as usize * 8 + (v * 8.0) as usize] += 1;
            }
            assert_eq!(seen, [1; 64], "{kind:?} from {first}");
        }
    }

    #[test]
    fn permutations_are_permutations() {
        for count in [1, 2, 6, 64, 100] {
            let mut seen: Vec<u32> = (0..count).map(|i| permuted(i, count, 0xdead_beef)).collect();
            seen.sort_unstable();
            assert_eq!(seen, (0..count).collect::<Vec<_>>());
        }
    }
}
