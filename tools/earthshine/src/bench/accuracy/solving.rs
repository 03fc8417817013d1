//! How the light of a measured world is solved, and where.

use crate::exit_code::WrongUse;
use crate::solver_world;
use crate::whole_world::{DirectLight, WholeLight, WholeWorld};
use clap::{Args, ValueEnum};
use earthshine_gpu::{AdapterChoice, GpuBackend, GpuDevice};
use earthshine_radiosity::solver::{Method, SolverSettings};
use earthshine_radiosity::{Backend, BackendError, CpuBackend, LocalMatrix, Slot};
use earthshine_world::{LightRig, Rgb};

/// Frames after which a solver that goes on for ever, or is not at rest, is read.
const FRAMES_MAX: u32 = 3000;

/// Which solver, and which backend.
#[derive(Args, Clone, Debug)]
pub(in crate::bench) struct SolvingArguments {
    /// How light is solved: gather (bounce by bounce until nothing changes), matrix, alias, cdf, progressive or hybrid,
    /// as in a server whose slots hold the whole world.
    #[arg(long, value_parser = method, default_value = "gather")]
    solver: Method,
    /// Where the matrix is computed: cpu, or gpu (needs --solver matrix).
    #[arg(long, default_value = "cpu")]
    pub(in crate::bench) backend: BackendKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::bench) enum BackendKind {
    Cpu,
    Gpu,
}

impl BackendKind {
    pub(in crate::bench) fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        }
    }
}

impl Default for SolvingArguments {
    fn default() -> Self {
        Self { solver: Method::Gather, backend: BackendKind::Cpu }
    }
}

fn method(name: &str) -> Result<Method, String> {
    let found = Method::ALL.into_iter().find(|method| method.name() == name);
    found.ok_or_else(|| format!("{name:?} is not gather, matrix, alias, cdf, progressive or hybrid"))
}

impl SolvingArguments {
    /// Of the solver.
    pub(in crate::bench) fn name(&self) -> &'static str {
        self.solver.name()
    }

    /// # Errors
    /// A backend that has nothing to do.
    pub(in crate::bench) fn check(&self) -> Result<(), WrongUse> {
        if self.backend == BackendKind::Gpu && self.solver != Method::Matrix {
            return Err(WrongUse("--backend gpu computes the matrix: add --solver matrix"));
        }
        Ok(())
    }

    /// The light of `rig` in `world`, all bounces.
    pub(super) fn solve(&self, world: &WholeWorld, rig: &LightRig) -> anyhow::Result<WholeLight> {
        if self.solver == Method::Gather {
            return Ok(world.solve(rig));
        }
        let areas: Vec<f32> = world.patches().map(|patch| patch.area).collect();
        let reflectance: Vec<Rgb> = world.patches().map(|patch| patch.reflectance).collect();
        let all: Vec<u32> = (0..areas.len() as u32).collect();
        let device = match self.backend {
            BackendKind::Cpu => None,
            BackendKind::Gpu => Some(GpuDevice::open(&AdapterChoice::default())?),
        };
        let matrix = move |slots: u32| {
            let too_large = |_| BackendError::OutOfMemory { slots, bytes: LocalMatrix::bytes(slots) };
            match &device {
                Some(device) => {
                    GpuBackend::new(device, slots).map(|backend| Box::new(backend) as Box<dyn Backend>)
                }
                None => CpuBackend::new(slots)
                    .map(|backend| Box::new(backend) as Box<dyn Backend>)
                    .map_err(too_large),
            }
        };
        let method = self.solver;
        let settings =
            SolverSettings { method, rebuild_items_per_step: u32::MAX, ..SolverSettings::default() };
        let (mut backend, _) =
            solver_world::backend_of(&world.rows, &areas, &reflectance, &all, settings, Box::new(matrix))?;
        let slots: Vec<Slot> = all.iter().map(|&slot| Slot(slot)).collect();
        let DirectLight { exitance, on_points } = world.direct_light(rig);
        let sky_irradiance = world.sky_irradiance(rig);
        backend.set_sources(&slots, &exitance, &sky_irradiance)?;
        for _ in 0..FRAMES_MAX {
            backend.step()?;
            if backend.is_settled() {
                break;
            }
        }
        let mut irradiance = vec![Rgb::ZERO; slots.len()];
        backend.read_irradiance(&slots, &mut irradiance)?;
        irradiance.iter_mut().for_each(|light| *light = light.max(Rgb::ZERO));
        Ok(WholeLight {
            irradiance,
            sky_irradiance,
            direct_exitance: exitance,
            near: on_points,
            sky: rig.sky,
        })
    }
}
