//! A device to test the GPU backend with: any adapter, a software one too.

use crate::shared::say;
use earthshine_gpu::{AdapterChoice, GpuDevice};

/// Set (by CI) where a missing adapter is a failure, not a reason to skip.
pub const REQUIRED: &str = "EARTHSHINE_TEST_GPU_REQUIRED";

/// Any adapter there is.
#[must_use]
pub fn any() -> AdapterChoice {
    AdapterChoice { allow_software: true, ..AdapterChoice::default() }
}

/// A device, or none with the reason printed.
///
/// # Panics
/// If there is none and [`REQUIRED`] is set.
#[must_use]
pub fn device_or_skip() -> Option<GpuDevice> {
    device_splitting(u64::MAX)
}

/// As [`device_or_skip`], splitting planes above `part_bytes_max` bytes.
///
/// # Panics
/// As [`device_or_skip`].
#[must_use]
pub fn device_splitting(part_bytes_max: u64) -> Option<GpuDevice> {
    match GpuDevice::open_splitting(&any(), part_bytes_max) {
        Ok(device) => Some(device),
        Err(error) => {
            assert!(std::env::var_os(REQUIRED).is_none(), "{REQUIRED} is set, but: {error}");
            say(&format!("SKIPPED a test of the GPU backend: {error}"));
            None
        }
    }
}
