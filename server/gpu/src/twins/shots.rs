//! Kernels that shoot: who matters, who shoots in a round, and what arrives. Choices are integers, the same to the bit.

use super::{
    Bench, Four, Twin, assert_near, bytes, entries, floats, fours, hold, link_rows, of_row, random,
    reflectance, residents, values,
};
use crate::recorder::folded;
use earthshine_radiosity::solver::shooting::UNSHOT_TOLERANCE;
use earthshine_shaders::host::{LiveRow, Pass, Resident};
use earthshine_shaders::kernel::{
    CHOOSE_CLASS, COUNT_LAST, FOLD_FLUX, SCAN_GROUPS, SHOOT_LINKS, TAKE_SHOOTERS,
};
use earthshine_shaders::limits::{
    LANES, SHOT_BRIGHTEST, SHOT_CLASSES, SHOT_LAST_CLASS, SHOT_LINKS_OF_LAST, SHOT_LISTED, SHOT_SCALE,
    SHOT_SHOOTERS, SHOT_WORDS,
};

pub(super) const TWINS: &[Twin] = &[
    Twin { kernels: &[FOLD_FLUX], holds: flux_that_is_folded },
    Twin { kernels: &[CHOOSE_CLASS], holds: the_last_class },
    Twin { kernels: &[COUNT_LAST, SCAN_GROUPS, TAKE_SHOOTERS], holds: shooters_of_a_round },
    Twin { kernels: &[SHOOT_LINKS], holds: shots_along_rows },
];

#[test]
fn kernels_of_shots_are_their_twins() {
    hold(TWINS);
}

/// Units that the brightest shot of a round has.
const UNITS: f64 = (1u32 << 29) as f64;

fn words(named: &[(u32, u32)]) -> [u32; SHOT_WORDS as usize] {
    let mut words = [0; SHOT_WORDS as usize];
    named.iter().for_each(|&(which, word)| words[which as usize] = word);
    words
}

fn class_of(importance: f32) -> usize {
    (importance.to_bits() >> 20) as usize
}

fn largest_of(unshot: &Four) -> f32 {
    unshot[0].abs().max(unshot[1].abs()).max(unshot[2].abs())
}

/// Of light that is unshot, whose scale is `scale`.
fn importance(unshot: &Four, patch: &Resident, scale: f32) -> f32 {
    let importance = largest_of(unshot) * patch.area;
    if importance > UNSHOT_TOLERANCE * scale { importance } else { 0.0 }
}

fn link_count(row: &LiveRow) -> u32 {
    row.count.max(1)
}

fn flux_that_is_folded(bench: &Bench<'_>, n: usize) {
    let (patches, (rows, _)) = (residents(n), link_rows(n));
    let (brightest, scale) = (3.5f32, 1e4f32);
    let state = words(&[(SHOT_BRIGHTEST, brightest.to_bits()), (SHOT_SCALE, scale.to_bits())]);
    let arrived: Vec<i32> = (0..3 * n).map(|at| ((random(30, at) - 0.5) * 1e8) as i32).collect();
    let (arriving, light, unshot) = (fours(31, n), fours(32, n), fours(33, n));
    let classes = vec![0u32; SHOT_CLASSES as usize];
    let inputs = [
        bytes(&patches),
        bytes(&rows),
        bytes(&state),
        bytes(&arrived),
        bytes(&arriving),
        bytes(&light),
        bytes(&unshot),
        bytes(&classes),
    ];
    let outputs = bench.threads(&FOLD_FLUX, &inputs, entries(n));
    let is_taken = |slot: usize| patches[slot].area > 0.0;
    let more = |slot: usize, c: usize| {
        let units = if c < 3 { f64::from(arrived[3 * slot + c]) } else { 0.0 };
        let more = f64::from(arriving[slot][c]) + f64::from(brightest) / UNITS * units;
        if is_taken(slot) { more } else { 0.0 }
    };
    let each =
        |of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> { (0..4 * n).map(|at| of(at / 4, at % 4)).collect() };
    let lit = each(&|slot, c| f64::from(light[slot][c]) + more(slot, c));
    assert_near(&floats(&outputs[5]), lit.into_iter(), "light");
    let left = each(&|slot, c| f64::from(unshot[slot][c]) + reflectance(&patches[slot], c) * more(slot, c));
    assert_near(&floats(&outputs[6]), left.into_iter(), "unshot");
    for slot in 0..n {
        let kept: Vec<i32> = values(&outputs[3][12 * slot..][..12]);
        assert_eq!(kept == [0; 3], is_taken(slot), "{slot}: {kept:?}");
        let kept: Vec<Four> = values(&outputs[4][16 * slot..][..16]);
        assert_eq!(kept[0] == [0.0; 4], is_taken(slot), "{slot}: {kept:?}");
    }
    // Of what the device says is unshot, so that rounding moves nobody into another class.
    let left: Vec<Four> = values(&outputs[6]);
    let mut expected = classes;
    for slot in (0..n).filter(|&slot| is_taken(slot)) {
        let importance = importance(&left[slot], &patches[slot], scale);
        expected[class_of(importance)] += if importance > 0.0 { link_count(&rows[slot]) } else { 0 };
    }
    assert_eq!(values::<u32>(&outputs[7]), expected);
}

fn the_last_class(bench: &Bench<'_>, n: usize) {
    // `n` classes that somebody is of.
    let mut classes = vec![0u32; SHOT_CLASSES as usize];
    (0..n).for_each(|at| classes[(at * 389 + 41) % SHOT_CLASSES as usize] = 1 + at as u32 * 7 % 100);
    let all: u32 = classes.iter().sum();
    for budget in [1, all / 3 + 1, all.max(1), all + 1, u32::MAX] {
        let pass = Pass { budget_links: budget, ..Pass::default() };
        let state = words(&[(SHOT_LISTED, 9), (SHOT_BRIGHTEST, 9), (SHOT_SHOOTERS, 9)]);
        let outputs = bench.run(&CHOOSE_CLASS, &[bytes(&classes), bytes(&state)], pass, [1, 1, 1]);
        assert_eq!(values::<u32>(&outputs[0]), vec![0; classes.len()], "counted afresh in the next round");
        let (mut last, mut above) = (classes.len(), 0);
        while last > 0 && above < budget {
            last -= 1;
            above += classes[last];
        }
        let of_last = budget - (above - classes[last]).min(budget);
        let named = [(SHOT_LAST_CLASS, last as u32), (SHOT_LINKS_OF_LAST, of_last), (SHOT_SHOOTERS, 9)];
        assert_eq!(values::<u32>(&outputs[1]), words(&named), "{budget} of {all}");
    }
}

fn shooters_of_a_round(bench: &Bench<'_>, n: usize) {
    let (patches, (rows, _)) = (residents(n), link_rows(n));
    // Few classes, so that the last one has many.
    let bright = |slot: usize| {
        let light = 2.0f32.powi((slot * 7 % 5) as i32 - 2) * (1.0 + 0.01 * random(34, slot));
        if slot.is_multiple_of(11) { [0.0; 4] } else { [light, -0.3 * light, 0.1, 0.0] }
    };
    let unshot: Vec<Four> = (0..n).map(bright).collect();
    let flat: Vec<Resident> = patches
        .iter()
        .map(|patch| Resident { area: if patch.area > 0.0 { 1.0 } else { 0.0 }, ..*patch })
        .collect();
    let class = |slot: usize| class_of(importance(&unshot[slot], &flat[slot], 1.0));
    for (last, of_last) in [(class_of(1.0), 0), (class_of(1.0), 500), (class_of(2.0), 1), (1, u32::MAX)] {
        let named = [(SHOT_SCALE, 1.0f32.to_bits()), (SHOT_LAST_CLASS, last as u32)];
        let mut state = words(&named);
        (state[SHOT_LINKS_OF_LAST as usize], state[SHOT_SHOOTERS as usize]) = (of_last, 5);
        let is_last = |slot: usize| class(slot) == last && unshot[slot] != [0.0; 4] && flat[slot].area > 0.0;
        let counted = |slot: usize| if is_last(slot) { link_count(&rows[slot]) } else { 0 };
        let groups = n.div_ceil(LANES as usize);
        let blank = vec![u32::MAX; groups];
        let inputs = [bytes(&flat), bytes(&rows), bytes(&unshot), bytes(&state), bytes(&blank)];
        let counts = bench.threads(&COUNT_LAST, &inputs, entries(n)).remove(4);
        let of_group = |group: usize| (256 * group..n.min(256 * group + 256)).map(counted).sum::<u32>();
        assert_eq!(values::<u32>(&counts), (0..groups).map(of_group).collect::<Vec<_>>());
        let before = bench.run(&SCAN_GROUPS, &[&counts], entries(groups), [1, 1, 1]).remove(0);
        let of_before = |group: usize| (0..group).map(of_group).sum::<u32>();
        assert_eq!(values::<u32>(&before), (0..groups).map(of_before).collect::<Vec<_>>());

        let (list, shot) = (vec![u32::MAX; n], vec![[-1.0f32; 4]; n]);
        let inputs =
            [bytes(&flat), bytes(&rows), bytes(&unshot), bytes(&state), &before, bytes(&list), bytes(&shot)];
        let outputs = bench.threads(&TAKE_SHOOTERS, &inputs, entries(n));
        let mut links = 0;
        let shoots = |slot: &usize| {
            let is_above = class(*slot) > last;
            let is_within = is_last(*slot) && links < of_last;
            links += counted(*slot);
            is_above || is_within
        };
        let expected: Vec<u32> = (0..n).filter(shoots).map(|slot| slot as u32).collect();
        let mut found: Vec<u32> = values::<u32>(&outputs[5])[..expected.len()].to_vec();
        found.sort_unstable();
        assert_eq!(found, expected);
        let brightest = expected.iter().map(|&slot| largest_of(&unshot[slot as usize])).fold(0.0, f32::max);
        state[SHOT_LISTED as usize] = expected.len() as u32;
        state[SHOT_SHOOTERS as usize] += expected.len() as u32;
        state[SHOT_BRIGHTEST as usize] = brightest.to_bits();
        assert_eq!(values::<u32>(&outputs[3]), state);
        let (mut unshot, mut shot) = (unshot.clone(), shot);
        for &slot in &expected {
            shot[slot as usize] = std::mem::take(&mut unshot[slot as usize]);
        }
        assert_eq!((values::<Four>(&outputs[2]), values::<Four>(&outputs[6])), (unshot, shot));
    }
}

fn shots_along_rows(bench: &Bench<'_>, n: usize) {
    let (mut patches, (rows, links)) = (residents(n), link_rows(n));
    // Rows lead to whoever is there.
    patches.iter_mut().for_each(|patch| patch.area = patch.area.max(0.25));
    let shot = fours(35, n);
    // Two of three, in no order.
    let shooters: Vec<u32> = (0..n as u32).rev().filter(|slot| slot % 3 != 0).collect();
    let brightest = 1.0f32;
    let state = words(&[(SHOT_BRIGHTEST, brightest.to_bits()), (SHOT_LISTED, shooters.len() as u32)]);
    let before: Vec<i32> = (0..3 * n as i32).collect();
    let inputs = [
        bytes(&patches),
        bytes(&rows),
        bytes(&links),
        bytes(&shooters),
        bytes(&shot),
        bytes(&state),
        bytes(&before),
    ];
    // Fewer workgroups than shooters: they share the list.
    let groups = n.clamp(1, 50);
    let found: Vec<i32> =
        values(&bench.run(&SHOOT_LINKS, &inputs, entries(groups), folded(groups as u32))[6]);
    let (mut expected, mut terms): (Vec<f64>, Vec<u32>) =
        (before.iter().map(|&units| f64::from(units)).collect(), vec![0; 3 * n]);
    for &slot in &shooters {
        let slot = slot as usize;
        for link in of_row(&rows[slot], &links) {
            let (to, area) = (link.slot as usize, f64::from(patches[link.slot as usize].area));
            for c in 0..3 {
                let flux = f64::from(shot[slot][c]) * f64::from(patches[slot].area);
                expected[3 * to + c] += flux * f64::from(link.share) / area * UNITS / f64::from(brightest);
                terms[3 * to + c] += 1;
            }
        }
    }
    for (at, (&found, expected)) in found.iter().zip(&expected).enumerate() {
        // A rounding to whole units a term, and of the factors before.
        let room = f64::from(terms[at]) + 1e-6 * expected.abs();
        assert!((f64::from(found) - expected).abs() <= room, "{at}: {found}, {expected}");
    }
}
