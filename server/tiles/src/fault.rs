//! A store that goes wrong on purpose: slow, missing, torn, flipped; by seed and rate.
//!
//! What goes wrong with the n-th load of a chunk is a hash of (seed, chunk, n), whatever the order and
//! the threads. Torn and flipped tiles are real tiles, damaged and decoded: the errors are the real ones.

use crate::error::TileError;
use crate::store::TileStore;
use crate::{EncodeOptions, RowCodec, decode_bytes, encode};
use earthshine_world::lineage::Parents;
use earthshine_world::random::{Purpose, hash, unit_f32};
use earthshine_world::{Chunk, ChunkId};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// How often what goes wrong. Rates are shares of all loads and add up to at most one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaultPlan {
    /// Of all decisions.
    pub seed: u64,
    /// Loads that succeed after [`Self::delay`].
    pub slow_rate: f32,
    /// Loads that find no file.
    pub missing_rate: f32,
    /// Loads that find a file cut off.
    pub torn_rate: f32,
    /// Loads that find a file with one bit flipped.
    pub flipped_rate: f32,
    /// How long a slow load takes at least; the caller's thread sleeps.
    pub delay: Duration,
}

/// What happens to one load.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Nothing.
    None,
    /// It succeeds, late.
    Slow,
    /// There is no file.
    Missing,
    /// The file ends early.
    Torn,
    /// One bit of the file is wrong.
    Flipped,
}

impl FaultPlan {
    /// Nothing goes wrong.
    #[must_use]
    pub fn none(seed: u64) -> Self {
        let delay = Duration::ZERO;
        Self { seed, slow_rate: 0.0, missing_rate: 0.0, torn_rate: 0.0, flipped_rate: 0.0, delay }
    }

    /// What happens to load number `attempt` (from 0) of chunk `id`.
    #[must_use]
    pub fn fault_of(&self, id: ChunkId, attempt: u64) -> Fault {
        let mut dice = unit_f32(self.bits(id, attempt));
        let faults = [
            (self.slow_rate, Fault::Slow),
            (self.missing_rate, Fault::Missing),
            (self.torn_rate, Fault::Torn),
            (self.flipped_rate, Fault::Flipped),
        ];
        for (rate, fault) in faults {
            if dice < rate {
                return fault;
            }
            dice -= rate;
        }
        Fault::None
    }

    fn bits(&self, id: ChunkId, attempt: u64) -> u64 {
        let [x, y, z] = id.coord.to_array().map(|c| u64::from(c.cast_unsigned()));
        let place = hash(self.seed, Purpose::Simulation, x << 32 | y, z << 8 | u64::from(id.level));
        hash(self.seed, Purpose::Simulation, place, attempt)
    }
}

/// `inner`, with faults.
#[derive(Debug)]
pub struct FaultyStore<S> {
    inner: S,
    plan: FaultPlan,
    attempts: Mutex<BTreeMap<ChunkId, u64>>,
}

impl<S> FaultyStore<S> {
    /// `inner` with the faults of `plan`.
    #[must_use]
    pub fn new(inner: S, plan: FaultPlan) -> Self {
        Self { inner, plan, attempts: Mutex::default() }
    }

    /// The sound store.
    #[must_use]
    pub fn inner(&self) -> &S {
        &self.inner
    }

    fn next_attempt(&self, id: ChunkId) -> u64 {
        // A counter is sound whatever its holder died of.
        let mut attempts = self.attempts.lock().unwrap_or_else(PoisonError::into_inner);
        let attempt = attempts.entry(id).or_default();
        *attempt += 1;
        *attempt - 1
    }
}

impl<S: TileStore> TileStore for FaultyStore<S> {
    /// Without faults: what is missing of it is a gap, which missing tiles make too.
    fn parents(&self, id: ChunkId) -> Result<Option<Parents>, TileError> {
        self.inner.parents(id)
    }

    fn load(&self, id: ChunkId) -> Result<Chunk, TileError> {
        let attempt = self.next_attempt(id);
        let bits = self.plan.bits(id, attempt).rotate_left(20);
        match self.plan.fault_of(id, attempt) {
            Fault::None => self.inner.load(id),
            Fault::Slow => {
                std::thread::sleep(self.plan.delay);
                self.inner.load(id)
            }
            Fault::Missing => {
                Err(TileError::Missing { chunk: id, path: PathBuf::from(format!("missing-{id}.tile")) })
            }
            Fault::Torn => self.load_damaged(id, "torn", |tile| tile.truncate(place(bits, tile.len()))),
            Fault::Flipped => self.load_damaged(id, "flipped", |tile| {
                let at = place(bits, tile.len());
                tile[at] ^= 1 << (bits & 7);
            }),
        }
    }
}

/// One of `length` places.
fn place(bits: u64, length: usize) -> usize {
    (bits % length as u64) as usize
}

impl<S: TileStore> FaultyStore<S> {
    fn load_damaged(
        &self,
        id: ChunkId,
        what: &str,
        damage: impl FnOnce(&mut Vec<u8>),
    ) -> Result<Chunk, TileError> {
        let chunk = self.inner.load(id)?;
        let mut tile =
            encode(&chunk, &EncodeOptions { world_hash: 0, codec: RowCodec::Half, zstd_level: 1 })?;
        damage(&mut tile);
        decode_bytes(&tile, Path::new(&format!("{what}-{id}.tile")))
    }
}
