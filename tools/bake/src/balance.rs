//! The rows of a whole world made reciprocal and balanced ([`crate::reciprocity`]), chunk by chunk.
//!
//! A first pass averages: each chunk reads its own rows and the parts of others' that lead to it, and puts the
//! result into the work folder. The rounds of scaling then go over these files. In memory are a few numbers a patch
//! and the rows of the chunks at work.

use crate::BakeError;
use crate::patches::PatchSet;
use crate::progress::{Progress, Stage};
use crate::reciprocity::{self, Balance, ROUNDS};
use crate::row_files::{self, RowIndex};
use crate::rows::RawRow;
use crate::words::{Reader, Writer};
use crate::work_folder::{Kind, Stamp, WorkFolder};
use earthshine_world::Grid;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// The rows of a world, in the work folder.
#[derive(Debug)]
pub(crate) struct RowStore<'a> {
    pub(crate) work: &'a WorkFolder,
    pub(crate) set: &'a PatchSet,
    pub(crate) grid: Grid,
    /// Of every chunk with patches.
    pub(crate) indices: BTreeMap<[i32; 3], RowIndex>,
    /// Hash of the scene and the parameters: averages of another one are of no use.
    pub(crate) content_hash: u64,
}

/// What the rounds of scaling came to, one a patch.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scaling {
    scales: Vec<f32>,
    shrinkages: Vec<f32>,
}

impl RowStore<'_> {
    /// Averages and balances all rows. `visits` are numbers of chunks with patches, in the order to work on them.
    pub(crate) fn balance(
        &self,
        visits: &[Vec<usize>],
        progress: &dyn Progress,
    ) -> Result<(Scaling, Balance), BakeError> {
        let passes = ROUNDS.len() as u64 + 1;
        progress.begin(Stage::Reciprocity, self.set.len() as u64 * passes);
        let mut scales = vec![1.0f32; self.set.len()];
        let mut sums = self.averaged(visits, progress)?;
        let squares: f64 = sums.iter().map(|sum| f64::from(sum - 1.0).powi(2)).sum();
        let rms_before = (squares / sums.len().max(1) as f64).sqrt() as f32;
        for power in ROUNDS {
            let next =
                scales.iter().zip(&sums).map(|(&scale, &sum)| reciprocity::rescaled(scale, sum, power));
            scales = next.collect();
            if power == ROUNDS[ROUNDS.len() - 1] {
                scales.iter_mut().for_each(|scale| *scale = reciprocity::settled(*scale));
            }
            sums = self.sums(&scales, progress)?;
        }
        let shrinkages = sums.into_iter().map(reciprocity::shrinkage).collect();
        let balance = Balance { rms_before, rounds: ROUNDS.len() as u32, ..Balance::default() };
        Ok((Scaling { scales, shrinkages }, balance))
    }

    /// The balanced rows of `chunk`, and what each was short of one.
    pub(crate) fn balanced(
        &self,
        chunk: [i32; 3],
        scaling: &Scaling,
    ) -> Result<(Vec<RawRow>, Vec<f32>), BakeError> {
        let Some(range) = self.set.chunks.get(&chunk) else { return Ok((Vec::new(), Vec::new())) };
        let mut rows = self.read_averages(chunk).ok_or(BakeError::WorkChanged { chunk })?;
        let deficits = rows
            .iter_mut()
            .enumerate()
            .map(|(at, row)| {
                let own = range.start as usize + at;
                reciprocity::close(row, own, &scaling.scales, &scaling.shrinkages)
            })
            .collect();
        Ok((rows, deficits))
    }

    /// Sums of all rows once both estimates of each pair are averaged.
    fn averaged(&self, visits: &[Vec<usize>], progress: &dyn Progress) -> Result<Vec<f32>, BakeError> {
        let chunks: Vec<[i32; 3]> = self.set.chunks.keys().copied().collect();
        let areas: Vec<f32> = self.set.patches.iter().map(|source| source.patch.area).collect();
        let rays: Vec<u32> = self.indices.values().flat_map(|index| &index.rays).copied().collect();
        let mut seen_from: BTreeMap<[i32; 3], Vec<[i32; 3]>> = BTreeMap::new();
        for (&from, index) in &self.indices {
            index.targets().for_each(|to| seen_from.entry(to).or_default().push(from));
        }
        let sums = Mutex::new(vec![0.0f32; self.set.len()]);
        for share in visits {
            share.par_iter().try_for_each(|&number| {
                let chunk = chunks[number];
                let rows = match self.read_averages(chunk) {
                    Some(rows) => rows,
                    None => {
                        let from = seen_from.get(&chunk).map_or(&[][..], Vec::as_slice);
                        let rows = self.average(chunk, from, &areas, &rays)?;
                        self.write_averages(chunk, &rows)?;
                        rows
                    }
                };
                let own: Vec<f32> = rows.iter().map(|row| reciprocity::scaled_sum(row, None, 1.0)).collect();
                let range = &self.set.chunks[&chunk];
                sums.lock().expect("no holder panics")[range.start as usize..range.end as usize]
                    .copy_from_slice(&own);
                progress.advance(own.len() as u64);
                Ok::<_, BakeError>(())
            })?;
        }
        Ok(sums.into_inner().expect("no holder panics"))
    }

    fn average(
        &self,
        chunk: [i32; 3],
        seen_from: &[[i32; 3]],
        areas: &[f32],
        rays: &[u32],
    ) -> Result<Vec<RawRow>, BakeError> {
        let changed = || BakeError::WorkChanged { chunk };
        let range = self.set.chunks[&chunk].clone();
        let (_, payload) = self.work.read(Kind::Rows, 0, chunk).ok_or_else(changed)?;
        let (mut rows, _) =
            row_files::decode(&payload, range.len(), self.set, &self.grid).ok_or_else(changed)?;
        drop(payload);
        let mut incoming: Vec<Vec<(u32, f32)>> = vec![Vec::new(); rows.len()];
        for &from in seen_from {
            let first = self.set.chunks[&from].start;
            let section = self.indices[&from].read_section(self.work, (from, chunk), self.set, &self.grid)?;
            for (row, target, share) in section {
                incoming[(target - range.start) as usize].push((first + u32::from(row), share));
            }
        }
        for (at, (row, incoming)) in rows.iter_mut().zip(&incoming).enumerate() {
            let own = range.start as usize + at;
            row.entries = reciprocity::merge_estimates(own, &row.entries, incoming, areas, rays);
        }
        Ok(rows)
    }

    /// Sums of all rows, scaled on both sides.
    fn sums(&self, scales: &[f32], progress: &dyn Progress) -> Result<Vec<f32>, BakeError> {
        let chunks: Vec<_> = self.set.chunks.iter().collect();
        let by_chunk: Vec<Vec<f32>> = chunks
            .par_iter()
            .map(|&(&chunk, range)| {
                let rows = self.read_averages(chunk).ok_or(BakeError::WorkChanged { chunk })?;
                progress.advance(rows.len() as u64);
                let own = &scales[range.start as usize..range.end as usize];
                let sum = |(row, &own)| reciprocity::scaled_sum(row, Some(scales), own);
                Ok(rows.iter().zip(own).map(sum).collect())
            })
            .collect::<Result<_, BakeError>>()?;
        Ok(by_chunk.concat())
    }

    fn write_averages(&self, chunk: [i32; 3], rows: &[RawRow]) -> Result<(), BakeError> {
        let mut out = Writer::default();
        for row in rows {
            out.f32s(row.sky);
            out.f32s([row.absorbed]);
            out.u32(row.entries.len() as u32);
            for &(patch, share) in &row.entries {
                out.u32(patch);
                out.f32s([share]);
            }
        }
        let stamp = Stamp { key: self.content_hash, ..Stamp::default() };
        self.work.write(Kind::Averages, 0, chunk, &stamp, &out.0)
    }

    fn read_averages(&self, chunk: [i32; 3]) -> Option<Vec<RawRow>> {
        let (stamp, payload) = self.work.read(Kind::Averages, 0, chunk)?;
        if stamp.key != self.content_hash {
            return None;
        }
        let mut reader = Reader(&payload);
        let rows = (0..self.set.chunks[&chunk].len()).map(|_| {
            let (sky, [absorbed]) = (reader.f32s()?, reader.f32s()?);
            let count = reader.count(8)?;
            let mut entry = || Some((reader.u32()?, reader.f32()?));
            let entries = (0..count).map(|_| entry()).collect::<Option<Vec<_>>>()?;
            let is_known = entries.iter().all(|&(patch, _)| (patch as usize) < self.set.len());
            is_known.then_some(RawRow { entries, sky, absorbed, rays: 0 })
        });
        let rows = rows.collect::<Option<Vec<_>>>()?;
        reader.is_empty().then_some(rows)
    }
}
