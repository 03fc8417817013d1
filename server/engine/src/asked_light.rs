//! Direct light that somebody else was asked for, for one local set: whose it is, and what it rests on.
//!
//! Nobody waits for it. When it comes it goes to the patch that it was asked for, if that still holds its slot, and never
//! takes the place of newer light ([`crate::relight`]); a set that is dropped or cleared forgets it.

use crate::relight::Stamp;
use earthshine_light::{LightUnderWay, LitPatch};
use earthshine_world::{Asked, PatchId};
use std::collections::VecDeque;

/// Most questions under way: two a tick, of newcomers and of what is out of date. More are not asked: patches keep the light
/// that they have.
pub(crate) const QUESTIONS_MAX: usize = 8;

/// A patch whose light was asked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AskedPatch {
    pub(crate) slot: u32,
    pub(crate) id: PatchId,
}

/// What was asked for together.
#[derive(Debug)]
pub(crate) struct Question {
    pub(crate) stamp: Stamp,
    pub(crate) tick: u64,
    pub(crate) patches: Vec<AskedPatch>,
}

/// Questions under way, the oldest first.
#[derive(Debug, Default)]
pub(crate) struct AskedLight(VecDeque<(Question, Box<dyn LightUnderWay>)>);

impl AskedLight {
    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// Slots asked for, each with the tick that it was asked in.
    #[cfg(test)]
    pub(crate) fn slots(&self) -> impl Iterator<Item = (u64, u32)> {
        let of = |(question, _): &(Question, _)| (question.tick, question.patches.clone());
        self.0.iter().map(of).flat_map(|(tick, patches)| patches.into_iter().map(move |of| (tick, of.slot)))
    }

    /// Whether no other question is to be asked.
    pub(crate) fn is_full(&self) -> bool {
        self.len() >= QUESTIONS_MAX
    }

    pub(crate) fn push(&mut self, question: Question, light: Box<dyn LightUnderWay>) {
        self.0.push_back((question, light));
    }

    /// The oldest question, once it is answered: by the light of its patches, or by nothing if that is lost.
    pub(crate) fn take_answered(&mut self) -> Option<(Question, Option<Vec<LitPatch>>)> {
        let light = match self.0.front_mut()?.1.look() {
            Asked::UnderWay => return None,
            Asked::Done(light) => Some(light),
            Asked::Lost => None,
        };
        Some((self.0.pop_front()?.0, light))
    }
}
