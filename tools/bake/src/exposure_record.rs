//! The exposure of a chunk's points, and what each rests on: which of them an edit can have changed.
//!
//! Nearly all points cast one of two sets of rays that hang on the point alone; whether these come to what changed is
//! asked by casting them again ([`Probe`]). The others, most of them buried, follow paths from hit to hit: all cells that
//! these cross are noted together.

use crate::builder::Builder;
use crate::cells::Seen;
use crate::changes::Changes;
use crate::counted_exposure;
use crate::exposure::ExposureTest;
use crate::eye::{Answer, Eye, Probe, Segment, Trail};
use crate::offload::Offload;
use crate::sample::SurfaceSample;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Points handled together.
const BATCH: usize = 256;

/// What the exposure of a point rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Basis {
    /// The rays of a point that sees nothing but sky.
    Open,
    /// Those of a point right in front of a surface.
    Near,
    /// Rays that hang on what other rays found.
    Paths,
}

impl Basis {
    /// What [`Self`] is as a number.
    pub(crate) fn from_byte(byte: u8) -> Option<Self> {
        [Self::Open, Self::Near, Self::Paths].into_iter().find(|&basis| basis as u8 == byte)
    }
}

/// Points with a basis each.
#[derive(Debug, Default)]
pub(crate) struct Points {
    pub(crate) samples: Vec<SurfaceSample>,
    pub(crate) bases: Vec<Basis>,
}

impl Points {
    /// Not exposed yet.
    pub(crate) fn new(samples: Vec<SurfaceSample>) -> Self {
        Self { bases: vec![Basis::Open; samples.len()], samples }
    }

    /// Finds out how exposed the points are that `is_wanted` says, on the device if there is one; notes in `seen` where paths
    /// went. How many rays it took.
    pub(crate) fn expose(
        &mut self,
        builder: &Builder<'_>,
        offload: &Offload<'_>,
        mut is_wanted: Vec<bool>,
        seen: &Seen<'_>,
    ) -> u64 {
        if builder.parameters.buried_rays == 0 {
            return 0;
        }
        let cast = AtomicU64::new(counted_exposure::expose(self, builder, offload, &mut is_wanted, seen));
        let runs = self.samples.par_chunks_mut(BATCH).zip(self.bases.par_chunks_mut(BATCH));
        runs.zip(is_wanted.par_chunks(BATCH)).for_each(|((samples, bases), is_wanted)| {
            let trail = Trail::default();
            let test = builder.exposure_test(Eye::trailing(builder.tracer, &trail));
            let sets = RaySets::of(builder, &samples[0]);
            let points = samples.iter_mut().zip(bases).zip(is_wanted);
            for ((sample, basis), _) in points.filter(|(_, is_wanted)| **is_wanted) {
                sample.exposure = test.of(sample);
                let segments = trail.take();
                *basis = sets.basis(&segments);
                if *basis == Basis::Paths {
                    segments.iter().for_each(|&(origin, way, reach)| seen.mark_way(origin, way, reach));
                }
            }
            cast.fetch_add(test.cast.get(), Ordering::Relaxed);
        });
        self.note_suspects();
        cast.into_inner()
    }

    /// Paths are followed from points that look buried, and from no others.
    pub(crate) fn note_suspects(&mut self) {
        let points = self.samples.iter_mut().zip(&self.bases);
        points.for_each(|(sample, basis)| sample.is_suspect = *basis == Basis::Paths);
    }

    /// Of each point, whether it may be exposed otherwise than before `changes`. `paths_changed` says so of all that rest
    /// on paths.
    pub(crate) fn concerned(
        &self,
        builder: &Builder<'_>,
        changes: &Changes,
        paths_changed: bool,
    ) -> Vec<bool> {
        let points = self.samples.par_iter().zip(&self.bases);
        let is_concerned = |(sample, basis): (&SurfaceSample, &Basis)| {
            let answer = match basis {
                Basis::Paths => return paths_changed,
                Basis::Open => Answer::Sky,
                Basis::Near => Answer::Near,
            };
            let probe = Probe::new(changes, answer);
            let _whatever = builder.exposure_test(Eye::asking(builder.tracer, &probe)).of(sample);
            probe.is_concerned()
        };
        points.with_min_len(BATCH).map(is_concerned).collect()
    }
}

/// How many rays each of the sets has that hang on the point alone.
#[derive(Debug)]
struct RaySets {
    open: usize,
    near: usize,
}

impl RaySets {
    fn of(builder: &Builder<'_>, sample: &SurfaceSample) -> Self {
        let count = |answer| {
            let trail = Trail::answering(answer);
            let _whatever = test_of(builder, &trail).of(sample);
            trail.take().len()
        };
        Self { open: count(Answer::Sky), near: count(Answer::Near) }
    }

    /// Paths begin where other rays ended.
    fn basis(&self, segments: &[Segment]) -> Basis {
        let is_from_one_place = segments.iter().all(|segment| segment.0 == segments[0].0);
        match segments.len() {
            _ if !is_from_one_place => Basis::Paths,
            count if count == self.open => Basis::Open,
            count if count == self.near => Basis::Near,
            _ => Basis::Paths,
        }
    }
}

fn test_of<'b>(builder: &'b Builder<'_>, trail: &'b Trail) -> ExposureTest<'b> {
    builder.exposure_test(Eye::trailing(builder.tracer, trail))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use earthshine_gen::{GenOptions, WorldKind};
    use earthshine_tiles::BakeParameters;
    use earthshine_trace::SceneTracer;
    use earthshine_world::Grid;

    /// Goal: the rays that are asked about an edit are those that were cast. Method: all points of a Cornell box and its
    /// blocks; what each cast, and what it casts when it is told what its basis says.
    #[test]
    fn points_cast_the_rays_of_their_basis() {
        let glb = earthshine_gen::generate(WorldKind::Cornell, &GenOptions::default(), &|_, _| {}).unwrap();
        let scene = earthshine_scene::load_bytes(&glb.bytes, "cornell", &Default::default()).unwrap();
        let grid = Grid { voxel_edge_m: 0.4, chunk_edge_voxels: 4 };
        let (tracer, parameters) = (SceneTracer::new(&scene), BakeParameters { grid, ..Default::default() });
        let builder = Builder { tracer: &tracer, parameters: &parameters };
        let samples = builder.samples(&Silent);
        let rays = |trail: &Trail, sample: &SurfaceSample| {
            let _whatever = test_of(&builder, trail).of(sample);
            trail.take()
        };
        let mut counts = [0; 3];
        for sample in &samples {
            let cast = rays(&Trail::default(), sample);
            let basis = RaySets::of(&builder, sample).basis(&cast);
            counts[basis as usize] += 1;
            let answer = match basis {
                Basis::Open => Answer::Sky,
                Basis::Near => Answer::Near,
                Basis::Paths => continue,
            };
            let told = rays(&Trail::answering(answer), sample);
            assert!(told.iter().map(|ray| (ray.0, ray.1)).eq(cast.iter().map(|ray| (ray.0, ray.1))));
        }
        assert!(counts.iter().all(|&count| count > 10), "{counts:?}");
        assert!([0, 1, 2].map(|byte| Basis::from_byte(byte).unwrap() as u8) == [0, 1, 2]);
        assert_eq!(Basis::from_byte(3), None);
    }
}
