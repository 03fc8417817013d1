//! Flux that has been shot and has not been told to its receivers yet: [`Flux`].
//!
//! Shooters scatter over their rows, so two of them may hit one receiver at once. A round with many form factors is dealt to
//! [`GROUPS`] groups by their number alone, each with an account of its own, and accounts are added up in turn: the same
//! bits on any number of threads.

use super::links::LinkRows;
use super::{Light, add_scaled};
use rayon::prelude::*;

/// Accounts of a large round.
const GROUPS: usize = 8;
/// Form factors from which on a round is large: below, adding up accounts takes longer than is won.
const LARGE_ROUND: u64 = 1 << 17;
/// Receivers a task takes.
const RECEIVERS_A_TASK: usize = 4096;

/// A patch that shoots, and its flux in lm.
pub(crate) type Shooter = (u32, Light);

/// Flux by receiver, lm.
#[derive(Debug, Clone)]
pub(crate) struct Flux {
    /// The first holds what is asked for; the others are zero but within [`Flux::send`].
    accounts: Vec<Vec<Light>>,
}

impl Flux {
    pub(crate) fn new(capacity: usize) -> Self {
        Self { accounts: vec![vec![[0.0; 4]; capacity]] }
    }

    /// What has arrived, by slot; whoever folds it into light zeroes it.
    pub(crate) fn arrived(&mut self) -> &mut [Light] {
        &mut self.accounts[0]
    }

    /// Sends all of `shooters`, whose rows hold `link_count` form factors.
    pub(crate) fn send(&mut self, links: &LinkRows, shooters: &[Shooter], link_count: u64) {
        if link_count < LARGE_ROUND {
            scatter(links, shooters, &mut self.accounts[0]);
            return;
        }
        let capacity = links.capacity();
        self.accounts.resize_with(GROUPS, || vec![[0.0; 4]; capacity]);
        let groups = shooters.par_chunks(shooters.len().div_ceil(GROUPS));
        self.accounts
            .par_iter_mut()
            .zip(groups)
            .for_each(|(account, shooters)| scatter(links, shooters, account));
        let (first, others) = self.accounts.split_at_mut(1);
        for other in others {
            let parts = other.par_chunks_mut(RECEIVERS_A_TASK);
            first[0].par_chunks_mut(RECEIVERS_A_TASK).zip(parts).for_each(|(sums, terms)| {
                for (sum, term) in sums.iter_mut().zip(&mut *terms) {
                    add_scaled(sum, 1.0, term);
                }
                terms.fill([0.0; 4]);
            });
        }
    }
}

fn scatter(links: &LinkRows, shooters: &[Shooter], account: &mut [Light]) {
    for (slot, flux) in shooters {
        for link in links.row(*slot as usize) {
            add_scaled(&mut account[link.slot as usize], link.share, flux);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::Rgb;

    /// Goal: groups change nothing but rounding, and threads not even that. Method: a large round, against one account.
    #[test]
    fn a_large_round_is_the_same_on_any_number_of_threads() {
        const COUNT: usize = 700;
        let mut links = LinkRows::new(COUNT);
        for slot in 0..COUNT {
            links.add(slot, 1.0, Rgb::ZERO, (0..slot).map(|other| (other, 1e-3)));
        }
        let shooters: Vec<Shooter> = (0..COUNT as u32).map(|slot| (slot, [slot as f32; 4])).collect();
        let link_count = links.link_count() as u64;
        assert!(link_count > LARGE_ROUND, "{link_count}");
        let sent = |threads| {
            let mut flux = Flux::new(COUNT);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| (0..2).for_each(|_| flux.send(&links, &shooters, link_count)));
            flux.arrived().to_vec()
        };
        let (one, two) = (sent(1), sent(3));
        assert_eq!(one, two);
        for (slot, found) in one.iter().enumerate() {
            let exact = 2e-3 * ((COUNT * (COUNT - 1) / 2) as f64 - slot as f64);
            assert!((f64::from(found[0]) - exact).abs() < 1e-5 * exact, "{slot}: {found:?}, {exact}");
        }
    }
}
