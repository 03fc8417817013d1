//! The states of the scene that files of the work folder were made from, and what changed since each.
//!
//! A state is the content of all cells. It lies in the work folder under its hash as long as a file names it.

use crate::BakeError;
use crate::cells::Cells;
use crate::changes::Changes;
use crate::work_folder::WorkFolder;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};

/// States in the folder from which on files of earlier ones are written again, so that those can go.
const STATES_MAX: usize = 8;

/// The state that is baked, and those before it that were asked for.
#[derive(Debug)]
pub(crate) struct States<'a> {
    work: &'a WorkFolder,
    /// The hash of the state that is baked.
    pub(crate) now: u64,
    /// Whether files of earlier states are to be written again even if nothing in them changed.
    pub(crate) renew_all: bool,
    earlier: Mutex<BTreeMap<u64, Option<Arc<Changes>>>>,
}

impl<'a> States<'a> {
    /// Puts the state `cells` into the folder.
    pub(crate) fn begin(work: &'a WorkFolder, cells: &Cells) -> Result<Self, BakeError> {
        let now = cells.state();
        let renew_all = work.count_states()? > STATES_MAX;
        work.write_state(now, &cells.encode())?;
        Ok(Self { work, now, renew_all, earlier: Mutex::default() })
    }

    /// What is different in `cells`, which are the state now, from state number `earlier`; `None` if that is not known.
    pub(crate) fn since(&self, earlier: u64, cells: &Cells) -> Option<Arc<Changes>> {
        if earlier == self.now {
            return Some(Arc::default());
        }
        let mut known = self.earlier.lock().expect("no holder panics");
        let read = || {
            let old = Cells::decode(&self.work.read_state(earlier)?)?;
            (old.state() == earlier).then_some(())?;
            Changes::between(&old, cells).map(Arc::new)
        };
        known.entry(earlier).or_insert_with(read).clone()
    }

    /// The states that files may still name.
    pub(crate) fn named(&self) -> BTreeSet<u64> {
        let earlier = self.earlier.lock().expect("no holder panics");
        let kept = earlier.keys().copied().filter(|_| !self.renew_all);
        kept.chain([self.now]).collect()
    }
}
