//! What one tick may spend, and how sessions share it.

/// What is left of one kind of work in this tick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Budget {
    left: u32,
}

impl Budget {
    /// A fresh tick's.
    pub(crate) fn new(most: u32) -> Self {
        Self { left: most }
    }

    /// An even share for the first of `waiting` sessions, rounded up: what it leaves goes to the others.
    pub(crate) fn share(self, waiting: usize) -> u32 {
        self.left.div_ceil(u32::try_from(waiting.max(1)).unwrap_or(u32::MAX))
    }

    /// Takes `amount`; the last piece of work may go beyond what is left.
    pub(crate) fn spend(&mut self, amount: u32) {
        self.left = self.left.saturating_sub(amount);
    }
}

/// The order in which sessions are served: another one is first each tick, so that none starves.
pub(crate) fn rotated<T: Copy>(waiting: &[T], tick: u64) -> Vec<T> {
    let mut order = waiting.to_vec();
    if !order.is_empty() {
        let first = usize::try_from(tick % order.len() as u64).expect("a remainder is below a usize");
        order.rotate_left(first);
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_add_up_to_the_budget() {
        for (most, waiting) in [(10, 3), (1, 4), (7, 7), (100, 1)] {
            let mut budget = Budget::new(most);
            let total: u32 = (1..=waiting)
                .rev()
                .map(|left| {
                    let share = budget.share(left);
                    budget.spend(share);
                    share
                })
                .sum();
            assert_eq!((total, budget.share(1)), (most, 0));
        }
    }

    #[test]
    fn everyone_is_first_in_turn() {
        assert_eq!(rotated(&[1, 2, 3], 4), [2, 3, 1]);
        assert!(rotated::<u8>(&[], 4).is_empty());
    }
}
