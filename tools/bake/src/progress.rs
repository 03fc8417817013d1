//! How a bake tells how far it is; the tool draws bars from it.

/// The stages of a bake, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Building the tree over the triangles; counted in triangles.
    Tree,
    /// Covering surfaces with points; counted in triangles, or in voxels where points come from their faces.
    Sample,
    /// Telling open, hidden and buried points apart; counted in points.
    Exposure,
    /// Tracing rows; counted in rays.
    Rows,
    /// Averaging and balancing rows; counted in rows.
    Reciprocity,
    /// Tracing receivers in the air; counted in rays.
    Receivers,
    /// Tracing receivers on surfaces; counted in patches.
    Detail,
    /// Encoding and writing tiles; counted in tiles.
    Tiles,
    /// Merging coarse levels; begins once a level, counted in its tiles.
    Pyramid,
}

impl Stage {
    /// All stages, in order.
    pub const ALL: [Self; 9] = [
        Self::Tree,
        Self::Sample,
        Self::Exposure,
        Self::Rows,
        Self::Reciprocity,
        Self::Receivers,
        Self::Detail,
        Self::Tiles,
        Self::Pyramid,
    ];

    /// Lower-case name, as in summaries.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tree => "tree",
            Self::Sample => "sample",
            Self::Exposure => "exposure",
            Self::Rows => "rows",
            Self::Reciprocity => "reciprocity",
            Self::Receivers => "receivers",
            Self::Detail => "detail",
            Self::Tiles => "tiles",
            Self::Pyramid => "pyramid",
        }
    }

    /// What is counted.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Tree => "triangles",
            Self::Sample => "places",
            Self::Exposure => "points",
            Self::Rows | Self::Receivers => "rays",
            Self::Reciprocity => "rows",
            Self::Detail => "patches",
            Self::Tiles | Self::Pyramid => "tiles",
        }
    }
}

/// Hears how far a bake is. Called from several threads.
pub trait Progress: Sync {
    /// A stage begins with `total` units to do.
    fn begin(&self, stage: Stage, total: u64);
    /// `units` more are done.
    fn advance(&self, units: u64);
    /// The device that rays were traced on failed of `cause`: the rest is traced on the CPU. Called once at most.
    fn device_failed(&self, cause: &str);
}

/// Hears nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _stage: Stage, _total: u64) {}
    fn advance(&self, _units: u64) {}
    fn device_failed(&self, _cause: &str) {}
}
