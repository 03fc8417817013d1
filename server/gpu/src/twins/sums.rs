//! Kernels that list what of rows' sums is news.

use super::{Bench, Four, Twin, bytes, entries, fours, hold, random, values};
use crate::recorder::folded;
use earthshine_shaders::host::{Pass, ReceiverAsked, SumsEntry};
use earthshine_shaders::kernel::{COUNT_SUMS, LIST_SUMS, SCAN_GROUPS};
use earthshine_shaders::limits::{LANES, SUM_PARTS};

pub(super) const TWINS: &[Twin] =
    &[Twin { kernels: &[COUNT_SUMS, SCAN_GROUPS, LIST_SUMS], holds: what_differs_is_listed }];

#[test]
fn kernels_of_sums_are_their_twins() {
    hold(TWINS);
}

/// The twin: parts that differ in a bit, in the order asked, and told from then on.
fn list(
    asked: &[ReceiverAsked],
    gathered: &[Four],
    told: &mut [Four],
    parts: std::ops::Range<u32>,
) -> Vec<SumsEntry> {
    let mut news = Vec::new();
    for (of, asked) in (0u32..).zip(asked) {
        for part in parts.clone() {
            let at = asked.row * SUM_PARTS + part;
            let sums = gathered[(of * SUM_PARTS + part) as usize];
            let told = &mut told[at as usize];
            if sums.map(f32::to_bits) != told.map(f32::to_bits) {
                *told = sums;
                let [red, green, blue, share] = sums;
                news.push(SumsEntry { at, red, green, blue, share });
            }
        }
    }
    news
}

/// Every third row is asked for, the last first; a part of them differs from what was told, by a bit or by much.
fn what_differs_is_listed(bench: &Bench<'_>, n: usize) {
    for (parts, changed) in [(0..SUM_PARTS, 0.0), (0..SUM_PARTS, 0.3), (0..SUM_PARTS, 1.0), (1..2, 0.5)] {
        let mut told = fours(1, 3 * n * SUM_PARTS as usize);
        let asked: Vec<ReceiverAsked> = (0..n)
            .rev()
            .map(|row| ReceiverAsked { row: 3 * row as u32, first_span: 7, first_target: 9 })
            .collect();
        let gathered: Vec<Four> = asked
            .iter()
            .flat_map(|asked| (0..SUM_PARTS).map(move |part| (asked.row * SUM_PARTS + part) as usize))
            .map(|at| match random(2, at) < changed {
                true if at.is_multiple_of(2) => told[at].map(f32::next_up),
                true => told[at].map(|of| 1.0 + of),
                false => told[at],
            })
            .collect();
        let count = n * parts.len();
        let groups = count.div_ceil(LANES as usize);
        let pass = Pass { part: parts.start, part_count: parts.len() as u32, ..entries(count) };
        let none = vec![SumsEntry::default(); count + 1];
        let inputs = [bytes(&asked), bytes(&gathered), bytes(&told), &vec![0u8; 4 * groups]];
        let counted = bench.threads(&COUNT_SUMS, &inputs, pass);
        let scanned = bench.run(&SCAN_GROUPS, &[&counted[3]], entries(groups), folded(1));
        let inputs = [bytes(&asked), bytes(&gathered), bytes(&told), &scanned[0], bytes(&none)];
        let after = bench.threads(&LIST_SUMS, &inputs, pass);
        let news: Vec<SumsEntry> = values(&after[4]);
        let found = &news[1..][..news[0].at as usize];
        let expected = list(&asked, &gathered, &mut told, parts.clone());
        assert_eq!(found, expected, "{n} rows, {changed}");
        assert_eq!(values::<Four>(&after[2]), told, "{n} rows, {changed}");
        assert_eq!(found.is_empty(), changed == 0.0 || expected.is_empty());
    }
}
