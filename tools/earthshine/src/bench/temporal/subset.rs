//! The patches nearest to the middle of a world, in a backend, with what comes from beyond them.

use crate::bench::lit_world::LitWorld;
use crate::solver_world;
use earthshine_radiosity::solver::{Method, SolverBackend, SolverSettings};
use earthshine_radiosity::{Backend, Slot};
use earthshine_world::{LightRig, Rgb};

/// Steps that gathering may take to settle: 0.98 bounces down to 1e-6.
pub(super) const SETTLE_STEPS: u32 = 1500;
/// What emissive surfaces emit before the change.
const EMISSION_BEFORE: f32 = 0.1;

/// Sources of a whole world before and after the change, and what leaves every patch then.
pub(super) struct Changes {
    before: Sources,
    after: Sources,
}

struct Sources {
    direct: Vec<Rgb>,
    exitance: Vec<Rgb>,
    sky: Vec<Rgb>,
}

impl Changes {
    pub(super) fn of(lit: &LitWorld) -> Self {
        let dim = LightRig {
            lights: Vec::new(),
            emission_scale: lit.rig.emission_scale * EMISSION_BEFORE,
            ..lit.rig.clone()
        };
        let before = lit.world.solve(&dim);
        Self {
            before: Sources {
                exitance: lit.world.exitance(&before),
                direct: before.direct_exitance,
                sky: before.sky_irradiance,
            },
            after: Sources {
                exitance: lit.exitance(),
                direct: lit.light.direct_exitance.clone(),
                sky: lit.light.sky_irradiance.clone(),
            },
        }
    }
}

/// Resident patches and both states of their light.
pub(super) struct Subset {
    pub(super) backend: SolverBackend,
    pub(super) slots: Vec<Slot>,
    before: (Vec<Rgb>, Vec<Rgb>),
    after: (Vec<Rgb>, Vec<Rgb>),
    /// Settled light before and after the change, lx.
    pub(super) light_before: Vec<Rgb>,
    pub(super) light_after: Vec<Rgb>,
}

impl Subset {
    pub(super) fn new(lit: &LitWorld, changes: &Changes, patches: &[u32]) -> anyhow::Result<Self> {
        // Slots in the order of the world: neighbours are neighbours in memory, as chunks enter an engine.
        let mut patches = patches.to_vec();
        patches.sort_unstable();
        let (backend, slot_of) = solver_world::backend(&lit.rows, &lit.areas, &lit.reflectance, &patches)?;
        let sources = |of: &Sources| -> (Vec<Rgb>, Vec<Rgb>) {
            let direct = patches.iter().map(|&patch| of.direct[patch as usize]).collect();
            let outside = |&patch: &u32| {
                let (columns, shares) = lit.rows.row(patch as usize);
                let entries = columns.iter().zip(shares);
                let far = entries.filter(|&(&column, _)| slot_of[column as usize] == solver_world::FAR);
                let far: Rgb = far.map(|(&column, &share)| of.exitance[column as usize] * share).sum();
                of.sky[patch as usize] + far
            };
            (direct, patches.iter().map(outside).collect())
        };
        let mut subset = Self {
            slots: (0..patches.len() as u32).map(Slot).collect(),
            before: sources(&changes.before),
            after: sources(&changes.after),
            light_before: Vec::new(),
            light_after: Vec::new(),
            backend,
        };
        subset.light_after = subset.settle(true)?;
        subset.light_before = subset.settle(false)?;
        Ok(subset)
    }

    pub(super) fn patch_count(&self) -> usize {
        self.slots.len()
    }

    pub(super) fn link_count(&self) -> usize {
        self.backend.links().link_count()
    }

    /// Lights before or after the change.
    pub(super) fn shine(&mut self, after: bool) -> anyhow::Result<()> {
        let (direct, outside) = if after { &self.after } else { &self.before };
        Ok(self.backend.set_sources(&self.slots, direct, outside)?)
    }

    /// Lights a share of the way from before to after the change; light is linear in them.
    pub(super) fn shine_between(&mut self, share: f32) -> anyhow::Result<()> {
        let between = |from: &[Rgb], to: &[Rgb]| -> Vec<Rgb> {
            from.iter().zip(to).map(|(&from, &to)| from.lerp(to, share)).collect()
        };
        let (direct, outside) =
            (between(&self.before.0, &self.after.0), between(&self.before.1, &self.after.1));
        Ok(self.backend.set_sources(&self.slots, &direct, &outside)?)
    }

    /// Solves as `settings` say: steps until the matrix is there that they may need, and the tables.
    pub(super) fn switch(&mut self, settings: &SolverSettings) -> anyhow::Result<()> {
        self.backend.set_solver(settings)?;
        for _ in 0..SETTLE_STEPS {
            self.backend.step()?;
            if self.backend.method() == settings.method {
                self.backend.step()?;
                return Ok(());
            }
        }
        anyhow::bail!("{} did not begin within {SETTLE_STEPS} frames", settings.method)
    }

    /// Gathers until the light before or after the change has settled, and reads it.
    pub(super) fn settle(&mut self, after: bool) -> anyhow::Result<Vec<Rgb>> {
        self.backend.set_solver(&SolverSettings { method: Method::Gather, ..SolverSettings::default() })?;
        self.shine(after)?;
        for _ in 0..SETTLE_STEPS {
            self.backend.step()?;
            if self.backend.is_settled() {
                break;
            }
        }
        self.light()
    }

    /// Light as it would be published.
    pub(super) fn light(&mut self) -> anyhow::Result<Vec<Rgb>> {
        let mut light = vec![Rgb::ZERO; self.slots.len()];
        self.backend.read_irradiance(&self.slots, &mut light)?;
        Ok(light)
    }
}

/// Root of the summed squares of `light - truth` over that of `norm`.
pub(super) fn rel_rmse(light: &[Rgb], truth: &[Rgb], norm: impl Fn(usize) -> Rgb) -> f64 {
    let (mut gap, mut all) = (0.0f64, 0.0f64);
    for (at, (light, truth)) in light.iter().zip(truth).enumerate() {
        gap += f64::from((*light - *truth).length_squared());
        all += f64::from(norm(at).length_squared());
    }
    if gap == 0.0 { 0.0 } else { (gap / all.max(f64::MIN_POSITIVE)).sqrt() }
}
