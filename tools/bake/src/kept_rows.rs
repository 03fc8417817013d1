//! Rows of an earlier bake, and which of them an edit makes us trace again.
//!
//! A file of the work folder is good as it is, or good but for the rows whose rays come to what changed since, or of no
//! use. Rows go in units that are traced together: one for a patch or a part of detail, six for a voxel of air.

use crate::changes::Changes;
use crate::row_files::{FoundRows, RowIndex};
use crate::rows::RawRow;
use crate::stages::{Known, Run};
use crate::work_folder::{Kind, Stale, Stamp};
use rayon::prelude::*;
use std::sync::Arc;

/// What the work folder has of a chunk's rows.
#[derive(Debug)]
pub(crate) enum Kept {
    /// Nothing of use.
    Nothing(Stale),
    /// Just what is wanted.
    All(RowIndex),
    /// Rows of an earlier state of the scene.
    Earlier(FoundRows, Arc<Changes>),
}

/// The rows of a chunk after an edit.
#[derive(Debug)]
pub(crate) struct Renewal {
    pub(crate) rows: Vec<RawRow>,
    /// Of each unit, whether it was traced.
    pub(crate) is_new: Vec<bool>,
    /// Why any was; `None` if none was.
    pub(crate) stale: Option<Stale>,
    /// Where the rows are in the file, if it is good as it is.
    pub(crate) index: Option<RowIndex>,
}

impl Kept {
    /// What there is of `kind` for `chunk`, where `now` holds; `decode` finds rows in a payload.
    pub(crate) fn of(
        run: &Run<'_>,
        known: &Known<'_>,
        (kind, chunk): (Kind, [i32; 3]),
        now: &Stamp,
        decode: impl FnOnce(&[u8]) -> Option<FoundRows>,
    ) -> Self {
        let Some((stamp, payload)) = run.files.work.read(kind, 0, chunk) else {
            return Self::Nothing(Stale::Absent);
        };
        if let Some(stale) = stamp.difference(now) {
            return Self::Nothing(stale);
        }
        match (decode(&payload), known.states.since(stamp.state, &known.cells)) {
            (Some(found), Some(changes)) if changes.is_empty() && !found.has_lost.contains(&true) => {
                Self::All(found.index)
            }
            (Some(found), Some(changes)) => Self::Earlier(found, changes),
            _ => Self::Nothing(Stale::Absent),
        }
    }

    /// All `units` of `per` rows each: as kept, or from `trace`, which is given all at once, where there is nothing, or a
    /// patch is gone, or `is_concerned` by what changed.
    pub(crate) fn renewed(
        self,
        (units, per): (usize, usize),
        is_concerned: impl Fn(usize, &[RawRow], &Changes) -> bool + Sync,
        trace: impl Fn(&[usize]) -> Vec<Vec<RawRow>>,
    ) -> Renewal {
        let all: Vec<usize> = (0..units).collect();
        let (found, changes) = match self {
            Self::Earlier(found, changes) => (found, changes),
            Self::All(_) | Self::Nothing(_) => {
                let rows = trace(&all).concat();
                let stale = if let Self::Nothing(stale) = self { stale } else { Stale::Absent };
                return Renewal { rows, is_new: vec![true; units], stale: Some(stale), index: None };
            }
        };
        let own = |unit: usize| unit * per..(unit + 1) * per;
        let has_to = |&unit: &usize| {
            found.has_lost[own(unit)].contains(&true) || is_concerned(unit, &found.rows[own(unit)], &changes)
        };
        let is_new: Vec<bool> = all.par_iter().map(has_to).collect();
        let new: Vec<usize> = all.into_iter().filter(|&unit| is_new[unit]).collect();
        let mut rows = found.rows;
        for (&unit, traced) in new.iter().zip(trace(&new)) {
            rows.splice(own(unit), traced);
        }
        let at = changes.example().to_array();
        let renewed = new.len() as u32;
        let stale = (renewed > 0).then_some(Stale::Part { renewed, of: units as u32, at });
        let index = stale.is_none().then_some(found.index);
        Renewal { rows, is_new, stale, index }
    }
}
