//! Kernels of the local matrix: products and sums in `f64`, moves to the bit.

use super::{Bench, Twin, assert_near, bytes, entries, floats, hold, random, randoms, residents};
use crate::plane::stripe_at;
use crate::recorder::folded;
use earthshine_shaders::host::{ExchangeEntry, Member, Pass, Resident, StripeMarks};
use earthshine_shaders::kernel::{
    COMBINE_COLUMNS, COPY_COLUMNS, EMIT_EXITANCE, GATHER_COLUMNS, MULTIPLY_TILES, RANK_UPDATE, READ_MEMBERS,
    RETURN_LIGHT, SCATTER_EXCHANGE, SUM_TILES, TIMES_SMALL, WRITE_COLUMNS,
};
use earthshine_shaders::limits::{BLOCK, RETURN_BANDS, SECTIONS};

pub(super) const TWINS: &[Twin] = &[
    Twin { kernels: &[GATHER_COLUMNS, COMBINE_COLUMNS], holds: gathers_and_combinations_are_products },
    Twin { kernels: &[RETURN_LIGHT], holds: returned_light_is_a_sum },
    Twin { kernels: &[TIMES_SMALL], holds: small_products_are_sums },
    Twin { kernels: &[RANK_UPDATE], holds: updates_are_products },
    Twin { kernels: &[WRITE_COLUMNS, COPY_COLUMNS, READ_MEMBERS], holds: columns_go_where_they_belong },
    Twin {
        kernels: &[EMIT_EXITANCE, MULTIPLY_TILES, SUM_TILES],
        holds: light_is_the_product_of_what_is_lit_for_what_is_wanted,
    },
    Twin { kernels: &[SCATTER_EXCHANGE], holds: scattered_entries_are_where_they_say },
];

#[test]
fn kernels_of_the_matrix_are_their_twins() {
    hold(TWINS);
}

pub(super) const WIDTH: usize = BLOCK as usize;

/// A matrix of `n` slots in whole stripes: every third slot of the last stripe and all beyond `n` are free.
pub(super) struct Example {
    pub(super) rows: usize,
    stripes: usize,
    pub(super) residents: Vec<Resident>,
    /// Row-major, symmetric.
    dense: Vec<f32>,
}

impl Example {
    pub(super) fn new(n: usize) -> Self {
        let stripes = n.div_ceil(64);
        let rows = stripes * 64;
        let is_taken = |slot: usize| slot < n && !(slot >= 64 && slot.is_multiple_of(3));
        let resident = |slot: usize| {
            let channel = |c: u64| 0.2 + 0.6 * random(10 + c, slot);
            Resident { reflectance: [channel(0), channel(1), channel(2)], area: 0.5 + random(13, slot) }
        };
        let residents: Vec<Resident> =
            (0..rows).map(|slot| if is_taken(slot) { resident(slot) } else { Resident::default() }).collect();
        let mut dense = vec![0.0; rows * rows];
        for (at, entry) in dense.iter_mut().enumerate() {
            let (a, b) = (at / rows, at % rows);
            if is_taken(a) && is_taken(b) {
                *entry = random(20, a.max(b) * rows + a.min(b));
            }
        }
        Self { rows, stripes, residents, dense }
    }

    fn packed(&self) -> Vec<f32> {
        let mut plane = Vec::with_capacity(stripe_at(self.stripes as u64) as usize);
        for stripe in 0..self.stripes {
            for column in 0..=stripe {
                for at in 0..64 * 64 {
                    plane.push(self.dense[(stripe * 64 + at / 64) * self.rows + column * 64 + at % 64]);
                }
            }
        }
        plane
    }

    fn unpacked(&self, plane: &[f32]) -> Vec<f32> {
        let mut dense = vec![f32::NAN; self.rows * self.rows];
        let mut numbers = plane.iter();
        for stripe in 0..self.stripes {
            for column in 0..=stripe {
                for at in 0..64 * 64 {
                    let (a, b) = (stripe * 64 + at / 64, column * 64 + at % 64);
                    let &number = numbers.next().expect("as many as packed");
                    dense[a * self.rows + b] = number;
                    if stripe != column {
                        dense[b * self.rows + a] = number;
                    }
                }
            }
        }
        dense
    }

    pub(super) fn pass(&self, channel: u32) -> Pass {
        Pass {
            rows: self.rows as u32,
            stripe_count: self.stripes as u32,
            end_stripe: self.stripes as u32,
            channel,
            part_count: 1,
            channel_stride: self.rows as u32 * BLOCK,
            first_weight: 1.0,
            second_weight: -0.5,
            outside_weight: 1.0,
            ..Pass::default()
        }
    }

    fn scale(&self, slot: usize, channel: usize) -> f64 {
        let Resident { reflectance, area } = self.residents[slot];
        if area > 0.0 { f64::from(reflectance[channel]) / f64::from(area) } else { 0.0 }
    }

    fn columns(&self, purpose: u64) -> Vec<f32> {
        randoms(purpose, 3 * self.rows * WIDTH)
    }

    fn dense_at(&self, a: usize, b: usize) -> f64 {
        f64::from(self.dense[a * self.rows + b])
    }

    /// Five slots, spread, in no order; none of none.
    fn members(&self) -> Vec<Member> {
        if self.rows == 0 {
            return Vec::new();
        }
        let slots = [self.rows - 1, 0, self.rows / 2, 7, 40];
        slots
            .into_iter()
            .zip([3, 0, 31, 2, 9])
            .map(|(slot, place)| Member { slot: slot as u32, place })
            .collect()
    }
}

fn gathers_and_combinations_are_products(bench: &Bench<'_>, n: usize) {
    let example = Example::new(n);
    let (right, first, second) = (example.columns(1), example.columns(2), example.columns(3));
    let named = vec![1u32; example.stripes];
    let sums = vec![f32::NAN; 3 * SECTIONS as usize * example.rows * WIDTH];
    let plane = example.packed();
    let grid = [example.stripes as u32, SECTIONS, 1];
    let inputs = [bytes(&plane), bytes(&right), bytes(&example.residents), bytes(&named), bytes(&sums)];
    let found = floats(&bench.run(&GATHER_COLUMNS, &inputs, example.pass(1), grid)[4]);
    let stride = example.rows * WIDTH;
    let section = |at: usize, section: usize| found[(SECTIONS as usize + section) * stride + at];
    let gathered: Vec<f32> =
        (0..stride).map(|at| (0..SECTIONS as usize).map(|s| section(at, s)).sum()).collect();
    let echo = |at: usize| -> f64 {
        let (row, place) = (at / WIDTH, at % WIDTH);
        let term = |slot: usize| {
            let value = f64::from(right[stride + slot * WIDTH + place]);
            example.dense_at(row, slot) * example.scale(slot, 1) * value
        };
        (0..example.rows).map(term).sum()
    };
    assert_near(&gathered, (0..stride).map(echo), "gathered");
    // All channels from the same sums.
    let sums: Vec<f32> = (0..3)
        .flat_map(|_| &found[SECTIONS as usize * stride..][..SECTIONS as usize * stride])
        .copied()
        .collect();
    let inputs = [bytes(&first), bytes(&second), bytes(&sums), bytes(&right)];
    let grid = [(stride / 256) as u32, 3, 1];
    let found = floats(&bench.run(&COMBINE_COLUMNS, &inputs, example.pass(0), grid)[3]);
    let expected = (0..3 * stride)
        .map(|at| f64::from(first[at]) - 0.5 * f64::from(second[at]) + f64::from(gathered[at % stride]));
    assert_near(&found, expected, "combined");
}

fn returned_light_is_a_sum(bench: &Bench<'_>, n: usize) {
    let example = Example::new(n);
    let stride = example.rows * WIDTH;
    let (exchange, columns) = (randoms(4, stride), example.columns(5));
    let returned = vec![f32::NAN; 3 * RETURN_BANDS as usize * WIDTH * WIDTH];
    let inputs = [bytes(&exchange), bytes(&columns), bytes(&example.residents), bytes(&returned)];
    let found = floats(&bench.run(&RETURN_LIGHT, &inputs, example.pass(0), [RETURN_BANDS, 3, 1])[3]);
    let len = 3 * WIDTH * WIDTH;
    let summed: Vec<f32> = (0..len).map(|at| found.iter().skip(at).step_by(len).sum()).collect();
    let expected = |at: usize| -> f64 {
        let (channel, from, to) = (at / WIDTH / WIDTH, at / WIDTH % WIDTH, at % WIDTH);
        let term = |slot: usize| {
            let sent = example.scale(slot, channel) * f64::from(exchange[slot * WIDTH + from]);
            sent * f64::from(columns[channel * stride + slot * WIDTH + to])
        };
        (0..example.rows).map(term).sum()
    };
    assert_near(&summed, (0..len).map(expected), "returned");
}

fn small_products_are_sums(bench: &Bench<'_>, n: usize) {
    let example = Example::new(n);
    let stride = example.rows * WIDTH;
    let columns = example.columns(5);
    let (small, members) = (randoms(6, 9 * WIDTH * WIDTH), example.members());
    let nothing = vec![f32::NAN; 3 * stride];
    let inputs = [bytes(&columns), bytes(&small), bytes(&members), bytes(&nothing), bytes(&nothing)];
    let pass = Pass { entry_count: members.len() as u32, ..example.pass(0) };
    let outputs = bench.run(&TIMES_SMALL, &inputs, pass, [(stride / 256) as u32, 3, 1]);
    let product = |at: usize, matrix: usize| -> f64 {
        let (channel, slot, place) = (at / stride, at % stride / WIDTH, at % WIDTH);
        let small = &small[(3 * channel + matrix) * WIDTH * WIDTH..];
        let member = members.iter().rfind(|member| member.slot as usize == slot);
        match member.filter(|_| matrix == 0) {
            Some(member) => f64::from(small[2 * WIDTH * WIDTH + member.place as usize * WIDTH + place]),
            None => (0..WIDTH)
                .map(|k| f64::from(columns[at - place + k]) * f64::from(small[k * WIDTH + place]))
                .sum(),
        }
    };
    assert_near(&floats(&outputs[3]), (0..3 * stride).map(|at| product(at, 0)), "finals");
    assert_near(&floats(&outputs[4]), (0..3 * stride).map(|at| product(at, 1)), "update");
}

fn updates_are_products(bench: &Bench<'_>, n: usize) {
    let example = Example::new(n);
    let (rows, stride) = (example.rows, example.rows * WIDTH);
    let (columns, plane) = (example.columns(7), example.packed());
    // A symmetric update: both factors are the same but for a factor of their columns.
    let update: Vec<f32> =
        columns.iter().enumerate().map(|(at, value)| value * (0.1 + (at % WIDTH) as f32 / 64.0)).collect();
    let stripes = example.stripes as u32;
    let inputs = [bytes(&plane), bytes(&columns), bytes(&update)];
    let found = example
        .unpacked(&floats(&bench.run(&RANK_UPDATE, &inputs, example.pass(2), [stripes, stripes, 1])[0]));
    let entry = |at: usize| -> f64 {
        let at_of = |slot: usize| 2 * stride + slot * WIDTH;
        let (a, b) = (at_of(at / rows), at_of(at % rows));
        let sum: f64 = (0..WIDTH).map(|k| f64::from(columns[a + k]) * f64::from(update[b + k])).sum();
        f64::from(example.dense[at]) + sum
    };
    assert_near(&found, (0..rows * rows).map(entry), "updated");
    assert!(
        (0..rows * rows).all(|at| found[at].to_bits() == found[at % rows * rows + at / rows].to_bits()),
        "symmetric"
    );
}

fn columns_go_where_they_belong(bench: &Bench<'_>, n: usize) {
    let example = Example::new(n);
    let (rows, stride) = (example.rows, example.rows * WIDTH);
    let (columns, plane) = (example.columns(7), example.packed());
    let members = example.members();
    let struck: Vec<Member> = members.iter().map(|of| Member { slot: u32::MAX, ..*of }).collect();
    let pass = Pass { entry_count: members.len() as u32, ..example.pass(1) };
    let grid = [(rows as u32).div_ceil(256), members.len() as u32, 1];
    let inputs = [bytes(&plane), bytes(&columns), bytes(&members)];
    let found = example.unpacked(&floats(&bench.run(&WRITE_COLUMNS, &inputs, pass, grid)[0]));
    let value = |slot: usize, member: &Member| columns[stride + slot * WIDTH + member.place as usize];
    for (at, &entry) in found.iter().enumerate() {
        let (high, low) = ((at / rows).max(at % rows), (at / rows).min(at % rows));
        let of = |slot: usize| members.iter().find(|member| member.slot as usize == slot);
        // Where two members meet, the one in the higher slot says what both exchange.
        let expected = match (of(high), of(low)) {
            (_, Some(low)) => value(high, low),
            (Some(high), None) => value(low, high),
            (None, None) => example.dense[at],
        };
        assert_eq!(entry, expected, "{n}: {high} {low}");
    }
    let inputs = [bytes(&plane), bytes(&columns), bytes(&struck)];
    let found = floats(&bench.run(&WRITE_COLUMNS, &inputs, pass, grid)[0]);
    assert!(found.iter().zip(&plane).all(|(a, b)| a == b), "who did not enter writes nothing");
    let inputs = [bytes(&plane), bytes(&example.residents), bytes(&members), bytes(&columns)];
    let copied = floats(&bench.run(&COPY_COLUMNS, &inputs, pass, grid)[3]);
    for (slot, member) in (0..rows).flat_map(|slot| members.iter().map(move |member| (slot, member))) {
        let expected = example.dense[slot * rows + member.slot as usize];
        assert_eq!(value_of(&copied, stride, slot, member), expected);
    }
    let among = vec![0.0f32; 3 * WIDTH * WIDTH];
    let inputs = [bytes(&plane), bytes(&members), bytes(&among)];
    let among = floats(&bench.run(&READ_MEMBERS, &inputs, pass, [4, 1, 1])[2]);
    for (a, b) in members.iter().flat_map(|a| members.iter().map(move |b| (a, b))) {
        let at = WIDTH * WIDTH + a.place as usize * WIDTH + b.place as usize;
        assert_eq!(among[at], example.dense[a.slot as usize * rows + b.slot as usize]);
    }
}

fn value_of(columns: &[f32], stride: usize, slot: usize, member: &Member) -> f32 {
    columns[stride + slot * WIDTH + member.place as usize]
}

fn light_is_the_product_of_what_is_lit_for_what_is_wanted(bench: &Bench<'_>, n: usize) {
    let example = Example::new(n);
    let rows = example.rows;
    let (own, outside) = (randoms(8, 3 * rows), randoms(9, 3 * rows));
    let sent = vec![f32::NAN; 3 * rows];
    let inputs = [bytes(&own), bytes(&outside), bytes(&example.residents), bytes(&sent)];
    let mut sent =
        floats(&bench.run(&EMIT_EXITANCE, &inputs, example.pass(0), [rows.div_ceil(256) as u32, 1, 1])[3]);
    let leaving = |at: usize| {
        f64::from(own[at])
            + f64::from(example.residents[at % rows].reflectance[at / rows]) * f64::from(outside[at])
    };
    assert_near(&sent, (0..3 * rows).map(leaving), "sent");

    // The second stripe is dark, and of the last only odd slots are wanted.
    let is_lit = |slot: usize| slot / 64 != 1;
    let is_wanted = |slot: usize| slot / 64 + 1 < example.stripes || slot % 2 == 1;
    (0..3 * rows).filter(|at| !is_lit(at % rows)).for_each(|at| sent[at] = 0.0);
    let bits = |stripe: usize, half: usize, is: &dyn Fn(usize) -> bool| {
        (0..32).filter(|&bit| is(stripe * 64 + half * 32 + bit)).fold(0u32, |bits, bit| bits | 1 << bit)
    };
    let marks: Vec<StripeMarks> = (0..example.stripes)
        .map(|stripe| StripeMarks {
            lit: [bits(stripe, 0, &is_lit), bits(stripe, 1, &is_lit)],
            wanted: [bits(stripe, 0, &is_wanted), bits(stripe, 1, &is_wanted)],
        })
        .collect();
    let tiles: Vec<u32> =
        (0..example.stripes as u32).flat_map(|row| (0..=row).map(move |column| row << 16 | column)).collect();
    let plane = example.packed();
    let tile_sums = vec![f32::NAN; 3 * example.stripes * example.stripes * 64];
    let mut sums = tile_sums.clone();
    for channel in 0..3 {
        let pass = Pass { entry_count: tiles.len() as u32, ..example.pass(channel) };
        let inputs = [bytes(&plane), bytes(&tiles), bytes(&marks), bytes(&sent), bytes(&sums)];
        sums = floats(&bench.run(&MULTIPLY_TILES, &inputs, pass, folded(tiles.len() as u32))[4]);
    }
    let before = vec![-1.0f32; 3 * rows];
    let inputs = [bytes(&sums), bytes(&marks), bytes(&example.residents), bytes(&outside), bytes(&before)];
    let found = floats(&bench.run(&SUM_TILES, &inputs, example.pass(0), [example.stripes as u32, 3, 1])[4]);
    let light = |at: usize| {
        let (channel, slot) = (at / rows, at % rows);
        if !is_wanted(slot) {
            return -1.0;
        }
        let flux: f64 =
            (0..rows).map(|from| example.dense_at(slot, from) * f64::from(sent[channel * rows + from])).sum();
        let area = f64::from(example.residents[slot].area);
        f64::from(outside[at]) + if area > 0.0 { flux / area } else { 0.0 }
    };
    assert_near(&found, (0..3 * rows).map(light), "irradiance");
}

fn scattered_entries_are_where_they_say(bench: &Bench<'_>, n: usize) {
    let residents = residents(n);
    let scattered: Vec<ExchangeEntry> = (0..n)
        .map(|slot| ExchangeEntry {
            at: (slot * WIDTH + slot % WIDTH) as u32,
            exchange_m2: 1.0 + slot as f32,
        })
        .collect();
    let mut expected = vec![0.0f32; n * WIDTH];
    let inputs = [bytes(&scattered), bytes(&residents), bytes(&expected)];
    let found = floats(&bench.threads(&SCATTER_EXCHANGE, &inputs, entries(n))[2]);
    // Nothing is exchanged with who is not there.
    let is_there = |entry: &&ExchangeEntry| residents[entry.at as usize / WIDTH].area > 0.0;
    scattered.iter().filter(is_there).for_each(|entry| expected[entry.at as usize] = entry.exchange_m2);
    assert_eq!(found, expected);
}
