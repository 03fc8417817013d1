//! Kernels that list what of a step's light is news.

use super::{Bench, Twin, bytes, device_or_skip, entries, hold, random, values};
use crate::news::tests::{code, planes};
use crate::recorder::folded;
use earthshine_shaders::host::{NewsEntry, NewsMarks, Pass};
use earthshine_shaders::kernel::{COUNT_NEWS, LIST_NEWS, SCAN_GROUPS};
use earthshine_shaders::limits::LANES;
use earthshine_world::Rgb;
use std::cell::RefCell;

pub(super) const TWINS: &[Twin] =
    &[Twin { kernels: &[COUNT_NEWS, SCAN_GROUPS, LIST_NEWS], holds: what_differs_is_listed }];

#[test]
fn kernels_of_news_are_their_twins() {
    hold(TWINS);
}

/// The twin: what is news, ascending, and told from then on.
fn list(light: &[Rgb], marks: &[NewsMarks], told: &mut [u32]) -> Vec<NewsEntry> {
    let mut news = Vec::new();
    for (slot, (&light, told)) in light.iter().zip(told).enumerate() {
        let is = |bits: u32| bits >> (slot % 32) & 1 == 1;
        let NewsMarks { known, fresh } = marks[slot / 32];
        if is(known) && (is(fresh) || code(light) != *told) {
            *told = code(light);
            news.push(NewsEntry { slot: slot as u32, red: light.x, green: light.y, blue: light.z });
        }
    }
    news
}

/// The kernels in turn; what is listed, and the codes told.
fn listed(bench: &Bench<'_>, light: &[Rgb], marks: &[NewsMarks], told: &[u32]) -> (Vec<NewsEntry>, Vec<u32>) {
    let groups = light.len().div_ceil(LANES as usize);
    let pass = Pass { channel_stride: light.len() as u32, ..entries(light.len()) };
    let (light, none) = (planes(light), vec![NewsEntry::default(); light.len() + 1]);
    let (light, marks, told, counts) = (bytes(&light), bytes(marks), bytes(told), vec![0u8; 4 * groups]);
    let counted = bench.threads(&COUNT_NEWS, &[light, marks, told, &counts], pass);
    let scanned = bench.run(&SCAN_GROUPS, &[&counted[3]], entries(groups), folded(1));
    let inputs = [light, marks, told, &scanned[0], bytes(&none)];
    let after = bench.threads(&LIST_NEWS, &inputs, pass);
    let news: Vec<NewsEntry> = values(&after[4]);
    (news[1..][..news[0].slot as usize].to_vec(), values(&after[2]))
}

/// Random light, of which a part differs from what was told by less than a code's step, a part by more; random marks.
fn what_differs_is_listed(bench: &Bench<'_>, n: usize) {
    for changed in [0.0, 0.01, 0.5, 1.0] {
        let lit = |at: usize| Rgb::new(random(1, at), random(2, at), random(3, at)) * 1e3;
        let mut told: Vec<u32> = (0..n).map(|at| code(lit(at))).collect();
        let grown =
            |at: usize| lit(at) * if random(4, at) < changed { 1.01 } else { 1.0 + 1e-5 * random(5, at) };
        let light: Vec<Rgb> = (0..n).map(grown).collect();
        let bits = |purpose: u64, at: usize, share: f32| {
            (0..32).fold(0, |bits, bit| bits | u32::from(random(purpose, 32 * at + bit) < share) << bit)
        };
        let marks = |at| NewsMarks { known: bits(8, at, 0.9), fresh: bits(9, at, 0.1 * changed) };
        let marks: Vec<NewsMarks> = (0..n.div_ceil(32)).map(marks).collect();
        let found = listed(bench, &light, &marks, &told);
        let expected = list(&light, &marks, &mut told);
        assert_eq!(found, (expected, told), "{n} slots, {changed}");
    }
}

/// Goal: a device's codes are those that are published, to the bit. Method: light of all magnitudes, on and beside every
/// place where rounding turns over, and beyond both ends.
#[test]
fn codes_of_a_device_are_the_published_ones() {
    let Some(device) = device_or_skip() else { return };
    let bench = Bench { device: &device, ran: RefCell::default() };
    let mut light =
        vec![Rgb::ZERO, Rgb::new(-0.0, -1.0, 0.0), Rgb::splat(f32::MAX), Rgb::new(1e-40, 0.0, -3.0)];
    for exponent in -30..24 {
        for mantissa in [256.0, 257.0, 300.5, 400.49, 510.5, 511.0, 511.49, 511.5, 511.51] {
            let channel = mantissa * 2f32.powi(exponent);
            for channel in [channel.next_down(), channel, channel.next_up()] {
                light.extend([Rgb::new(channel, 0.0, channel * 0.37), Rgb::new(0.5, channel, 3.0) * channel]);
            }
        }
    }
    for at in 0..20_000 {
        let channel = |c: u64| random(c, at) * 2f32.powi((random(7 + c, at) * 50.0) as i32 - 26);
        light.push(Rgb::new(channel(1), channel(2), channel(3)));
    }
    let marks = vec![NewsMarks { known: u32::MAX, fresh: u32::MAX }; light.len().div_ceil(32)];
    let (news, told) = listed(&bench, &light, &marks, &vec![0; light.len()]);
    assert_eq!(news.len(), light.len());
    for (&light, told) in light.iter().zip(told) {
        assert_eq!(told, code(light), "{light}");
    }
}
