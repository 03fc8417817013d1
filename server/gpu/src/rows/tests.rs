//! Light over rows on a device against the CPU's, frame by frame through the same life, on whatever adapter there is.

use super::*;
use crate::AdapterChoice;
use crate::readback::read_now;
use earthshine_radiosity::bench::Streamed;
use earthshine_radiosity::closed_box::ClosedBox;
use earthshine_radiosity::solver::sampler::{FAR, SKY, sky_part};
use earthshine_radiosity::solver::shooting::{SCALE_KEPT, UNSHOT_TOLERANCE};
use earthshine_radiosity::solver::{DrawnRows, SolverBackend};
use earthshine_radiosity::tables::{AliasTable, BuildRoom, CdfTable, RowTable};
use earthshine_radiosity::{Backend, CpuBackend, Update};
use earthshine_shaders::host::{Link, LiveRow, RowSpan};
use earthshine_shaders::kernel::KERNELS;
use std::io::Write as _;
use wgpu::Buffer;

/// Slots, around the width of a workgroup.
const SIZES: [usize; 5] = [1, 63, 64, 65, 300];
const METHODS: [Method; 5] =
    [Method::Gather, Method::Alias, Method::Cdf, Method::Progressive, Method::Hybrid];

fn device_or_skip() -> Option<GpuDevice> {
    match GpuDevice::open(&AdapterChoice { allow_software: true, ..AdapterChoice::default() }) {
        Ok(device) => Some(device),
        Err(error) => {
            assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "{error}");
            // Past the test harness, which swallows what passing tests print.
            writeln!(std::io::stderr(), "SKIPPED a test of rows: {error}").expect("standard error");
            None
        }
    }
}

fn settings(method: Method) -> SolverSettings {
    let weight = if method.is_endless() { 0.75 } else { 0.998 };
    SolverSettings { method, samples_per_row: 13, history_weight: weight, ..SolverSettings::default() }
}

/// A backend on the device and one on the CPU, with the same patches and light.
struct Twins {
    backends: [SolverBackend; 2],
    streamed: Streamed,
    /// Of all light so far.
    brightest: f32,
}

impl Twins {
    fn new(device: &GpuDevice, size: usize, settings: SolverSettings) -> Self {
        let matrix = || {
            Box::new(
                |slots| Ok(Box::new(CpuBackend::new(slots).expect("a small matrix")) as Box<dyn Backend>),
            )
        };
        let made = [GpuRowLight::factory(device), CpuRowLight::factory()]
            .map(|light| SolverBackend::with_light(size as u32, settings, matrix(), light).expect("sound"));
        let streamed = Streamed::new(ClosedBox::new(size + size / 5 + 1, 5), size, 5);
        Self { backends: made, streamed, brightest: 1e-9 }
    }

    fn apply(&mut self, updates: &[Update]) {
        let [device, cpu] = &mut self.backends;
        assert_eq!(device.apply(updates), cpu.apply(updates));
    }

    fn shine(&mut self, lamp: f32, outside: f32) {
        let slots = self.streamed.taken();
        let own: Vec<Rgb> = slots.iter().map(|slot| self.streamed.source(*slot) * lamp).collect();
        let around = vec![Rgb::new(0.5, 0.6, 1.0) * outside; slots.len()];
        let sky = vec![Rgb::new(0.1, 0.2, 0.9) * outside; slots.len()];
        for backend in &mut self.backends {
            backend.set_sources(&slots, &own, &around).expect("taken slots");
            backend.set_sky(&slots, &vec![0.05; slots.len()], &sky).expect("taken slots");
        }
    }

    /// A frame on both; the largest difference of any light as a share of the brightest so far.
    fn step(&mut self) -> f32 {
        let slots = self.streamed.taken();
        let mut light = [vec![Rgb::ZERO; slots.len()], vec![Rgb::ZERO; slots.len()]];
        for (backend, light) in self.backends.iter_mut().zip(&mut light) {
            backend.step().expect("it steps");
            backend.read_irradiance(&slots, light).expect("taken slots");
        }
        self.brightest = light[1].iter().map(|light| light.max_element()).fold(self.brightest, f32::max);
        let gaps = light[0].iter().zip(&light[1]).map(|(a, b)| (*a - *b).abs().max_element());
        gaps.fold(0.0, f32::max) / self.brightest
    }
}

/// How far the two may be apart in a frame: both draw the same; who shoots at a tie is decided by rounding.
fn tolerance(method: Method) -> f32 {
    match method {
        Method::Progressive | Method::Hybrid => 2e-3,
        _ => 2e-5,
    }
}

/// Goal: every kernel is its twin. Method: a life of arrivals, lamps, swaps within budgets and departures on both.
#[test]
fn a_life_on_a_device_is_the_life_on_the_cpu() {
    let Some(device) = device_or_skip() else { return };
    for (size, method) in SIZES.into_iter().flat_map(|size| METHODS.map(|method| (size, method))) {
        let few = SolverSettings { rebuild_items_per_step: 3000, ..settings(method) };
        let mut twins = Twins::new(&device, size, few);
        let entering = twins.streamed.enter(size);
        twins.apply(&entering);
        let mut frames = 0;
        for (lamp, outside, swapped) in [(10.0, 1.0, 0), (10.0, 1.0, size / 3), (3.0, 0.2, 1), (0.0, 0.0, 0)]
        {
            // In turn: those who enter together do not see each other's first light on the device.
            for _ in 0..swapped {
                let mut updates = twins.streamed.leave(1);
                updates.extend(twins.streamed.enter(1));
                twins.apply(&updates);
            }
            twins.shine(lamp, outside);
            for _ in 0..4 {
                frames += 1;
                let gap = twins.step();
                assert!(gap <= tolerance(method), "{method}, {size} slots, frame {frames}: {gap}");
            }
        }
        let everybody = twins.streamed.leave(size);
        twins.apply(&everybody);
        twins.step();
    }
}

/// The words of a buffer.
fn words<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(device: &GpuDevice, buffer: &Buffer) -> Vec<T> {
    let bytes = read_now(device, "test", buffer, buffer.size(), |_| {}).expect("a device that works");
    bytemuck::pod_collect_to_vec(&bytes)
}

/// Asserts that rows and tables on the device are those of `residents`, word by word.
fn assert_is_copy(light: &GpuRowLight, residents: &Residents, size: usize) {
    let method = light.method;
    let (device, buffers) = (&light.device, &light.buffers);
    let (rows, links): (Vec<LiveRow>, Vec<Link>) =
        (words(device, &buffers.rows), words(device, &buffers.links.buffer));
    let outside: Vec<f32> = words(device, &buffers.outside_shares);
    let (spans, outcomes): (Vec<RowSpan>, Vec<u32>) =
        (words(device, &buffers.spans), words(device, &buffers.outcomes.buffer));
    let [bins, guide]: [Vec<u32>; 2] = [&buffers.bins, &buffers.guide].map(|of| words(device, &of.buffer));
    for slot in 0..size {
        let expected: Vec<Link> = residents
            .links
            .row(slot)
            .iter()
            .map(|link| Link { slot: link.slot, share: link.share })
            .collect();
        let row = rows[slot];
        assert!(links[row.first as usize..][..row.count as usize] == expected, "{size}: row {slot}");
        if !residents.links.is_taken(slot) {
            assert_eq!(spans[slot], RowSpan::default(), "{size}: table {slot}");
            continue;
        }
        let rest = residents.links.outside_share(slot, &mut Vec::new());
        assert_eq!(outside[slot], rest, "{size}: outside of {slot}");
        let sky = sky_part(rest, residents.sky_shares[slot]);
        let weights: Vec<f32> = expected.iter().map(|link| link.share).chain([rest - sky, sky]).collect();
        let table = table_words(method, &weights);
        let span = spans[slot];
        let (first, count) = (span.first_bin as usize, span.item_count as usize);
        let expected: Vec<u32> = expected.iter().map(|link| link.slot).chain([FAR, SKY]).collect();
        assert!(outcomes[first..][..count] == expected, "{size}: outcomes of {slot}");
        assert!(bins[first..][..count] == table.bins, "{size}, {method}: bins of {slot}");
        if method == Method::Cdf {
            let first = span.first_guide as usize;
            assert!(guide[first..][..table.guide.len()] == table.guide, "{size}: guide of {slot}");
        }
    }
}

/// What a table on the CPU looks like to a shader.
struct TableWords {
    bins: Vec<u32>,
    /// Empty for an alias table.
    guide: Vec<u32>,
}

fn table_words(method: Method, weights: &[f32]) -> TableWords {
    fn built<T: RowTable>(weights: &[f32]) -> T {
        let mut table = T::default();
        table.rebuild(weights, &mut BuildRoom::default()).expect("finite weights");
        table
    }
    if method == Method::Cdf {
        let table: CdfTable = built(weights);
        return TableWords { bins: table.ends().to_vec(), guide: table.guide().0.to_vec() };
    }
    let table: AliasTable = built(weights);
    TableWords { bins: table.bins().iter().map(|bin| bin.0).collect(), guide: Vec::new() }
}

/// Goal: rows grow, shrink and move as on the host, and tables are made from them. Method: swaps of many sizes, some who
/// come into slots that others have left, then every word is compared.
#[test]
fn rows_and_tables_stay_the_hosts_through_swaps() {
    let Some(device) = device_or_skip() else { return };
    for (size, method) in SIZES.into_iter().flat_map(|size| [Method::Alias, Method::Cdf].map(|of| (size, of)))
    {
        let mut streamed = Streamed::new(ClosedBox::new(size + size / 2 + 1, 3), size, 3);
        let mut residents = Residents::new(size);
        let method = settings(method);
        let dark = vec![[0.0; 4]; size];
        let mut light = GpuRowLight::new(&device, &residents, &method, &dark).expect("small");
        for (leave, enter) in
            [(0, size / 2 + 1), (size / 4, size / 4), (0, size), (size / 2, size / 2), (1, 1), (size / 3, 0)]
        {
            let mut updates = streamed.leave(leave);
            updates.extend(streamed.enter(enter));
            for update in &updates {
                match update {
                    Update::Add { slot, reflectance, area, row, .. } => {
                        let entries = row.iter().map(|&(other, share)| (other.0 as usize, share));
                        let at = slot.0 as usize;
                        residents.links.add(at, *area, *reflectance, entries);
                        light.come(&residents, at).expect("a device that works");
                        residents.sky_shares[at] = 0.03;
                        light.outdate(at);
                    }
                    Update::Remove { slot } => {
                        light.leave(&residents, slot.0 as usize).expect("a device that works");
                        residents.remove(slot.0 as usize);
                    }
                }
            }
            let all = SolverSettings { rebuild_items_per_step: u32::MAX, ..method };
            let frame = Frame { settings: &all, number: 0, order: &[], matrix: None };
            light.advance(&mut residents, frame).expect("a device that works");
            assert_is_copy(&light, &residents, size);
        }
    }
}

/// Goal: the same calls give the same bits. Method: a life with swaps, twice.
#[test]
fn the_same_life_twice_has_the_same_bits() {
    let Some(device) = device_or_skip() else { return };
    for method in METHODS {
        let live = || {
            let mut twins = Twins::new(&device, 130, settings(method));
            let entering = twins.streamed.enter(130);
            twins.apply(&entering);
            let mut light = Vec::new();
            for round in 0..3 {
                let mut updates = twins.streamed.leave(11);
                updates.extend(twins.streamed.enter(11));
                twins.apply(&updates);
                twins.shine(10.0 - round as f32, 1.0);
                twins.step();
                let slots = twins.streamed.taken();
                let mut now = vec![Rgb::ZERO; slots.len()];
                twins.backends[0].read_irradiance(&slots, &mut now).expect("taken slots");
                light.extend(now);
            }
            light
        };
        assert!(live() == live(), "{method}");
    }
}

/// Goal: a row longer than a section, and one that outgrows its region, are drawn from. Method: a patch that names others
/// over and over, alone on both.
#[test]
fn a_row_longer_than_a_section_is_drawn_from() {
    let Some(device) = device_or_skip() else { return };
    for method in [Method::Alias, Method::Cdf] {
        let mut twins = Twins::new(&device, 40, settings(method));
        let entering = twins.streamed.enter(39);
        twins.apply(&entering);
        twins.shine(10.0, 1.0);
        twins.step();
        let free = (0..40).map(Slot).find(|&slot| !twins.backends[0].is_taken(slot)).expect("one is free");
        // In turn, so that no entry is next to another of its slot.
        let others = twins.streamed.taken();
        let row: Vec<(Slot, f32)> = (0..9000).map(|at| (others[at % others.len()], 1e-6)).collect();
        let area_of = |slot: Slot, twins: &Twins| twins.backends[0].links().area(slot.0 as usize);
        let column = row.iter().map(|&(slot, share)| (slot, share / area_of(slot, &twins))).collect();
        let add = Update::Add { slot: free, reflectance: Rgb::splat(0.5), area: 1.0, row, column };
        twins.apply(&[add]);
        for frame in 0..4 {
            let gap = twins.step();
            assert!(gap <= 1e-4, "{method}, frame {frame}: {gap}");
        }
    }
}

/// What a device does not do, the CPU does: adaptive draws are the same to the bit.
#[test]
fn adaptive_draws_are_the_cpus() {
    let Some(device) = device_or_skip() else { return };
    let adaptive = SolverSettings { adaptive: true, ..settings(Method::Cdf) };
    assert!(!GpuRowLight::is_possible(&adaptive));
    let coloured = SolverSettings { rows: DrawnRows::Multibounce, ..settings(Method::Cdf) };
    assert!(!GpuRowLight::is_possible(&coloured) && GpuRowLight::is_possible(&settings(Method::Cdf)));
    let mut twins = Twins::new(&device, 65, settings(Method::Cdf));
    let entering = twins.streamed.enter(65);
    twins.apply(&entering);
    twins.shine(10.0, 1.0);
    twins.step();
    for backend in &mut twins.backends {
        assert_eq!(backend.set_solver(&adaptive), Ok(true));
    }
    assert!(twins.step() < 1e-4, "each goes on from its own light");
}

/// Goal: after a lost device nothing on it is taken for light, half a life included. Method: it is destroyed between a batch
/// and its step.
#[test]
fn a_lost_device_publishes_nothing() {
    let Some(device) = device_or_skip() else { return };
    for method in METHODS {
        let device = if device.is_lost() { device_or_skip().expect("there was one") } else { device.clone() };
        let mut streamed = Streamed::new(ClosedBox::new(70, 3), 64, 3);
        let (mut residents, settings) = (Residents::new(64), settings(method));
        let dark = vec![[0.0; 4]; 64];
        let mut light = GpuRowLight::new(&device, &residents, &settings, &dark).expect("small");
        for update in streamed.enter(64) {
            let Update::Add { slot, reflectance, area, row, .. } = update else { panic!("they enter") };
            let entries = row.iter().map(|&(other, share)| (other.0 as usize, share));
            residents.links.add(slot.0 as usize, area, reflectance, entries);
            light.come(&residents, slot.0 as usize).expect("a device that works");
        }
        let frame = || Frame { settings: &settings, number: 0, order: &[], matrix: None };
        light.advance(&mut residents, frame()).expect("a device that works");
        light.leave(&residents, 9).expect("collected, and the device not asked");
        residents.remove(9);
        device.destroy();
        let lost = |result| matches!(result, Err(BackendError::DeviceLost { .. }));
        assert!(lost(light.advance(&mut residents, frame())), "{method}");
        let mut read = vec![Rgb::ZERO; 9];
        let slots: Vec<Slot> = (0..9).map(Slot).collect();
        assert!(lost(light.read(&residents, &slots, &mut read)), "{method}");
        assert!(read.iter().all(|light| *light == Rgb::ZERO), "{method}");
        assert!(lost(GpuRowLight::new(&device, &residents, &settings, &dark).map(drop)), "{method}");
    }
}

/// Goal: a device that tells times tells what its kernels take, of some frames, without being asked or waited for. Method: the
/// first frame is timed, the next are not; its times come with one of those.
#[test]
fn some_frames_are_timed_for_whoever_watches() {
    let Some(device) = device_or_skip() else { return };
    let mut twins = Twins::new(&device, 65, settings(Method::Hybrid));
    let entering = twins.streamed.enter(65);
    twins.apply(&entering);
    twins.shine(10.0, 1.0);
    assert!(device.pass_totals().is_empty(), "no frame yet");
    twins.step();
    assert!(device.pass_totals().is_empty(), "nobody waits for them");
    for frame in 0..20 {
        twins.shine(9.0 - 0.1 * frame as f32, 1.0);
        twins.step();
    }
    let first = device.pass_totals();
    assert_eq!(first.is_empty(), !device.has_timestamps());
    if device.has_timestamps() {
        let shots = first["shoot_links"];
        assert!(shots.count == 4 && shots.seconds > 0.0, "{shots:?}");
    }
    twins.shine(5.0, 1.0);
    twins.step();
    assert_eq!(device.pass_totals(), first);
}

/// Goal: numbers that shaders repeat are the CPU's.
#[test]
fn constants_of_shaders_are_the_cpus() {
    let value = |name: &str| {
        let declaration = format!("const {name}: f32 = ");
        let source = KERNELS.iter().find(|kernel| kernel.source.contains(&declaration)).expect(name).source;
        let (_, rest) = source.split_once(&declaration).expect(name);
        rest.split(';').next().and_then(|number| number.parse::<f32>().ok()).expect(name)
    };
    assert_eq!(value("UNSHOT_TOLERANCE"), UNSHOT_TOLERANCE);
    assert_eq!(value("SCALE_KEPT"), SCALE_KEPT);
    assert_eq!(value("UNSHOT_MIN"), remainder::UNSHOT_MIN);
}
