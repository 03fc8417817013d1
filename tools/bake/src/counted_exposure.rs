//! The exposure of points by rays that a device traces: a few of each at first, the others of those that are not clear, and
//! the paths of those that look buried, segment by segment.
//!
//! What a point's test asks next hangs on what its rays have found, so nothing is guessed: many points are asked about in
//! step. Of paths a device names what they meet first, and where they meet it is computed here. Points with a ray through
//! what may have holes are left to the CPU, which begins anew.

use crate::builder::Builder;
use crate::cells::Seen;
use crate::exposure::{Exposure, ExposureTest, FIRST_RAYS, Verdict, unburied};
use crate::exposure_record::{Basis, Points};
use crate::eye::Eye;
use crate::inquiry::QUESTION_RAYS;
use crate::light_search::{LightSearch, Sight};
use crate::offload::Offload;
use crate::questions::ask_all;
use earthshine_trace::ends::{FacedRays, RUN_RAYS_MAX};
use earthshine_trace::{Query, RayFan};
use rayon::prelude::*;
use std::collections::VecDeque;

/// A point whose fan is asked about.
#[derive(Debug, Clone, Copy)]
struct Asker {
    point: usize,
    /// What its first rays have met, once they have.
    first: Option<FacedRays>,
    /// How many rays of paths found that light comes to it, if they were asked to.
    lit_by: Option<u32>,
}

/// A point that looks buried, and its search for light.
#[derive(Debug, Clone, Copy)]
struct Suspect {
    asker: Asker,
    /// What its rays have met, and how many they are.
    faced: FacedRays,
    rays: u32,
    search: LightSearch,
    path_rays: u32,
}

/// A question.
enum Asked {
    Fans(Vec<(Asker, RayFan)>),
    Sights(Vec<(Suspect, Sight)>),
}

/// Its answer.
enum Answer {
    Faced(Vec<FacedRays>),
    First(Vec<Option<u32>>),
}

/// What is known of the points so far.
struct Found<'p> {
    points: &'p mut Points,
    builder: &'p Builder<'p>,
    offload: &'p Offload<'p>,
    seen: &'p Seen<'p>,
    is_wanted: &'p mut [bool],
    waiting: VecDeque<Asker>,
    suspects: VecDeque<Suspect>,
    /// Rays that were of use.
    cast: u64,
}

/// Exposes of `points` what `is_wanted` says and a device can tell, and says that it is wanted no more; notes in `seen`
/// where suspect points' rays went. How many rays that took.
pub(crate) fn expose(
    points: &mut Points,
    builder: &Builder<'_>,
    offload: &Offload<'_>,
    is_wanted: &mut [bool],
    seen: &Seen<'_>,
) -> u64 {
    let rays = builder.parameters.buried_rays;
    if !offload.is_working() || !(FIRST_RAYS + 1..=RUN_RAYS_MAX).contains(&rays) {
        return 0;
    }
    let wanted = (0..is_wanted.len()).filter(|&point| is_wanted[point]);
    let waiting = wanted.map(|point| Asker { point, first: None, lit_by: None }).collect();
    let near_m = builder.exposure_test(builder.tracer.into()).near_m();
    let suspects = VecDeque::new();
    let mut found = Found { points, builder, offload, seen, is_wanted, waiting, suspects, cast: 0 };
    let answer = |asked: &Asked| match asked {
        Asked::Fans(fans) => {
            let fans: Vec<RayFan> = fans.iter().map(|(_, fan)| *fan).collect();
            offload.face(&fans, near_m).map(Answer::Faced)
        }
        Asked::Sights(sights) => {
            let rays: Vec<Query> = sights.iter().map(|(_, sight)| *sight.query()).collect();
            offload.first(&rays).map(Answer::First)
        }
    };
    ask_all(&mut found, Found::next, answer, |found, asked, answer| match (asked, answer) {
        (Asked::Fans(fans), Answer::Faced(faced)) => {
            fans.into_iter().zip(faced).for_each(|((asker, _), faced)| found.hear(asker, faced));
        }
        (Asked::Sights(sights), Answer::First(triangles)) => found.hear_sights(sights, triangles),
        _ => unreachable!("answers are to what was asked"),
    });
    found.cast
}

impl<'p> Found<'p> {
    fn test(&self) -> ExposureTest<'p> {
        self.builder.exposure_test(self.builder.tracer.into())
    }

    /// Fans first: what they leave follows paths in step.
    fn next(&mut self) -> Option<Asked> {
        if self.waiting.is_empty() {
            let count = self.suspects.len().min(QUESTION_RAYS);
            let suspects: Vec<Suspect> = self.suspects.drain(..count).collect();
            let builder = self.builder;
            let sight = |suspect: Suspect| {
                let test = builder.exposure_test(builder.tracer.into());
                (suspect, suspect.search.sight(&test))
            };
            return (count > 0).then(|| Asked::Sights(suspects.into_par_iter().map(sight).collect()));
        }
        let rays = self.builder.parameters.buried_rays;
        let (mut left, mut count) = (QUESTION_RAYS, 0);
        let ray_count = |asker: &Asker| if asker.first.is_none() { FIRST_RAYS } else { rays - FIRST_RAYS };
        while let Some(asker) = self.waiting.get(count)
            && let Some(rest) = left.checked_sub(ray_count(asker) as usize)
        {
            (left, count) = (rest, count + 1);
        }
        let askers: Vec<Asker> = self.waiting.drain(..count).collect();
        let (builder, samples) = (self.builder, &self.points.samples);
        let fan = |asker: Asker| {
            let whole = builder.exposure_test(builder.tracer.into()).fan(&samples[asker.point]);
            let first_pair = if asker.first.is_none() { 0 } else { FIRST_RAYS };
            (asker, RayFan { first_pair, ray_count: ray_count(&asker), ..whole })
        };
        Some(Asked::Fans(askers.into_par_iter().map(fan).collect()))
    }

    /// Takes in what the rays of `asker` face.
    fn hear(&mut self, asker: Asker, faced: FacedRays) {
        let all = self.builder.parameters.buried_rays;
        let before = asker.first.unwrap_or_default();
        let faced = FacedRays {
            back: before.back + faced.back,
            near: before.near + faced.near,
            for_host: faced.for_host,
            reach_m: before.reach_m.max(faced.reach_m),
        };
        let (verdict, rays, basis) = match asker.first {
            None => (Verdict::of_first(faced.back, faced.near), FIRST_RAYS, Basis::Open),
            Some(_) => (Verdict::of_all(faced.back, faced.near, all), all, Basis::Near),
        };
        let exposure = match (verdict, asker.lit_by) {
            _ if faced.for_host > 0 => {
                self.offload.note_returned(u64::from(rays + asker.lit_by.unwrap_or(0)));
                return;
            }
            (Verdict::Unclear, _) => {
                self.waiting.push_back(Asker { first: Some(faced), ..asker });
                return;
            }
            (Verdict::Suspect, None) => {
                let sample = &self.points.samples[asker.point];
                let search = LightSearch::new(&self.test().fan(sample), sample.key());
                self.suspects.push_back(Suspect { asker, faced, rays, search, path_rays: 0 });
                return;
            }
            (Verdict::Suspect, Some(_)) => unburied(faced.near, all),
            (Verdict::Clear(exposure), _) => exposure,
        };
        match asker.lit_by {
            None => self.settle(asker.point, exposure, basis, rays),
            Some(path_rays) => self.settle_suspect(asker.point, exposure, &faced, (rays, path_rays)),
        }
    }

    /// Takes in what the sights of searches meet first.
    fn hear_sights(&mut self, sights: Vec<(Suspect, Sight)>, triangles: Vec<Option<u32>>) {
        let (builder, offload, seen) = (self.builder, self.offload, self.seen);
        let hear = |((mut suspect, sight), triangle): ((Suspect, Sight), Option<u32>)| {
            let test = builder.exposure_test(Eye::noting(builder.tracer, seen));
            let hit = test.tracer.closest_named(sight.query(), triangle, || offload.note_returned(1));
            let is_lit = match sight {
                Sight::Lamp(_) => suspect.search.pass_lamp(hit.is_some()),
                Sight::Way(way) => suspect.search.follow(&test, &way, hit),
            };
            suspect.path_rays += 1;
            (suspect, is_lit)
        };
        let heard: Vec<(Suspect, Option<bool>)> = sights.into_par_iter().zip(triangles).map(hear).collect();
        for (suspect, is_lit) in heard {
            let Suspect { asker, faced, rays, path_rays, .. } = suspect;
            match is_lit {
                None => self.suspects.push_back(suspect),
                Some(true) if rays < self.builder.parameters.buried_rays => {
                    self.waiting.push_back(Asker { first: Some(faced), lit_by: Some(path_rays), ..asker });
                }
                Some(is_lit) => {
                    let exposure = if is_lit { unburied(faced.near, rays) } else { Exposure::Buried };
                    self.settle_suspect(asker.point, exposure, &faced, (rays, path_rays));
                }
            }
        }
    }

    /// A point that followed paths: its own rays are noted too, each as far as the farthest got.
    fn settle_suspect(
        &mut self,
        point: usize,
        exposure: Exposure,
        faced: &FacedRays,
        (rays, path_rays): (u32, u32),
    ) {
        let fan = self.test().fan(&self.points.samples[point]);
        for ray in (0..rays).map(|ray| fan.query(ray)) {
            self.seen.mark_way(ray.origin, ray.direction, faced.reach_m);
        }
        self.settle(point, exposure, Basis::Paths, rays + path_rays);
    }

    fn settle(&mut self, point: usize, exposure: Exposure, basis: Basis, rays: u32) {
        self.points.samples[point].exposure = exposure;
        self.points.bases[point] = basis;
        self.is_wanted[point] = false;
        self.cast += u64::from(rays);
    }
}
