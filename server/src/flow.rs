//! How much may be on its way to one client, and where its next delta starts.

use std::collections::VecDeque;

/// What one client has been sent and what it says it holds.
#[derive(Debug)]
pub(crate) struct Flow {
    held: u64,
    in_flight: VecDeque<u64>,
    in_flight_max: usize,
}

/// An ack of a generation that was never sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct UnknownGeneration;

impl Flow {
    /// Nothing sent, nothing held.
    pub(crate) fn new(in_flight_max: u32) -> Self {
        Self { held: 0, in_flight: VecDeque::new(), in_flight_max: in_flight_max as usize }
    }

    /// Whether another delta may go out.
    pub(crate) fn has_room(&self) -> bool {
        self.in_flight.len() < self.in_flight_max
    }

    /// Whether all that was sent is acknowledged.
    pub(crate) fn is_empty(&self) -> bool {
        self.in_flight.is_empty()
    }

    /// The generation from which the next delta starts.
    pub(crate) fn held(&self) -> u64 {
        self.held
    }

    /// The generation that the client holds once all that is on its way has come.
    pub(crate) fn newest(&self) -> u64 {
        self.in_flight.back().copied().unwrap_or(self.held)
    }

    /// A delta to `generation` went out.
    pub(crate) fn sent(&mut self, generation: u64) {
        self.in_flight.push_back(generation);
    }

    /// The client holds `generation`. Less than before means that it lost what it had: it is sent again.
    pub(crate) fn acknowledge(&mut self, generation: u64) -> Result<(), UnknownGeneration> {
        if generation > self.newest() {
            return Err(UnknownGeneration);
        }
        if generation < self.held || generation == 0 {
            self.in_flight.clear();
        } else {
            self.in_flight.retain(|&sent| sent > generation);
        }
        self.held = generation;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acks_make_room_and_move_the_start() {
        let mut flow = Flow::new(2);
        flow.sent(3);
        assert!(flow.has_room());
        flow.sent(5);
        assert!(!flow.has_room());
        assert_eq!(flow.held(), 0);
        flow.acknowledge(3).unwrap();
        assert!(flow.has_room());
        assert_eq!(flow.held(), 3);
        assert_eq!(flow.acknowledge(6), Err(UnknownGeneration));
        assert_eq!(flow.held(), 3);
    }

    #[test]
    fn a_client_that_lost_its_light_may_say_so() {
        let mut flow = Flow::new(1);
        flow.sent(9);
        flow.acknowledge(9).unwrap();
        flow.sent(10);
        flow.acknowledge(0).unwrap();
        assert!(flow.has_room());
        assert_eq!(flow.held(), 0);
    }
}
