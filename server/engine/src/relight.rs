//! Light on the slots of one local set: which direct light is out of date, lighting it again, and the sources and
//! results of the backend.
//!
//! `direct exitance = reflectance * direct irradiance + emission * scale`; what comes from outside the resident set
//! is `sky.irradiance(sky shares)` and the far light that [`crate::far`] has gathered; a gap is never given to the sky.

use crate::asked_light::{AskedPatch, Question};
use crate::direct::ShadowCasters;
use crate::local_set::LocalSet;
use crate::shadow_reach::{ShadowReach, light_count};
use earthshine_light::LitPatch;
use earthshine_radiosity::{BackendError, Slot};
use earthshine_world::{Light, LightRig, Patch, PatchId, Rgb, SamplePoint};
use std::collections::BTreeMap;

/// Sources beyond this are limited, lm/m2: all bounces of them still fit an `f32`. The sun's face has 6e9.
const SOURCE_MAX: f32 = 1e24;

/// What direct light depends on, besides the patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stamp {
    lights: u64,
    casters: u64,
}

impl Stamp {
    /// No generation of casters: some that came or went since may have changed this light.
    const TOUCHED: u64 = u64::MAX;
}

/// Light on one slot.
#[derive(Debug, Default)]
pub(crate) struct SlotLight {
    /// From delta lights, lx.
    direct_irradiance: Rgb,
    /// The same on each sample point, where it differs between them and there is detail to read it.
    on_points: Box<[Rgb]>,
    /// What it was computed from; nothing before the first time.
    lit: Option<Stamp>,
    /// The tick that it was computed in, or asked for; before the first time, the tick that the patch came in.
    lit_tick: u64,
    /// When somebody else was last asked for it, and what that will rest on; nothing once it has come.
    asked: Option<(u64, Stamp)>,
    /// Direct exitance and outside irradiance that the backend holds.
    sources: Option<(Rgb, Rgb)>,
    /// The part of the outside irradiance that comes straight from the sky, lx.
    sky_irradiance: Rgb,
    /// What arrives from the patches that are not resident, by their parents, lx.
    pub(crate) far_irradiance: Rgb,
    /// What the backend last said, lx; nothing before the first time.
    pub(crate) irradiance: Option<Rgb>,
}

impl SlotLight {
    /// What arrives straight from the sky, as the backend was told, lx.
    pub(crate) fn sky_irradiance(&self) -> Rgb {
        self.sky_irradiance
    }

    /// Direct irradiance: the mean, and on each sample point where that differs between them; nothing else.
    pub(crate) fn on_points(&self) -> Option<(Rgb, &[Rgb])> {
        (!self.on_points.is_empty()).then_some((self.direct_irradiance, &*self.on_points))
    }

    /// Direct irradiance, and which lights it is of.
    #[cfg(test)]
    pub(crate) fn direct(&self) -> (Rgb, Option<u64>) {
        (self.direct_irradiance, self.lit.map(|lit| lit.lights))
    }

    /// What it rests on, or will once it has come, and since when: the newest there is.
    fn newest(&self) -> (Option<Stamp>, u64) {
        let lit_tick = if self.lit.is_some() { self.lit_tick } else { 0 };
        self.asked.map_or((self.lit, lit_tick), |(tick, stamp)| (Some(stamp), tick))
    }

    /// The patch took its slot in `tick`.
    pub(crate) fn came(&mut self, tick: u64) {
        self.lit_tick = tick;
    }

    /// Takes what was computed or asked for in `tick`.
    fn light_up(&mut self, (mean, on_points): LitPatch, lit: Stamp, tick: u64) {
        (self.direct_irradiance, self.on_points) = (mean, on_points);
        (self.lit, self.lit_tick) = (Some(lit), tick);
    }

    /// What leaves `patch`, emitted and reflected, as far as the backend has said, lm/m2.
    pub(crate) fn exitance(&self, patch: &Patch) -> Rgb {
        let direct = self.sources.map_or(Rgb::ZERO, |(direct, _)| direct);
        direct
            + patch.reflectance.min(Rgb::splat(Patch::REFLECTANCE_MAX)) * self.irradiance.unwrap_or(Rgb::ZERO)
    }
}

/// Everything that lighting one session needs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Relight<'a> {
    casters: &'a ShadowCasters,
    lights: &'a [Light],
    stamp: Stamp,
    tick: u64,
    voxel_edge_m: f32,
    /// Whether light on single points is kept.
    has_detail: bool,
}

impl<'a> Relight<'a> {
    /// `lights_generation` counts changes of `lights`. `has_detail`: there are detail voxels to read light on points.
    pub(crate) fn new(
        casters: &'a ShadowCasters,
        lights: &'a [Light],
        lights_generation: u64,
        tick: u64,
        voxel_edge_m: f32,
        has_detail: bool,
    ) -> Self {
        // Without lights there are no shadows that could change.
        let casters_generation = if lights.is_empty() { 0 } else { casters.generation() };
        Self {
            casters,
            lights,
            stamp: Stamp { lights: lights_generation, casters: casters_generation },
            tick,
            voxel_edge_m,
            has_detail,
        }
    }

    /// Sample points of one patch times the lights that reach it.
    pub(crate) fn cost(&self, patch: &Patch) -> u32 {
        let lights = light_count(self.lights, patch.centroid, self.voxel_edge_m);
        // That no light reaches it is not known for nothing.
        u32::try_from(lights).unwrap_or(u32::MAX).saturating_mul(patch.point_count).max(1)
    }

    /// Holds all direct light, on its way too, against the casters that came and went since: what none of them can have changed
    /// is up to date.
    pub(crate) fn note_casters(&self, local: &mut LocalSet) {
        if self.lights.is_empty() {
            return;
        }
        let mut reaches: BTreeMap<u64, ShadowReach<'_>> = BTreeMap::new();
        for resident in local.residents.iter_mut().flatten() {
            let light = &mut resident.light;
            for stamp in light.lit.iter_mut().chain(light.asked.as_mut().map(|(_, stamp)| stamp)) {
                let is_known = [self.stamp.casters, Stamp::TOUCHED].contains(&stamp.casters);
                if stamp.lights != self.stamp.lights || is_known {
                    continue;
                }
                let since = stamp.casters;
                let reach = reaches
                    .entry(since)
                    .or_insert_with(|| ShadowReach::of(self.casters, since, self.lights, self.voxel_edge_m));
                let is_touched = reach.touches(resident.patch.centroid);
                stamp.casters = if is_touched { Stamp::TOUCHED } else { self.stamp.casters };
            }
        }
    }

    /// How old direct light is, as [`PatchLight::staleness`](crate::PatchLight) says it.
    pub(crate) fn staleness(&self, light: &SlotLight) -> u8 {
        if light.lit == Some(self.stamp) {
            return 0;
        }
        // At most 64.
        1 + self.tick.saturating_sub(light.lit_tick).max(1).ilog2() as u8
    }

    /// Slots whose direct light is out of date.
    pub(crate) fn stale_count(&self, local: &LocalSet) -> u32 {
        let count = local.iter().filter(|(_, resident)| resident.light.lit != Some(self.stamp)).count();
        u32::try_from(count).expect("slots are u32")
    }

    /// Whether any of them is not on its way.
    pub(crate) fn has_unasked(&self, local: &LocalSet) -> bool {
        local.iter().any(|(_, resident)| resident.light.newest().0 != Some(self.stamp))
    }

    /// Those that are not on their way, most urgent first: never lit or lit by other lights, then shadowed by other casters;
    /// among equals the one whose turn was longest ago.
    pub(crate) fn unasked_slots(&self, local: &LocalSet) -> Vec<u32> {
        let turn = |(slot, light): (u32, &SlotLight)| {
            let (stamp, tick) = light.newest();
            let has_lights = stamp.is_some_and(|stamp| stamp.lights == self.stamp.lights);
            // Answers are told apart by the tick of their question: a slot is asked for once a tick.
            let is_asked_now = light.asked.is_some_and(|(asked_tick, _)| asked_tick == self.tick);
            (stamp != Some(self.stamp) && !is_asked_now).then_some((has_lights, tick, slot))
        };
        let lights = local.iter().map(|(slot, resident)| (slot, &resident.light));
        let mut unasked: Vec<_> = lights.filter_map(turn).collect();
        unasked.sort_unstable();
        unasked.into_iter().map(|(_, _, slot)| slot).collect()
    }

    /// Lights `slots` in turn until `most` is spent, one at least, or asks somebody else to. Returns slots lit by now and what was
    /// spent.
    pub(crate) fn light(&self, local: &mut LocalSet, slots: &[u32], most: u32) -> (u32, u32) {
        if slots.is_empty() || (local.asked.is_full() && !self.lights.is_empty()) {
            return (0, 0);
        }
        let (mut taken, mut spent) = (0usize, 0u32);
        for &slot in slots {
            let cost = self.cost(&local.resident(slot).patch);
            if taken > 0 && spent.saturating_add(cost) > most {
                break;
            }
            taken += 1;
            spent = spent.saturating_add(cost);
        }
        let slots = &slots[..taken];
        let patches: Vec<_> = slots.iter().map(|&slot| points_of(local, slot)).collect();
        if let Some(light) = self.casters.ask(self.lights, &patches, self.has_detail) {
            let asked = slots.iter().map(|&slot| AskedPatch { slot, id: local.resident(slot).id });
            let question = Question { stamp: self.stamp, tick: self.tick, patches: asked.collect() };
            for &slot in slots {
                local.resident_mut(slot).light.asked = Some((self.tick, self.stamp));
            }
            local.asked.push(question, light);
            return (0, spent);
        }
        let irradiances = self.casters.irradiance(self.lights, &patches);
        for (&slot, (mean, on_points)) in slots.iter().zip(irradiances) {
            let light = &mut local.resident_mut(slot).light;
            light.light_up((mean, self.kept(on_points)), self.stamp, self.tick);
            light.asked = None;
        }
        (slots.len() as u32, spent)
    }

    /// Gives the light that has come to the patches that it was asked for, if they still hold their slots and have no newer one.
    /// What is lost can be asked for again.
    pub(crate) fn take_asked(&self, local: &mut LocalSet) -> Arrived {
        let mut arrived = Arrived::default();
        while let Some((question, light)) = local.asked.take_answered() {
            let mut answers = light.map(Vec::into_iter);
            for AskedPatch { slot, id } in question.patches {
                let answer = answers.as_mut().and_then(Iterator::next);
                let resident = local.residents[slot as usize].as_mut().filter(|resident| resident.id == id);
                let Some(of) = resident.map(|resident| &mut resident.light) else { continue };
                // What has not been asked for again since was held against all casters meanwhile.
                let held = of.asked.take_if(|(tick, _)| *tick == question.tick);
                let Some(answer) = answer.filter(|_| question.tick >= of.lit_tick) else {
                    continue;
                };
                arrived.is_other_light |= of.lit.is_none_or(|lit| lit.lights != question.stamp.lights);
                arrived.slots += 1;
                let lit = held.map_or(question.stamp, |(_, stamp)| stamp);
                of.light_up(answer, lit, question.tick);
            }
        }
        arrived
    }

    /// Light on single points, where there is detail to read it.
    fn kept(&self, on_points: Box<[Rgb]>) -> Box<[Rgb]> {
        if self.has_detail { on_points } else { Box::default() }
    }
}

/// What came of the light that somebody else was asked for.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Arrived {
    /// Slots that have it now.
    pub(crate) slots: u32,
    /// Whether it is of other lights than what any of them had.
    pub(crate) is_other_light: bool,
}

fn points_of(local: &LocalSet, slot: u32) -> (&Patch, &[SamplePoint]) {
    let resident = local.resident(slot);
    (&resident.patch, local.chunk_of(resident.id).points_of(&resident.patch))
}

/// Has newcomers whose direct light is on its way lit as the coarse patch that stood for them until then: what leaves them would
/// be missing for some ticks in the light of all that see them. Returns whether there are any.
pub(crate) fn stand_in(local: &mut LocalSet, coarser: Option<&LocalSet>) -> bool {
    if local.asked.len() == 0 {
        return false;
    }
    let parent_of = |id: PatchId| {
        let table = local.slots_of(id.chunk)?;
        let parent = *table.lineage.of(id.chunk)?.get(usize::from(id.local))?;
        let above = coarser?;
        let slot = above.slot_of(PatchId { chunk: id.chunk.parent(), local: parent })?;
        Some(above.resident(slot).light.direct_irradiance)
    };
    let is_unlit = |of: &SlotLight| of.lit.is_none() && of.direct_irradiance == Rgb::ZERO;
    let unlit = local.iter().filter(|(_, resident)| is_unlit(&resident.light));
    let lit = unlit.filter_map(|(slot, resident)| Some((slot, parent_of(resident.id)?)));
    let lit: Vec<(u32, Rgb)> = lit.filter(|&(_, irradiance)| irradiance != Rgb::ZERO).collect();
    for &(slot, irradiance) in &lit {
        local.resident_mut(slot).light.direct_irradiance = irradiance;
    }
    !lit.is_empty()
}

/// What [`set_sources`] found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SourcesSet {
    /// Whether any differed from what the backend held.
    pub(crate) changed: bool,
    /// How many of those had to be limited.
    pub(crate) limited: u64,
}

/// Gives the backend every source that differs from what it holds.
///
/// # Errors
/// Whatever the backend says: it is of no more use.
pub(crate) fn set_sources(local: &mut LocalSet, rig: &LightRig) -> Result<SourcesSet, BackendError> {
    let (mut slots, mut exitances, mut outside) = (Vec::new(), Vec::new(), Vec::new());
    let (mut sky_shares, mut skies) = (Vec::new(), Vec::new());
    let mut limited = 0;
    for (slot, resident) in (0u32..).zip(&mut local.residents) {
        let Some(resident) = resident else { continue };
        let patch = &resident.patch;
        let reflectance = patch.reflectance.min(Rgb::splat(Patch::REFLECTANCE_MAX));
        let (exitance, exitance_limited) =
            limit(reflectance * resident.light.direct_irradiance + patch.emission * rig.emission_scale);
        let (sky, sky_limited) = limit(rig.sky.irradiance(&resident.sky_shares));
        let (arriving, far_limited) = limit(sky + resident.light.far_irradiance);
        let sky_before = std::mem::replace(&mut resident.light.sky_irradiance, sky);
        if resident.light.sources != Some((exitance, arriving)) || sky != sky_before {
            resident.light.sources = Some((exitance, arriving));
            limited += u64::from(exitance_limited || sky_limited || far_limited);
            slots.push(Slot(slot));
            exitances.push(exitance);
            outside.push(arriving);
            sky_shares.push(resident.sky_shares.iter().sum::<f32>().min(1.0));
            skies.push(sky);
        }
    }
    let changed = !slots.is_empty();
    if changed {
        local.backend.set_sources(&slots, &exitances, &outside)?;
        local.backend.set_sky(&slots, &sky_shares, &skies)?;
        local.needs_step = true;
    }
    Ok(SourcesSet { changed, limited })
}

/// Steps the backend and takes what it has to tell, if there is reason to. One that is behind is stepped in a later tick:
/// nobody waits. Returns whether any light is another, to the bit.
///
/// # Errors
/// Whatever the backend says: it is of no more use.
pub(crate) fn step(local: &mut LocalSet) -> Result<bool, BackendError> {
    if !local.needs_step && local.backend.is_settled() {
        return Ok(false);
    }
    if !local.backend.is_behind() {
        local.needs_step = false;
        local.backend.step()?;
    }
    let mut news = std::mem::take(&mut local.news);
    local.backend.take_news(&mut news)?;
    let mut changed = false;
    for (slot, irradiance) in news.drain(..) {
        // Rounding may leave a little less than nothing.
        let irradiance = Some(irradiance.max(Rgb::ZERO));
        changed |=
            std::mem::replace(&mut local.resident_mut(slot.0).light.irradiance, irradiance) != irradiance;
    }
    local.news = news;
    Ok(changed)
}

/// A source that arithmetic survives, and whether that changed it.
fn limit(source: Rgb) -> (Rgb, bool) {
    let bound = |x: f32| if x.is_nan() { 0.0 } else { x.clamp(0.0, SOURCE_MAX) };
    let limited = Rgb::new(bound(source.x), bound(source.y), bound(source.z));
    (limited, limited != source)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_that_arithmetic_would_not_survive_are_limited() {
        assert_eq!(limit(Rgb::new(1.0, 0.0, 6e9)), (Rgb::new(1.0, 0.0, 6e9), false));
        assert_eq!(limit(Rgb::new(f32::INFINITY, f32::NAN, 1.0)), (Rgb::new(SOURCE_MAX, 0.0, 1.0), true));
    }
}
