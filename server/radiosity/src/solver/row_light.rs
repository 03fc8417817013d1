//! Who keeps the light of sparse rows and advances it by one method: [`RowLight`].
//!
//! [`SolverBackend`](super::SolverBackend) keeps who is there and chooses the method; a `RowLight` lives as long as its
//! method does. [`CpuRowLight`](super::CpuRowLight) is the reference; others follow it within rounding.

use super::residents::Residents;
use super::{Light, SolverSettings};
use crate::backend::{Backend, BackendError, Slot};
use earthshine_world::Rgb;

/// Makes the light of some residents, given the method to advance it by and the light to go on from, by slot.
pub type RowLightFactory = Box<
    dyn FnMut(&mut Residents, &SolverSettings, &[Light]) -> Result<Box<dyn RowLight>, BackendError> + Send,
>;

/// What a frame is told.
pub struct Frame<'a> {
    /// Of the method that the light was made for.
    pub settings: &'a SolverSettings,
    /// Counts on from frame to frame.
    pub number: u32,
    /// Slots, most urgent first.
    pub order: &'a [u32],
    /// For rows of the matrix, where they are drawn from.
    pub matrix: Option<&'a mut dyn Backend>,
}

impl std::fmt::Debug for Frame<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Frame").field("number", &self.number).finish_non_exhaustive()
    }
}

/// Light on residents, and what its method keeps besides.
pub trait RowLight: Send {
    /// A patch has come into `slot`: its links are there, its sources are not yet.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    fn come(&mut self, residents: &Residents, slot: usize) -> Result<(), BackendError>;

    /// The patch in `slot` goes; its links and sources are still there.
    ///
    /// # Errors
    /// [`BackendError::DeviceLost`], [`BackendError::OutOfMemory`].
    fn leave(&mut self, residents: &Residents, slot: usize) -> Result<(), BackendError>;

    /// The sources of `slot` have changed by `own` and `outside`, and are in `residents` already.
    fn change(&mut self, residents: &Residents, slot: usize, own: &Light, outside: &Light);

    /// What the row of `slot` sends outside is shared otherwise between what is far and the sky.
    fn outdate(&mut self, slot: usize);

    /// Advances the light by a frame.
    ///
    /// # Errors
    /// As [`Backend::step`].
    fn advance(&mut self, residents: &mut Residents, frame: Frame<'_>) -> Result<(), BackendError>;

    /// Whether another frame without any change would leave the light as it is, to the bit, as far as is known by now.
    fn is_settled(&self) -> bool;

    /// The light of `slots`, which are taken, with what is only estimated.
    ///
    /// # Errors
    /// As [`Backend::read_irradiance`].
    fn read(&mut self, residents: &Residents, slots: &[Slot], out: &mut [Rgb]) -> Result<(), BackendError>;

    /// As [`Backend::reads_at_once`], of the same light.
    fn reads_at_once(&self) -> bool {
        true
    }

    /// As [`Backend::poll_irradiance`], of the same light. The default reads at once.
    ///
    /// # Errors
    /// As [`Backend::poll_irradiance`].
    fn poll(&mut self, residents: &Residents, slots: &[Slot], out: &mut [Rgb]) -> Result<bool, BackendError> {
        self.read(residents, slots, out).map(|()| true)
    }

    /// As [`Backend::take_news`], of the same light.
    ///
    /// # Errors
    /// As [`Backend::take_news`].
    fn take_news(&mut self, residents: &Residents, news: &mut Vec<(Slot, Rgb)>) -> Result<(), BackendError>;

    /// Whether news of light that is there is still on its way, or was not taken yet.
    fn is_news_coming(&self) -> bool {
        false
    }

    /// Takes in what has arrived, so that it no longer holds up the next step; it is told by [`Self::take_news`].
    ///
    /// # Errors
    /// As [`Backend::take_news`].
    fn collect(&mut self) -> Result<(), BackendError> {
        Ok(())
    }

    /// As [`Backend::is_behind`], as far as was collected.
    fn is_behind(&self) -> bool {
        false
    }
}
