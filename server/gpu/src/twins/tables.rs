//! Kernels of rows and of the tables that are drawn from: words to the bit, light by its sums.

use super::{
    Bench, Twin, assert_near, bytes, entries, floats, fours, hold, link_rows, of_row, random, values,
};
use earthshine_radiosity::solver::sampler::{FAR, SKY, sky_part};
use earthshine_radiosity::tables::draw::{self, Spread};
use earthshine_radiosity::tables::masses::total_of;
use earthshine_radiosity::tables::{AliasTable, BuildRoom, CdfTable, RowTable};
use earthshine_shaders::host::{Link, LiveRow, Pass, RowEdit, RowSpan, TableSpan};
use earthshine_shaders::kernel::{
    BUILD_ALIAS, BUILD_CDF, DRAW_ALIAS, DRAW_CDF, EDIT_ROWS, FILL_TABLES, FORGET_LEAVING,
};

pub(super) const TWINS: &[Twin] = &[
    Twin { kernels: &[BUILD_ALIAS], holds: alias_tables },
    Twin { kernels: &[BUILD_CDF], holds: cumulative_tables },
    Twin { kernels: &[FILL_TABLES], holds: weights_of_rows },
    Twin { kernels: &[DRAW_ALIAS, DRAW_CDF], holds: draws_of_rows },
    Twin { kernels: &[EDIT_ROWS], holds: rows_that_change },
    Twin { kernels: &[FORGET_LEAVING], holds: tables_of_who_leaves },
];

#[test]
fn kernels_of_tables_are_their_twins() {
    hold(TWINS);
}

/// Weights of `n` rows of lengths around a workgroup's; one row in nine has none.
fn weights(n: usize) -> Vec<Vec<f32>> {
    let lengths = [2usize, 300, 63, 64, 65, 1, 255, 256, 257];
    let weight = |row: usize, item: usize| match row % 9 {
        8 => 0.0,
        // Far apart, so that some masses are none.
        3 => 1.0 / (1.0 + item as f32).powi(4),
        _ => random(40, row * 512 + item),
    };
    (0..n).map(|row| (0..lengths[row % 9]).map(|item| weight(row, item)).collect()).collect()
}

fn built<T: RowTable>(weights: &[f32]) -> T {
    let mut table = T::default();
    table.rebuild(weights, &mut BuildRoom::default()).expect("finite weights");
    table
}

/// Where each of some lists begins if each has `room` more than it needs.
fn starts(lengths: impl Iterator<Item = usize>, room: usize) -> Vec<usize> {
    let mut at = 0;
    let mut start = |length: usize| {
        let first = at;
        at += length + room;
        first
    };
    let mut starts: Vec<usize> = lengths.map(&mut start).collect();
    starts.push(start(0));
    starts
}

fn alias_tables(bench: &Bench<'_>, n: usize) {
    let rows = weights(n);
    let lengths = || rows.iter().map(Vec::len);
    let (first_weights, first_bins) = (starts(lengths(), 0), starts(lengths(), 3));
    let spans: Vec<TableSpan> = (0..n)
        .map(|row| TableSpan {
            first_weight: first_weights[row] as u32,
            first_bin: first_bins[row] as u32,
            item_count: rows[row].len() as u32,
        })
        .collect();
    let (bins, totals) = (vec![u32::MAX; first_bins[n]], vec![-1.0f32; n]);
    let all = rows.concat();
    let (masses, parts) = (vec![0u32; all.len()], vec![[0u32; 2]; all.len()]);
    let inputs = [bytes(&spans), bytes(&all), bytes(&masses), bytes(&parts), bytes(&bins), bytes(&totals)];
    let outputs = bench.groups(&BUILD_ALIAS, &inputs, entries(n));
    let mut expected = bins;
    let mut expected_totals = totals;
    for (row, weights) in rows.iter().enumerate() {
        let table: AliasTable = built(weights);
        expected_totals[row] = table.total();
        for (to, bin) in expected[first_bins[row]..].iter_mut().zip(table.bins()) {
            *to = bin.0;
        }
    }
    assert!(values::<u32>(&outputs[4]) == expected, "bins of {n}");
    assert_eq!(floats(&outputs[5]), expected_totals);
}

fn cumulative_tables(bench: &Bench<'_>, n: usize) {
    let rows = weights(n);
    let lengths = || rows.iter().map(Vec::len);
    let (first_items, first_bins) = (starts(lengths(), 0), starts(lengths(), 3));
    let first_guides = starts(lengths().map(usize::next_power_of_two), 2);
    let spans: Vec<RowSpan> = (0..n)
        .map(|row| RowSpan {
            first_item: first_items[row] as u32,
            // A free slot among them.
            item_count: if row % 50 == 49 { 0 } else { rows[row].len() as u32 },
            first_bin: first_bins[row] as u32,
            first_guide: first_guides[row] as u32,
            total_at: (n - 1 - row) as u32,
        })
        .collect();
    let (mut ends, mut guide) = (vec![7u32; first_bins[n]], vec![7u32; first_guides[n]]);
    let (all, mut totals) = (rows.concat(), vec![-1.0f32; n]);
    let inputs = [bytes(&spans), bytes(&all), bytes(&ends), bytes(&guide), bytes(&totals)];
    let outputs = bench.groups(&BUILD_CDF, &inputs, entries(n));
    for (row, span) in spans.iter().enumerate().filter(|(_, span)| span.item_count > 0) {
        let table: CdfTable = built(&rows[row]);
        totals[span.total_at as usize] = table.total();
        let put = |to: &mut [u32], from: &[u32]| to[..from.len()].copy_from_slice(from);
        put(&mut guide[first_guides[row]..], table.guide().0);
        put(&mut ends[first_bins[row]..], table.ends());
    }
    assert!(values::<u32>(&outputs[2]) == ends, "ends of {n}");
    assert!(values::<u32>(&outputs[3]) == guide, "guides of {n}");
    assert_eq!(floats(&outputs[4]), totals);
}

fn weights_of_rows(bench: &Bench<'_>, n: usize) {
    let (rows, links) = link_rows(n);
    let sky_shares: Vec<f32> = (0..n).map(|slot| 0.4 * random(41, slot)).collect();
    let lengths = || rows.iter().map(|row| row.count as usize + 2);
    let (first_items, first_bins) = (starts(lengths(), 0), starts(lengths(), 3));
    // Rows in another order than slots.
    let builds: Vec<RowSpan> = (0..n)
        .map(|slot| RowSpan {
            first_item: first_items[slot] as u32,
            item_count: rows[slot].count + 2,
            first_bin: first_bins[slot] as u32,
            first_guide: first_bins[slot] as u32,
            total_at: slot as u32,
        })
        .rev()
        .collect();
    let mut weights = vec![-1.0f32; first_items[n]];
    let (mut outcomes, mut totals) = (vec![7u32; first_bins[n]], vec![-1.0f32; n]);
    let spans = vec![RowSpan::default(); n];
    let inputs = [
        bytes(&builds),
        bytes(&rows),
        bytes(&links),
        bytes(&sky_shares),
        bytes(&weights),
        bytes(&outcomes),
        bytes(&spans),
        bytes(&totals),
    ];
    let outputs = bench.groups(&FILL_TABLES, &inputs, entries(n));
    let found_spans: Vec<RowSpan> = values(&outputs[6]);
    for slot in 0..n {
        let row = of_row(&rows[slot], &links);
        let shares: Vec<f32> = row.iter().map(|link| link.share).collect();
        let outside = 1.0 - total_of(&shares);
        let sky = sky_part(outside, sky_shares[slot]);
        let own: Vec<f32> = shares.into_iter().chain([outside - sky, sky]).collect();
        totals[slot] = total_of(&own);
        weights[first_items[slot]..][..own.len()].copy_from_slice(&own);
        let looked: Vec<u32> = row.iter().map(|link| link.slot).chain([FAR, SKY]).collect();
        outcomes[first_bins[slot]..][..own.len()].copy_from_slice(&looked);
        let first = first_bins[slot] as u32;
        let span = RowSpan {
            first_item: first,
            item_count: own.len() as u32,
            first_bin: first,
            first_guide: first,
            total_at: slot as u32,
        };
        assert_eq!(found_spans[slot], span);
    }
    assert_eq!(floats(&outputs[4]), weights);
    assert!(values::<u32>(&outputs[5]) == outcomes, "outcomes of {n}");
    assert_eq!(floats(&outputs[7]), totals);
}

/// What a row is drawn from, for a shader.
struct Drawn {
    words: Vec<u32>,
    guide: Vec<u32>,
    total: f32,
    /// Items of all draws of a frame.
    items: Vec<usize>,
}

impl Drawn {
    fn new(is_alias: bool, weights: &[f32], key: u32, samples: u32) -> Self {
        let items = |table: &dyn Fn(u32) -> usize, spread: Spread| {
            (0..samples).map(|sample| table(draw::random(key, sample, samples, spread))).collect()
        };
        if is_alias {
            let table: AliasTable = built(weights);
            let words = table.bins().iter().map(|bin| bin.0).collect();
            let items = items(&|bits| table.draw(bits), Spread::Independent);
            return Self { words, guide: Vec::new(), total: table.total(), items };
        }
        let table: CdfTable = built(weights);
        let items = items(&|bits| table.draw(bits), Spread::Systematic);
        Self { words: table.ends().to_vec(), guide: table.guide().0.to_vec(), total: table.total(), items }
    }
}

fn draws_of_rows(bench: &Bench<'_>, n: usize) {
    let rows = weights(n);
    let (sent, outside, light) = (fours(42, n), fours(43, 2 * n), fours(44, n));
    let pass = Pass { seed: 9, frame: 4, samples_per_row: 13, first_weight: 0.75, ..entries(n) };
    for is_alias in [true, false] {
        let drawn: Vec<Drawn> = rows
            .iter()
            .enumerate()
            .map(|(row, weights)| {
                let key = draw::row_key(pass.seed, pass.frame, row as u32);
                Drawn::new(is_alias, weights, key, pass.samples_per_row)
            })
            .collect();
        let (mut words, mut guide, mut outcomes) = (Vec::<u32>::new(), Vec::<u32>::new(), Vec::<u32>::new());
        let mut spans = Vec::new();
        for (row, drawn) in drawn.iter().enumerate() {
            spans.push(RowSpan {
                first_item: outcomes.len() as u32,
                // A free slot among them.
                item_count: if row % 50 == 49 { 0 } else { rows[row].len() as u32 },
                first_bin: words.len() as u32,
                first_guide: guide.len() as u32,
                total_at: row as u32,
            });
            words.extend(&drawn.words);
            guide.extend(&drawn.guide);
            let looks = |item: usize| match item % 7 {
                5 => FAR,
                6 => SKY,
                _ => ((row + item * 31) % n) as u32,
            };
            outcomes.extend((0..rows[row].len()).map(looks));
        }
        let totals: Vec<f32> = drawn.iter().map(|drawn| drawn.total).collect();
        let mut inputs = vec![
            bytes(&spans),
            bytes(&outcomes),
            bytes(&totals),
            bytes(&sent),
            bytes(&outside),
            bytes(&light),
            bytes(&words),
        ];
        let kernel = if is_alias { &DRAW_ALIAS } else { &DRAW_CDF };
        inputs.extend((!is_alias).then_some(bytes(&guide)));
        let found = floats(&bench.threads(kernel, &inputs, pass)[5]);
        let expected = |at: usize| {
            let (slot, c) = (at / 4, at % 4);
            let before = f64::from(light[slot][c]);
            if spans[slot].item_count == 0 {
                return before;
            }
            let brings = |&item: &usize| {
                f64::from(match outcomes[spans[slot].first_item as usize + item] {
                    FAR => outside[2 * slot][c],
                    SKY => outside[2 * slot + 1][c],
                    other => sent[other as usize][c],
                })
            };
            let mean = drawn[slot].items.iter().map(brings).sum::<f64>() / f64::from(pass.samples_per_row);
            0.75 * before + 0.25 * mean * f64::from(totals[slot])
        };
        assert_near(&found, (0..4 * n).map(expected), "drawn");
    }
}

/// A bit a slot: every fourth one leaves.
fn leaving(n: usize) -> Vec<u32> {
    let mut bits = vec![0u32; n.div_ceil(32)];
    (0..n).filter(|&slot| is_leaving(slot as u32)).for_each(|slot| bits[slot / 32] |= 1 << (slot % 32));
    bits
}

const fn is_leaving(slot: u32) -> bool {
    slot % 4 == 2
}

/// Rows are struck in place; then some are appended to, and half of these move. The bits of those who left before are still
/// there then, and mean nothing.
fn rows_that_change(bench: &Bench<'_>, n: usize) {
    let (rows, links) = link_rows(n);
    let (sent, arriving) = (fours(45, n), fours(46, n));
    let newcomers: Vec<Link> =
        (0..4 * n).map(|at| Link { slot: at as u32, share: random(47, at) / 500.0 }).collect();
    let bits = leaving(n);
    for is_striking in [true, false] {
        let end = links.len();
        let edits: Vec<RowEdit> = (0..n)
            .map(|slot| {
                let LiveRow { first, count } = rows[slot];
                let edit = RowEdit {
                    slot: slot as u32,
                    old_first: first,
                    old_count: count,
                    first,
                    ..RowEdit::default()
                };
                match (is_striking, slot % 2) {
                    (true, _) => edit,
                    // Behind all others, as long as the longest may become.
                    (false, 0) => RowEdit {
                        first: (end + slot * 160) as u32,
                        first_new: 4 * slot as u32,
                        new_count: 4,
                        ..edit
                    },
                    (false, _) => RowEdit { first_new: 4 * slot as u32, new_count: 3, ..edit },
                }
            })
            .rev()
            .collect();
        let mut places = links.clone();
        places.resize(end + 160 * n, Link::default());
        let blank = vec![-1.0f32; n];
        let inputs = [
            bytes(&edits),
            bytes(&bits),
            bytes(&newcomers),
            bytes(&places),
            bytes(&rows),
            bytes(&blank),
            bytes(&sent),
            bytes(&arriving),
        ];
        let pass = Pass { is_leaving: u32::from(is_striking), ..entries(n) };
        let outputs = bench.groups(&EDIT_ROWS, &inputs, pass);
        let (found, found_rows): (Vec<Link>, Vec<LiveRow>) = (values(&outputs[3]), values(&outputs[4]));
        let outside = floats(&outputs[5]);
        let mut booked: Vec<[f64; 4]> = arriving.iter().map(|light| light.map(f64::from)).collect();
        for edit in &edits {
            let slot = edit.slot as usize;
            let stays = |link: &&Link| !(is_striking && is_leaving(link.slot));
            let old = of_row(&rows[slot], &links);
            let added = &newcomers[edit.first_new as usize..][..edit.new_count as usize];
            let expected: Vec<Link> = old.iter().filter(stays).chain(added).copied().collect();
            assert_eq!(found_rows[slot], LiveRow { first: edit.first, count: expected.len() as u32 });
            assert_eq!(of_row(&found_rows[slot], &found), expected, "{slot} of {n}");
            let shares: Vec<f32> = expected.iter().map(|link| link.share).collect();
            assert_eq!(outside[slot], 1.0 - total_of(&shares));
            for link in old.iter().filter(|link| !stays(link)) {
                for (booked, sent) in booked[slot].iter_mut().zip(sent[link.slot as usize]) {
                    *booked -= f64::from(link.share) * f64::from(sent);
                }
            }
        }
        assert_near(&floats(&outputs[7]), booked.into_iter().flatten(), "taken back");
    }
}

fn tables_of_who_leaves(bench: &Bench<'_>, n: usize) {
    let lengths = [2usize, 300, 63, 64, 65, 0, 255, 256, 257];
    let length = |slot: usize| lengths[slot % 9];
    let first_items = starts((0..n).map(length), 3);
    let mut outcomes: Vec<u32> = (0..first_items[n])
        .map(|at| match at % 7 {
            5 => FAR,
            6 => SKY,
            _ => ((at * 31) % n) as u32,
        })
        .collect();
    let mut spans: Vec<RowSpan> = (0..n)
        .map(|slot| RowSpan {
            first_item: first_items[slot] as u32,
            item_count: length(slot) as u32,
            total_at: slot as u32,
            ..RowSpan::default()
        })
        .collect();
    // Only rows that somebody leaves are named: two of three.
    let edits: Vec<RowEdit> = (0..n as u32)
        .filter(|slot| slot % 3 != 0)
        .map(|slot| RowEdit { slot, ..RowEdit::default() })
        .collect();
    let bits = leaving(n);
    let inputs = [bytes(&edits), bytes(&bits), bytes(&spans), bytes(&outcomes)];
    let outputs = bench.groups(&FORGET_LEAVING, &inputs, entries(edits.len()));
    for edit in &edits {
        let slot = edit.slot as usize;
        if is_leaving(edit.slot) {
            spans[slot] = RowSpan::default();
            continue;
        }
        for outcome in &mut outcomes[first_items[slot]..][..length(slot)] {
            *outcome = if *outcome < SKY && is_leaving(*outcome) { FAR } else { *outcome };
        }
    }
    assert_eq!(values::<RowSpan>(&outputs[2]), spans);
    assert!(values::<u32>(&outputs[3]) == outcomes, "outcomes of {n}");
}
