//! Receivers on a device against their twin on the CPU, on whatever adapter there is.

use crate::receivers::{GpuReceivers, ReceiversError};
use crate::twins::{device_or_skip, device_within};
use earthshine_radiosity::receivers::{
    ColumnSpan, NO_SOURCE, ReceiverGather, ReceiverLight, ReceiverRow, ReceiverSums, RowsOf, gather_receivers,
};
use earthshine_world::random::{Purpose, hash, unit_f32};
use earthshine_world::{
    Asked, Chunk, ChunkCoord, ChunkId, ChunkRows, Column, Direction, OccluderMesh, ReceiverPlace, Receivers,
    Rgb, Sky, Vec4, VoxelCoord,
};
use std::sync::Arc;

/// Patches of each of a chunk's two segments.
const PATCHES: u32 = 300;
const SLOTS: u32 = 128;
const PARENTS: u32 = 40;
const SKY: Sky = Sky { lobes: [Rgb::ONE, Rgb::X, Rgb::Y, Rgb::Z, Rgb::splat(7.0), Rgb::splat(0.5)] };

fn random(purpose: u64, at: usize) -> f32 {
    unit_f32(hash(9, Purpose::Simulation, at as u64, purpose))
}

/// A chunk with a row of each of `lengths` columns; what of a row is no column is the sky's and absorbed.
fn chunk(number: i32, lengths: &[usize]) -> Arc<Chunk> {
    let mut rows = ChunkRows {
        segments: [0, 1].map(|x| ChunkId::new(0, ChunkCoord::new(x, number, 0))).to_vec(),
        row_starts: vec![0],
        ..ChunkRows::default()
    };
    for (row, &length) in lengths.iter().enumerate() {
        for item in 0..length {
            let at = rows.columns.len();
            let local = hash(number as u64, Purpose::Simulation, at as u64, 1) % u64::from(PATCHES + 5);
            rows.columns.push(Column { segment: (item % 2) as u16, local: local as u16 });
            rows.shares.push(random(2, at) / length as f32);
        }
        rows.row_starts.push(rows.columns.len() as u32);
        rows.sky_shares.push(std::array::from_fn(|lobe| 0.1 * random(3, row * 6 + lobe)));
        rows.absorbed_shares.push(0.1);
    }
    let place = |row| ReceiverPlace::in_air(VoxelCoord::new(row, number, 0), Direction::PosY);
    let places = (0..lengths.len() as i32).map(place).collect();
    Arc::new(Chunk {
        id: ChunkId::new(0, ChunkCoord::new(0, number, 0)),
        patches: Vec::new(),
        points: Vec::new(),
        rows: ChunkRows::default(),
        receivers: Receivers { places, rows },
        occluders: OccluderMesh::default(),
    })
}

/// Who stands for the columns of a question.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Residency {
    All,
    None,
    Gap,
    /// A third each, another one for another number.
    Mixed(usize),
}

impl Residency {
    fn source(self, patch: usize) -> u32 {
        let (slot, parent) = (patch as u32 % SLOTS, SLOTS + patch as u32 % PARENTS);
        match self {
            Self::All => slot,
            Self::None => parent,
            Self::Gap => NO_SOURCE,
            Self::Mixed(round) => [slot, parent, NO_SOURCE][(patch / 3 + round * patch) % 3],
        }
    }
}

/// A question about rows of some chunks, and what it borrows.
struct Question {
    rows_of: RowsOf,
    chunks: Vec<Arc<Chunk>>,
    first_spans: Vec<u32>,
    spans: Vec<ColumnSpan>,
    columns: Vec<u32>,
    sources: Vec<Vec4>,
    rows: Vec<ReceiverRow>,
}

impl Question {
    /// About all rows of all `chunks`, the last first.
    fn new(chunks: &[Arc<Chunk>], residency: Residency) -> Self {
        let (mut first_spans, mut spans, mut rows) = (Vec::new(), Vec::new(), Vec::new());
        for (chunk, of) in (0u32..).zip(chunks) {
            first_spans.push(spans.len() as u32);
            for _ in &of.receivers.rows.segments {
                spans.push(ColumnSpan { first: spans.len() as u32 * PATCHES, count: PATCHES });
            }
            rows.extend((0..of.receivers.rows.row_count() as u32).map(|row| ReceiverRow { chunk, row }));
        }
        rows.reverse();
        let columns = (0..spans.len() * PATCHES as usize).map(|patch| residency.source(patch)).collect();
        let light = |at: usize| Vec4::new(random(5, at), 100.0 * random(6, at), random(7, at), 1.0);
        let unknown = |at: usize| at as u32 >= SLOTS && at.is_multiple_of(5);
        let sources = (0..(SLOTS + PARENTS) as usize)
            .map(|at| if unknown(at) { Vec4::ZERO } else { light(at) })
            .collect();
        let rows_of = RowsOf::Receivers;
        Self { rows_of, chunks: chunks.to_vec(), first_spans, spans, columns, sources, rows }
    }

    fn asked<R>(&self, ask: impl FnOnce(&ReceiverGather<'_>) -> R) -> R {
        let chunks: Vec<&Arc<Chunk>> = self.chunks.iter().collect();
        ask(&ReceiverGather {
            rows_of: self.rows_of,
            chunks: &chunks,
            first_spans: &self.first_spans,
            spans: &self.spans,
            columns: &self.columns,
            sources: &self.sources,
            slot_count: SLOTS,
            sky: &SKY,
            rows: &self.rows,
        })
    }
}

fn fetched(gpu: &mut GpuReceivers) -> Vec<ReceiverSums> {
    loop {
        match gpu.fetch().expect("a device that works") {
            Asked::UnderWay => std::thread::yield_now(),
            Asked::Done(sums) => return sums,
            Asked::Lost => panic!("a gather was handed over"),
        }
    }
}

/// Asks, and holds the answer against the CPU's: light within 1e-5 of the brightest, shares within 1e-6.
fn check(gpu: &mut GpuReceivers, question: &Question) -> Vec<ReceiverSums> {
    question.asked(|gather| gpu.gather(gather)).expect("room, and a device that works");
    let (found, expected) = (fetched(gpu), question.asked(gather_receivers));
    assert_eq!(found.len(), expected.len());
    let light = |of: &ReceiverSums| [of.irradiance, of.far_irradiance, of.sky_irradiance];
    let shares = |of: &ReceiverSums| [of.resident_share, of.far_share, of.fed_share];
    let brightest = expected.iter().flat_map(light).map(Rgb::max_element).fold(0.0, f32::max);
    for (at, (found, expected)) in found.iter().zip(&expected).enumerate() {
        for (found, expected) in light(found).into_iter().zip(light(expected)) {
            let gap = (found - expected).abs().max_element();
            assert!(gap <= 1e-5 * brightest, "receiver {at}: {found} for {expected}");
        }
        for (found, expected) in shares(found).into_iter().zip(shares(expected)) {
            assert!((found - expected).abs() <= 1e-6, "receiver {at}: {found} for {expected}");
        }
    }
    found
}

/// Goal: any number of receivers, with rows of any length, whoever is resident. Method: rows of lengths around a workgroup's
/// lanes; all columns resident, all fed by parents, all gaps, mixed; the same again has the same bits.
#[test]
fn receivers_of_a_device_have_the_light_of_the_cpu() {
    let Some(device) = device_or_skip() else { return };
    let lengths = [0, 1, 63, 64, 65, 200, 0, 2];
    for count in [0, 1, 63, 64, 65, 1000] {
        let lengths: Vec<usize> = (0..count).map(|row| lengths[row % lengths.len()]).collect();
        let mut gpu = GpuReceivers::new(&device).expect("a small buffer");
        for residency in [Residency::All, Residency::None, Residency::Gap, Residency::Mixed(1)] {
            let question = Question::new(&[chunk(0, &lengths)], residency);
            let sums = check(&mut gpu, &question);
            assert_eq!(check(&mut gpu, &question), sums, "the same bits");
            let has_light = |of: &ReceiverSums| of.irradiance != Rgb::ZERO;
            assert_eq!(
                sums.iter().any(has_light),
                count > 1 && matches!(residency, Residency::All | Residency::Mixed(_))
            );
        }
    }
}

/// Goal: what changes between questions is told, and nothing else has to be. Method: patches come and go, chunks too, one of
/// them returns, and fewer rows are asked for; rows have to be put into larger buffers on the way.
#[test]
fn tables_and_chunks_follow_what_comes_and_goes() {
    let Some(device) = device_or_skip() else { return };
    let mut gpu = GpuReceivers::new(&device).expect("a small buffer");
    let chunks: Vec<Arc<Chunk>> = (0..4).map(|number| chunk(number, &[200; 120])).collect();
    for (round, held) in [0..1, 0..2, 1..3, 0..1, 0..4, 2..4].into_iter().enumerate() {
        let mut question = Question::new(&chunks[held], Residency::Mixed(round));
        check(&mut gpu, &question);
        // One patch gets a slot, one loses it, one parent becomes bright.
        question.columns[7] = 3;
        question.columns[500] = SLOTS + 1;
        question.sources[SLOTS as usize + 1] = Vec4::new(50.0, 60.0, 70.0, 1.0);
        check(&mut gpu, &question);
        question.rows.truncate(5);
        check(&mut gpu, &question);
    }
    // Rows of patches take the place of those of receivers, and the reverse.
    let mut chunk = Chunk::clone(&chunks[0]);
    std::mem::swap(&mut chunk.rows, &mut chunk.receivers.rows);
    let mut patches = Question::new(&chunks[..1], Residency::Mixed(1));
    let of_receivers = check(&mut gpu, &patches);
    (patches.chunks, patches.rows_of) = (vec![Arc::new(chunk)], RowsOf::Patches);
    let far = |of: &ReceiverSums| (of.far_irradiance, of.fed_share);
    let of_patches = check(&mut gpu, &patches);
    assert!(of_patches.iter().map(far).eq(of_receivers.iter().map(far)));
    check(&mut gpu, &Question::new(&chunks[1..], Residency::Mixed(1)));
}

/// Goal: rows whose shares are half floats take half the room, and gather the same bits. Method: the same rows, and one more that
/// does not fit, by which the whole chunk is held wide; shares of all magnitudes.
#[test]
fn rows_of_half_floats_gather_the_same_bits_in_half_the_room() {
    let Some(device) = device_or_skip() else { return };
    let lengths: Vec<usize> = (0..90).map(|row| row * 37 % 2000).collect();
    let mut narrow = Chunk::clone(&chunk(0, &lengths));
    // Eleven bits of mantissa, within 24 octaves of the largest of a row.
    for (at, share) in narrow.receivers.rows.shares.iter_mut().enumerate() {
        let magnitude = 2f32.powi(-(at as i32 * 7 % 14)) / 1024.0;
        *share = f32::from_bits((share.max(1e-6).to_bits() & 0x7F_E000) | magnitude.to_bits());
    }
    let mut wide = narrow.clone();
    let rows = &mut wide.receivers.rows;
    rows.columns.push(Column { segment: 0, local: 0 });
    rows.shares.push(0.1);
    rows.row_starts.push(rows.columns.len() as u32);
    rows.sky_shares.push([0.0; 6]);
    rows.absorbed_shares.push(0.9);
    wide.receivers.places.push(wide.receivers.places[0]);
    let [narrow, wide] = [narrow, wide].map(Arc::new);
    let gathered = |chunk: &Arc<Chunk>| {
        let mut gpu = GpuReceivers::new(&device).expect("a small buffer");
        let mut question = Question::new(&[Arc::clone(chunk)], Residency::Mixed(1));
        question.rows.retain(|row| row.row < 90);
        (check(&mut gpu, &question), *device.row_bytes() as f64)
    };
    let [(narrow, narrow_bytes), (wide, wide_bytes)] = [gathered(&narrow), gathered(&wide)];
    assert_eq!(narrow, wide, "the same bits");
    assert!(narrow_bytes < 0.52 * wide_bytes, "{narrow_bytes} of {wide_bytes} bytes");
}

/// Goal: what has not changed does not cross, whatever else is asked for in between, and what was told follows its row. Method: the
/// same rows again, in another order, fewer, after others, after their chunk went and came; bytes are counted.
#[test]
fn only_what_has_changed_comes_back() {
    let Some(device) = device_or_skip() else { return };
    let mut gpu = GpuReceivers::new(&device).expect("a small buffer");
    let chunks: Vec<Arc<Chunk>> = (0..2).map(|number| chunk(number, &[40; 300])).collect();
    let [mut both, one, other] = [0..2, 0..1, 1..2].map(|of| Question::new(&chunks[of], Residency::All));
    let bytes = || device.read_back_bytes().get("receivers").copied().unwrap_or(0);
    let mut crossed = |question: &Question| {
        let before = bytes();
        check(&mut gpu, question);
        bytes() - before
    };
    let (count, part) = (20, 20);
    // All light comes from slots, and the sky.
    assert_eq!(crossed(&both), count + 600 * 3 * part, "the first guess is all of it");
    let again = crossed(&both);
    assert!((count..=count + 600 * 3 * part).contains(&again), "guessed from before");
    assert_eq!(crossed(&both), count, "nothing but the count");
    both.rows.reverse();
    both.rows.truncate(321);
    assert_eq!(crossed(&both), count);
    // The light of one patch: those who see it, in the part that comes from slots.
    both.sources[5].x += 1.0;
    let changed = crossed(&both);
    assert!((count + part..=count + 321 * part).contains(&changed), "{changed}");
    crossed(&both);
    assert_eq!(crossed(&both), count);
    // Chunks that went and came have other rows there.
    crossed(&one);
    crossed(&one);
    assert_eq!(crossed(&one), count);
    let came = crossed(&other);
    assert!(came >= count + 300 * 2 * part, "{came}");
}

/// Goal: a gather that nobody waited for takes no word out of the next one's mouth. Method: gathers of other light are given up one after
/// the other, as soon as they were begun, or when they have come and nobody took them; the last is right.
#[test]
fn gathers_that_are_given_up_are_told_with_the_next() {
    let Some(device) = device_or_skip() else { return };
    let mut gpu = GpuReceivers::new(&device).expect("a small buffer");
    let mut question = Question::new(&[chunk(0, &[40; 90])], Residency::Mixed(0));
    for round in 0..6 {
        check(&mut gpu, &question);
        for given_up in 0..round {
            question.sources[given_up].y += 3.0;
            question.asked(|gather| gpu.gather(gather)).expect("room, and a device that works");
            if given_up % 2 == 1 {
                device.wait("test", device.queue().submit([])).expect("a device that works");
            }
        }
        check(&mut gpu, &question);
        // More rows than there was room for so far take another buffer.
        question = Question::new(&[chunk(round as i32, &vec![40; 90 << round])], Residency::Mixed(round));
        question.sources[7] = Vec4::new(1.0, 2.0, round as f32, 1.0);
    }
    check(&mut gpu, &question);
}

/// Goal: more than there is room for is refused in words, and what fits again is gathered again.
#[test]
fn rows_without_room_are_refused_until_they_fit() {
    let Some(device) = device_or_skip() else { return };
    let chunks: Vec<Arc<Chunk>> = (0..3).map(|number| chunk(number, &[100; 10])).collect();
    let mut gpu = GpuReceivers::with_room(&device, 2 * 8 * 1000).expect("a small buffer");
    let two = Question::new(&chunks[..2], Residency::Mixed(0));
    check(&mut gpu, &two);
    let three = Question::new(&chunks, Residency::Mixed(0));
    let refused = three.asked(|gather| gpu.gather(gather));
    assert_eq!(refused, Err(ReceiversError::TooLarge { bytes: 24_000, most: 16_000 }));
    assert!(!three.asked(|gather| gpu.begin(gather)));
    assert_eq!(gpu.take(), Asked::Lost);
    check(&mut gpu, &two);
    check(&mut gpu, &Question::new(&chunks[2..], Residency::All));
}

/// Goal: all who gather on a device share its room, and who leaves makes room. Method: room for three chunks' rows, two
/// gatherers with two each.
#[test]
fn gatherers_share_the_room_of_a_device() {
    let Some(device) = device_or_skip() else { return };
    let chunks: Vec<Arc<Chunk>> = (0..4).map(|number| chunk(number, &[100; 10])).collect();
    let room = 3 * 8 * 1000;
    let [mut first, mut second] =
        [(); 2].map(|()| GpuReceivers::with_room(&device, room).expect("a small buffer"));
    let [one, two, others] =
        [&chunks[..1], &chunks[..2], &chunks[2..]].map(|of| Question::new(of, Residency::Mixed(0)));
    check(&mut first, &two);
    assert!(*device.row_bytes() <= room);
    let refused = others.asked(|gather| second.gather(gather));
    assert!(
        matches!(refused, Err(ReceiversError::TooLarge { bytes: 16_000, most }) if most < 16_000),
        "{refused:?}"
    );
    drop(first);
    assert_eq!(*device.row_bytes(), 0);
    check(&mut second, &others);
    check(&mut second, &one);
    drop(second);
    assert_eq!(*device.row_bytes(), 0);
}

/// Goal: a table or sources above a binding are refused, not cut.
#[test]
fn tables_above_a_binding_are_refused() {
    let Some(device) = device_within(4 << 10) else { return };
    let mut gpu = GpuReceivers::new(&device).expect("a small buffer");
    let chunks: Vec<Arc<Chunk>> = (0..2).map(|number| chunk(number, &[4; 4])).collect();
    check(&mut gpu, &Question::new(&chunks[..1], Residency::All));
    let question = Question::new(&chunks, Residency::All);
    let refused = question.asked(|gather| gpu.gather(gather));
    assert!(matches!(refused, Err(ReceiversError::OutOfMemory { bytes: 4800 })), "{refused:?}");
}

/// Goal: sums are given once, a new gather takes the place of the last, and a lost device is nobody's answer.
#[test]
fn a_gather_is_answered_once_and_a_lost_device_never() {
    let Some(device) = device_or_skip() else { return };
    let mut gpu = GpuReceivers::new(&device).expect("a small buffer");
    assert_eq!(gpu.take(), Asked::Lost);
    let [few, many] = [3, 90].map(|rows| Question::new(&[chunk(0, &vec![64; rows])], Residency::All));
    assert!(few.asked(|gather| gpu.begin(gather)) && many.asked(|gather| gpu.begin(gather)));
    assert_eq!(fetched(&mut gpu).len(), 90);
    assert_eq!(gpu.take(), Asked::Lost);
    assert!(few.asked(|gather| gpu.begin(gather)));
    device.destroy();
    assert_eq!(gpu.take(), Asked::Lost);
    assert!(!few.asked(|gather| gpu.begin(gather)) && device.is_lost());
    assert_eq!(gpu.rows_max(), 0);
    assert!(matches!(GpuReceivers::new(&device), Err(ReceiversError::Device(_))));
}

#[test]
fn kernels_and_questions_mean_the_same_by_no_source() {
    assert_eq!(earthshine_shaders::limits::NO_SOURCE, NO_SOURCE);
}
