//! Reading and checking a configuration: every fault names its file, line and key, or its value and what was expected.

use super::Config;
use earthshine_protocol::{LIGHTS_MAX, VOLUME_DIM_MAX, VOLUME_VOXELS_MAX};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Why a configuration was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file could not be read.
    #[error("cannot read the configuration {path:?}: {cause}")]
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        cause: std::io::Error,
    },
    /// The file is not what [`Config`] expects: syntax, an unknown key, a value of the wrong type.
    #[error("{}:{line}:{column}: {message}", path.display())]
    Parse {
        /// Which file.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// Names the key and what is allowed.
        message: String,
    },
    /// A `--set KEY=VALUE` that does not fit.
    #[error("--set {setting}: {message}")]
    Set {
        /// As it was given.
        setting: String,
        /// What is wrong with it.
        message: String,
    },
    /// A value of the `[engine]` table outside of what works.
    #[error(transparent)]
    Engine(#[from] earthshine_engine::ConfigError),
    /// A value outside of what works.
    #[error("{key} = {value}: {requirement}")]
    Value {
        /// Which key.
        key: &'static str,
        /// What it was set to.
        value: String,
        /// What is asked of it.
        requirement: &'static str,
    },
}

/// Smallest time (s) or rate (Hz, MB/s) a key may ask for.
const TIME_OR_RATE_MIN: f64 = 1e-3;
/// Longest time-out a key may ask for, s.
const TIMEOUT_MAX_S: f64 = 86_400.0;
/// Fastest rate a key may ask for, Hz.
const RATE_MAX_HZ: f64 = 10_000.0;
/// Faster than any disk.
const TILE_RATE_MAX_MB_S: f64 = 1e6;
/// Most voxels along one edge of a volume.
const VOLUME_EDGE_MAX: u32 = VOLUME_DIM_MAX;

impl Config {
    /// Reads and checks the file at `path`; keys it leaves out keep their defaults.
    ///
    /// # Errors
    /// [`ConfigError::Read`], [`ConfigError::Parse`], [`ConfigError::Value`].
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let config = Self::parse(&read(path)?, path)?;
        config.validate()?;
        Ok(config)
    }

    /// Parses `text`; `path` is for messages only. Values are not checked yet.
    pub(super) fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        toml::from_str(text).map_err(|error| {
            let offset = error.span().map_or(0, |span| span.start).min(text.len());
            let before = &text.as_bytes()[..offset];
            let line_start = before.iter().rposition(|&byte| byte == b'\n').map_or(0, |at| at + 1);
            ConfigError::Parse {
                path: path.to_owned(),
                line: before.iter().filter(|&&byte| byte == b'\n').count() + 1,
                column: offset - line_start + 1,
                message: error.message().to_owned(),
            }
        })
    }

    /// Checks every value against what works.
    ///
    /// # Errors
    /// [`ConfigError::Value`] for the first that does not.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.engine.validate()?;
        self.validate_counts()?;
        self.validate_times()
    }

    fn validate_counts(&self) -> Result<(), ConfigError> {
        let counts = [
            ("connections_max", self.connections_max, 65_536),
            ("message_bytes_max", self.message_bytes_max, 1 << 26),
            ("engine.lights_max", self.engine.lights_max, LIGHTS_MAX as u32),
            ("loader_threads", self.loader_threads, 256),
            ("tile_queue", self.tile_queue, 4096),
            ("volume_snap_voxels", self.volume_snap_voxels, VOLUME_EDGE_MAX / 4),
            ("deltas_in_flight_max", self.deltas_in_flight_max, 64),
        ];
        for (key, value, most) in counts {
            if value == 0 || value > most {
                return Err(refuse(key, format!("{value} (1 to {most})"), "outside of what is allowed"));
            }
        }
        // Every session needs its connection, and health checks need some besides.
        if self.connections_max <= self.engine.sessions_max {
            return Err(refuse(
                "connections_max",
                self.connections_max,
                "must be more than engine.sessions_max",
            ));
        }
        let [least, edges] = [self.volume_snap_voxels * 2, VOLUME_EDGE_MAX];
        let voxels = self.volume_dims_max.iter().map(|&edge| u64::from(edge)).product::<u64>();
        let fits = self.volume_dims_max.iter().all(|&edge| (least..=edges).contains(&edge));
        if !fits || voxels > u64::from(VOLUME_VOXELS_MAX) {
            let value = format!("{:?}", self.volume_dims_max);
            let requirement =
                "each edge must be twice volume_snap_voxels to 512 voxels, the whole at most 2^21";
            return Err(refuse("volume_dims_max", value, requirement));
        }
        Ok(())
    }

    fn validate_times(&self) -> Result<(), ConfigError> {
        let times = [
            ("hello_timeout_s", self.hello_timeout_s, TIMEOUT_MAX_S),
            ("idle_timeout_s", self.idle_timeout_s, TIMEOUT_MAX_S),
            ("keepalive_interval_s", self.keepalive_interval_s, TIMEOUT_MAX_S),
            ("keepalive_timeout_s", self.keepalive_timeout_s, TIMEOUT_MAX_S),
            ("statistics_interval_s", self.statistics_interval_s, TIMEOUT_MAX_S),
            ("drain_timeout_s", self.drain_timeout_s, TIMEOUT_MAX_S),
            ("camera_rate_max_hz", self.camera_rate_max_hz, RATE_MAX_HZ),
            ("tick_rate_hz", self.tick_rate_hz, RATE_MAX_HZ),
            ("tile_rate_mb_s", self.tile_rate_mb_s, TILE_RATE_MAX_MB_S),
        ];
        let never_or_poll = [0.0..=0.0, TIME_OR_RATE_MIN..=TIMEOUT_MAX_S];
        if !never_or_poll.iter().any(|range| range.contains(&self.world_poll_s)) {
            let value = format!("{} (0, or {TIME_OR_RATE_MIN} to {TIMEOUT_MAX_S})", self.world_poll_s);
            return Err(refuse("world_poll_s", value, "outside of what is allowed"));
        }
        for (key, value, most) in times {
            if !(TIME_OR_RATE_MIN..=most).contains(&value) {
                return Err(refuse(
                    key,
                    format!("{value} ({TIME_OR_RATE_MIN} to {most})"),
                    "outside of what is allowed",
                ));
            }
        }
        Ok(())
    }
}

fn refuse(key: &'static str, value: impl ToString, requirement: &'static str) -> ConfigError {
    ConfigError::Value { key, value: value.to_string(), requirement }
}

/// The text of the file at `path`.
pub(super) fn read(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path).map_err(|cause| ConfigError::Read { path: path.to_owned(), cause })
}

/// A checked number of seconds as a duration.
pub(crate) fn seconds(value: f64) -> Duration {
    Duration::try_from_secs_f64(value).unwrap_or(Duration::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEFAULT_FILE: &str = include_str!("../../../config/default.toml");
    const SOAK_FILE: &str = include_str!("../../../config/soak.toml");

    fn paths(table: &toml::Table, prefix: &str, into: &mut Vec<String>) {
        for (key, value) in table {
            match value {
                toml::Value::Table(inner) => paths(inner, &format!("{prefix}{key}."), into),
                _ => into.push(format!("{prefix}{key}")),
            }
        }
        into.sort();
    }

    #[test]
    fn the_default_file_is_the_default_and_names_every_key() {
        let config = Config::parse(DEFAULT_FILE, Path::new("default.toml")).unwrap();
        assert_eq!(config, Config::default());
        config.validate().unwrap();
        let (mut in_file, mut in_code) = (Vec::new(), Vec::new());
        paths(&toml::from_str(DEFAULT_FILE).unwrap(), "", &mut in_file);
        paths(&toml::Table::try_from(Config::default()).unwrap(), "", &mut in_code);
        assert_eq!(in_file, in_code);
    }

    #[test]
    fn the_soak_file_is_valid_and_tight() {
        let config = Config::parse(SOAK_FILE, Path::new("soak.toml")).unwrap();
        config.validate().unwrap();
        assert!(config.tile_queue < Config::default().tile_queue);
        assert_ne!(config.engine, Config::default().engine);
    }

    #[test]
    fn an_unknown_key_names_file_line_and_key() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        std::fs::write(&path, "tile_queue = 2\n\ntile_queu = 4\n").unwrap();
        let message = Config::load(&path).unwrap_err().to_string();
        assert!(message.contains("mine.toml:3:1"), "{message}");
        assert!(message.contains("`tile_queu`") && message.contains("`tile_queue`"), "{message}");

        std::fs::write(&path, "[engine]\nno_such_budget = 1\n").unwrap();
        let message = Config::load(&path).unwrap_err().to_string();
        assert!(message.contains("mine.toml:2:") && message.contains("no_such_budget"), "{message}");
    }

    #[test]
    fn what_cannot_work_is_refused_by_its_key() {
        let refusal = |text: &str| {
            let config = Config::parse(text, Path::new("a.toml")).unwrap();
            config.validate().unwrap_err().to_string()
        };
        assert!(refusal("tick_rate_hz = nan").contains("tick_rate_hz"));
        for key in ["world_poll_s", "statistics_interval_s"] {
            assert!(refusal(&format!("{key} = 1e-10")).contains(key));
        }
        assert!(refusal("tile_queue = 0").contains("tile_queue"));
        assert!(refusal("volume_dims_max = [64, 64, 2000]").contains("volume_dims_max"));
        assert!(refusal("connections_max = 8").contains("sessions_max"));
        assert!(refusal("[engine]\nsessions_max = 0").contains("sessions_max"));
    }

    #[test]
    fn a_missing_file_is_named() {
        let message = Config::load(Path::new("nowhere/mine.toml")).unwrap_err().to_string();
        assert!(message.contains("nowhere/mine.toml"), "{message}");
    }

    #[test]
    fn the_token_does_not_show_in_debug_output() {
        let config = Config { bearer_token: super::super::Secret("hunter2".to_owned()), ..Config::default() };
        assert!(!format!("{config:?}").contains("hunter2"));
    }
}
