//! Progress on standard error: one bar a stage, with rate and time left; silent with `--json` or `--quiet`.

use earthshine_bake::{Progress, Stage};
use indicatif::{HumanCount, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::io::IsTerminal as _;
use std::sync::Mutex;

/// A bar for each stage of a bake.
#[derive(Debug)]
pub(crate) struct BakeBars {
    bar: Mutex<Option<ProgressBar>>,
    /// What was said last, without a terminal: a stage that begins again for each level is named once.
    named: Mutex<Option<Stage>>,
    quiet: bool,
}

impl BakeBars {
    pub(crate) fn new(quiet: bool) -> Self {
        Self { bar: Mutex::new(None), named: Mutex::new(None), quiet }
    }

    /// Ends the last bar.
    pub(crate) fn finish(&self) {
        if let Some(bar) = self.bar.lock().expect("no holder panics").take() {
            bar.finish();
        }
    }
}

impl Progress for BakeBars {
    fn begin(&self, stage: Stage, total: u64) {
        self.finish();
        let is_named = self.named.lock().expect("no holder panics").replace(stage) == Some(stage);
        if !self.quiet && !is_named && !std::io::stderr().is_terminal() {
            eprintln!("{}: {} {}", stage.name(), HumanCount(total), stage.unit());
        }
        let bar = counted(stage.name(), stage.unit(), total, self.quiet);
        *self.bar.lock().expect("no holder panics") = Some(bar);
    }

    fn advance(&self, units: u64) {
        if let Some(bar) = &*self.bar.lock().expect("no holder panics") {
            bar.inc(units);
        }
    }

    fn device_failed(&self, cause: &str) {
        let said = format!("warning: tracing on the device failed: {cause}; the CPU traces the rest");
        match &*self.bar.lock().expect("no holder panics") {
            Some(bar) => bar.suspend(|| eprintln!("{said}")),
            None => eprintln!("{said}"),
        }
    }
}

/// A bar over `total` `unit`s.
pub(crate) fn counted(name: &'static str, unit: &'static str, total: u64, quiet: bool) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let style =
        ProgressStyle::with_template("{prefix:>12} [{bar:30}] {percent:>3}% {rate:>22} {eta:>5} left")
            .expect("the template is a constant")
            .progress_chars("=> ")
            .with_key("rate", move |state: &ProgressState, out: &mut dyn std::fmt::Write| {
                write!(out, "{} {unit}/s", HumanCount(state.per_sec() as u64))
                    .expect("a string takes any text");
            });
    let bar = ProgressBar::with_draw_target(Some(total), target);
    bar.set_style(style);
    bar.set_prefix(name);
    bar
}
