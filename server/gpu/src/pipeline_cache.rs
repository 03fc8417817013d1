//! Compiled kernels as bytes, to be given to the next open: a driver that keeps none of its own then compiles nothing twice.
//!
//! It is not where they are kept: bytes go in and come out, files are the shell's. Start at [`CachedPipelines`].

use std::error::Error as _;
use wgpu::{Device, ErrorFilter, Features, PipelineCache, PipelineCacheDescriptor};

/// What [`crate::GpuDevice::open_cached`] made of the bytes it was given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CachedPipelines {
    /// What became of them.
    pub given: Given,
    /// All kernels, to be given the next time, unless they are the bytes that were given; none where the driver hands out
    /// nothing.
    pub changed: Option<Vec<u8>>,
}

/// What became of bytes that were given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Given {
    /// Only Vulkan can be given any.
    Unsupported,
    /// There were none.
    Nothing,
    /// They are of another adapter or driver, or damaged: all kernels were compiled.
    Refused {
        /// What is wrong with them.
        cause: String,
    },
    /// The driver took them.
    Taken,
}

/// A cache while kernels are compiled.
pub(crate) struct Cache {
    pub(crate) wgpu: Option<PipelineCache>,
    given: Given,
}

impl Cache {
    /// Of a device that was asked for [`Features::PIPELINE_CACHE`] if it has it. `stored` are bytes of an earlier cache or
    /// none.
    pub(crate) fn new(device: &Device, stored: &[u8]) -> Self {
        if !device.features().contains(Features::PIPELINE_CACHE) {
            return Self::none();
        }
        if stored.is_empty() {
            return Self { wgpu: Some(create(device, None)), given: Given::Nothing };
        }
        // Without a scope, bytes of another adapter would count as a device that failed.
        let scope = device.push_error_scope(ErrorFilter::Validation);
        let cache = create(device, Some(stored));
        match pollster::block_on(scope.pop()) {
            None => Self { wgpu: Some(cache), given: Given::Taken },
            Some(error) => {
                let cause = error.source().map_or_else(|| error.to_string(), innermost);
                Self { wgpu: Some(create(device, None)), given: Given::Refused { cause } }
            }
        }
    }

    /// Nothing is cached.
    pub(crate) fn none() -> Self {
        Self { wgpu: None, given: Given::Unsupported }
    }

    /// Once kernels are compiled.
    pub(crate) fn finish(self, stored: &[u8]) -> CachedPipelines {
        let bytes = self.wgpu.and_then(|cache| cache.get_data());
        CachedPipelines { given: self.given, changed: bytes.filter(|bytes| bytes != stored) }
    }
}

fn create(device: &Device, data: Option<&[u8]>) -> PipelineCache {
    let descriptor = PipelineCacheDescriptor { label: Some("kernels"), data, fallback: false };
    // SAFETY: wgpu refuses bytes whose header is not of this adapter and driver; that what follows it is whole is asked of
    // callers of `GpuDevice::open_cached`, and the server holds its file against a checksum.
    unsafe { device.create_pipeline_cache(&descriptor) }
}

fn innermost(error: &(dyn std::error::Error + 'static)) -> String {
    let mut error = error;
    while let Some(source) = error.source() {
        error = source;
    }
    error.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AdapterChoice, GpuBackend, GpuDevice};
    use earthshine_radiosity::Backend as _;
    use std::io::Write as _;

    /// Whether a device that was opened with `stored` works, and what it made of it.
    fn opened(stored: &[u8]) -> CachedPipelines {
        let any = AdapterChoice { allow_software: true, ..AdapterChoice::default() };
        let (device, pipelines) = GpuDevice::open_cached(&any, stored).expect("it was open before");
        let mut backend = GpuBackend::new(&device, 8).expect("a small matrix");
        backend.resolve().expect("a device that works");
        assert!(!device.is_lost());
        pipelines
    }

    /// Goal: bytes of another driver and damaged ones are said and cost only time. Method: those that a device gave, with
    /// each part of their header changed, cut off, and followed by more.
    #[test]
    fn stored_kernels_are_taken_or_refused_and_never_fatal() {
        let any = AdapterChoice { allow_software: true, ..AdapterChoice::default() };
        let skip = match GpuDevice::open_cached(&any, &[]) {
            Err(error) => {
                assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "{error}");
                Some(error.to_string())
            }
            Ok((_, pipelines)) if pipelines.given == Given::Unsupported => {
                assert_eq!(pipelines.changed, None);
                Some("this adapter's API takes no stored kernels".to_owned())
            }
            Ok(_) => None,
        };
        if let Some(cause) = skip {
            writeln!(std::io::stderr(), "SKIPPED a test of stored kernels: {cause}").expect("standard error");
            return;
        }
        let first = opened(&[]);
        assert_eq!(first.given, Given::Nothing);
        let bytes = first.changed.expect("the driver has something to keep");
        assert_eq!(opened(&bytes).given, Given::Taken);

        let flipped = |at: usize| {
            let mut other = bytes.clone();
            other[at] ^= 1;
            other
        };
        // Magic, version, width of pointers, API, adapter, driver, size: as wgpu's header has them.
        let headers = [0, 8, 12, 16, 24, 40, 48].map(flipped);
        let longer = [&bytes[..], &[0]].concat();
        let cut = [bytes[..10].to_vec(), bytes[..bytes.len() - 1].to_vec(), longer];
        for other in headers.iter().chain(&cut) {
            let found = opened(other);
            assert!(matches!(&found.given, Given::Refused { cause } if !cause.is_empty()), "{found:?}");
            assert!(found.changed.is_some(), "they are to be replaced");
        }
    }
}
