//! What one tick may spend, and how sessions share it.

/// The part of its budgets that a tick may spend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Effort(f32);

impl Effort {
    /// All of it.
    pub(crate) const FULL: Self = Self(1.0);

    /// Nothing for a share that cannot be.
    pub(crate) fn new(share: f32) -> Option<Self> {
        (share > 0.0 && share <= 1.0).then_some(Self(share))
    }

    pub(crate) fn share(self) -> f32 {
        self.0
    }

    /// What it leaves of `most`, one at least.
    pub(crate) fn of(self, most: u32) -> u32 {
        // A share of a u32 is one.
        ((f64::from(most) * f64::from(self.0)) as u32).max(1)
    }
}

/// How one of those who wait counts among all who still do, itself included.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weight {
    pub(crate) own: u64,
    pub(crate) waiting: u64,
}

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

    /// What is left.
    pub(crate) fn left(self) -> u32 {
        self.left
    }

    /// The share of whoever's turn it is, rounded up: what it leaves goes to the others.
    pub(crate) fn share(self, weight: Weight) -> u32 {
        let share = (u64::from(self.left) * weight.own).div_ceil(weight.waiting.max(1));
        u32::try_from(share).unwrap_or(u32::MAX).min(self.left)
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
        for (most, parts) in
            [(10, vec![1, 1, 1]), (1, vec![1; 4]), (7, vec![1; 7]), (100, vec![1]), (32, vec![1, 1, 4])]
        {
            let mut budget = Budget::new(most);
            let mut waiting: u64 = parts.iter().sum();
            let mut total = 0;
            for own in parts {
                let share = budget.share(Weight { own, waiting });
                budget.spend(share);
                waiting -= own;
                total += share;
            }
            assert_eq!((total, budget.share(Weight { own: 1, waiting: 1 })), (most, 0));
        }
    }

    #[test]
    fn an_effort_is_a_part_of_a_budget_and_never_nothing() {
        let half = Effort::new(0.5).unwrap();
        assert_eq!([half.of(10), half.of(1), Effort::FULL.of(u32::MAX)], [5, 1, u32::MAX]);
        assert!([0.0, -1.0, 1.1, f32::NAN].map(Effort::new).iter().all(Option::is_none));
    }

    #[test]
    fn who_counts_more_gets_more() {
        let budget = Budget::new(30);
        assert_eq!(budget.share(Weight { own: 1, waiting: 6 }), 5);
        assert_eq!(budget.share(Weight { own: 4, waiting: 6 }), 20);
    }

    #[test]
    fn everyone_is_first_in_turn() {
        assert_eq!(rotated(&[1, 2, 3], 4), [2, 3, 1]);
        assert!(rotated::<u8>(&[], 4).is_empty());
    }
}
