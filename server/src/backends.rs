//! Who computes: backends for the engine, on the CPU or on a device that is opened again when it is lost.

use crate::config::{BackendKind, Config};
use crate::device_light::DeviceLight;
use crate::device_receivers::DeviceReceivers;
use crate::error::ServerError;
use crate::pipeline_file::DeviceOpener;
use earthshine_engine::{BackendFactory, Engine, SolverConfig};
use earthshine_gpu::{AdapterChoice, GpuBackend, GpuDevice, GpuRowLight, memory};
use earthshine_radiosity::receivers::ReceiverLight;
use earthshine_radiosity::solver::row_light::RowLightFactory;
use earthshine_radiosity::solver::{CpuRowLight, Method, SolverBackend, SolverSettings};
use earthshine_radiosity::{Backend, BackendError, CpuBackend, LocalMatrix, Slot};
use std::sync::{Arc, Mutex, PoisonError};

/// The device that backends are built on, if any; shared so that it can be looked at from outside the engine's thread.
#[derive(Debug, Clone, Default)]
pub struct CurrentDevice(Arc<Mutex<Option<GpuDevice>>>);

impl CurrentDevice {
    /// None where the CPU computes.
    #[must_use]
    pub fn get(&self) -> Option<GpuDevice> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set(&self, device: Option<GpuDevice>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = device;
    }
}

/// Where levels are computed, found once at the start. Clones share the device.
#[derive(Debug, Clone)]
pub(crate) struct Backends {
    current: CurrentDevice,
    /// None: the CPU.
    opener: Option<DeviceOpener>,
    strict: bool,
}

impl Backends {
    /// Opens the device that `config` asks for.
    ///
    /// # Errors
    /// [`ServerError::Gpu`], [`ServerError::GpuSlots`].
    pub(crate) fn open(config: &Config) -> Result<Self, ServerError> {
        let mut backends =
            Self { current: CurrentDevice::default(), opener: None, strict: config.gpu_strict };
        if config.backend == BackendKind::Cpu {
            return Ok(backends);
        }
        let choice = AdapterChoice { name: config.gpu_adapter.clone(), allow_software: false };
        let opener = DeviceOpener::new(choice, &config.gpu_pipeline_cache);
        match opener.open() {
            Ok(device) => {
                fits(config, &device)?;
                tracing::info!(adapter = device.name(), "computing on a device");
                backends.current.set(Some(device));
                backends.opener = Some(opener);
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
        if self.opener.is_none() {
            return engine;
        }
        let current = self.device();
        let receivers = move || Box::new(DeviceReceivers::new(current.clone())) as Box<dyn ReceiverLight>;
        engine.lit_by(|| Box::new(DeviceLight::new(self.device()))).receivers_by(Box::new(receivers))
    }

    /// Local matrices with as many slots as asked for, or fewer if there is no memory for them.
    fn matrices(&self) -> BackendFactory {
        let Some(opener) = self.opener.clone() else { return Box::new(on_cpu) };
        let (current, strict) = (self.current.clone(), self.strict);
        Box::new(move |wanted| match reopened(&current, &opener) {
            Some(device) => on_device(&device, wanted, strict),
            None => on_cpu(wanted),
        })
    }

    /// Light over rows, for every method but the matrix.
    fn light(&self) -> RowLightFactory {
        match self.opener.as_ref().and_then(|opener| reopened(&self.current, opener)) {
            Some(device) => GpuRowLight::factory(&device),
            None => CpuRowLight::factory(),
        }
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

/// The device, opened again if it was lost; none where that fails, once more tried with the next backend.
fn reopened(current: &CurrentDevice, opener: &DeviceOpener) -> Option<GpuDevice> {
    if let Some(device) = current.get().filter(|device| !device.is_lost()) {
        return Some(device);
    }
    match opener.open() {
        Ok(device) => {
            tracing::warn!(adapter = device.name(), "a lost device was opened again");
            current.set(Some(device.clone()));
            Some(device)
        }
        Err(error) => {
            tracing::error!(%error, "a lost device could not be opened again; computing on the CPU");
            None
        }
    }
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
mod tests {
    use super::*;

    fn config(backend: BackendKind, gpu_adapter: &str) -> Config {
        Config { backend, gpu_adapter: gpu_adapter.to_owned(), ..Config::default() }
    }

    /// Goal: no adapter is a refusal with a cure if one was asked for, and the CPU if not. Method: an adapter that
    /// nobody has.
    #[test]
    fn without_an_adapter_gpu_is_refused_and_auto_computes_on_the_cpu() {
        let name = "an adapter that nobody has";
        let Err(error) = Backends::open(&config(BackendKind::Gpu, name)) else { panic!("there is none") };
        assert!(matches!(error, ServerError::Gpu(_)) && error.exit_code() == 5, "{error}");
        for kind in [BackendKind::Auto, BackendKind::Cpu] {
            let backends = Backends::open(&config(kind, name)).expect("the CPU is there");
            assert_eq!(backends.matrices()(8).expect("a small matrix").capacity(), 8);
            assert!(backends.device().get().is_none());
        }
    }

    /// Goal: a device whose limits are below the configured size gives as many slots as it may, and says so, or is refused
    /// where fewer are not wanted. Method: any adapter, bound to small buffers.
    #[test]
    fn limits_below_the_size_are_fewer_slots_or_a_refusal() {
        let any = AdapterChoice { allow_software: true, ..AdapterChoice::default() };
        let Ok(device) = GpuDevice::open_within(&any, 1 << 16) else {
            assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "there has to be an adapter");
            return;
        };
        let most = memory::slots_max(device.binding_bytes_max());
        assert!((1..4096).contains(&most), "{most}");
        assert_eq!(on_device(&device, 4096, false).expect("fewer").capacity(), most);
        assert!(matches!(on_device(&device, 4096, true), Err(BackendError::OutOfMemory { slots: 4096, .. })));
        let mut config = config(BackendKind::Gpu, "");
        config.engine.resident_patches_max = 4096;
        fits(&config, &device).expect("fewer are said");
        config.gpu_strict = true;
        let Err(error) = fits(&config, &device) else { panic!("strictly, 4096 do not fit") };
        assert!(
            matches!(&error, ServerError::GpuSlots { wanted: 4096, most: found, .. } if *found == most),
            "{error}"
        );
        config.engine.resident_patches_max = most;
        fits(&config, &device).expect("as many as there are");
    }

    /// Goal: a device solves whatever is asked for, and is opened again for light over rows once it is lost. Method: a
    /// hybrid, before and after.
    #[test]
    fn light_over_rows_is_made_on_the_device_that_is_there() {
        let any = AdapterChoice { allow_software: true, ..AdapterChoice::default() };
        let Ok(device) = GpuDevice::open(&any) else { return };
        let current = CurrentDevice::default();
        current.set(Some(device.clone()));
        let backends = Backends {
            current,
            opener: Some(DeviceOpener::new(any, std::path::Path::new(""))),
            strict: false,
        };
        let hybrid = SolverConfig { by_level: vec![Method::Hybrid], ..SolverConfig::default() };
        let step = || {
            let mut backend = (backends.solving(&hybrid))(16).expect("a small backend");
            backend.set_solver(&hybrid.settings(0, 16, 1)).expect("sound settings");
            backend.step().map(drop)
        };
        assert_eq!(step(), Ok(()));
        device.destroy();
        assert_eq!(step(), Ok(()), "on a device that was opened again");
        assert!(backends.device().get().is_some_and(|device| !device.is_lost()));
    }

    /// Goal: a device without room gives fewer slots, or an error if fewer are not wanted; other errors are not retried.
    #[test]
    fn want_of_memory_halves_unless_strict() {
        let small = |capacity| {
            if capacity > 10 {
                Err(BackendError::OutOfMemory { slots: capacity, bytes: 1 })
            } else {
                on_cpu(capacity)
            }
        };
        assert_eq!(halving(64, 64, false, small).expect("8 fit").capacity(), 8);
        assert!(matches!(halving(64, 64, true, small), Err(BackendError::OutOfMemory { .. })));
        let none = |capacity| Err(BackendError::OutOfMemory { slots: capacity, bytes: 1 });
        assert!(matches!(halving(64, 64, false, none), Err(BackendError::SlotOutside(Slot(64), 0))));
        let lost = |_| Err(BackendError::DeviceLost { cause: "gone".to_owned() });
        assert!(matches!(halving(64, 64, false, lost), Err(BackendError::DeviceLost { .. })));
    }
}
