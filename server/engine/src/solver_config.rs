//! Which solver lights each level, and how much work it may do: [`SolverConfig`].

use crate::config::ConfigError;
use earthshine_radiosity::solver::{DrawnRows, Method, SettingsError, SolverSettings};

/// Solvers of all levels. May change at run time: light goes on from where it is.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SolverConfig {
    /// The solver of each level, finest first; the last serves all further levels. Empty: `matrix` for levels of at most
    /// [`Self::MATRIX_SLOTS_MAX`] slots, `hybrid` for larger ones.
    ///
    /// - `matrix`: exact at once; memory and the time of a swap grow with the square of the patches.
    /// - `hybrid`: for more patches than a matrix fits; a change of light takes a few ticks, still light costs nothing.
    pub by_level: Vec<Method>,
    /// What `alias` and `cdf` draw from.
    ///
    /// - `form_factors`: light of a bounce a tick, through the light of the tick before; a swap changes few rows.
    /// - `multibounce`: all bounces at once, but the matrix has to be held and every swap changes all rows, which then wait
    ///   for their turn under `table_items_per_tick_max`. On the CPU only.
    pub drawn_rows: DrawnRows,
    /// Draws a row and tick (k) of `alias`, `cdf` and `hybrid`, 1 to 4096. Higher: less noise, longer ticks.
    pub samples_per_row: u32,
    /// Weight of the past (w) in `alias` and `cdf`, at least 0, below 1. Higher: less noise, light lags longer.
    pub history_weight: f32,
    /// Whether draws and weight follow the measured variance of each row.
    pub adaptive: bool,
    /// Table items that a view rebuilds a tick after patches came or went, at least 1: of the nearest patches first, and
    /// a quarter of them in turn. Lower: rows draw from old tables for longer; they stay true, but for newcomers.
    pub table_items_per_tick_max: u32,
    /// Form factors that `progressive` and `hybrid` shoot over a tick, for each resident patch, at least 1.
    ///
    /// - Higher: a change of light arrives in fewer ticks.
    /// - Lower: shorter ticks while light changes.
    pub shot_links_per_patch: u32,
    /// Ticks between two audits, in which a matrix solves the same light and the difference is exported; 0 for none.
    ///
    /// An audited view holds the matrix as well: memory and the time of swaps are those of both.
    pub audit_every_ticks: u32,
}

impl Default for SolverConfig {
    fn default() -> Self {
        let settings = SolverSettings::default();
        Self {
            by_level: Vec::new(),
            drawn_rows: DrawnRows::FormFactors,
            samples_per_row: settings.samples_per_row,
            history_weight: settings.history_weight,
            adaptive: settings.adaptive,
            table_items_per_tick_max: settings.rebuild_items_per_step,
            shot_links_per_patch: settings.shot_links_per_patch,
            audit_every_ticks: 0,
        }
    }
}

impl SolverConfig {
    /// Most slots for which a matrix is chosen where no solver is named: beyond, a swap and a frame of `hybrid` cost less.
    pub const MATRIX_SLOTS_MAX: u32 = 4096;

    /// What the backend of a view of `level` with so many `slots` is told.
    #[must_use]
    pub fn settings(&self, level: u8, slots: u32, seed: u64) -> SolverSettings {
        let named = self.by_level.get(usize::from(level)).or(self.by_level.last()).copied();
        let by_size = if slots <= Self::MATRIX_SLOTS_MAX { Method::Matrix } else { Method::Hybrid };
        SolverSettings {
            method: named.unwrap_or(by_size),
            rows: self.drawn_rows,
            seed: seed as u32,
            samples_per_row: self.samples_per_row,
            history_weight: self.history_weight,
            adaptive: self.adaptive,
            rebuild_items_per_step: self.table_items_per_tick_max,
            shot_links_per_patch: self.shot_links_per_patch,
        }
    }

    /// Checks every key against its range.
    ///
    /// # Errors
    /// The first key that is out of it.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let error = |key, value: String, cause| Err(ConfigError { key, value, cause });
        match self.settings(0, 0, 0).validate() {
            Ok(()) => Ok(()),
            Err(SettingsError::Samples(k)) => {
                error("solver.samples_per_row", k.to_string(), "it has to be between 1 and 4096")
            }
            Err(SettingsError::HistoryWeight(w)) => {
                error("solver.history_weight", w.to_string(), "it has to be at least 0 and below 1")
            }
            Err(SettingsError::RebuildItems) => {
                error("solver.table_items_per_tick_max", "0".to_owned(), "it has to be at least 1")
            }
            Err(SettingsError::ShotLinks) => {
                error("solver.shot_links_per_patch", "0".to_owned(), "it has to be at least 1")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_impossible_value_is_refused_by_name() {
        type Spoil = fn(&mut SolverConfig);
        let cases: [(&str, Spoil); 6] = [
            ("solver.samples_per_row", |c| c.samples_per_row = 0),
            ("solver.history_weight", |c| c.history_weight = 1.0),
            ("solver.history_weight", |c| c.history_weight = -0.5),
            ("solver.history_weight", |c| c.history_weight = f32::NAN),
            ("solver.table_items_per_tick_max", |c| c.table_items_per_tick_max = 0),
            ("solver.shot_links_per_patch", |c| c.shot_links_per_patch = 0),
        ];
        for (key, spoil) in cases {
            let mut config = SolverConfig::default();
            config.validate().unwrap();
            spoil(&mut config);
            assert_eq!(config.validate().unwrap_err().key, key);
        }
    }

    #[test]
    fn without_a_name_the_size_decides() {
        let config = SolverConfig::default();
        let method = |slots| config.settings(0, slots, 1).method;
        let most = SolverConfig::MATRIX_SLOTS_MAX;
        assert_eq!(
            [method(1), method(most), method(most + 1)],
            [Method::Matrix, Method::Matrix, Method::Hybrid]
        );
    }

    #[test]
    fn levels_beyond_the_list_use_its_last_solver() {
        let config: SolverConfig = toml::from_str("by_level = [\"hybrid\", \"matrix\"]").unwrap();
        let method = |level| config.settings(level, 100, 1).method;
        assert_eq!([method(0), method(1), method(9)], [Method::Hybrid, Method::Matrix, Method::Matrix]);
        assert!(toml::from_str::<SolverConfig>("by_level = [\"radiosity\"]").is_err());
        let coloured: SolverConfig = toml::from_str("drawn_rows = \"multibounce\"").unwrap();
        assert_eq!(coloured.settings(0, 100, 1).rows, DrawnRows::Multibounce);
        assert!(toml::from_str::<SolverConfig>("drawn_rows = \"matrix\"").is_err());
        assert!("hybrid".parse::<Method>() == Ok(Method::Hybrid));
        assert!("magic".parse::<Method>().unwrap_err().contains("progressive"));
    }
}
