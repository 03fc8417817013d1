//! The GPU backend passes the suite of its trait on whatever adapter there is; without one these tests say why they are
//! skipped.

use earthshine_gpu::{GpuBackend, GpuDevice};
use earthshine_radiosity::Backend;
use earthshine_tests::adapter::{device_or_skip, device_within};
use earthshine_tests::backend_suite::{backend_conformance, backend_conformance_at};

fn conforms(device: &GpuDevice) {
    eprintln!("on {}", device.name());
    backend_conformance(|slots| {
        Box::new(GpuBackend::new(device, slots).expect("a small matrix")) as Box<dyn Backend>
    });
}

#[test]
fn the_gpu_backend_conforms() {
    if let Some(device) = device_or_skip() {
        conforms(&device);
    }
}

/// Goal: several blocks, stripes and sections at once.
#[test]
fn the_gpu_backend_conforms_at_a_larger_size() {
    if let Some(device) = device_or_skip() {
        backend_conformance_at(&[300], |slots| Box::new(GpuBackend::new(&device, slots).expect("small")));
    }
}

/// Goal: planes above the largest binding are split, and nobody notices. Method: a limit of two tiles, so that 65 slots
/// take two parts.
#[test]
fn the_gpu_backend_conforms_with_split_planes() {
    if let Some(device) = device_within(2 << 14) {
        conforms(&device);
    }
}
