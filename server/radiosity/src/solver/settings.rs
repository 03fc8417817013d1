//! Which method, and how much work it may do: [`SolverSettings`].

use crate::tables::draw::Spread;
use serde::{Deserialize, Serialize};

/// How light is advanced by a frame. The table in [`crate::solver`] compares them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// The dense multibounce matrix: exact at once; `6 M^2` bytes, O(M^2) a frame and a swap.
    #[default]
    Matrix,
    /// Iterated sparse product with warm start, a bounce a frame.
    Gather,
    /// Temporal radiosity with draws from alias tables: the sources' method.
    Alias,
    /// The same with systematic draws from cumulative tables.
    Cdf,
    /// Progressive shooting of unshot exitance, largest first.
    Progressive,
    /// Shooting, and draws for what is not shot yet.
    Hybrid,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Matrix, Self::Gather, Self::Alias, Self::Cdf, Self::Progressive, Self::Hybrid];

    /// Whether it goes on for ever, with noise, when nothing changes.
    #[must_use]
    pub const fn is_endless(self) -> bool {
        matches!(self, Self::Alias | Self::Cdf)
    }

    /// Whether it draws from tables.
    #[must_use]
    pub const fn draws(self) -> bool {
        matches!(self, Self::Alias | Self::Cdf | Self::Hybrid)
    }

    /// As in configuration and figures.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Matrix => "matrix",
            Self::Gather => "gather",
            Self::Alias => "alias",
            Self::Cdf => "cdf",
            Self::Progressive => "progressive",
            Self::Hybrid => "hybrid",
        }
    }
}

impl std::fmt::Display for Method {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Method {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|method| method.name() == name)
            .ok_or_else(|| format!("{name:?} is not matrix, gather, alias, cdf, progressive or hybrid"))
    }
}

/// Which rows [`Method::Alias`] and [`Method::Cdf`] draw from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DrawnRows {
    /// Rows of form factors: a bounce a frame, through the light of the frame before.
    #[default]
    FormFactors,
    /// Rows of the multibounce matrix: all bounces at once, each channel by its own entries; takes the matrix as well.
    Multibounce,
}

/// What a [`SolverBackend`](super::SolverBackend) does a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverSettings {
    /// How light is advanced.
    pub method: Method,
    /// What `alias` and `cdf` draw from.
    pub rows: DrawnRows,
    /// Of every draw.
    pub seed: u32,
    /// Draws a row and frame (k), 1 to [`Self::SAMPLES_MAX`]. Higher: less noise, longer frames.
    pub samples_per_row: u32,
    /// Weight of the past (w) in a temporal blend, at least 0, below 1. Higher: less noise, light lags longer:
    /// `1 / (1 - w)` frames to 63 % of a step.
    pub history_weight: f32,
    /// Whether `k` and `w` follow the measured variance of each row: rows with more noise draw more, and a row whose
    /// light has moved forgets its past.
    pub adaptive: bool,
    /// Items of tables that a step rebuilds after patches came or went, at least 1. A core makes 100 million a second.
    pub rebuild_items_per_step: u32,
    /// Form factors that a step shoots over, for each resident patch, at least 1.
    pub shot_links_per_patch: u32,
}

impl Default for SolverSettings {
    fn default() -> Self {
        Self {
            method: Method::Matrix,
            rows: DrawnRows::FormFactors,
            seed: 1,
            samples_per_row: 32,
            history_weight: 0.998,
            adaptive: false,
            rebuild_items_per_step: 200_000,
            shot_links_per_patch: 96,
        }
    }
}

/// A setting that cannot be.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// k.
    #[error("samples_per_row is {0}: it has to be between 1 and {max}", max = SolverSettings::SAMPLES_MAX)]
    Samples(u32),
    /// w.
    #[error("history_weight is {0}: it has to be at least 0 and below 1, or light would never follow")]
    HistoryWeight(f32),
    /// Table rebuilds.
    #[error("rebuild_items_per_step is 0: tables would never follow the patches")]
    RebuildItems,
    /// Shots.
    #[error("shot_links_per_patch is 0: light would never leave its source")]
    ShotLinks,
}

impl SolverSettings {
    /// Most draws a row and frame.
    pub const SAMPLES_MAX: u32 = 4096;

    /// Checks every field against its range.
    ///
    /// # Errors
    /// The first that is out of it.
    pub fn validate(&self) -> Result<(), SettingsError> {
        if !(1..=Self::SAMPLES_MAX).contains(&self.samples_per_row) {
            return Err(SettingsError::Samples(self.samples_per_row));
        }
        if !(0.0..1.0).contains(&self.history_weight) {
            return Err(SettingsError::HistoryWeight(self.history_weight));
        }
        if self.rebuild_items_per_step == 0 {
            return Err(SettingsError::RebuildItems);
        }
        if self.shot_links_per_patch == 0 {
            return Err(SettingsError::ShotLinks);
        }
        Ok(())
    }

    /// Whether light comes from the matrix, whole or drawn.
    #[must_use]
    pub fn needs_matrix(&self) -> bool {
        self.method == Method::Matrix || self.is_coloured()
    }

    /// Whether rows of the matrix are drawn from.
    #[must_use]
    pub fn is_coloured(&self) -> bool {
        self.method.is_endless() && self.rows == DrawnRows::Multibounce
    }

    /// How the method spreads its draws.
    #[must_use]
    pub(crate) fn spread(&self) -> Spread {
        if self.method == Method::Alias { Spread::Independent } else { Spread::Systematic }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_cannot_be_are_refused_by_name() {
        let refused = |spoil: fn(&mut SolverSettings)| {
            let mut settings = SolverSettings::default();
            settings.validate().expect("the default is sound");
            spoil(&mut settings);
            settings.validate().expect_err("spoilt").to_string()
        };
        assert!(refused(|s| s.samples_per_row = 0).starts_with("samples_per_row is 0"));
        assert!(refused(|s| s.samples_per_row = 5000).starts_with("samples_per_row is 5000"));
        for weight in [1.0, 1.5, -0.1, f32::NAN] {
            let settings = SolverSettings { history_weight: weight, ..SolverSettings::default() };
            assert!(matches!(settings.validate(), Err(SettingsError::HistoryWeight(_))), "{weight}");
        }
        assert!(refused(|s| s.rebuild_items_per_step = 0).contains("rebuild_items_per_step"));
        assert!(refused(|s| s.shot_links_per_patch = 0).contains("shot_links_per_patch"));
    }
}
