//! Flags and environment variables of `serve`, laid over a file or the defaults.
//!
//! Only settings that change from run to run have a flag of their own; `--set` reaches every key.

use super::load::{ConfigError, read};
use super::{BackendKind, Config, Secret};
use crate::ServerError;
use earthshine_radiosity::solver::Method;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// Arguments of `serve`. Precedence: flag, environment, `--set`, file, default.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ServeArgs {
    /// Folder of the baked world
    #[arg(env = "EARTHSHINE_WORLD")]
    pub world: Option<PathBuf>,
    /// Configuration file (TOML); config/default.toml lists every key
    #[arg(long, env = "EARTHSHINE_CONFIG", value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Where clients connect; port 0 takes a free one
    #[arg(long, env = "EARTHSHINE_LISTEN", value_name = "ADDRESS")]
    pub listen: Option<SocketAddr>,
    /// Where /metrics, /health and /ready answer; port 0 takes a free one
    #[arg(long, env = "EARTHSHINE_ADMIN_LISTEN", value_name = "ADDRESS")]
    pub admin_listen: Option<SocketAddr>,
    /// Who computes
    #[arg(long, env = "EARTHSHINE_BACKEND")]
    pub backend: Option<BackendKind>,
    /// Solvers by level, finest first: matrix, gather, alias, cdf, progressive or hybrid
    #[arg(long, env = "EARTHSHINE_SOLVER", value_name = "NAMES", value_delimiter = ',')]
    pub solver: Vec<Method>,
    /// Ticks between two audits of the solvers by the matrix; 0 for none
    #[arg(long, env = "EARTHSHINE_AUDIT", value_name = "TICKS")]
    pub audit: Option<u32>,
    /// Part of the name of the graphics adapter to compute on; `earthshine gpu` lists them
    #[arg(long, env = "EARTHSHINE_GPU_ADAPTER", value_name = "NAME")]
    pub gpu_adapter: Option<String>,
    /// Refuse an adapter with less room than is configured, instead of taking what fits
    #[arg(long = "strict", env = "EARTHSHINE_GPU_STRICT")]
    pub gpu_strict: bool,
    /// Kernels do without the adapter's subgroups
    #[arg(long = "without-subgroups", env = "EARTHSHINE_WITHOUT_SUBGROUPS")]
    pub without_subgroups: bool,
    /// File that keeps compiled kernels from one start to the next
    #[arg(long, env = "EARTHSHINE_GPU_PIPELINE_CACHE", value_name = "FILE")]
    pub gpu_pipeline_cache: Option<PathBuf>,
    /// Sessions at once
    #[arg(long, env = "EARTHSHINE_SESSIONS_MAX", value_name = "COUNT")]
    pub sessions_max: Option<u32>,
    /// Ticks of the engine in a second
    #[arg(long, env = "EARTHSHINE_TICK_RATE_HZ", value_name = "HZ")]
    pub tick_rate_hz: Option<f64>,
    /// Threads that read tiles
    #[arg(long, env = "EARTHSHINE_LOADER_THREADS", value_name = "COUNT")]
    pub loader_threads: Option<u32>,
    /// Seconds that a graceful stop may take
    #[arg(long, env = "EARTHSHINE_DRAIN_TIMEOUT_S", value_name = "SECONDS")]
    pub drain_timeout_s: Option<f64>,
    /// Token that clients must send; prefer the environment, flags show in process lists
    #[arg(long, env = "EARTHSHINE_BEARER_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub bearer_token: Option<String>,
    /// Any other key, as in the file: --set engine.KEY=VALUE (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

impl ServeArgs {
    /// The configuration these arguments ask for, checked.
    ///
    /// # Errors
    /// [`ServerError::Config`], naming the file and line, the flag, or the key.
    pub fn resolve(self) -> Result<Config, ServerError> {
        let text = self.config.as_deref().map(read).transpose()?.unwrap_or_default();
        let path = self.config.as_deref().unwrap_or(Path::new("(defaults)"));
        // Typed first: a fault of the file is reported with its line, before any overlay.
        let from_file = Config::parse(&text, path)?;
        let mut config = if self.set.is_empty() { from_file } else { with_settings(&text, path, &self.set)? };
        self.overlay(&mut config);
        config.validate()?;
        Ok(config)
    }

    fn overlay(self, config: &mut Config) {
        fn put<T>(into: &mut T, value: Option<T>) {
            if let Some(value) = value {
                *into = value;
            }
        }
        put(&mut config.world, self.world);
        put(&mut config.listen, self.listen);
        put(&mut config.admin_listen, self.admin_listen);
        put(&mut config.backend, self.backend);
        put(&mut config.engine.solver.by_level, Some(self.solver).filter(|solvers| !solvers.is_empty()));
        put(&mut config.engine.solver.audit_every_ticks, self.audit);
        put(&mut config.gpu_adapter, self.gpu_adapter);
        config.gpu_strict |= self.gpu_strict;
        config.gpu_subgroups &= !self.without_subgroups;
        put(&mut config.gpu_pipeline_cache, self.gpu_pipeline_cache);
        put(&mut config.engine.sessions_max, self.sessions_max);
        put(&mut config.tick_rate_hz, self.tick_rate_hz);
        put(&mut config.loader_threads, self.loader_threads);
        put(&mut config.drain_timeout_s, self.drain_timeout_s);
        put(&mut config.bearer_token, self.bearer_token.map(Secret));
    }
}

/// The file's table with each `KEY=VALUE` put into it, read again as a whole.
fn with_settings(text: &str, path: &Path, settings: &[String]) -> Result<Config, ConfigError> {
    let mut table: toml::Table = toml::from_str(text).map_err(|error| ConfigError::Parse {
        path: path.to_owned(),
        line: 1,
        column: 1,
        message: error.message().to_owned(),
    })?;
    for setting in settings {
        let fault = |message: String| ConfigError::Set { setting: setting.clone(), message };
        let (key, value) = setting.split_once('=').ok_or_else(|| fault("expected KEY=VALUE".to_owned()))?;
        insert(&mut table, key.trim(), parse_value(value.trim())).map_err(fault)?;
        // One at a time, so that the message names the setting at fault.
        let _: Config =
            table.clone().try_into().map_err(|error: toml::de::Error| fault(error.message().to_owned()))?;
    }
    table.try_into().map_err(|error: toml::de::Error| ConfigError::Set {
        setting: settings.join(" "),
        message: error.message().to_owned(),
    })
}

/// `value` as TOML, or as a plain string where it is none: `--set world=town` needs no quotes.
fn parse_value(value: &str) -> toml::Value {
    let as_toml = toml::from_str::<toml::Table>(&format!("value = {value}")).ok();
    as_toml
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| toml::Value::String(value.to_owned()))
}

fn insert(table: &mut toml::Table, key: &str, value: toml::Value) -> Result<(), String> {
    match key.split_once('.') {
        None => {
            table.insert(key.to_owned(), value);
            Ok(())
        }
        Some((head, rest)) => {
            let inner = table.entry(head).or_insert_with(|| toml::Value::Table(toml::Table::new()));
            let inner = inner.as_table_mut().ok_or_else(|| format!("{head} is a value, not a table"))?;
            insert(inner, rest, value)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_go_before_settings_before_the_file_before_defaults() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        std::fs::write(&path, "loader_threads = 3\ntile_queue = 5\n[engine]\nsessions_max = 2\n").unwrap();
        let arguments = ServeArgs {
            config: Some(path),
            sessions_max: Some(7),
            set: vec![
                "engine.sessions_max=6".to_owned(),
                "loader_threads=4".to_owned(),
                "world=town".to_owned(),
            ],
            ..ServeArgs::default()
        };
        let config = arguments.resolve().unwrap();
        assert_eq!((config.engine.sessions_max, config.loader_threads, config.tile_queue), (7, 4, 5));
        assert_eq!(config.world, PathBuf::from("town"));
        assert!(config.gpu_subgroups);
        let without = ServeArgs { without_subgroups: true, ..ServeArgs::default() };
        assert!(!without.resolve().unwrap().gpu_subgroups);
        assert_eq!(config.idle_timeout_s, Config::default().idle_timeout_s);
    }

    #[test]
    fn a_setting_that_does_not_fit_is_named() {
        let refusal = |setting: &str| {
            let arguments = ServeArgs { set: vec![setting.to_owned()], ..ServeArgs::default() };
            arguments.resolve().unwrap_err().to_string()
        };
        assert!(refusal("tile_queu=4").contains("--set tile_queu=4: unknown field"));
        assert!(refusal("engine.no_such=4").contains("no_such"));
        assert!(refusal("tile_queue").contains("KEY=VALUE"));
        assert!(refusal("tile_queue=0").contains("tile_queue = 0"));
        assert!(refusal("tile_queue.deep=0").contains("tile_queue"));
    }

    #[test]
    fn the_environment_fills_in_for_flags() {
        use clap::{Args as _, FromArgMatches as _};
        let command = || ServeArgs::augment_args(clap::Command::new("serve"));
        let argument = command().get_arguments().find(|a| a.get_id() == "listen").cloned().unwrap();
        assert_eq!(argument.get_env(), Some(std::ffi::OsStr::new("EARTHSHINE_LISTEN")));
        let matches = command().get_matches_from(["serve", "town", "--listen", "127.0.0.1:0"]);
        let config = ServeArgs::from_arg_matches(&matches).unwrap().resolve().unwrap();
        assert_eq!((config.world, config.listen.port()), (PathBuf::from("town"), 0));
    }
}
