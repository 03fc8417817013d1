//! Form-factor rows: uncoloured, single-bounce, sparse.
//!
//! Row `i` says where the light that arrives at patch `i` may come from: `F_ij` for patches, six sky
//! lobes for true escapes, and the rest, absorbed. The parts sum to one. Which columns are *resident*
//! and which *far* is a matter of the moment (see [`RowParts`]); the sky is stored and never guessed.

use crate::{ChunkId, PatchId};

/// One entry's target: an index into [`ChunkRows::segments`] and a patch of that chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Column {
    /// Which chunk, as an index into the segment table.
    pub segment: u16,
    /// Which patch of that chunk.
    pub local: u16,
}

/// All rows of one chunk, in compressed sparse row form.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ChunkRows {
    /// Chunks that columns point into, ascending.
    pub segments: Vec<ChunkId>,
    /// `row_starts[i]..row_starts[i + 1]` are the entries of row `i`; one longer than the patch count.
    pub row_starts: Vec<u32>,
    /// Targets, ascending within a row.
    pub columns: Vec<Column>,
    /// Form factors `F_ij`, 0..=1, one a column.
    pub shares: Vec<f32>,
    /// Sky share of each row by direction lobe: an escape along `d` adds `d_a^2` to the lobe it faces.
    pub sky_shares: Vec<[f32; 6]>,
    /// Share that hits a side without patches or was cut off: known to bring no light.
    pub absorbed_shares: Vec<f32>,
}

impl ChunkRows {
    /// Number of rows.
    #[must_use]
    pub fn row_count(&self) -> usize {
        self.sky_shares.len()
    }

    /// The entries of row `row`.
    ///
    /// # Panics
    /// If `row` is not below [`Self::row_count`].
    pub fn row(&self, row: usize) -> impl ExactSizeIterator<Item = (Column, f32)> + '_ {
        let range = self.row_starts[row] as usize..self.row_starts[row + 1] as usize;
        self.columns[range.clone()].iter().copied().zip(self.shares[range].iter().copied())
    }

    /// Whose column `column` is.
    ///
    /// # Panics
    /// If the column's segment is not in the table; readers check that before a row leaves them.
    #[must_use]
    pub fn patch_id(&self, column: Column) -> PatchId {
        PatchId { chunk: self.segments[usize::from(column.segment)], local: column.local }
    }

    /// Sum of everything in row `row`: patches, sky, absorbed. One within the invariant's tolerance.
    ///
    /// # Panics
    /// If `row` is not below [`Self::row_count`].
    #[must_use]
    pub fn row_sum(&self, row: usize) -> f32 {
        let patches: f64 = self.row(row).map(|(_, share)| f64::from(share)).sum();
        let sky: f64 = self.sky_shares[row].iter().map(|&share| f64::from(share)).sum();
        (patches + sky + f64::from(self.absorbed_shares[row])) as f32
    }
}

/// How a row splits at one moment. `resident + far + sky + absorbed = 1`; never merge `far` into `sky`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RowParts {
    /// Columns that hold slots.
    pub resident: f32,
    /// Columns that exist but are not resident.
    pub far: f32,
    /// True escapes.
    pub sky: f32,
    /// Known to bring no light.
    pub absorbed: f32,
}

impl RowParts {
    /// What light rests on: all but the far part, 0..=1.
    #[must_use]
    pub fn known(&self) -> f32 {
        (self.resident + self.sky + self.absorbed).clamp(0.0, 1.0)
    }
}
