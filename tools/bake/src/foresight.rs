//! Rays that a device traces before they are asked for.
//!
//! The code that casts a row's rays one by one stays the only one: it is run with a [`Foresight`], which notes what is
//! asked and answers "sky"; a [`RayCaster`] traces what all rows of a batch asked at once; then it is run again and gets
//! these answers, confirmed by the CPU's own crossing. Where an answer changes what is asked next, that is another round;
//! what few rays are left in the end are cast on the CPU. So a row is the CPU's, to the bit, but for rays that pass an edge
//! or meet two triangles within rounding.

use crate::offload::Offload;
use earthshine_trace::{Hit, Query, SceneTracer};
use rayon::prelude::*;
use std::sync::Mutex;

/// Rays that are traced together: what a thread has waiting at once takes some 10 MiB.
const BATCH_RAYS: usize = 1 << 18;
/// Rounds after which the rest is cast on the CPU.
const ROUNDS_MAX: u32 = 8;
/// Fewer rays are not worth the way to a device and back.
const ROUND_RAYS_MIN: usize = 64;

/// What is known of one unit's rays, in the order in which they are asked for. What is asked after an answer that is not
/// known must not hang on it: else another question would stand in its place the next time, which is a mistake in `trace`.
#[derive(Debug, Default)]
pub(crate) struct Foresight {
    known: Vec<(Query, Option<u32>)>,
    asking: Mutex<Asking>,
    /// Whether what is not known is to be looked for on the CPU.
    is_last: bool,
}

#[derive(Debug, Default)]
struct Asking {
    next: usize,
    unknown: Vec<Query>,
}

impl Foresight {
    /// As [`SceneTracer::closest`] from a distance of zero on, as far as it is known.
    pub(crate) fn closest(&self, tracer: &SceneTracer<'_>, query: Query) -> Option<Hit> {
        let known = {
            let mut asking = self.asking.lock().expect("no holder panics");
            asking.next += 1;
            let known = self.known.get(asking.next - 1).copied();
            if known.is_none() && !self.is_last {
                asking.unknown.push(query);
                return None;
            }
            known
        };
        match known {
            Some((asked, triangle)) => {
                assert_eq!(asked, query, "a ray is asked for in the same place again");
                tracer.confirmed(&query, triangle)
            }
            None => tracer.closest(query.origin, query.direction, 0.0, query.distance_max),
        }
    }

    /// What was asked and not known; begins anew.
    fn take_unknown(&mut self) -> Vec<Query> {
        std::mem::take(self.asking.get_mut().expect("no holder panics")).unknown
    }
}

/// What `trace` makes of each of `units`, in order, each of which casts about `rays` rays: on all threads, and with the
/// foresight of a device if there is one, for as long as it works. `each` is called whenever one is made.
pub(crate) fn trace_all<T: Send>(
    offload: Option<&Offload<'_>>,
    units: &[usize],
    rays: u32,
    each: &(impl Fn() + Sync),
    trace: impl Fn(usize, Option<&Foresight>) -> T + Sync,
) -> Vec<T> {
    let Some(offload) = offload.filter(|offload| offload.caster().is_some()) else {
        let one = |&unit: &usize| {
            let made = trace(unit, None);
            each();
            made
        };
        return units.par_iter().map(one).collect();
    };
    let mut all = Vec::with_capacity(units.len());
    for units in units.chunks((BATCH_RAYS / rays.max(1) as usize).max(1)) {
        all.extend(in_rounds(offload, units, each, &trace));
    }
    all
}

/// The units of one batch.
fn in_rounds<T: Send>(
    offload: &Offload<'_>,
    units: &[usize],
    each: &(impl Fn() + Sync),
    trace: &(impl Fn(usize, Option<&Foresight>) -> T + Sync),
) -> Vec<T> {
    let mut done: Vec<Option<T>> = units.iter().map(|_| None).collect();
    let mut open: Vec<(usize, Foresight)> = (0..units.len()).map(|at| (at, Foresight::default())).collect();
    for round in 0.. {
        let ran: Vec<(T, Vec<Query>)> = open
            .par_iter_mut()
            .map(|(at, foresight)| (trace(units[*at], Some(foresight)), foresight.take_unknown()))
            .collect();
        let mut queries = Vec::new();
        let mut waiting = Vec::new();
        for ((at, foresight), (result, unknown)) in open.into_iter().zip(ran) {
            if unknown.is_empty() {
                done[at] = Some(result);
                each();
            } else {
                queries.extend_from_slice(&unknown);
                waiting.push((at, foresight, unknown));
            }
        }
        if waiting.is_empty() {
            break;
        }
        let caster = offload.caster().filter(|_| round < ROUNDS_MAX && queries.len() >= ROUND_RAYS_MIN);
        let found = caster
            .and_then(|caster| caster.first_triangles(&queries).map_err(|error| offload.fail(error)).ok());
        let is_last = found.is_none();
        let mut found = found.unwrap_or_default().into_iter();
        open = waiting
            .into_iter()
            .map(|(at, mut foresight, unknown)| {
                foresight.is_last = is_last;
                foresight.known.extend(unknown.into_iter().zip(found.by_ref()));
                (at, foresight)
            })
            .collect();
    }
    done.into_iter().map(|result| result.expect("the last round leaves none open")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::{Progress, Stage};
    use earthshine_light::TreeLayout;
    use earthshine_scene::Scene;
    use earthshine_trace::{CasterError, RayCaster, RayDevice};
    use earthshine_world::Vec3;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// The CPU as a device that does `batches_max` batches, and who hears of its failures.
    #[derive(Debug, Clone, Copy)]
    struct Twin {
        tracer: &'static SceneTracer<'static>,
        batches: &'static AtomicUsize,
        batches_max: usize,
        failures: &'static AtomicUsize,
    }

    impl Twin {
        fn new(batches_max: usize) -> Self {
            let scene = Box::leak(Box::new(walls()));
            Self {
                tracer: Box::leak(Box::new(SceneTracer::new(scene))),
                batches: Box::leak(Box::default()),
                batches_max,
                failures: Box::leak(Box::default()),
            }
        }

        fn offload(&self) -> Offload<'_> {
            Offload::new(Some(self), self.tracer, self)
        }
    }

    impl RayDevice for Twin {
        fn caster(&self, layout: &TreeLayout) -> Result<Box<dyn RayCaster>, CasterError> {
            assert_eq!(layout.triangles.len(), 40);
            Ok(Box::new(*self))
        }
    }

    impl RayCaster for Twin {
        fn first_triangles(&self, queries: &[Query]) -> Result<Vec<Option<u32>>, CasterError> {
            if self.batches.fetch_add(1, Ordering::Relaxed) >= self.batches_max {
                return Err(CasterError("it is tired".to_owned()));
            }
            let first = |q: &Query| self.tracer.closest(q.origin, q.direction, 0.0, q.distance_max);
            Ok(queries.iter().map(|query| first(query).map(|hit| hit.triangle as u32)).collect())
        }
    }

    impl Progress for Twin {
        fn begin(&self, _stage: Stage, _total: u64) {}
        fn advance(&self, _units: u64) {}
        fn device_failed(&self, cause: &str) {
            assert_eq!(cause, "it is tired");
            self.failures.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Walls at heights 1, 2, ...: a ray up from within finds the next.
    fn walls() -> Scene {
        let wall = |z: u16| {
            [(-9.0, -9.0), (29.0, -9.0), (-9.0, 29.0)].map(|(x, y)| Vec3::new(x, y, f32::from(z) + 1.0))
        };
        Scene {
            triangles: (0..40).map(wall).collect(),
            texture_coordinates: vec![[[0.0; 2]; 3]; 40],
            material_of: vec![0; 40],
            ..Scene::default()
        }
    }

    /// A unit that climbs from wall to wall, so that each ray hangs on the one before.
    fn climb(tracer: &SceneTracer<'_>, unit: usize, foresight: Option<&Foresight>) -> Vec<usize> {
        let (mut origin, mut met) = (Vec3::new(0.1, 0.01 * unit as f32, 0.5), Vec::new());
        for _ in 0..unit % 30 {
            let query = Query { origin, direction: Vec3::Z, distance_max: f32::INFINITY };
            let hit = match foresight {
                Some(foresight) => foresight.closest(tracer, query),
                None => tracer.closest(query.origin, query.direction, 0.0, query.distance_max),
            };
            let Some(hit) = hit else { break };
            met.push(hit.triangle);
            origin.z += hit.distance + 0.01;
        }
        met
    }

    #[test]
    fn what_is_foreseen_is_what_is_seen() {
        for count in [0, 1, 63, 64, 65, 500] {
            let device = Twin::new(50);
            let units: Vec<usize> = (0..count).collect();
            let seen = trace_all(None, &units, 30, &|| (), |unit, _| climb(device.tracer, unit, None));
            let offload = device.offload();
            let climb = |unit: usize, known: Option<&Foresight>| climb(device.tracer, unit, known);
            assert_eq!(seen, trace_all(Some(&offload), &units, 30, &|| (), climb), "{count} units");
            let batches = device.batches.load(Ordering::Relaxed);
            // Of 65 units 62 ask anything: too few.
            assert_eq!(batches > 0, count == 500, "{batches} batches of {count} units");
            assert!(batches <= ROUNDS_MAX as usize, "{batches} batches of {count} units");
        }
    }

    /// Goal: a device that fails anywhere in a bake costs nothing but time, and is asked no more.
    #[test]
    fn what_a_device_leaves_when_it_fails_is_seen_on_the_cpu() {
        let units: Vec<usize> = (0..500).collect();
        for batches_max in [0, 1, 3] {
            let device = Twin::new(batches_max);
            let offload = device.offload();
            let seen = trace_all(None, &units, 30, &|| (), |unit, _| climb(device.tracer, unit, None));
            for _ in 0..2 {
                let climb = |unit: usize, known: Option<&Foresight>| climb(device.tracer, unit, known);
                assert_eq!(seen, trace_all(Some(&offload), &units, 30, &|| (), climb), "{batches_max}");
            }
            assert_eq!(device.batches.load(Ordering::Relaxed), batches_max + 1);
            assert_eq!(device.failures.load(Ordering::Relaxed), 1, "said once");
            assert_eq!(offload.failure().as_deref(), Some("it is tired"));
        }
    }
}
