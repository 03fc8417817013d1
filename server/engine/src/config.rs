//! Limits and trade-offs of the engine, one key each. Where to start: [`EngineConfig`].

use crate::solver_config::SolverConfig;
use earthshine_radiosity::solver::SolverSettings;

/// Settings of the engine. Every key has a default; an unknown key is an error.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EngineConfig {
    /// Seed of everything random: points on the sun's disc, drift probes. Another seed, other noise of the same size.
    pub seed: u64,
    /// Patches in a session's local matrix (M), 1 to [`Self::RESIDENT_PATCHES_LIMIT`].
    ///
    /// A session takes `6 M^2` bytes (25 MiB at 2048); an add or removal costs O(M^2).
    /// - Higher: light from farther away; slower ticks.
    /// - Lower: cheaper ticks; more light is missing beyond the resident set.
    pub resident_patches_max: u32,
    /// Patches in a session's matrix of each coarser level, 1 to [`Self::RESIDENT_PATCHES_LIMIT`].
    ///
    /// A session takes `6 M^2` bytes a level (6 MiB at 1024). A top level of no more patches is always held whole.
    /// - Higher: finer light from far away; more memory and time for every level.
    /// - Lower: cheaper; far light comes from coarser patches. Below the top level's patches some is missing.
    pub coarse_patches_max: u32,
    /// Sessions at one time, at least 1. One more is ignored and counted.
    ///
    /// - Higher: more clients; memory and the time of a tick grow with each.
    pub sessions_max: u32,
    /// Tiles requested and not yet answered, at least 1.
    ///
    /// - Higher: keeps a fast disk busy.
    /// - Lower: less is read in vain when a camera jumps.
    pub tiles_in_flight_max: u32,
    /// Memory for decoded chunks (patches, rows, shadow casters), bytes.
    ///
    /// Nearest chunks come first. What is not wanted any more stays as long as there is room, up to `spare_bytes_max`. When room
    /// is needed, what has been unwanted longest and lies farthest goes first. Sizes of tiles not yet seen are estimates, so that the
    /// tiles in flight may overshoot it for a tick.
    /// - Higher: a larger `load_radius_m` can be filled.
    /// - Lower: less memory; shadows and light from fewer chunks.
    pub decoded_bytes_max: u64,
    /// Of that, memory for chunks that no camera wants any more: who turns back finds them. 0 keeps none. While tiles are on their
    /// way, less by as much as they will take.
    ///
    /// - Higher: less is read again where cameras come and go between the same places; memory grows up to it.
    /// - Lower: less memory, sooner as much as it will ever be.
    pub spare_bytes_max: u64,
    /// Memory of the decoded tiles that are taken in a tick, bytes, at least 1; one tile in any case, the others wait.
    ///
    /// Taking a tile checks each of its rows.
    /// - Higher: bursts of tiles are usable sooner; longer ticks.
    pub accepted_bytes_per_tick_max: u64,
    /// Chunks whose cube is within this distance of a camera are wanted in memory, m.
    ///
    /// Shadow casters and patches come from them alone.
    /// - Higher: shadows from farther away, light is there before the camera; more memory and disk traffic.
    pub load_radius_m: f32,
    /// A resident patch (a loaded chunk) stays until it is farther than what would replace it by this share, 0..=1.
    ///
    /// - Higher: less swapping when a camera wavers; the resident set lags behind the nearest patches.
    /// - 0: always exactly the nearest; a wavering camera swaps all the time.
    pub hysteresis: f32,
    /// Distances are measured from where the camera will be after this time at its present velocity, s.
    ///
    /// The point lies at most half of `load_radius_m` ahead. Longer: light is there earlier on straight flights, and
    /// wrongly placed in turns.
    pub look_ahead_s: f32,
    /// Tiles are asked for along the way that the camera takes in this time at its present velocity, s.
    ///
    /// The way ends [`Self::TILE_WAY_RADII`] load radii ahead. Longer: fast cameras find their tiles in memory; more are read in vain.
    pub tile_look_ahead_s: f32,
    /// What lies straight behind a camera counts as farther by this share in the order of work, 0..=4; beside it half of that.
    ///
    /// It changes what comes first, never what is resident in the end.
    /// - Higher: light in view is there sooner after a jump; what is behind comes later.
    /// - 0: strictly nearest first.
    pub view_bias: f32,
    /// Patches added a tick to a matrix of the most slots there are, over all sessions, at least 1. Each costs O(M^2), less in
    /// larger batches.
    ///
    /// Where a matrix holds fewer patches, adds are cheaper, and up to [`Self::CHEAPER_SWAPS_LIMIT`] count as one.
    /// - Higher: light arrives sooner after a jump; longer ticks.
    pub adds_per_tick_max: u32,
    /// Patches removed a tick, over all sessions, at least 1, counted as adds are.
    ///
    /// Lower than `adds_per_tick_max` it also slows adds once the local set is full.
    pub removals_per_tick_max: u32,
    /// Sample points times lights that are lit a tick (about the number of shadow rays), over all sessions.
    ///
    /// At least one patch a tick and session is lit however small this is.
    /// - Higher: moving lights are followed closely; longer ticks.
    /// - Lower: shorter ticks; direct light is older (counted as stale in each frame).
    pub shadow_points_per_tick_max: u32,
    /// Voxels with receivers (light in empty air, and detail of surfaces) that a session is told of, 0 to [`Self::RECEIVER_VOXELS_LIMIT`].
    ///
    /// The nearest to the camera are taken.
    /// - Higher: moving objects are lit, and surfaces have detail, farther away; more memory, larger deltas.
    /// - 0: moving objects have light only next to surfaces, and there is no detail.
    pub receiver_voxels_max: u32,
    /// Rows of receivers gathered a tick, over all sessions, at least 1.
    ///
    /// One voxel a session and tick is gathered however small this is. A device gathers all of them whatever it is.
    /// - Higher: light in the air follows the light of surfaces closely; longer ticks.
    /// - Lower: shorter ticks; light in the air is older.
    pub receiver_rows_per_tick_max: u32,
    /// Delta lights of a session, at least 1. Lights with more are ignored and counted.
    ///
    /// Direct light costs shadow rays in proportion: with more lights it is older.
    pub lights_max: u32,
    /// Wait before a failed tile or backend is tried again, s; it doubles with every failure of the same tile.
    pub retry_after_s: f64,
    /// Failures of a tile that are tried again; one more and its chunk is quarantined.
    pub retries_max: u32,
    /// A quarantined chunk is tried once more after this time, and so on, s.
    ///
    /// - Higher: less work and fewer warnings for tiles that stay bad.
    /// - Lower: a repaired tile is found sooner.
    pub quarantine_s: f64,
    /// Adds and removals of a session between two measurements of its matrix' rounding, at least 1.
    ///
    /// A measurement costs about as much as one add.
    pub drift_probe_every_swaps: u32,
    /// Relative rounding above which a session's matrix is repaired, some columns a tick: keep it far above `f32`'s usual
    /// 1e-5. Above 0.1 it is solved afresh, O(M^3).
    pub drift_max: f32,
    /// How light is solved, by level.
    pub solver: SolverConfig,
}

impl Default for EngineConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            resident_patches_max: 2048,
            coarse_patches_max: 1024,
            sessions_max: 8,
            tiles_in_flight_max: 8,
            decoded_bytes_max: 640 << 20,
            spare_bytes_max: 64 << 20,
            accepted_bytes_per_tick_max: 16 << 20,
            load_radius_m: 48.0,
            hysteresis: 0.1,
            look_ahead_s: 0.25,
            tile_look_ahead_s: 1.0,
            view_bias: 0.5,
            adds_per_tick_max: 32,
            removals_per_tick_max: 32,
            shadow_points_per_tick_max: 32_768,
            receiver_voxels_max: 4096,
            receiver_rows_per_tick_max: 8192,
            lights_max: 256,
            retry_after_s: 1.0,
            retries_max: 3,
            quarantine_s: 60.0,
            drift_probe_every_swaps: 1000,
            drift_max: 1e-4,
            solver: SolverConfig::default(),
        }
    }
}

/// A setting that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("engine setting `{key}` is {value}: {cause}")]
pub struct ConfigError {
    /// Name of the key.
    pub key: &'static str,
    /// What it was set to.
    pub value: String,
    /// What it has to be.
    pub cause: &'static str,
}

impl EngineConfig {
    /// Most slots of a level's local set.
    #[must_use]
    pub fn slots(&self, level: u8) -> u32 {
        if level == 0 { self.resident_patches_max } else { self.coarse_patches_max }
    }

    /// How a view of `level` solves light.
    #[must_use]
    pub fn solver_settings(&self, level: u8) -> SolverSettings {
        self.solver.settings(level, self.slots(level), self.seed)
    }

    /// Largest `resident_patches_max`: 1.5 GiB a session.
    pub const RESIDENT_PATCHES_LIMIT: u32 = 16_384;
    /// Most detail voxels that a session is told of: with those emptied a delta is still one message.
    pub const DETAIL_VOXELS_LIMIT: u32 = 32_768;
    /// Largest `receiver_voxels_max`: with the largest resident set a delta is still one message.
    pub const RECEIVER_VOXELS_LIMIT: u32 = 16_384;
    /// Most adds, or removals, that are counted as one: those of a matrix that is mostly empty are cheap.
    pub const CHEAPER_SWAPS_LIMIT: u32 = 8;
    /// Largest `sessions_max`.
    pub const SESSIONS_LIMIT: u32 = 1024;
    /// Load radii ahead of a camera at which tiles are asked for at most.
    pub const TILE_WAY_RADII: u8 = 4;
    /// Largest `load_radius_m`, m.
    pub const LOAD_RADIUS_LIMIT_M: f32 = 1e5;

    /// Checks every key against its range.
    ///
    /// # Errors
    /// The first key that is out of it.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let count = |key, value: u32, most: u32, cause| {
            if (1..=most).contains(&value) {
                Ok(())
            } else {
                Err(ConfigError { key, value: value.to_string(), cause })
            }
        };
        let real = |key, value: f64, range: std::ops::RangeInclusive<f64>, cause| {
            if range.contains(&value) {
                Ok(())
            } else {
                Err(ConfigError { key, value: value.to_string(), cause })
            }
        };
        self.solver.validate()?;
        let at_least_one = "it has to be at least 1";
        count(
            "resident_patches_max",
            self.resident_patches_max,
            Self::RESIDENT_PATCHES_LIMIT,
            "it has to be between 1 and 16384",
        )?;
        count(
            "coarse_patches_max",
            self.coarse_patches_max,
            Self::RESIDENT_PATCHES_LIMIT,
            "it has to be between 1 and 16384",
        )?;
        count("sessions_max", self.sessions_max, Self::SESSIONS_LIMIT, "it has to be between 1 and 1024")?;
        count("tiles_in_flight_max", self.tiles_in_flight_max, u32::MAX, at_least_one)?;
        count("adds_per_tick_max", self.adds_per_tick_max, u32::MAX, at_least_one)?;
        count("removals_per_tick_max", self.removals_per_tick_max, u32::MAX, at_least_one)?;
        count("shadow_points_per_tick_max", self.shadow_points_per_tick_max, u32::MAX, at_least_one)?;
        if self.receiver_voxels_max > Self::RECEIVER_VOXELS_LIMIT {
            let (key, value) = ("receiver_voxels_max", self.receiver_voxels_max.to_string());
            return Err(ConfigError { key, value, cause: "it has to be between 0 and 16384" });
        }
        count("receiver_rows_per_tick_max", self.receiver_rows_per_tick_max, u32::MAX, at_least_one)?;
        count("lights_max", self.lights_max, u32::MAX, at_least_one)?;
        count("drift_probe_every_swaps", self.drift_probe_every_swaps, u32::MAX, at_least_one)?;
        if self.decoded_bytes_max == 0 {
            return Err(ConfigError { key: "decoded_bytes_max", value: "0".to_owned(), cause: at_least_one });
        }
        if self.accepted_bytes_per_tick_max == 0 {
            let key = "accepted_bytes_per_tick_max";
            return Err(ConfigError { key, value: "0".to_owned(), cause: at_least_one });
        }
        real(
            "load_radius_m",
            self.load_radius_m.into(),
            1e-3..=Self::LOAD_RADIUS_LIMIT_M.into(),
            "it has to be between 0.001 and 100000",
        )?;
        real("hysteresis", self.hysteresis.into(), 0.0..=1.0, "it has to be between 0 and 1")?;
        real(
            "tile_look_ahead_s",
            self.tile_look_ahead_s.into(),
            0.0..=60.0,
            "it has to be between 0 and 60",
        )?;
        real("view_bias", self.view_bias.into(), 0.0..=4.0, "it has to be between 0 and 4")?;
        real("look_ahead_s", self.look_ahead_s.into(), 0.0..=60.0, "it has to be between 0 and 60")?;
        real("retry_after_s", self.retry_after_s, 0.0..=86_400.0, "it has to be between 0 and 86400")?;
        real("quarantine_s", self.quarantine_s, 0.01..=1e9, "it has to be between 0.01 and 1e9")?;
        real("drift_max", self.drift_max.into(), 1e-7..=1.0, "it has to be between 1e-7 and 1")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_valid_and_survives_a_round_trip() {
        let config = EngineConfig::default();
        config.validate().unwrap();
        let text = toml::to_string(&config).unwrap();
        assert_eq!(toml::from_str::<EngineConfig>(&text).unwrap(), config);
        assert_eq!(toml::from_str::<EngineConfig>("").unwrap(), config);
    }

    #[test]
    fn unknown_keys_are_named() {
        let error = toml::from_str::<EngineConfig>("resident_patches = 3").unwrap_err();
        assert!(error.to_string().contains("resident_patches"), "{error}");
    }

    #[test]
    fn each_impossible_value_is_refused_by_name() {
        type Spoil = fn(&mut EngineConfig);
        let cases: [(&str, Spoil); 22] = [
            ("resident_patches_max", |c| c.resident_patches_max = 0),
            ("resident_patches_max", |c| c.resident_patches_max = 20_000),
            ("coarse_patches_max", |c| c.coarse_patches_max = 0),
            ("sessions_max", |c| c.sessions_max = 0),
            ("tiles_in_flight_max", |c| c.tiles_in_flight_max = 0),
            ("decoded_bytes_max", |c| c.decoded_bytes_max = 0),
            ("load_radius_m", |c| c.load_radius_m = f32::NAN),
            ("hysteresis", |c| c.hysteresis = -0.1),
            ("tile_look_ahead_s", |c| c.tile_look_ahead_s = -1.0),
            ("accepted_bytes_per_tick_max", |c| c.accepted_bytes_per_tick_max = 0),
            ("quarantine_s", |c| c.quarantine_s = f64::NAN),
            ("view_bias", |c| c.view_bias = 5.0),
            ("look_ahead_s", |c| c.look_ahead_s = f32::INFINITY),
            ("adds_per_tick_max", |c| c.adds_per_tick_max = 0),
            ("removals_per_tick_max", |c| c.removals_per_tick_max = 0),
            ("shadow_points_per_tick_max", |c| c.shadow_points_per_tick_max = 0),
            ("receiver_voxels_max", |c| c.receiver_voxels_max = 20_000),
            ("receiver_rows_per_tick_max", |c| c.receiver_rows_per_tick_max = 0),
            ("lights_max", |c| c.lights_max = 0),
            ("retry_after_s", |c| c.retry_after_s = -1.0),
            ("drift_probe_every_swaps", |c| c.drift_probe_every_swaps = 0),
            ("drift_max", |c| c.drift_max = 0.0),
        ];
        for (key, spoil) in cases {
            let mut config = EngineConfig::default();
            spoil(&mut config);
            assert_eq!(config.validate().unwrap_err().key, key);
        }
    }
}
