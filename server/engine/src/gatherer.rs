//! Whoever gathers rows beside the CPU, and when the CPU does it.

use crate::refusals::Refusals;
use earthshine_radiosity::receivers::ReceiverLight;

/// Somebody who gathers rows, or nobody.
#[derive(Debug, Default)]
pub(crate) struct Gatherer {
    light: Option<Box<dyn ReceiverLight>>,
    refusals: Refusals,
}

impl Gatherer {
    pub(crate) fn new(light: Box<dyn ReceiverLight>) -> Self {
        Self { light: Some(light), refusals: Refusals::default() }
    }

    /// Whether there is anybody.
    pub(crate) fn is_there(&self) -> bool {
        self.light.is_some()
    }

    /// Whoever gathers, to ask how a gather stands.
    pub(crate) fn light(&mut self) -> Option<&mut Box<dyn ReceiverLight>> {
        self.light.as_mut()
    }

    /// Whoever can be asked for another gather now, and the most rows of it; nobody where the CPU has to do it.
    pub(crate) fn ready(&mut self) -> Option<(&mut Box<dyn ReceiverLight>, usize)> {
        let light = self.light.as_mut()?;
        if !self.refusals.may_ask() {
            return None;
        }
        let rows_max = light.rows_max();
        (rows_max > 0).then_some((light, rows_max))
    }

    /// It has refused.
    pub(crate) fn rest(&mut self) {
        self.refusals.note();
    }
}
