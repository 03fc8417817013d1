//! Who of a block enters, and its small systems: `f32` on the device against `f64` on the host.

use super::matrix::{Example, WIDTH};
use super::{Bench, Twin, bytes, floats, hold, random, values};
use earthshine_radiosity::local_matrix::capacitance::{Entering, SmallMatrices, leaving};
use earthshine_shaders::host::{Member, Pass, Resident};
use earthshine_shaders::kernel::SOLVE_BLOCK;
use earthshine_shaders::limits::RETURN_BANDS;
use earthshine_world::Rgb;

pub(super) const TWINS: &[Twin] = &[Twin { kernels: &[SOLVE_BLOCK], holds: blocks_are_solved_as_in_f64 }];

#[test]
fn kernels_of_a_block_are_their_twins() {
    hold(TWINS);
}

/// A block of patches for [`SOLVE_BLOCK`]. Every seventh patch is a mirror, refused in one channel alone; the last offer is
/// nobody.
struct BlockExample {
    example: Example,
    /// Spread, and not in order.
    members: Vec<Member>,
    offered: Vec<Resident>,
    returned: Vec<f32>,
}

/// Numbers for each pair of a block, symmetric: a mirror sees itself, others see little of each other.
fn square(purpose: u64) -> Vec<f32> {
    let pair = |a: usize, b: usize| {
        let own = if a == b && a % 7 == 3 { 0.97 } else { 0.0 };
        own + random(purpose, a.max(b) * WIDTH + a.min(b)) / 64.0
    };
    (0..WIDTH * WIDTH).map(|at| pair(at / WIDTH, at % WIDTH)).collect()
}

impl BlockExample {
    fn new(n: usize) -> Self {
        let count = n.min(WIDTH);
        let slot = |place: usize| (place * 7 % count * (n / count.max(1))) as u32;
        let members = (0..count).map(|place| Member { slot: slot(place), place: place as u32 }).collect();
        let offer = |place: usize| match place {
            _ if place + 1 == count && count > 2 => Resident::default(),
            _ if place % 7 == 3 => Resident { reflectance: [0.3, 0.98, 0.3], area: 1.0 },
            _ => Resident {
                reflectance: std::array::from_fn(|channel| 0.9 * random(30 + channel as u64, place)),
                area: 0.5 + random(33, place),
            },
        };
        let band = |band: u64| square(50 + band).into_iter().map(|light| light / 128.0);
        let returned = (0..3 * u64::from(RETURN_BANDS)).flat_map(band).collect();
        Self { example: Example::new(n), members, offered: (0..WIDTH).map(offer).collect(), returned }
    }

    fn count(&self) -> usize {
        self.members.len()
    }

    fn run(&self, bench: &Bench<'_>, pass: Pass, among: &[f32]) -> Vec<Vec<u8>> {
        let rows = self.example.rows;
        let exchange = vec![0.0f32; rows * WIDTH];
        let small = vec![f32::NAN; 9 * WIDTH * WIDTH];
        let refused = vec![u32::MAX; rows / 32];
        let inputs: [&[u8]; 8] = [
            bytes(&self.returned),
            bytes(among),
            bytes(&self.offered),
            bytes(&self.example.residents),
            bytes(&self.members),
            bytes(&exchange),
            bytes(&small),
            bytes(&refused),
        ];
        let pass = Pass { entry_count: self.count() as u32, ..pass };
        bench.run(&SOLVE_BLOCK, &inputs, pass, [1, 1, 1])
    }

    /// Small matrices of the block, `entry` by channel and place among a pass's numbers.
    fn matrices(&self, entry: impl Fn(usize, usize) -> f64) -> SmallMatrices {
        let count = self.count();
        let mut matrices = SmallMatrices::zero(count);
        for channel in 0..3 {
            for (at, of) in matrices.plane_mut(channel).iter_mut().enumerate() {
                *of = entry(channel, at / count * WIDTH + at % count);
            }
        }
        matrices
    }
}

/// Against `f64` on the host: who enters, and the matrices of who does.
fn blocks_are_solved_as_in_f64(bench: &Bench<'_>, n: usize) {
    let block = BlockExample::new(n);
    let count = block.count();
    let mut among = square(40);
    among.resize(3 * WIDTH * WIDTH, 0.5);
    let pass = Pass { pivot_min: 0.05, ..block.example.pass(0) };
    let outputs = block.run(bench, pass, &among);
    if count == 0 {
        assert_eq!(outputs[3], bytes(&block.example.residents), "nobody comes");
        return;
    }
    let light = block.matrices(|channel, at| {
        let of_band = |band: usize| f64::from(block.returned[(band * 3 + channel) * WIDTH * WIDTH + at]);
        f64::from(among[at]) + (0..RETURN_BANDS as usize).map(of_band).sum::<f64>()
    });
    // Nobody is never refused on the host: such a patch is as one whose pivot is weak.
    let patch = |place: usize| match block.offered[place] {
        of if of.area > 0.0 => (Rgb::from_array(of.reflectance), of.area),
        _ => (Rgb::splat(1e6), 1.0),
    };
    let expected = Entering::solve(&light, 0.05, patch);
    let noted: Vec<Member> = values(&outputs[4]);
    let kept = noted.iter().enumerate().filter(|(_, of)| of.slot != u32::MAX);
    assert_eq!(kept.fold(0u32, |kept, (place, _)| kept | 1 << place), expected.kept, "{n}");
    assert!(count < WIDTH || expected.kept.count_ones() < 28, "some are refused");
    assert_small(&floats(&outputs[6]), [&expected.inverse, &expected.factor, &expected.among], count);
    let (residents, bits): (Vec<Resident>, Vec<u32>) = (values(&outputs[3]), values(&outputs[7]));
    let rows = floats(&outputs[5]);
    for (place, member) in block.members.iter().enumerate() {
        let (slot, is_kept) = (member.slot as usize, expected.kept >> place & 1 == 1);
        assert_eq!(residents[slot], if is_kept { block.offered[place] } else { Resident::default() });
        assert_eq!(bits[slot / 32] >> (slot % 32) & 1 == 0, is_kept, "{slot}");
        let (row, direct) = (&rows[slot * WIDTH..][..count], &among[place * WIDTH..][..count]);
        assert!(row.iter().zip(direct).all(|(&found, &own)| found == if is_kept { own } else { 0.0 }));
    }
    the_same_leave(bench, &block);
}

fn the_same_leave(bench: &Bench<'_>, block: &BlockExample) {
    let exchange: Vec<f32> = (60..63).flat_map(square).collect();
    let outputs = block.run(bench, Pass { is_leaving: 1, ..block.example.pass(0) }, &exchange);
    let gone = block.matrices(|channel, at| f64::from(exchange[channel * WIDTH * WIDTH + at]));
    let resident = |place: usize| {
        let of = block.example.residents[block.members[place].slot as usize];
        if of.area > 0.0 { (Rgb::from_array(of.reflectance), of.area) } else { (Rgb::ZERO, 1.0) }
    };
    let (nothing, factor) = (SmallMatrices::zero(block.count()), leaving(gone, resident));
    assert_small(&floats(&outputs[6]), [&nothing, &factor, &nothing], block.count());
    let (residents, bits): (Vec<Resident>, Vec<u32>) = (values(&outputs[3]), values(&outputs[7]));
    for slot in block.members.iter().map(|member| member.slot as usize) {
        assert_eq!(residents[slot], Resident::default());
        assert_eq!(bits[slot / 32] >> (slot % 32) & 1, 0);
    }
}

/// What a sweep in `f32` may be off, as a share of the largest number of its matrix.
const SWEEP_REL: f64 = 2e-6;

fn assert_small(found: &[f32], expected: [&SmallMatrices; 3], count: usize) {
    for (matrix, found) in found.chunks_exact(WIDTH * WIDTH).enumerate() {
        let expected = expected[matrix % 3].plane(matrix / 3);
        let largest = expected.iter().fold(0.0f64, |largest, of| largest.max(of.abs()));
        for (at, &found) in found.iter().enumerate() {
            let (row, column) = (at / WIDTH, at % WIDTH);
            // Beyond the block N is the identity, and nobody reads it.
            if row.max(column) < count {
                let gap = (f64::from(found) - expected[row * count + column]).abs();
                assert!(gap <= SWEEP_REL * largest, "{matrix}, {row} {column}: {found}, {largest}");
            }
        }
    }
}
