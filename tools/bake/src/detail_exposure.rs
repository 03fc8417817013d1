//! Which points of a chunk are hidden in their detail voxels.
//!
//! A point is hidden where most of what it sees is nearer than a quarter of its voxel: others hardly see it, and it must not
//! share in the light of what they do see ([`crate::exposure`]). Detail is read where it lies, by voxels of half an edge and
//! less. What is near for a voxel of four metres, the foot of a wall beside a parked car, is a place of its own there. So
//! what is hidden is asked again, with what is near for its detail voxel.
//!
//! And few paths find the light that comes into a dark cavity. Where one point of a piece found some so, the others are hidden
//! there, not buried ([`crate::buried`]): whoever looks at them reads their own light, and not that of the voxel's patch.

use crate::buried::reached;
use crate::exposure::{Exposure, ExposureTest};
use crate::rows::{RAY_OFFSET, RowCaster};
use crate::sample::SurfaceSample;
use earthshine_tiles::BakeParameters;
use rayon::prelude::*;
use std::cell::Cell;

/// Points asked together.
const BATCH: usize = 256;

/// Asks each hidden point of `samples`, which `caster`'s rays may begin on, whether it is hidden in its detail voxel too.
///
/// The rays are those that found it hidden, fewer where they soon tell; no summary counts them.
pub(crate) fn expose(samples: &mut [SurfaceSample], caster: &RowCaster<'_>) {
    let parameters = caster.parameters;
    samples.par_chunks_mut(BATCH).for_each(|samples| {
        let test = test_of(caster, parameters.of_detail_voxels().grid.voxel_edge_m);
        for sample in samples.iter_mut().filter(|sample| matches!(sample.exposure, Exposure::Hidden(_))) {
            sample.exposure = test.of(sample);
        }
    });
}

/// Asks by the rays of `caster` what is hidden in voxels of `voxel_edge_m`.
fn test_of<'a>(caster: &RowCaster<'a>, voxel_edge_m: f32) -> ExposureTest<'a> {
    let BakeParameters { grid, buried_rays, seed, .. } = *caster.parameters;
    ExposureTest {
        tracer: caster.tracer,
        rays: buried_rays,
        voxel_edge_m,
        off_surface_m: RAY_OFFSET * grid.voxel_edge_m,
        seed,
        cast: Cell::new(0),
    }
}

/// Says that those of `samples` are hidden that are buried in a piece to which paths found light; `in_voxels` are the same points,
/// with their voxels.
pub(crate) fn reach<'s, I: Iterator<Item = &'s SurfaceSample>>(
    samples: &mut [SurfaceSample],
    in_voxels: impl Fn() -> I,
) {
    let reached = reached(in_voxels());
    for (sample, of) in samples.iter_mut().zip(in_voxels()) {
        if sample.exposure == Exposure::Buried && reached.contains_key(&(of.side, of.voxel)) {
            sample.exposure = Exposure::Hidden(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::PatchSet;
    use crate::test_shapes::{point, quad, scene_of};
    use earthshine_trace::SceneTracer;
    use earthshine_world::{Grid, Vec3, VoxelCoord};

    /// Of two points on a floor under lids, one 0.4 m above it and one 0.05 m, both hidden in a voxel of four metres.
    fn exposures(detail: u32) -> Vec<Exposure> {
        let [along, across] = [Vec3::X * 2.0, Vec3::Z * 4.0];
        let lid = |x: f32, height: f32| quad(Vec3::new(x, height, 0.0), along, across);
        let floor = quad(Vec3::ZERO, across, 2.0 * along);
        let scene = scene_of([lid(0.0, 0.4), lid(2.0, 0.05), floor].concat());
        let tracer = SceneTracer::new(&scene);
        let parameters = BakeParameters {
            grid: Grid { voxel_edge_m: 4.0, chunk_edge_voxels: 1 },
            detail,
            ..BakeParameters::default()
        };
        let set = PatchSet::group(&[], &parameters);
        let caster = RowCaster {
            tracer: (&tracer).into(),
            samples: &[],
            sources: &[],
            first: 0,
            set: &set,
            parameters: &parameters,
        };
        let sample = |x: f32| SurfaceSample {
            exposure: Exposure::Hidden(0.25),
            ..point(Vec3::new(x, 0.0, 2.0), Vec3::Y, VoxelCoord::ZERO)
        };
        let mut samples = [sample(1.0), sample(3.0)];
        expose(&mut samples, &caster);
        samples.map(|sample| sample.exposure).to_vec()
    }

    #[test]
    fn a_gap_is_hidden_by_the_size_of_the_voxel_that_is_read() {
        let is_hidden = |exposure: &Exposure| matches!(exposure, Exposure::Hidden(_));
        assert!(exposures(1).iter().all(is_hidden), "voxels of 4 m: {:?}", exposures(1));
        let in_detail = exposures(4);
        assert!(in_detail[0] == Exposure::Open(1.0) && is_hidden(&in_detail[1]), "of 1 m: {in_detail:?}");
    }

    #[test]
    fn what_shares_a_piece_with_light_is_hidden_and_not_buried() {
        let point_of = |side: u32, exposure: Exposure, is_suspect: bool| SurfaceSample {
            side,
            exposure,
            is_suspect,
            ..point(Vec3::ZERO, Vec3::Y, VoxelCoord::ZERO)
        };
        let point = |side: u32, exposure: Exposure| point_of(side, exposure, true);
        let (open, buried) = (Exposure::Open(0.5), Exposure::Buried);
        // Of the last side one point lies outside of what the other is inside of.
        let outside = point_of(7, open, false);
        let in_voxels =
            [point(1, buried), point(1, open), point(3, buried), point(5, open), point(7, buried), outside];
        // Detail voxels of their own do not part them.
        let mut samples = in_voxels;
        samples[0].voxel = VoxelCoord::X;
        reach(&mut samples, || in_voxels.iter());
        assert_eq!(
            samples.map(|sample| sample.exposure),
            [Exposure::Hidden(0.0), open, buried, open, buried, open]
        );
    }
}
