//! When somebody who has refused to compute light is asked again. The one place that decides it: devices only say no.

/// After a refusal the CPU does the work so many times before somebody else is asked again: looking for room that is not
/// there costs time too.
const LEFT_TO_CPU: u32 = 64;

/// Of one whom work is handed to.
#[derive(Debug, Default)]
pub(crate) struct Refusals {
    left_to_cpu: u32,
}

impl Refusals {
    /// It has refused.
    pub(crate) fn note(&mut self) {
        self.left_to_cpu = LEFT_TO_CPU;
    }

    /// Whether it may be asked now; if not, the CPU does the work this once.
    pub(crate) fn may_ask(&mut self) -> bool {
        let may_ask = self.left_to_cpu == 0;
        self.left_to_cpu = self.left_to_cpu.saturating_sub(1);
        may_ask
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_leaves_a_while_to_the_cpu() {
        let mut refusals = Refusals::default();
        assert!(refusals.may_ask() && refusals.may_ask());
        refusals.note();
        assert!((0..LEFT_TO_CPU).all(|_| !refusals.may_ask()));
        assert!(refusals.may_ask());
    }
}
