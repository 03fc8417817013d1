//! Each kernel against its twin in plain loops, on whatever adapter there is: at no entry, one, around half a workgroup's
//! width, and at more than two workgroups.
//!
//! Twins name the kernels that they run, and are held to it; a kernel that nobody names fails
//! [`every_kernel_has_a_twin`]. Numbers around what a kernel is given are watched: it may write none of them.

mod block;
mod light;
mod matrix;
mod news;
mod points;
mod shots;
mod sums;
mod tables;

use crate::AdapterChoice;
use crate::device::GpuDevice;
use crate::readback::read_now;
use crate::recorder::{Recorder, folded, uniform_buffer};
use earthshine_shaders::host::{Link, LiveRow, Pass, Resident};
use earthshine_shaders::kernel::{
    COUNT_ENDS, FACE_FANS, GATHER_RECEIVERS, KERNELS, Kernel, LIGHT_POINTS, MAKE_RAYS, TRACE_CLOSEST,
};
use earthshine_shaders::limits::LANES;
use earthshine_world::random::{Purpose, hash, unit_f32};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::io::Write as _;
use wgpu::BufferUsages;

/// Entries: slots, rows, points or whatever a kernel has a thread or a workgroup for.
const SIZES: [usize; 6] = [0, 1, 63, 64, 65, 600];
/// Of results of a few hundred sums of numbers below one.
const TOLERANCE: f64 = 1e-4;
/// Around each buffer, never to be changed.
const MARGIN: [u8; 64] = [0xA5; 64];

/// Kernels that are held against their twins, at such sizes, where what they work on is at hand.
const ELSEWHERE: [(Kernel, &str); 6] = [
    (TRACE_CLOSEST, include_str!("../../tests/rays/closest.rs")),
    (MAKE_RAYS, include_str!("../../tests/rays/fans.rs")),
    (FACE_FANS, include_str!("../../tests/rays/fans.rs")),
    (COUNT_ENDS, include_str!("../../tests/rays/ends.rs")),
    (LIGHT_POINTS, include_str!("../../tests/direct.rs")),
    (GATHER_RECEIVERS, include_str!("../receiver_tests.rs")),
];

/// A test of kernels at a number of entries.
struct Twin {
    kernels: &'static [Kernel],
    holds: fn(&Bench<'_>, usize),
}

/// Holds kernels against their twins, at every size, by way of subgroups and without.
fn hold(twins: &[Twin]) {
    let Some(device) = device_or_skip() else { return };
    hold_on(&device, twins);
    match device.subgroup_lanes() {
        Some(_) => {
            let choice = AdapterChoice { without_subgroups: true, ..any() };
            let without = GpuDevice::open(&choice).expect("there was one");
            assert_eq!(without.subgroup_lanes(), None);
            hold_on(&without, twins);
        }
        None => say("SKIPPED a test of kernels by way of subgroups: the adapter has none, or not in order"),
    }
}

fn hold_on(device: &GpuDevice, twins: &[Twin]) {
    for (twin, n) in twins.iter().flat_map(|twin| SIZES.map(|n| (twin, n))) {
        let bench = Bench { device, ran: RefCell::default() };
        (twin.holds)(&bench, n);
        let named: BTreeSet<&str> = twin.kernels.iter().map(|kernel| kernel.name).collect();
        assert_eq!(bench.ran.into_inner(), named, "what a twin names is what it runs");
    }
}

#[test]
fn every_kernel_has_a_twin() {
    let twins = [
        block::TWINS,
        light::TWINS,
        matrix::TWINS,
        news::TWINS,
        points::TWINS,
        shots::TWINS,
        sums::TWINS,
        tables::TWINS,
    ];
    let kernels = twins.into_iter().flatten().flat_map(|twin| twin.kernels).copied();
    for (kernel, file) in &ELSEWHERE {
        assert!(file.contains("for count in [0, 1, 63, 64, 65, "), "{}", kernel.name);
    }
    let named: BTreeSet<&str> =
        kernels.chain(ELSEWHERE.map(|(kernel, _)| kernel)).map(|kernel| kernel.name).collect();
    let described: BTreeSet<&str> = KERNELS.iter().map(|kernel| kernel.name).collect();
    assert_eq!(named, described);
}

fn any() -> AdapterChoice {
    AdapterChoice { allow_software: true, ..AdapterChoice::default() }
}

/// A device, or none with the reason printed; none is a failure where CI says so.
pub(crate) fn device_or_skip() -> Option<GpuDevice> {
    device_within(u64::MAX)
}

/// As [`device_or_skip`], one that binds no more than so many bytes.
pub(crate) fn device_within(binding_bytes_max: u64) -> Option<GpuDevice> {
    GpuDevice::open_within(&any(), binding_bytes_max)
        .inspect_err(|error| {
            assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "{error}");
            say(&format!("SKIPPED a test of kernels: {error}"));
        })
        .ok()
}

/// Past the test harness, which swallows what passing tests print.
fn say(line: &str) {
    writeln!(std::io::stderr(), "{line}").expect("standard error");
}

/// A device, and which kernels have run on it.
struct Bench<'a> {
    device: &'a GpuDevice,
    ran: RefCell<BTreeSet<&'static str>>,
}

impl Bench<'_> {
    /// Runs a kernel on buffers of these bytes; returns all of them afterwards.
    fn run(&self, kernel: &Kernel, inputs: &[&[u8]], pass: Pass, grid: [u32; 3]) -> Vec<Vec<u8>> {
        let device = self.device;
        self.ran.borrow_mut().insert(kernel.name);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let buffers: Vec<wgpu::Buffer> = inputs
            .iter()
            .map(|bytes| {
                let padded = [bytes, &MARGIN[..]].concat();
                let buffer = device.buffer("test", padded.len() as u64, usage).expect("a small buffer");
                device.queue().write_buffer(&buffer, 0, &padded);
                buffer
            })
            .collect();
        let uniforms = uniform_buffer(device).expect("a small buffer");
        let mut recorder = Recorder::new(device, &uniforms, None);
        recorder.dispatch(kernel, &buffers.iter().collect::<Vec<_>>(), pass, grid);
        recorder.submit().expect("a device that works");
        let read = |(buffer, bytes): (&wgpu::Buffer, &&[u8])| {
            let padded = (bytes.len() + MARGIN.len()) as u64;
            let mut read = read_now(device, "test", buffer, padded, |_| {}).expect("a device that works");
            assert_eq!(read.split_off(bytes.len()), MARGIN, "{} writes beyond a buffer", kernel.name);
            read
        };
        buffers.iter().zip(inputs).map(read).collect()
    }

    /// As [`Self::run`] with a thread an entry of the pass.
    fn threads(&self, kernel: &Kernel, inputs: &[&[u8]], pass: Pass) -> Vec<Vec<u8>> {
        self.run(kernel, inputs, pass, folded(pass.entry_count.div_ceil(LANES)))
    }

    /// As [`Self::run`] with a workgroup an entry of the pass.
    fn groups(&self, kernel: &Kernel, inputs: &[&[u8]], pass: Pass) -> Vec<Vec<u8>> {
        self.run(kernel, inputs, pass, folded(pass.entry_count))
    }
}

fn entries(n: usize) -> Pass {
    Pass { entry_count: n as u32, ..Pass::default() }
}

fn bytes<T: bytemuck::NoUninit>(values: &[T]) -> &[u8] {
    bytemuck::cast_slice(values)
}

/// What lies in `bytes`.
fn values<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(bytes: &[u8]) -> Vec<T> {
    bytemuck::pod_collect_to_vec(bytes)
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    values(bytes)
}

fn random(purpose: u64, at: usize) -> f32 {
    unit_f32(hash(5, Purpose::Simulation, at as u64, purpose))
}

fn randoms(purpose: u64, count: usize) -> Vec<f32> {
    (0..count).map(|at| random(purpose, at)).collect()
}

/// Light, or anything of four numbers.
type Four = [f32; 4];

fn fours(purpose: u64, count: usize) -> Vec<Four> {
    (0..count).map(|at| std::array::from_fn(|c| random(purpose, 4 * at + c))).collect()
}

/// Patches; every fifth slot is free.
fn residents(n: usize) -> Vec<Resident> {
    let resident = |slot: usize| Resident {
        reflectance: std::array::from_fn(|c| 0.9 * random(70 + c as u64, slot)),
        area: 0.5 + random(73, slot),
    };
    (0..n).map(|slot| if slot % 5 == 4 { Resident::default() } else { resident(slot) }).collect()
}

/// Of channel 0 to 3; the fourth reflects nothing.
fn reflectance(resident: &Resident, channel: usize) -> f64 {
    resident.reflectance.get(channel).map_or(0.0, |&share| f64::from(share))
}

/// Rows of up to 150 links each, some without any, one after the other with gaps.
fn link_rows(n: usize) -> (Vec<LiveRow>, Vec<Link>) {
    let (mut rows, mut links) = (Vec::new(), Vec::new());
    for slot in 0..n {
        let count = if slot % 5 == 4 { 0 } else { slot * 7 % 151 };
        rows.push(LiveRow { first: links.len() as u32, count: count as u32 });
        let link = |at: usize| Link {
            slot: (hash(6, Purpose::Simulation, (slot * 151 + at) as u64, 0) % n as u64) as u32,
            share: random(74, slot * 151 + at) / 151.0,
        };
        links.extend((0..count + 3).map(link));
    }
    (rows, links)
}

fn of_row<'a>(row: &LiveRow, links: &'a [Link]) -> &'a [Link] {
    &links[row.first as usize..][..row.count as usize]
}

fn assert_near(found: &[f32], expected: impl Iterator<Item = f64>, what: &str) {
    let mut count = 0;
    for (at, (&found, expected)) in found.iter().zip(expected).enumerate() {
        assert!(
            (f64::from(found) - expected).abs() <= TOLERANCE * expected.abs().max(1.0),
            "{what} {at}: {found}, {expected}"
        );
        count += 1;
    }
    assert_eq!(count, found.len(), "{what}");
}
