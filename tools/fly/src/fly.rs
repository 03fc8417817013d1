//! The flight itself: one loop over camera steps and arriving light.

use crate::{FlyReport, Path, PathError, Probes, SunPath, report::Latencies};
use earthshine_client::{Camera, Client, ClientError, ClientOptions, Light, Lights};
use std::{
    collections::VecDeque,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::time::{Interval, MissedTickBehavior, interval};

/// What to fly, and what to watch.
#[derive(Debug, Clone)]
pub struct FlyOptions {
    /// Of the server, `http://host:port`.
    pub uri: String,
    /// How to connect.
    pub client: ClientOptions,
    /// Where the camera goes.
    pub path: Path,
    /// Of the flight.
    pub duration: Duration,
    /// Camera steps a second, up to [`Self::RATE_HZ_MAX`].
    pub rate_hz: f32,
    /// Lights of the session; `None` leaves those that came with the scene.
    pub lights: Option<Lights>,
    /// Moves the sun of [`Self::lights`] (or of no lights at all); `None` for a sun that stands still.
    pub sun: Option<SunPath>,
    /// Where light is looked for.
    pub probes: Probes,
    /// When the callback is called: at the first camera step at or after each of these times, s; ascending.
    pub picture_times_s: Vec<f32>,
}

impl FlyOptions {
    /// Slowest camera.
    pub const RATE_HZ_MIN: f32 = 0.01;
    /// Fastest camera.
    pub const RATE_HZ_MAX: f32 = 1000.0;
    /// Longest flight: `f32` still tells its milliseconds apart.
    pub const DURATION_MAX: Duration = Duration::from_secs(4 * 3600);

    /// 20 s at 60 Hz, everything else as it comes.
    #[must_use]
    pub fn new(uri: impl Into<String>, path: Path) -> Self {
        Self {
            uri: uri.into(),
            client: ClientOptions {
                name: concat!("earthshine-fly ", env!("CARGO_PKG_VERSION")).into(),
                ..ClientOptions::default()
            },
            path,
            duration: Duration::from_secs(20),
            rate_hz: 60.0,
            lights: None,
            sun: None,
            probes: Probes::default(),
            picture_times_s: Vec::new(),
        }
    }

    fn validate(&self) -> Result<(), FlyError> {
        let fault = |cause: String| Err(FlyError::Options { cause });
        let rate = |rate: f32| (Self::RATE_HZ_MIN..=Self::RATE_HZ_MAX).contains(&rate);
        let sent = self.sun.map_or(Self::RATE_HZ_MIN, |sun| sun.rate_hz);
        for (whose, found) in [("poses are", self.rate_hz), ("the sun's path is (rate_hz)", sent)] {
            if !rate(found) {
                let (least, most) = (Self::RATE_HZ_MIN, Self::RATE_HZ_MAX);
                return fault(format!("{whose} sent at {found} Hz; it must be {least} to {most}"));
            }
        }
        if self.duration > Self::DURATION_MAX {
            return fault(format!("a flight of more than {} s", Self::DURATION_MAX.as_secs()));
        }
        if !self.picture_times_s.is_sorted() {
            return fault("picture times must ascend".to_owned());
        }
        if let Some(cause) = self.sun.and_then(|sun| sun.validate().err()) {
            return fault(format!("the sun's path: {cause}"));
        }
        self.path.validate().map_err(FlyError::Path)
    }
}

/// Why a flight did not start, or ended early.
#[derive(Debug, thiserror::Error)]
pub enum FlyError {
    /// A number that makes no sense.
    #[error("cannot fly: {cause}")]
    Options {
        /// Which.
        cause: String,
    },
    /// The path cannot be flown.
    #[error(transparent)]
    Path(PathError),
    /// The session could not be opened, or broke.
    #[error("after {after_s:.1} s: {cause}")]
    Client {
        /// Of flight, s.
        after_s: f64,
        /// What happened.
        #[source]
        cause: ClientError,
    },
}

/// What the callback sees.
#[derive(Debug, Clone)]
pub struct FlyFrame {
    /// Which of [`FlyOptions::picture_times_s`].
    pub picture: usize,
    /// Of flight, s.
    pub time_s: f32,
    /// Where the camera is.
    pub camera: Camera,
    /// What light it has. Keep it: it does not change.
    pub light: Arc<Light>,
    /// What shines; `None` for the scene's own lights.
    pub lights: Option<Lights>,
}

/// Flies until the time is over or `landing` resolves, and returns what was measured.
///
/// `on_frame` is called on this task: what it spends is time that the camera stands still, so pictures are better
/// drawn after the flight, from the frames kept.
///
/// # Errors
/// [`FlyError::Options`] and [`FlyError::Path`] before anything is sent; [`FlyError::Client`].
pub async fn fly(
    options: &FlyOptions,
    landing: impl Future<Output = ()>,
    mut on_frame: impl FnMut(FlyFrame),
) -> Result<FlyReport, FlyError> {
    options.validate()?;
    let before = Instant::now();
    let client = Client::connect(&options.uri, options.client.clone()).await;
    let client = client.map_err(|cause| FlyError::Client { after_s: 0.0, cause })?;
    let mut flight = Flight::new(options, client, before);
    let flown = flight.run(landing, &mut on_frame).await;
    let after_s = flight.start.elapsed().as_secs_f64();
    flown.map_err(|cause| FlyError::Client { after_s, cause })?;
    Ok(flight.land().await)
}

/// A jump whose light has not come yet.
struct Jump {
    camera_sequence: u64,
    at: Instant,
}

struct Flight<'a> {
    options: &'a FlyOptions,
    client: Client,
    /// Before connecting.
    before: Instant,
    start: Instant,
    report: FlyReport,
    answers: Latencies,
    teleports: Latencies,
    camera: Camera,
    lights: Option<Lights>,
    jumps: u64,
    jump: Option<Jump>,
    pictures: VecDeque<(usize, f32)>,
}

impl<'a> Flight<'a> {
    fn new(options: &'a FlyOptions, client: Client, before: Instant) -> Self {
        Self {
            options,
            client,
            before,
            start: Instant::now(),
            report: FlyReport::default(),
            answers: Latencies::new(),
            teleports: Latencies::new(),
            camera: options.path.camera(0.0),
            lights: options.lights.clone(),
            jumps: 0,
            jump: None,
            pictures: options.picture_times_s.iter().copied().enumerate().collect(),
        }
    }

    async fn run(
        &mut self,
        landing: impl Future<Output = ()>,
        on_frame: &mut impl FnMut(FlyFrame),
    ) -> Result<(), ClientError> {
        if let Some(lights) = &self.lights {
            self.client.set_lights(lights)?;
        }
        let mut camera_steps = ticks(self.options.rate_hz);
        // Without a sun nobody listens to its ticks.
        let mut sun_steps = ticks(self.options.sun.map_or(1.0, |sun| sun.rate_hz));
        self.start = Instant::now();
        let end = tokio::time::sleep(self.options.duration);
        tokio::pin!(end, landing);
        loop {
            tokio::select! {
                biased;
                () = &mut end => break,
                () = &mut landing => break,
                light = self.client.next_light() => {
                    let light = light?;
                    self.arrived(&light);
                }
                _ = sun_steps.tick(), if self.options.sun.is_some() => self.move_sun()?,
                _ = camera_steps.tick() => self.step(on_frame)?,
            }
        }
        Ok(())
    }

    fn move_sun(&mut self) -> Result<(), ClientError> {
        let Some(sun) = self.options.sun else { return Ok(()) };
        let share = self.start.elapsed().as_secs_f32() / self.options.duration.as_secs_f32().max(1e-3);
        let base = self.options.lights.clone().unwrap_or_default();
        let lights = sun.lights(&base, share.min(1.0));
        self.client.set_lights(&lights)?;
        self.lights = Some(lights);
        Ok(())
    }

    fn step(&mut self, on_frame: &mut impl FnMut(FlyFrame)) -> Result<(), ClientError> {
        let time_s = self.start.elapsed().as_secs_f32();
        self.camera = self.options.path.camera(time_s);
        let camera_sequence = self.client.set_camera(self.camera)?;
        self.report.camera_updates += 1;
        let jumps = self.options.path.jump(time_s);
        if jumps != self.jumps {
            self.jumps = jumps;
            self.report.teleports += 1;
            self.jump = Some(Jump { camera_sequence, at: Instant::now() });
        }
        // As in a game: this step is drawn with what is there now, not with what it has just asked for.
        let light = self.client.light();
        self.report.settled_frames += u64::from(light.frame().settled);
        self.report.incomplete_frames += u64::from(light.frame().missing_near > 0);
        if self.report.first_light_ms.is_some() {
            let found = self.ask(&light);
            self.report.probed(found);
        }
        while let Some(&(picture, due_s)) = self.pictures.front()
            && time_s >= due_s
        {
            self.pictures.pop_front();
            let (camera, light, lights) = (self.camera, Arc::clone(&light), self.lights.clone());
            on_frame(FlyFrame { picture, time_s, camera, light, lights });
        }
        self.take_answers();
        Ok(())
    }

    fn arrived(&mut self, light: &Light) {
        if self.report.first_light_ms.is_none() && light.patch_count() > 0 {
            self.report.first_light_ms = Some(self.before.elapsed().as_secs_f64() * 1000.0);
        }
        // Near the camera nothing of level 0 may be missing, as far as the server promises anything.
        if let Some(jump) = &self.jump
            && light.camera_sequence() >= jump.camera_sequence
            && light.frame().missing_near == 0
            && !self.ask(light).is_miss
        {
            self.teleports.record(jump.at.elapsed());
            self.jump = None;
        }
    }

    fn ask(&self, light: &Light) -> crate::probe::Found {
        self.options.probes.ask(light, self.camera.position, self.client.session().voxel_edge_m)
    }

    fn take_answers(&mut self) {
        for answer in self.client.take_answers() {
            self.answers.record(answer.latency);
        }
    }

    async fn land(mut self) -> FlyReport {
        self.take_answers();
        let duration_s = self.start.elapsed().as_secs_f64();
        let statistics = self.client.statistics();
        self.report.last_patches = self.client.light().patch_count() as u64;
        self.client.close().await;
        let mut report = self.report;
        report.duration_s = duration_s;
        report.frames = statistics.frames;
        report.frames_per_s = statistics.frames as f64 / duration_s.max(1e-9);
        report.bytes = statistics.bytes;
        report.bytes_per_s = statistics.bytes as f64 / duration_s.max(1e-9);
        report.server_tick_ms = statistics.server.map(|server| f64::from(server.tick_ms));
        report.promised_radius_m = statistics.server.map(|server| f64::from(server.promised_radius_m));
        report.promised_speed_m_s = statistics.server.map(|server| f64::from(server.promised_speed_m_s));
        report.promise_violations = statistics.server.map(|server| server.promise_violations);
        report.server_far_share = statistics.server.map(|server| f64::from(server.far_share));
        report.server_fed_share = statistics.server.map(|server| f64::from(server.fed_share));
        report.server_matrix_drift = statistics.server.map(|server| f64::from(server.matrix_drift));
        report.warning = statistics.warning;
        report.set_latencies(&self.answers, &self.teleports);
        report
    }
}

fn ticks(rate_hz: f32) -> Interval {
    let mut ticks = interval(Duration::from_nanos((1e9 / f64::from(rate_hz)) as u64));
    // A step that came late is not made up for: the camera is where the clock says.
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    ticks
}
