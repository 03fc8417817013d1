//! Kernels that advance light over rows without drawing or shooting: sources, gathers, sums over slots.

use super::{
    Bench, Four, Twin, assert_near, bytes, entries, floats, fours, hold, link_rows, of_row, random, randoms,
    reflectance, residents, values,
};
use crate::recorder::folded;
use earthshine_radiosity::solver::remainder::UNSHOT_MIN;
use earthshine_radiosity::solver::sampler::sky_part;
use earthshine_radiosity::solver::shooting::SCALE_KEPT;
use earthshine_radiosity::solver::step_gather;
use earthshine_shaders::host::{Pass, Resident};
use earthshine_shaders::kernel::{
    CLEAR_SLOTS, GATHER_ROWS, MEASURE_LIGHT, PUBLISH_LIGHT, SEND_LIGHT, SEND_REST, SHARE_OUTSIDE, SUM_LAMPS,
    SUM_LIGHT, TAKE_GATHERED, TAKE_SOURCES,
};
use earthshine_shaders::limits::{LANES, RAY_LANES, SHOT_CHANGE, SHOT_SCALE, SHOT_UNSHOT_SHARE, SHOT_WORDS};

pub(super) const TWINS: &[Twin] = &[
    Twin { kernels: &[SEND_LIGHT, SEND_REST], holds: what_is_sent },
    Twin { kernels: &[SHARE_OUTSIDE], holds: draws_of_the_outside },
    Twin { kernels: &[TAKE_SOURCES], holds: sources_that_change },
    Twin { kernels: &[CLEAR_SLOTS], holds: slots_that_are_left },
    Twin { kernels: &[GATHER_ROWS, TAKE_GATHERED], holds: rows_that_are_gathered },
    Twin { kernels: &[MEASURE_LIGHT, SUM_LIGHT], holds: light_that_is_measured },
    Twin { kernels: &[PUBLISH_LIGHT], holds: light_that_is_published },
    Twin { kernels: &[SUM_LAMPS], holds: lamps_that_are_summed },
];

#[test]
fn kernels_of_light_are_their_twins() {
    hold(TWINS);
}

/// What `n` slots times four channels come to.
fn each(n: usize, of: impl Fn(usize, usize) -> f64) -> impl Iterator<Item = f64> {
    (0..4 * n).map(move |at| of(at / 4, at % 4))
}

fn wide(light: &[Four], slot: usize, channel: usize) -> f64 {
    f64::from(light[slot][channel])
}

fn what_is_sent(bench: &Bench<'_>, n: usize) {
    let (patches, own, light, unshot) = (residents(n), fours(1, n), fours(2, n), fours(3, n));
    let blank = vec![[f32::NAN; 4]; n];
    let inputs = [bytes(&patches), bytes(&own), bytes(&light), bytes(&unshot), bytes(&blank)];
    let found = floats(&bench.threads(&SEND_LIGHT, &inputs, entries(n))[4]);
    let reflected = |slot: usize, c: usize| reflectance(&patches[slot], c) * wide(&light, slot, c);
    let sent = |slot: usize, c| wide(&own, slot, c) + reflected(slot, c) - wide(&unshot, slot, c);
    assert_near(&found, each(n, sent), "sent");
    let inputs = [bytes(&patches), bytes(&unshot), bytes(&light), bytes(&blank)];
    let found = floats(&bench.threads(&SEND_REST, &inputs, entries(n))[3]);
    assert_near(&found, each(n, |slot, c| wide(&unshot, slot, c) + reflected(slot, c)), "rest");
}

fn draws_of_the_outside(bench: &Bench<'_>, n: usize) {
    // Rounding leaves less than nothing now and then; some rows see no sky.
    let shares: Vec<f32> = (0..n).map(|slot| random(4, slot) - 0.1).collect();
    let sky_shares: Vec<f32> =
        (0..n).map(|slot| if slot % 3 == 0 { 0.0 } else { 0.3 * random(5, slot) }).collect();
    let (outside, sky) = (fours(6, n), fours(7, n));
    let blank = vec![[f32::NAN; 4]; 2 * n];
    let inputs = [bytes(&shares), bytes(&sky_shares), bytes(&outside), bytes(&sky), bytes(&blank)];
    let found = floats(&bench.threads(&SHARE_OUTSIDE, &inputs, entries(n))[4]);
    let over = |light: f64, share: f32| if share > 0.0 { light / f64::from(share) } else { 0.0 };
    let drawn = |at: usize, c: usize| {
        let slot = at / 2;
        let sky_share = sky_part(shares[slot], sky_shares[slot]);
        let from_sky = if sky_share > 0.0 { wide(&sky, slot, c) } else { 0.0 };
        match at % 2 {
            0 => over((wide(&outside, slot, c) - from_sky).max(0.0), shares[slot] - sky_share),
            _ => over(from_sky, sky_share),
        }
    };
    assert_near(&found, each(2 * n, drawn), "drawn");
}

fn sources_that_change(bench: &Bench<'_>, n: usize) {
    let patches = residents(n);
    let [new_own, new_outside, own, outside, light, unshot] = [8, 9, 10, 11, 12, 13].map(|of| fours(of, n));
    for is_shot in [0u32, 1] {
        let inputs = [
            bytes(&patches),
            bytes(&new_own),
            bytes(&new_outside),
            bytes(&own),
            bytes(&outside),
            bytes(&light),
            bytes(&unshot),
        ];
        let outputs = bench.threads(&TAKE_SOURCES, &inputs, Pass { is_shot, ..entries(n) });
        assert_eq!(values::<Four>(&outputs[3]), new_own);
        assert_eq!(values::<Four>(&outputs[4]), new_outside);
        let shot = f64::from(is_shot);
        let more_in = |slot, c| shot * (wide(&new_outside, slot, c) - wide(&outside, slot, c));
        let more = |slot, c| shot * (wide(&new_own, slot, c) - wide(&own, slot, c));
        assert_near(&floats(&outputs[5]), each(n, |s, c| wide(&light, s, c) + more_in(s, c)), "light");
        let left =
            |s: usize, c| wide(&unshot, s, c) + more(s, c) + reflectance(&patches[s], c) * more_in(s, c);
        assert_near(&floats(&outputs[6]), each(n, left), "unshot");
    }
}

fn slots_that_are_left(bench: &Bench<'_>, n: usize) {
    // Every other slot, last first.
    let slots: Vec<u32> = (0..n as u32).rev().map(|at| 2 * at + 1).collect();
    let light = fours(14, 2 * n + 1);
    let mut inputs = vec![bytes(&slots)];
    inputs.resize(7, bytes(&light));
    let outputs = bench.threads(&CLEAR_SLOTS, &inputs, entries(n));
    let kept = |slot: usize| if slot % 2 == 1 { [0.0; 4] } else { light[slot] };
    let expected: Vec<Four> = (0..light.len()).map(kept).collect();
    assert!(outputs[1..].iter().all(|output| values::<Four>(output) == expected));
}

fn rows_that_are_gathered(bench: &Bench<'_>, n: usize) {
    let (rows, links) = link_rows(n);
    let (sent, outside, patches) = (fours(15, n), fours(16, n), residents(n));
    // All slots but every third, last first.
    let slots: Vec<u32> = (0..n as u32).rev().filter(|slot| slot % 3 != 1).collect();
    let is_listed = |slot: usize| slot % 3 != 1;
    let blank = vec![[-1.0f32; 4]; n];
    let inputs = [bytes(&slots), bytes(&rows), bytes(&links), bytes(&sent), bytes(&outside), bytes(&blank)];
    let grid = folded(slots.len().div_ceil(4) as u32);
    let found = bench.run(&GATHER_ROWS, &inputs, entries(slots.len()), grid).remove(5);
    let arriving = |slot: usize, c: usize| {
        let from = |link: &earthshine_shaders::host::Link| {
            f64::from(link.share) * wide(&sent, link.slot as usize, c)
        };
        let sum: f64 = of_row(&rows[slot], &links).iter().map(from).sum();
        if is_listed(slot) { sum + wide(&outside, slot, c) } else { -1.0 }
    };
    assert_near(&floats(&found), each(n, arriving), "gathered");

    let gathered: Vec<Four> = values(&found);
    let (light, unshot) = (fours(17, n), fours(18, n));
    for (is_shot, tolerance) in [(0u32, 0.0f32), (1, 0.0), (1, 0.5)] {
        let inputs = [bytes(&slots), bytes(&patches), &found, bytes(&light), bytes(&unshot)];
        let pass = Pass { is_shot, first_weight: tolerance, ..entries(slots.len()) };
        let outputs = bench.threads(&TAKE_GATHERED, &inputs, pass);
        let is_taken = |slot: usize, c: usize| {
            let (fresh, old) = (gathered[slot][c], light[slot][c]);
            is_listed(slot) && (fresh - old).abs() > tolerance * fresh.abs()
        };
        let of_light = |s, c| wide(if is_taken(s, c) { &gathered } else { &light }, s, c);
        assert_near(&floats(&outputs[3]), each(n, of_light), "light");
        let more = |s: usize, c| {
            let gap = wide(&gathered, s, c) - wide(&light, s, c);
            if is_shot == 1 && is_taken(s, c) { reflectance(&patches[s], c) * gap } else { 0.0 }
        };
        assert_near(&floats(&outputs[4]), each(n, |s, c| wide(&unshot, s, c) + more(s, c)), "unshot");
    }
}

fn light_that_is_measured(bench: &Bench<'_>, n: usize) {
    let patches = residents(n);
    let [own, light, unshot, gathered] = [19, 20, 21, 22].map(|of| fours(of, n));
    let groups = n.div_ceil(LANES as usize);
    let taken_count = patches.iter().filter(|patch| patch.area > 0.0).count() as u32;
    let largest = |of: &dyn Fn(usize) -> f64| of(0).abs().max(of(1).abs()).max(of(2).abs());
    let power = |slot: usize, patch: &Resident| {
        let leaving = |c| wide(&own, slot, c) + reflectance(patch, c) * wide(&light, slot, c);
        f64::from(patch.area) * largest(&leaving)
    };
    let dark = |slot: usize, patch: &Resident| f64::from(patch.area) * largest(&|c| wide(&unshot, slot, c));
    let sum = |of: &dyn Fn(usize, &Resident) -> f64| -> f64 {
        patches.iter().enumerate().map(|(slot, patch)| of(slot, patch)).sum()
    };
    let before = 0.7f32;
    for is_shot in [0u32, 1] {
        let blank = vec![[f32::NAN; 4]; 2 * groups];
        let inputs =
            [bytes(&patches), bytes(&own), bytes(&light), bytes(&unshot), bytes(&gathered), bytes(&blank)];
        let sums = bench.threads(&MEASURE_LIGHT, &inputs, Pass { is_shot, ..entries(n) }).remove(5);
        let pass = Pass { is_shot, taken_count, ..entries(groups) };
        let words = vec![before.to_bits(); SHOT_WORDS as usize];
        let words = bench.run(&SUM_LIGHT, &[&sums, bytes(&words)], pass, [1, 1, 1]).remove(1);
        let words = floats(&words);
        let found = [SHOT_SCALE, SHOT_UNSHOT_SHARE, SHOT_CHANGE].map(|word| words[word as usize]);
        let expected = if is_shot == 1 {
            let (all, rest) = (sum(&power), sum(&dark));
            let mean = all / f64::from(taken_count.max(1));
            let share = if all > 0.0 { rest / all } else { 0.0 };
            [f64::from(SCALE_KEPT * before).max(mean), share, f64::from(before)]
        } else {
            let worst = step_gather::change(&light, &gathered, taken_count as usize);
            [f64::from(before), f64::from(before), worst]
        };
        assert_near(&found, expected.into_iter(), "what is measured");
    }
}

fn light_that_is_published(bench: &Bench<'_>, n: usize) {
    let (light, rest) = (fours(23, n), fours(24, n));
    for share in [0.5 * UNSHOT_MIN, 2.0 * UNSHOT_MIN] {
        let mut words = [0u32; SHOT_WORDS as usize];
        words[SHOT_UNSHOT_SHARE as usize] = share.to_bits();
        let blank = vec![f32::NAN; 3 * n];
        let inputs = [bytes(&light), bytes(&words), bytes(&rest), bytes(&blank)];
        let pass = Pass { channel_stride: n as u32, ..entries(n) };
        let outputs = bench.threads(&PUBLISH_LIGHT, &inputs, pass);
        let kept = |slot, c| if share > UNSHOT_MIN { wide(&rest, slot, c) } else { 0.0 };
        assert_near(&floats(&outputs[2]), each(n, kept), "rest");
        let published = (0..3 * n).map(|at| wide(&light, at % n, at / n) + kept(at % n, at / n));
        assert_near(&floats(&outputs[3]), published, "published");
    }
}

fn lamps_that_are_summed(bench: &Bench<'_>, n: usize) {
    let lamps = 5;
    let arriving = randoms(25, 4 * lamps * n);
    let blank = vec![[f32::NAN; 4]; n];
    let pass = Pass { rows: n as u32, ..entries(lamps) };
    let grid = folded((n as u32).div_ceil(RAY_LANES));
    let found = bench.run(&SUM_LAMPS, &[bytes(&arriving), bytes(&blank)], pass, grid).remove(1);
    let sum = |at: usize, c: usize| (0..lamps).map(|lamp| f64::from(arriving[4 * (lamp * n + at) + c])).sum();
    assert_near(&floats(&found), each(n, sum), "on points");
}
