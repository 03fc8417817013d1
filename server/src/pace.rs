//! How long ticks take on this machine, and what follows: how much a tick may do so that the next one comes in time, and how many
//! whole ticks' work a second a promise can count on.
//!
//! A tick that takes longer than its period is followed by ones that may do less, down to [`EFFORT_MIN`]; as soon as they have time
//! to spare they may do more. What is left undone is done later. At rest ticks are short and say nothing of the rate, so
//! only those that spent at least half of what they might are measured. The engine is told of changes that matter.

/// Part of the period that a tick is to take at most: the rest is for frames on their way to clients.
const PERIOD_SHARE: f64 = 0.9;
/// Less than this part of its budgets no tick has: what a tick costs whatever it does would be all that is done.
const EFFORT_MIN: f64 = 0.5;
/// By how much one long tick, of which nobody knows whose fault it was, lessens the effort at most.
const STEP_DOWN_MAX: f64 = 0.85;
/// By how much one short tick that spent all it had raises it.
const STEP_UP: f64 = 1.02;
/// Part of a tick's effort from which on it counts as busy.
const BUSY_SHARE: f64 = 0.5;
/// Busy ticks that a mean reaches back over.
const MEMORY_TICKS: f64 = 64.0;
/// Busy ticks before anything is said of the rate.
const TICKS_MIN: u32 = 16;
/// Relative change of the rate that is told.
const RATE_CHANGE_MIN: f64 = 0.1;
/// Relative change of the effort that is told.
const EFFORT_CHANGE_MIN: f64 = 0.02;

/// What the engine is to be told after a tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct News {
    /// Ticks a second with all of their budgets.
    pub(crate) tick_rate_hz: Option<f32>,
    /// Part of its budgets that a tick may spend.
    pub(crate) effort: Option<f32>,
}

/// The mean of busy ticks, and what ticks may do.
#[derive(Debug)]
pub(crate) struct Pace {
    period_s: f64,
    told_hz: f64,
    /// Mean time that a tick with all of its budgets would take.
    mean_s: f64,
    busy_ticks: u32,
    effort: f64,
    told_effort: f64,
}

impl Pace {
    /// Ticks come at `most_hz` at most, and the engine counts on that.
    pub(crate) fn new(most_hz: f64) -> Self {
        let period_s = 1.0 / most_hz;
        Self { period_s, told_hz: most_hz, mean_s: 0.0, busy_ticks: 0, effort: 1.0, told_effort: 1.0 }
    }

    /// What the engine was told last.
    pub(crate) fn told(&self) -> News {
        News { tick_rate_hz: Some(self.told_hz as f32), effort: Some(self.told_effort as f32) }
    }

    /// A tick took `tick_s` and spent the part `spent` of all that its budget for swaps holds.
    pub(crate) fn note(&mut self, tick_s: f64, spent: f64) -> News {
        let tick_rate_hz = if spent < BUSY_SHARE * self.told_effort { None } else { self.note_busy(tick_s) };
        let time_left = PERIOD_SHARE * self.period_s / tick_s.max(1e-9);
        if time_left < 1.0 {
            self.effort *= time_left.max(STEP_DOWN_MAX);
        } else if spent >= 0.9 * self.told_effort {
            self.effort *= STEP_UP.min(time_left);
        }
        self.effort = self.effort.clamp(EFFORT_MIN, 1.0);
        let is_news = (self.effort / self.told_effort - 1.0).abs() > EFFORT_CHANGE_MIN
            || (self.effort >= 1.0 && self.told_effort < 1.0);
        if is_news {
            self.told_effort = self.effort;
        }
        News { tick_rate_hz, effort: is_news.then_some(self.effort as f32) }
    }

    fn note_busy(&mut self, tick_s: f64) -> Option<f32> {
        self.busy_ticks = self.busy_ticks.saturating_add(1);
        let weight = (1.0 / f64::from(self.busy_ticks)).max(1.0 / MEMORY_TICKS);
        let whole_s = tick_s.max(self.period_s) / self.told_effort;
        self.mean_s += weight * (whole_s - self.mean_s);
        let rate_hz = 1.0 / self.mean_s;
        let has_changed = (rate_hz / self.told_hz - 1.0).abs() > RATE_CHANGE_MIN;
        (self.busy_ticks >= TICKS_MIN && has_changed).then(|| {
            self.told_hz = rate_hz;
            rate_hz as f32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is told of the rate in `ticks` ticks that each take `fixed_s`, and `swaps_s` for swaps at full effort.
    fn told(pace: &mut Pace, [fixed_s, swaps_s]: [f64; 2], spent: f64, ticks: u32) -> Vec<f32> {
        let tick = |pace: &mut Pace| {
            let effort = pace.told_effort;
            pace.note(fixed_s + swaps_s * effort, spent * effort).tick_rate_hz
        };
        (0..ticks).filter_map(|_| tick(pace)).collect()
    }

    #[test]
    fn busy_ticks_tell_the_rate_and_idle_ones_do_not() {
        let mut pace = Pace::new(60.0);
        assert_eq!(told(&mut pace, [0.01, 0.0], 1.0, 100), [], "faster than they come");
        assert_eq!(told(&mut pace, [0.5, 0.0], 0.1, 100), [], "too little to do");
        let slower = told(&mut pace, [0.0, 0.04], 0.9, 500);
        assert!((22.0..31.0).contains(slower.last().unwrap()), "{slower:?}");
        assert!(slower.len() < 12 && slower.is_sorted_by(|a, b| a > b), "{slower:?}");
        let back = told(&mut pace, [0.0, 0.01], 1.0, 1000);
        assert!(back.is_sorted_by(|a, b| a < b) && *back.last().unwrap() > 54.0, "{back:?}");
    }

    #[test]
    fn a_few_slow_ticks_at_the_start_say_nothing_of_the_rate() {
        let mut pace = Pace::new(60.0);
        assert!((0..TICKS_MIN - 1).all(|_| pace.note(1.0, 1.0).tick_rate_hz.is_none()));
    }

    #[test]
    fn work_is_spread_until_ticks_come_in_time_and_taken_up_again() {
        let mut pace = Pace::new(60.0);
        told(&mut pace, [0.003, 0.018], 1.0, 200);
        let tick_s = 0.003 + 0.018 * pace.told_effort;
        assert!((0.8..1.0).contains(&(tick_s * 60.0)), "{tick_s} s");
        told(&mut pace, [0.003, 0.005], 1.0, 200);
        assert_eq!(pace.told().effort, Some(1.0));
        told(&mut pace, [1.0, 0.0], 1.0, 200);
        assert_eq!(pace.told().effort, Some(EFFORT_MIN as f32), "something is done however slow ticks are");
        told(&mut pace, [0.001, 0.0], 0.0, 200);
        assert_eq!(pace.told().effort, Some(EFFORT_MIN as f32), "short ticks with nothing to do say nothing");
    }
}
