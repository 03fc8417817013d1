//! Light over sparse rows on a device: [`GpuRowLight`], the counterpart of `radiosity::solver::CpuRowLight`.
//!
//! The host keeps who is there; a device keeps a copy of the rows and is told what changes in them. Rows have the CPU's
//! order, so tables and draws have its bits; sums over rows are made in another order, and differ by rounding.
//!
//! ```text
//! come, leave ──collected──▶ edit_rows ▶ forget_leaving, clear_slots │ gather_rows ▶ take_gathered (light of who comes)
//! advance     take_sources ▶ fill_tables ▶ build_alias or build_cdf (budgeted) ▶ the method:
//!   gather       send_light ▶ gather_rows ▶ measure_light ▶ take_gathered ▶ sum_light
//!   alias, cdf   send_light ▶ share_outside ▶ draw_alias or draw_cdf
//!   progressive  (fold_flux ▶ choose_class ▶ count_last ▶ scan_groups ▶ take_shooters ▶ shoot_links) x 4
//!                ▶ fold_flux ▶ some rows gathered afresh ▶ measure_light ▶ sum_light
//!   hybrid       as progressive ▶ send_rest ▶ draw_cdf
//! publish_light ▶ news ┄┄16 bytes a slot that changed┄┄▶ host, not waited for
//! ```
//!
//! Same calls, same bits on the same device: floats are summed in one order; flux that is shot is added up in whole units
//! by integer atomics, and the list of shooters, which is in no order, is only summed over.
//!
//! | file | holds |
//! |---|---|
//! | `pool.rs` | where rows and tables lie in buffers that they share |
//! | `buffers.rs` | what lies on the device |
//! | `edits.rs` | who comes and goes |
//! | `passes.rs` | passes that several methods run |
//! | `tables.rs` | tables, a budget of them a frame |
//! | `shots.rs` | progressive shooting |

mod buffers;
mod edits;
mod passes;
mod pool;
mod shots;
mod tables;
#[cfg(test)]
mod tests;

use crate::device::GpuDevice;
use crate::news::News;
use crate::readback::{Later, read_now};
use crate::recorder::Recorder;
use crate::timing::{PassTime, Sampling, Timing};
use buffers::Buffers;
pub(crate) use buffers::{LINK_BYTES, SLOT_BYTES};
use earthshine_radiosity::solver::cpu_light::GATHER_SETTLED;
use earthshine_radiosity::solver::links::LinkRows;
use earthshine_radiosity::solver::row_light::{Frame, RowLightFactory};
use earthshine_radiosity::solver::shooting::SETTLE_FRAMES;
use earthshine_radiosity::solver::{
    CpuRowLight, Light, Method, Residents, RowLight, SolverSettings, remainder,
};
use earthshine_radiosity::{BackendError, Slot};
use earthshine_shaders::host::{Pass, Resident};
use earthshine_shaders::kernel::{PUBLISH_LIGHT, SEND_REST, SHARE_OUTSIDE, TAKE_SOURCES};
use earthshine_shaders::limits::{SHOT_CHANGE, SHOT_SHOOTERS, SHOT_WORDS};
use earthshine_world::Rgb;
use edits::Edits;
use passes::{groups, upload};
use std::ops::Range;
use tables::Tables;

/// Light on residents, advanced on a device by one method.
#[derive(Debug)]
pub struct GpuRowLight {
    device: GpuDevice,
    method: Method,
    buffers: Buffers,
    edits: Edits,
    /// None where nothing is drawn.
    tables: Option<Tables>,
    residents: Vec<Resident>,
    /// Slots whose patch, sources or sky the device has not been told.
    new_residents: Dirty,
    new_sources: Dirty,
    new_sky: Dirty,
    /// Where the rows that are gathered afresh go on.
    refresh_cursor: usize,
    /// The frame after which something changed last.
    woken_at: u64,
    /// What changed, and what the words of shots say, on its way to the host.
    news: News,
    /// Light as it was read last, and whether that is the light of the last frame.
    published: Vec<Rgb>,
    is_read: bool,
    /// Light of a frame, whole, on its way to the host; and of the slots it was asked for, whether it is of their patches.
    polled: Later,
    are_polled_known: Vec<bool>,
    timing: Option<Timing>,
    sampling: Sampling,
}

/// A range of slots that may have changed.
#[derive(Debug, Clone, Default)]
struct Dirty(Option<Range<usize>>);

impl Dirty {
    fn mark(&mut self, slot: usize) {
        let range = self.0.clone().unwrap_or(slot..slot + 1);
        self.0 = Some(range.start.min(slot)..range.end.max(slot + 1));
    }

    fn take(&mut self) -> Range<usize> {
        self.0.take().unwrap_or(0..0)
    }
}

impl GpuRowLight {
    /// Begins a method from `light`.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    ///
    /// # Panics
    /// For [`Method::Matrix`], which works on no rows, and for what [`Self::is_possible`] denies.
    pub fn new(
        device: &GpuDevice,
        residents: &Residents,
        settings: &SolverSettings,
        light: &[Light],
    ) -> Result<Self, BackendError> {
        assert!(settings.method != Method::Matrix && Self::is_possible(settings), "{settings:?}");
        let links = &residents.links;
        let slots = links.capacity();
        let (edits, uploaded) = Edits::new(links);
        let buffers = Buffers::new(device, slots, uploaded.len(), settings.method)?;
        buffers.links.write(device, &uploaded);
        let resident = |slot: usize| Resident {
            reflectance: links.reflectance(slot).to_array(),
            area: links.area(slot),
        };
        let mut news = News::new(device, slots, 4 * u64::from(SHOT_WORDS))?;
        (0..slots).filter(|&slot| links.is_taken(slot)).for_each(|slot| news.know(slot));
        let mut new = Self {
            method: settings.method,
            edits,
            tables: settings.method.draws().then(|| Tables::new(links)),
            residents: (0..slots).map(resident).collect(),
            new_residents: Dirty(Some(0..slots)),
            new_sources: Dirty(Some(0..slots)),
            new_sky: Dirty(Some(0..slots)),
            refresh_cursor: 0,
            woken_at: 0,
            news,
            published: light.iter().map(|light| Rgb::new(light[0], light[1], light[2])).collect(),
            is_read: true,
            polled: Later::default(),
            are_polled_known: Vec::new(),
            timing: None,
            sampling: Sampling::default(),
            buffers,
            device: device.clone(),
        };
        new.begin(residents, light)?;
        Ok(new)
    }

    /// Whether a device can do what `settings` ask for: neither draws from rows of the matrix nor adaptive ones.
    #[must_use]
    pub fn is_possible(settings: &SolverSettings) -> bool {
        !(settings.is_coloured() || settings.method.is_endless() && settings.adaptive)
    }

    /// Makes such light, or the CPU's where it is not possible.
    #[must_use]
    pub fn factory(device: &GpuDevice) -> RowLightFactory {
        let device = device.clone();
        Box::new(move |residents, settings, light| {
            if Self::is_possible(settings) {
                Ok(Box::new(Self::new(&device, residents, settings, light)?))
            } else {
                Ok(Box::new(CpuRowLight::new(residents, settings, light)))
            }
        })
    }

    /// Times every pass from now on; false where the device cannot.
    ///
    /// # Errors
    /// [`BackendError::OutOfMemory`], [`BackendError::DeviceLost`].
    pub fn time_passes(&mut self) -> Result<bool, BackendError> {
        self.timing = Timing::new(&self.device)?;
        Ok(self.timing.is_some())
    }

    /// The passes since the last call. Waits for the device.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn take_times(&mut self) -> Result<Vec<PassTime>, BackendError> {
        self.timing.as_mut().map_or(Ok(Vec::new()), |timing| timing.take(&self.device))
    }

    /// Waits until the device has done all it was told.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`].
    pub fn finish(&self) -> Result<(), BackendError> {
        self.device.wait("finish", self.device.queue().submit([]))
    }

    fn slots(&self) -> u32 {
        self.residents.len() as u32
    }

    fn is_shot(&self) -> bool {
        matches!(self.method, Method::Progressive | Method::Hybrid)
    }

    fn pass(&self) -> Pass {
        Pass { entry_count: self.slots(), is_shot: u32::from(self.is_shot()), ..Pass::default() }
    }

    fn recorder(&mut self) -> (Recorder<'_>, &Buffers) {
        (Recorder::new(&self.device, &self.buffers.uniforms, self.timing.as_mut()), &self.buffers)
    }

    /// Sums of all rows, the light to go on from and, where light is shot, a bounce after which what has been sent is known.
    fn begin(&mut self, residents: &Residents, light: &[Light]) -> Result<(), BackendError> {
        upload(&self.device, &self.buffers.irradiance, light, 0..light.len());
        self.upload_residents();
        self.sum_all_rows()?;
        let pass = self.pass();
        // Nothing is unshot of the sources there are: the bounce says what is.
        self.take_sources(residents, Pass { is_shot: 0, ..pass })?;
        if self.is_shot() {
            let (mut recorder, buffers) = self.recorder();
            recorder.over(residents.links.link_count() as u64).send_light(buffers, pass);
            recorder.gather_rows(buffers, &buffers.all_slots, &buffers.outside, pass);
            recorder.take_gathered(buffers, &buffers.all_slots, 0.0, pass);
            recorder.submit()?;
        }
        Ok(())
    }

    fn upload_residents(&mut self) {
        let range = self.new_residents.take();
        upload(&self.device, &self.buffers.residents, &self.residents, range);
    }

    /// Tells the device of sources and the sky that have changed.
    fn take_sources(&mut self, residents: &Residents, pass: Pass) -> Result<(), BackendError> {
        let sky = self.new_sky.take();
        upload(&self.device, &self.buffers.sky, &residents.sky, sky.clone());
        upload(&self.device, &self.buffers.sky_shares, &residents.sky_shares, sky);
        let range = self.new_sources.take();
        if range.is_empty() {
            return Ok(());
        }
        upload(&self.device, &self.buffers.new_own, &residents.direct, range.clone());
        upload(&self.device, &self.buffers.new_outside, &residents.outside, range);
        let (mut recorder, buffers) = self.recorder();
        let bound = [
            &buffers.residents,
            &buffers.new_own,
            &buffers.new_outside,
            &buffers.own,
            &buffers.outside,
            &buffers.irradiance,
            &buffers.unshot,
        ];
        recorder.dispatch(&TAKE_SOURCES, &bound, pass, groups(pass));
        recorder.submit().map(|_| ())
    }

    fn wake(&mut self) {
        self.woken_at = self.news.step();
    }

    fn advance_gathered(&mut self, links: &LinkRows) -> Result<(), BackendError> {
        let pass = Pass { taken_count: links.taken_count() as u32, ..self.pass() };
        let links = self.edits.links_of(0..self.slots());
        let (mut recorder, buffers) = self.recorder();
        recorder.over(links).send_light(buffers, pass);
        recorder.gather_rows(buffers, &buffers.all_slots, &buffers.outside, pass);
        recorder.measure_light(buffers, pass);
        recorder.take_gathered(buffers, &buffers.all_slots, 0.0, pass);
        recorder.submit().map(|_| ())
    }

    fn advance_drawn(&mut self, settings: &SolverSettings, number: u32) -> Result<(), BackendError> {
        let pass = Pass {
            seed: settings.seed,
            frame: number,
            samples_per_row: settings.samples_per_row,
            first_weight: settings.history_weight,
            ..self.pass()
        };
        let method = self.method;
        let (mut recorder, buffers) = self.recorder();
        recorder.send_light(buffers, pass);
        let bound = [
            &buffers.outside_shares,
            &buffers.sky_shares,
            &buffers.outside,
            &buffers.sky,
            &buffers.outside_draws,
        ];
        recorder.dispatch(&SHARE_OUTSIDE, &bound, pass, groups(pass));
        recorder.draw(buffers, method, [&buffers.outside_draws, &buffers.irradiance], pass);
        recorder.submit().map(|_| ())
    }

    /// Draws what is not shot yet.
    fn advance_rest(&mut self, settings: &SolverSettings, number: u32) -> Result<(), BackendError> {
        let pass = Pass {
            seed: settings.seed,
            frame: number,
            samples_per_row: (settings.samples_per_row / remainder::SAMPLES_PART).max(1),
            first_weight: remainder::HISTORY_WEIGHT,
            ..self.pass()
        };
        let (mut recorder, buffers) = self.recorder();
        let bound = [&buffers.residents, &buffers.unshot, &buffers.rest, &buffers.sent];
        recorder.dispatch(&SEND_REST, &bound, pass, groups(pass));
        // Nothing of the rest comes from outside: a change there is in the light at once.
        recorder.draw(buffers, Method::Cdf, [&buffers.dark, &buffers.rest], pass);
        recorder.submit().map(|_| ())
    }

    /// Puts light together and sends what is news to the host.
    fn publish(&mut self) -> Result<(), BackendError> {
        let slots = self.slots();
        let pass = Pass { channel_stride: slots, ..self.pass() };
        let mut recorder = Recorder::new(&self.device, &self.buffers.uniforms, self.timing.as_mut());
        let buffers = &self.buffers;
        let bound = [&buffers.irradiance, &buffers.shot_words, &buffers.rest, &buffers.published];
        recorder.dispatch(&PUBLISH_LIGHT, &bound, pass, groups(pass));
        self.news.record(&mut recorder, &buffers.published, slots, Some(&buffers.shot_words));
        let submission = recorder.submit()?;
        self.news.submitted(&self.device, submission);
        self.is_read = false;
        Ok(())
    }

    /// The light of the last frame, whole. Waits for the device.
    fn fetch(&mut self) -> Result<(), BackendError> {
        self.device.check()?;
        if !self.is_read {
            let published = &self.buffers.published;
            let bytes = read_now(&self.device, "light", published, published.size(), |_| {})?;
            self.published = lights_of(&bytes, self.published.len());
            self.is_read = true;
            self.news.wait(&self.device)?;
            self.sampling.end(&self.device, &mut self.timing)?;
        }
        Ok(())
    }
}

impl RowLight for GpuRowLight {
    fn come(&mut self, residents: &Residents, slot: usize) -> Result<(), BackendError> {
        self.flush_leaving()?;
        self.edits.come(&residents.links, slot);
        let reflectance = residents.links.reflectance(slot).to_array();
        self.residents[slot] = Resident { reflectance, area: residents.links.area(slot) };
        self.new_residents.mark(slot);
        if let Some(tables) = &mut self.tables {
            tables.come(&residents.links, slot);
        }
        self.news.know(slot);
        self.wake();
        Ok(())
    }

    fn leave(&mut self, residents: &Residents, slot: usize) -> Result<(), BackendError> {
        self.flush_coming()?;
        self.edits.leave(&residents.links, slot);
        if let Some(tables) = &mut self.tables {
            tables.leave(&residents.links, slot);
        }
        // Sources of a free slot are none by the time that the device is told.
        self.new_sources.mark(slot);
        self.new_sky.mark(slot);
        self.news.forget(slot);
        self.wake();
        Ok(())
    }

    fn change(&mut self, _: &Residents, slot: usize, _: &Light, _: &Light) {
        self.new_sources.mark(slot);
        self.wake();
    }

    fn outdate(&mut self, slot: usize) {
        if let Some(tables) = &mut self.tables {
            tables.outdate(slot);
        }
        self.new_sky.mark(slot);
    }

    fn advance(&mut self, residents: &mut Residents, frame: Frame<'_>) -> Result<(), BackendError> {
        self.news.make_room(&self.device)?;
        self.sampling.end(&self.device, &mut self.timing)?;
        self.sampling.begin(&self.device, &mut self.timing)?;
        self.flush_leaving()?;
        self.flush_coming()?;
        // The sky's light changes without a word; it is told with the sources.
        if self.method.is_endless() {
            self.new_sky = Dirty(Some(0..self.residents.len()));
        }
        self.take_sources(residents, self.pass())?;
        self.rebuild_tables(residents, frame.order, frame.settings.rebuild_items_per_step)?;
        match self.method {
            Method::Matrix | Method::Gather => self.advance_gathered(&residents.links)?,
            Method::Alias | Method::Cdf => self.advance_drawn(frame.settings, frame.number)?,
            Method::Progressive => self.shoot(&residents.links, frame.settings)?,
            Method::Hybrid => {
                self.shoot(&residents.links, frame.settings)?;
                self.advance_rest(frame.settings, frame.number)?;
            }
        }
        self.publish()
    }

    /// By what has arrived of a frame since the last change: light that has settled does not move again.
    fn is_settled(&self) -> bool {
        let says = |what: &dyn Fn(&[u32]) -> bool| {
            self.news.words().is_some_and(|(step, words)| step > self.woken_at && what(words))
        };
        match self.method {
            Method::Alias | Method::Cdf => false,
            Method::Progressive | Method::Hybrid => {
                self.news.step() - self.woken_at >= u64::from(SETTLE_FRAMES)
                    || says(&|words| words[SHOT_SHOOTERS as usize] == 0)
            }
            Method::Matrix | Method::Gather => {
                says(&|words| f64::from(f32::from_bits(words[SHOT_CHANGE as usize])) < GATHER_SETTLED)
            }
        }
    }

    fn read(&mut self, residents: &Residents, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError> {
        self.fetch()?;
        for (slot, out) in slots.iter().zip(out) {
            let at = slot.0 as usize;
            let light = self.published[at];
            if residents.links.is_taken(at) && !light.is_finite() {
                return Err(BackendError::NotANumber(*slot));
            }
            // What was published last is its predecessor's, if nothing was since it came.
            *out = if self.news.is_of_patch(at) { light } else { Rgb::ZERO };
        }
        Ok(())
    }

    fn reads_at_once(&self) -> bool {
        self.is_read
    }

    fn poll(&mut self, residents: &Residents, slots: &[Slot], out: &mut [Rgb]) -> Result<bool, BackendError> {
        if !self.polled.is_coming() {
            if self.is_read {
                return self.read(residents, slots, out).map(|()| true);
            }
            self.are_polled_known = slots.iter().map(|slot| self.news.is_of_patch(slot.0 as usize)).collect();
            self.polled.send_for(&self.device, "light asked for", &[&self.buffers.published])?;
        }
        let Some(bytes) = self.polled.take(&self.device, None)? else { return Ok(false) };
        let light = lights_of(&bytes, self.published.len());
        for ((slot, out), &is_known) in slots.iter().zip(out).zip(&self.are_polled_known) {
            *out = if is_known { light[slot.0 as usize] } else { Rgb::ZERO };
            if residents.links.is_taken(slot.0 as usize) && !out.is_finite() {
                return Err(BackendError::NotANumber(*slot));
            }
        }
        Ok(true)
    }

    fn take_news(&mut self, _: &Residents, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError> {
        self.news.take(&self.device, news)
    }

    fn is_news_coming(&self) -> bool {
        !self.news.is_told()
    }

    fn collect(&mut self) -> Result<(), BackendError> {
        self.news.collect(&self.device)
    }

    fn is_behind(&self) -> bool {
        self.news.is_full()
    }
}

/// Of light as it is published: a channel after the other.
fn lights_of(bytes: &[u8], slots: usize) -> Vec<Rgb> {
    let found: Vec<f32> = bytemuck::pod_collect_to_vec(bytes);
    (0..slots).map(|slot| Rgb::new(found[slot], found[slots + slot], found[2 * slots + slot])).collect()
}
