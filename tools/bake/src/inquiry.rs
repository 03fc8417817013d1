//! Rows whose rays end on a device: many ask at once, hear where their rays end, and may ask again.
//!
//! The rays are those that the CPU casts for the same row, from the same seeds, and what comes back is what it would have
//! added up, but for rounding, rays along edges, and rays that come back to be cast here. When the device fails, the CPU
//! makes what is not made yet. [`count_all`] drives it; `counted_rows`, `counted_receivers` and `detail` ask.

use crate::offload::Offload;
use crate::questions::ask_all;
use earthshine_trace::Rays;
use earthshine_trace::ends::{RUN_RAYS_MAX, Run, RunEnds, RunSum};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Rays of one question to a device, if one asker alone does not ask for more: 8 MiB where they are made here. An asker has
/// [`ON_THEIR_WAY`](crate::questions::ON_THEIR_WAY) and one at once.
pub(crate) const QUESTION_RAYS: usize = 1 << 18;

/// What one asker wants to know.
#[derive(Debug, Default)]
pub(crate) struct Question {
    pub(crate) rays: Rays,
    /// Over these rays.
    pub(crate) runs: Vec<Run>,
}

impl Question {
    /// Asks for `sum` over rays `first..first + count`, in runs that are not too long.
    pub(crate) fn sum(&mut self, first: u32, count: u32, sum: RunSum) {
        self.runs.extend((first..first + count).step_by(RUN_RAYS_MAX as usize).map(|at| Run {
            first_ray: at,
            ray_count: (first + count - at).min(RUN_RAYS_MAX),
            sum,
        }));
    }
}

/// Asks for the ends of its rays, once or several times.
pub(crate) trait Inquiry: Send {
    /// What it makes of them.
    type Made: Send;

    /// About how many rays it asks next: at most
    /// [`COUNTED_RAYS_MAX`](earthshine_trace::ends::COUNTED_RAYS_MAX).
    fn ray_count(&self) -> usize;

    /// The next question.
    fn ask(&mut self) -> Question;

    /// Hears the ends of its runs; what it has made if it need not ask again.
    fn hear(&mut self, ends: &[RunEnds]) -> Option<Self::Made>;
}

/// What becomes of each of `units`, in order: what `begin` asks a device for, while there is one that works, and
/// `on_cpu` of the others. `each` is called whenever one is made.
pub(crate) fn count_all<I: Inquiry>(
    offload: &Offload<'_>,
    units: &[usize],
    begin: impl Fn(usize) -> I + Sync,
    on_cpu: impl Fn(usize) -> I::Made + Sync,
    each: &(impl Fn() + Sync),
) -> Vec<I::Made> {
    let asking = if offload.is_working() { units } else { &[] };
    let waiting: VecDeque<(usize, I)> =
        asking.par_iter().enumerate().map(|(at, &unit)| (at, begin(unit))).collect::<Vec<_>>().into();
    let made: Vec<Option<I::Made>> = units.iter().map(|_| None).collect();
    let mut state = (waiting, made);
    ask_all(
        &mut state,
        |(waiting, _)| (!waiting.is_empty()).then(|| Asked::of(first_askers(waiting))),
        |asked| offload.count(&asked.question.rays, &asked.question.runs),
        |(waiting, made), asked, ends| {
            for (at, inquiry, result) in asked.heard(&ends) {
                match result {
                    None => waiting.push_back((at, inquiry)),
                    Some(result) => {
                        made[at] = Some(result);
                        each();
                    }
                }
            }
        },
    );
    let finished = state.1.into_par_iter().zip(units).map(|(made, &unit)| {
        made.unwrap_or_else(|| {
            let made = on_cpu(unit);
            each();
            made
        })
    });
    finished.collect()
}

/// As many as ask for the rays of one question, one at least.
fn first_askers<I: Inquiry>(waiting: &mut VecDeque<(usize, I)>) -> Vec<(usize, I)> {
    let mut rays = 0;
    let fits = |(_, inquiry): &&(usize, I)| {
        rays += inquiry.ray_count();
        rays <= QUESTION_RAYS
    };
    let count = waiting.iter().take_while(fits).count().max(1);
    waiting.drain(..count).collect()
}

/// What several ask at once.
struct Asked<I> {
    askers: Vec<(usize, I)>,
    /// Of all of them.
    question: Question,
    /// Of each, how many runs are its own.
    own_runs: Vec<usize>,
}

impl<I: Inquiry> Asked<I> {
    fn of(mut askers: Vec<(usize, I)>) -> Self {
        let questions: Vec<Question> = askers.par_iter_mut().map(|(_, inquiry)| inquiry.ask()).collect();
        let own_runs = questions.iter().map(|question| question.runs.len()).collect();
        let (mut all, mut first) = (Question::default(), 0);
        for Question { rays, runs } in questions {
            all.runs.extend(runs.iter().map(|run| Run { first_ray: first + run.first_ray, ..*run }));
            first += rays.count() as u32;
            all.rays.append(rays);
        }
        Self { askers, question: all, own_runs }
    }

    /// What each makes of `ends`.
    fn heard(self, ends: &[RunEnds]) -> Vec<(usize, I, Option<I::Made>)> {
        let mut rest = ends;
        let mut own = |count: usize| {
            let (own, others) = rest.split_at(count);
            rest = others;
            own
        };
        let own: Vec<&[RunEnds]> = self.own_runs.iter().map(|&count| own(count)).collect();
        let hear = |((at, mut inquiry), ends): ((usize, I), &[RunEnds])| {
            let made = inquiry.hear(ends);
            (at, inquiry, made)
        };
        self.askers.into_par_iter().zip(own).map(hear).collect()
    }
}
