//! How many ticks a second this machine makes while there is as much to do as a tick may: what a promise can count on.
//!
//! At rest ticks are short and say nothing, so only those that added at least half of the patches that a tick may are measured. The
//! engine is told when the rate has changed by much.

/// Part of a tick's adds from which on it counts as busy.
const BUSY_SHARE: f64 = 0.5;
/// Busy ticks that a mean reaches back over.
const MEMORY_TICKS: f64 = 64.0;
/// Busy ticks before anything is said.
const TICKS_MIN: u32 = 16;
/// Relative change of the rate that is told.
const CHANGE_MIN: f64 = 0.1;

/// The mean of busy ticks.
#[derive(Debug)]
pub(crate) struct Pace {
    most_hz: f64,
    told_hz: f64,
    mean_s: f64,
    busy_ticks: u32,
}

impl Pace {
    /// Ticks come at `most_hz` at most, and the engine counts on that.
    pub(crate) fn new(most_hz: f64) -> Self {
        Self { most_hz, told_hz: most_hz, mean_s: 0.0, busy_ticks: 0 }
    }

    /// What the engine was told last, Hz.
    pub(crate) fn told_hz(&self) -> f32 {
        self.told_hz as f32
    }

    /// A tick took `tick_s` and added `adds` of at most `adds_max` patches. Returns the rate, Hz, where it is to be told.
    pub(crate) fn note(&mut self, tick_s: f64, adds: u64, adds_max: u32) -> Option<f32> {
        if (adds as f64) < BUSY_SHARE * f64::from(adds_max) {
            return None;
        }
        self.busy_ticks = self.busy_ticks.saturating_add(1);
        let weight = (1.0 / f64::from(self.busy_ticks)).max(1.0 / MEMORY_TICKS);
        self.mean_s += weight * (tick_s - self.mean_s);
        let rate_hz = (1.0 / self.mean_s.max(1e-9)).min(self.most_hz);
        let has_changed = (rate_hz / self.told_hz - 1.0).abs() > CHANGE_MIN;
        (self.busy_ticks >= TICKS_MIN && has_changed).then(|| {
            self.told_hz = rate_hz;
            rate_hz as f32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn busy_ticks_tell_the_rate_and_idle_ones_do_not() {
        let mut pace = Pace::new(60.0);
        let mut told = |tick_s: f64, adds: u64, ticks: u32| {
            (0..ticks).filter_map(|_| pace.note(tick_s, adds, 32)).collect::<Vec<f32>>()
        };
        assert_eq!(told(0.01, 32, 100), [], "faster than they come");
        assert_eq!(told(0.5, 3, 100), [], "too little to do");
        let slower = told(0.04, 30, 500);
        assert!((22.5..28.0).contains(slower.last().unwrap()), "{slower:?}");
        assert!(slower.len() < 8 && slower.is_sorted_by(|a, b| a > b), "{slower:?}");
        let back = told(0.01, 20, 1000);
        assert!(back.is_sorted_by(|a, b| a < b) && *back.last().unwrap() > 54.0, "{back:?}");
    }

    #[test]
    fn a_few_slow_ticks_at_the_start_say_nothing() {
        let mut pace = Pace::new(60.0);
        assert!((0..TICKS_MIN - 1).all(|_| pace.note(1.0, 32, 32).is_none()));
    }
}
