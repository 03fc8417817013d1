//! The two sides of a patch builder: where samples come from, and how samples become patches.
//!
//! A bake's [`BakeMethod`](earthshine_tiles::BakeMethod) names one of each, and any goes with any. Between the two
//! stands [`exposure`](crate::exposure), which is the same for all. Start at [`Builder::surfaces`].

use crate::buried::{BuriedPiece, buried_pieces};
use crate::clusters::clusters_of;
use crate::content::has_emitters;
use crate::exposure::{Exposure, ExposureTest};
use crate::eye::Eye;
use crate::hammersley::sample_voxels;
use crate::patches::PatchSet;
use crate::progress::{Progress, Stage};
use crate::rows::RAY_OFFSET;
use crate::sample::{EVERYWHERE, SurfaceSample, sample_triangle};
use earthshine_scene::Scene;
use earthshine_tiles::{BakeParameters, PatchBuilder, SampleSource};
use earthshine_trace::SceneTracer;
use glam::IVec3;
use rayon::prelude::*;
use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering};

/// Triangles or points handled between two progress reports.
const BATCH: usize = 1024;

/// Makes samples and patches of a scene.
#[derive(Debug, Clone, Copy)]
pub struct Builder<'a> {
    /// The scene.
    pub tracer: &'a SceneTracer<'a>,
    /// Which sides of builders, and how fine.
    pub parameters: &'a BakeParameters,
}

/// What rows are made of.
#[derive(Debug)]
pub struct Surfaces {
    /// All samples, buried ones too.
    pub samples: Vec<SurfaceSample>,
    /// Their patches.
    pub set: PatchSet,
}

impl Builder<'_> {
    /// All steps at once: samples, their exposure, patches.
    #[must_use]
    pub fn surfaces(&self, progress: &dyn Progress) -> Surfaces {
        let mut samples = self.samples(progress);
        self.expose(&mut samples, progress);
        let set = self.patches(&samples);
        Surfaces { samples, set }
    }

    /// The first side: covers the scene's surfaces. Where there is detail, no sample by area crosses a detail voxel's face,
    /// so that areas in it are exact.
    #[must_use]
    pub fn samples(&self, progress: &dyn Progress) -> Vec<SurfaceSample> {
        match self.parameters.method.samples {
            SampleSource::Area => {
                let detail = IVec3::splat(self.parameters.detail.cast_signed());
                let mut samples = covered(self.tracer.scene(), &self.parameters.of_detail_voxels(), progress);
                samples.iter_mut().for_each(|sample| sample.voxel = sample.voxel.div_euclid(detail));
                samples
            }
            SampleSource::Hammersley => sample_voxels(self.tracer, self.parameters, progress),
        }
    }

    /// Tells how exposed each sample is; how many rays that took.
    pub fn expose(&self, samples: &mut [SurfaceSample], progress: &dyn Progress) -> u64 {
        if self.parameters.buried_rays == 0 {
            return 0;
        }
        progress.begin(Stage::Exposure, samples.len() as u64);
        let cast = AtomicU64::new(0);
        let exposures: Vec<(Exposure, bool)> = samples
            .par_chunks(BATCH)
            .flat_map_iter(|run| {
                let test = self.exposure_test(self.tracer.into());
                let found: Vec<(Exposure, bool)> = run.iter().map(|sample| test.told(sample)).collect();
                cast.fetch_add(test.cast.get(), Ordering::Relaxed);
                progress.advance(run.len() as u64);
                found
            })
            .collect();
        for (sample, told) in samples.iter_mut().zip(exposures) {
            (sample.exposure, sample.is_suspect) = told;
        }
        cast.into_inner()
    }

    pub(crate) fn exposure_test<'b>(&'b self, tracer: Eye<'b>) -> ExposureTest<'b> {
        let voxel_edge_m = self.parameters.grid.voxel_edge_m;
        ExposureTest {
            tracer,
            rays: self.parameters.buried_rays,
            voxel_edge_m,
            off_surface_m: RAY_OFFSET * voxel_edge_m,
            seed: self.parameters.seed,
            cast: Cell::new(0),
        }
    }

    /// The second side: makes patches of samples.
    #[must_use]
    pub fn patches(&self, samples: &[SurfaceSample]) -> PatchSet {
        let set = match self.parameters.method.builder {
            PatchBuilder::Axis => PatchSet::group(samples, self.parameters),
            PatchBuilder::Clustered => {
                let clusters = clusters_of(self.tracer, samples, self.parameters);
                PatchSet::of_clusters(samples, &clusters, self.parameters)
            }
        };
        set.with_buried(self.buried_pieces(samples))
    }

    /// The pieces of `samples` whose hits are absorbed.
    pub(crate) fn buried_pieces(&self, samples: &[SurfaceSample]) -> Vec<BuriedPiece> {
        if has_emitters(self.tracer.scene()) {
            return Vec::new();
        }
        buried_pieces(samples, self.parameters.weights, self.parameters.grid)
    }
}

fn covered(scene: &Scene, parameters: &BakeParameters, progress: &dyn Progress) -> Vec<SurfaceSample> {
    let total = scene.triangles.len();
    progress.begin(Stage::Sample, total as u64);
    let batches: Vec<Vec<SurfaceSample>> = (0..total.div_ceil(BATCH))
        .into_par_iter()
        .map(|batch| {
            let mut samples = Vec::new();
            let range = batch * BATCH..((batch + 1) * BATCH).min(total);
            let done = range.len() as u64;
            for triangle in range {
                sample_triangle(scene, triangle, parameters, EVERYWHERE, |sample| samples.push(sample));
            }
            progress.advance(done);
            samples
        })
        .collect();
    batches.concat()
}
