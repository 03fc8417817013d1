//! The device of a bake for as long as it works: when it fails, that is said once, and the CPU does what is left.

use crate::progress::Progress;
use earthshine_trace::{CasterError, RayCaster, RayDevice, SceneTracer};
use std::sync::OnceLock;

/// A device with the scene's trees on it, if there is one, and whether it has failed.
pub(crate) struct Offload<'a> {
    caster: Option<Box<dyn RayCaster>>,
    failure: OnceLock<CasterError>,
    progress: &'a dyn Progress,
}

impl<'a> Offload<'a> {
    /// Puts the trees of `tracer` on `device`.
    pub(crate) fn new(
        device: Option<&dyn RayDevice>,
        tracer: &SceneTracer<'_>,
        progress: &'a dyn Progress,
    ) -> Self {
        let mut offload = Self { caster: None, failure: OnceLock::new(), progress };
        match device.map(|device| device.caster(&tracer.layout())) {
            None => {}
            Some(Ok(caster)) => offload.caster = Some(caster),
            Some(Err(error)) => offload.fail(error),
        }
        offload
    }

    /// Who traces many rays at once; nobody where there is no device or it has failed.
    pub(crate) fn caster(&self) -> Option<&dyn RayCaster> {
        self.caster.as_deref().filter(|_| self.failure.get().is_none())
    }

    /// The device is of no more use. Only the first failure is told.
    pub(crate) fn fail(&self, error: CasterError) {
        let mut is_first = false;
        let cause = self.failure.get_or_init(|| {
            is_first = true;
            error
        });
        if is_first {
            self.progress.device_failed(&cause.0);
        }
    }

    /// What it failed of.
    pub(crate) fn failure(&self) -> Option<String> {
        self.failure.get().map(|error| error.0.clone())
    }
}
