//! Kernels that bring light on points together for their patches.

use super::{Bench, Four, Twin, bytes, entries, hold, random, values};
use crate::recorder::folded;
use earthshine_light::told_apart;
use earthshine_shaders::host::{LitPatch, Pass, PointSpan};
use earthshine_shaders::kernel::{LIST_POINTS, SCAN_GROUPS, SUM_POINTS};
use earthshine_shaders::limits::LANES;
use earthshine_world::Rgb;

pub(super) const TWINS: &[Twin] =
    &[Twin { kernels: &[SUM_POINTS, SCAN_GROUPS, LIST_POINTS], holds: means_and_points_that_differ }];

#[test]
fn kernels_of_points_are_their_twins() {
    hold(TWINS);
}

/// Patches of none to nine points, a part of them lit alike on all, a part on all but one.
fn means_and_points_that_differ(bench: &Bench<'_>, n: usize) {
    let (mut spans, mut on_points) = (Vec::new(), Vec::<Four>::new());
    for patch in 0..n {
        let count = patch * 7 % 10;
        spans.push(PointSpan { first_point: on_points.len() as u32, point_count: count as u32 });
        let light = |at: usize| [1, 2, 3, 4].map(|channel| 100.0 * random(channel, 16 * patch + at));
        on_points.extend((0..count).map(|point| match patch % 3 {
            0 => light(0),
            1 => light(usize::from(point == 4)),
            _ => light(point),
        }));
    }
    let groups = n.div_ceil(LANES as usize);
    let pass = Pass { rows: on_points.len() as u32, ..entries(n) };
    let (lit, none) = (vec![LitPatch::default(); n], vec![[0u32; 3]; on_points.len() + 1]);
    let inputs = [bytes(&spans), bytes(&on_points), bytes(&lit), &vec![0u8; 4 * groups]];
    let summed = bench.threads(&SUM_POINTS, &inputs, pass);
    let scanned = bench.run(&SCAN_GROUPS, &[&summed[3]], entries(groups), folded(1));
    let inputs = [bytes(&spans), bytes(&on_points), &summed[2], &scanned[0], bytes(&none)];
    let listed: Vec<[u32; 3]> = values(&bench.threads(&LIST_POINTS, &inputs, pass)[4]);
    let mut expected = Vec::new();
    for (found, span) in values::<LitPatch>(&summed[2]).into_iter().zip(&spans) {
        let own = &on_points[span.first_point as usize..][..span.point_count as usize];
        let own: Vec<Rgb> = own.iter().map(|&[red, green, blue, _]| Rgb::new(red, green, blue)).collect();
        let mean = own.iter().sum::<Rgb>() / own.len().max(1) as f32;
        assert!((Rgb::from_array(found.mean) - mean).abs().max_element() <= 1e-6 * mean.max_element());
        let told = told_apart(&own);
        assert_eq!(found.told_points as usize, told.len());
        expected.extend(told.iter().map(|light| light.to_array().map(f32::to_bits)));
    }
    assert_eq!(listed[0], [expected.len() as u32, 0, 0]);
    assert_eq!(&listed[1..][..expected.len()], expected, "{n} patches");
    assert!(listed[1 + expected.len()..].iter().all(|words| *words == [0; 3]), "nothing else");
}
