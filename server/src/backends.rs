//! Who computes: backends for the engine, on the CPU or on a device, with the CPU standing in while that is opened again.

use crate::config::{BackendKind, Config};
use crate::device_light::DeviceLight;
use crate::device_receivers::DeviceReceivers;
use crate::device_source::{CurrentDevice, DeviceSource, Found, Open};
use crate::error::ServerError;
use crate::on_device::OnDevice;
use crate::pipeline_file::DeviceOpener;
use earthshine_engine::{BackendFactory, Engine, SolverConfig};
use earthshine_gpu::{AdapterChoice, GpuBackend, GpuDevice, GpuRowLight, memory};
use earthshine_radiosity::receivers::ReceiverLight;
use earthshine_radiosity::solver::row_light::RowLightFactory;
use earthshine_radiosity::solver::{CpuRowLight, Method, SolverBackend, SolverSettings};
use earthshine_radiosity::{Backend, BackendError, CpuBackend, LocalMatrix, Slot};
use std::sync::{Arc, Mutex, PoisonError};

/// Where levels are computed, found once at the start. Clones share the device.
#[derive(Debug, Clone)]
pub(crate) struct Backends {
    current: CurrentDevice,
    /// None: the CPU.
    source: Option<DeviceSource>,
    strict: bool,
}

impl Backends {
    /// Opens the device that `config` asks for.
    ///
    /// # Errors
    /// [`ServerError::Gpu`], [`ServerError::GpuSlots`].
    pub(crate) fn open(config: &Config) -> Result<Self, ServerError> {
        let choice = AdapterChoice {
            name: config.gpu_adapter.clone(),
            allow_software: false,
            without_subgroups: !config.gpu_subgroups,
        };
        Self::open_by(config, DeviceOpener::new(choice, &config.gpu_pipeline_cache).into())
    }

    /// As [`Self::open`], by `open`.
    fn open_by(config: &Config, open: Arc<Open>) -> Result<Self, ServerError> {
        let mut backends =
            Self { current: CurrentDevice::default(), source: None, strict: config.gpu_strict };
        if config.backend == BackendKind::Cpu {
            return Ok(backends);
        }
        match open() {
            Ok(device) => {
                fits(config, &device)?;
                tracing::info!(adapter = device.name(), "computing on a device");
                backends.current.set(Some(device));
                backends.source = Some(DeviceSource::new(backends.current.clone(), open));
            }
            Err(error) if config.backend == BackendKind::Auto => {
                tracing::warn!(%error, "computing on the CPU");
            }
            Err(error) => return Err(ServerError::Gpu(error)),
        }
        Ok(backends)
    }

    /// The device, now and after it was opened again.
    pub(crate) fn device(&self) -> CurrentDevice {
        self.current.clone()
    }

    /// `engine` with direct light and light of receivers on the device, if there is one.
    pub(crate) fn lighting(&self, engine: Engine) -> Engine {
        if self.source.is_none() {
            return engine;
        }
        let current = self.device();
        let receivers =
            move || Box::new(DeviceReceivers(OnDevice::new(current.clone()))) as Box<dyn ReceiverLight>;
        engine.lit_by(|| Box::new(DeviceLight(OnDevice::new(self.device())))).gathered_by(Box::new(receivers))
    }

    /// Local matrices with as many slots as asked for, or fewer if there is no memory for them.
    fn matrices(&self) -> BackendFactory {
        let Some(source) = self.source.clone() else { return Box::new(on_cpu) };
        let strict = self.strict;
        Box::new(move |wanted| match source.find() {
            Found::Device(device) => on_device(&device, wanted, strict),
            Found::Wait => Err(awaited()),
            Found::Nothing => on_cpu(wanted),
        })
    }

    /// Light over rows, for every method but the matrix.
    fn light(&self) -> RowLightFactory {
        let Some(source) = self.source.clone() else { return CpuRowLight::factory() };
        let current = self.current.clone();
        let mut on_cpu = CpuRowLight::factory();
        Box::new(move |residents, settings, light| {
            if !GpuRowLight::is_possible(settings) {
                if current.note_left_to_cpu() {
                    tracing::warn!(
                        method = %settings.method,
                        rows = ?settings.rows,
                        adaptive = settings.adaptive,
                        "no kernels draw so: this light is computed on the CPU"
                    );
                }
                return on_cpu(residents, settings, light);
            }
            match source.find() {
                Found::Device(device) => Ok(Box::new(GpuRowLight::new(&device, residents, settings, light)?)),
                Found::Wait => Err(awaited()),
                Found::Nothing => on_cpu(residents, settings, light),
            }
        })
    }

    /// Backends that solve as `config` says, with matrices where they need one.
    pub(crate) fn solving(&self, config: &SolverConfig) -> BackendFactory {
        let matrices = Arc::new(Mutex::new(self.matrices()));
        let (config, backends) = (config.clone(), self.clone());
        Box::new(move |capacity| {
            let matrices = Arc::clone(&matrices);
            let make = move |capacity| (matrices.lock().unwrap_or_else(PoisonError::into_inner))(capacity);
            let named = u8::try_from(config.by_level.len()).unwrap_or(u8::MAX);
            let needs_matrix = config.audit_every_ticks > 0
                || (0..named.max(1)).any(|level| config.settings(level, capacity, 0).needs_matrix());
            // A matrix says first how many slots there is memory for.
            let method = if needs_matrix { Method::Matrix } else { Method::Gather };
            // The engine tells each level's solver.
            let settings = SolverSettings { method, ..SolverSettings::default() };
            let backend = SolverBackend::with_light(capacity, settings, Box::new(make), backends.light())?;
            Ok(Box::new(backend) as Box<dyn Backend>)
        })
    }
}

/// A matrix as large as configured fits the device's limits, or less is said, or refused if `gpu_strict`.
fn fits(config: &Config, device: &GpuDevice) -> Result<(), ServerError> {
    let most = memory::slots_max(device.binding_bytes_max()).min(LocalMatrix::CAPACITY_MAX);
    let wanted = config.engine.resident_patches_max;
    if wanted <= most {
        return Ok(());
    }
    if config.gpu_strict {
        return Err(ServerError::GpuSlots { adapter: device.name().to_owned(), wanted, most });
    }
    tracing::warn!(adapter = device.name(), wanted, most, "the device's limits allow fewer resident patches");
    Ok(())
}

/// What a backend is told that has to wait for a device.
fn awaited() -> BackendError {
    BackendError::DeviceLost { cause: "another is being opened".to_owned() }
}

fn on_device(device: &GpuDevice, wanted: u32, strict: bool) -> Result<Box<dyn Backend>, BackendError> {
    let most = memory::slots_max(device.binding_bytes_max()).min(LocalMatrix::CAPACITY_MAX);
    let capacity = if strict { wanted } else { wanted.min(most) };
    halving(wanted, capacity, strict, |capacity| {
        GpuBackend::new(device, capacity).map(|backend| Box::new(backend) as Box<dyn Backend>)
    })
}

fn on_cpu(wanted: u32) -> Result<Box<dyn Backend>, BackendError> {
    halving(wanted, wanted, false, |capacity| match CpuBackend::new(capacity) {
        Ok(backend) => Ok(Box::new(backend) as Box<dyn Backend>),
        Err(_) => Err(BackendError::OutOfMemory { slots: capacity, bytes: LocalMatrix::bytes(capacity) }),
    })
}

/// Tries `capacity` slots, then half of them and so on for want of memory, unless `strict`.
fn halving(
    wanted: u32,
    mut capacity: u32,
    strict: bool,
    build: impl Fn(u32) -> Result<Box<dyn Backend>, BackendError>,
) -> Result<Box<dyn Backend>, BackendError> {
    loop {
        match build(capacity) {
            Err(cause @ BackendError::OutOfMemory { .. }) if !strict => {
                tracing::warn!(%cause, capacity, "a local matrix was refused");
                capacity /= 2;
                if capacity == 0 {
                    return Err(BackendError::SlotOutside(Slot(wanted), 0));
                }
            }
            result => return result,
        }
    }
}

#[cfg(test)]
mod tests;
