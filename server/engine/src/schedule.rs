//! Which chunks are wanted in memory, over all sessions, and in which order they are asked for.

use crate::SessionId;
use crate::chunks::ChunkTable;
use crate::config::EngineConfig;
use crate::residency::ChunkState;
use earthshine_world::{ChunkId, Vec3};
use std::collections::{BTreeMap, BTreeSet};

/// Where chunks of a pinned level stand: before all distances.
const PINNED_RANK: f32 = -1.0;

/// The chunks wanted now.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Wants {
    /// All of them, nearest to any camera first.
    pub(crate) nearest_first: Vec<ChunkId>,
    /// Each session's own, ascending.
    pub(crate) by_session: BTreeMap<SessionId, Vec<ChunkId>>,
}

/// Chunks within their level's load radius of any focus, nearest first, as many as fit the memory.
///
/// A pinned level comes before everything else, all of it. Distances count in chunks of their level: half as much for each
/// level up.
/// What is in memory or on its way counts as nearer by the hysteresis. A chunk that would not fit alone is passed
/// over; the first that does not fit beside the nearer ones ends the list.
pub(crate) fn wanted_chunks(
    focuses: &BTreeMap<SessionId, Vec3>,
    chunks: &ChunkTable,
    config: &EngineConfig,
) -> Wants {
    let keep = 1.0 + config.hysteresis;
    let mut by_session = BTreeMap::new();
    let mut distances: BTreeMap<ChunkId, f32> = BTreeMap::new();
    for (&session, &focus) in focuses {
        let mut own = Vec::new();
        for plan in chunks.levels() {
            let reach_m = if plan.is_pinned { f32::INFINITY } else { plan.load_radius_m };
            let scale = f32::from(1u16 << plan.level);
            for (id, entry, distance) in chunks.near(plan, focus, reach_m * keep) {
                let effective = match entry.state {
                    ChunkState::Quarantined => continue,
                    ChunkState::Absent => distance,
                    _ => distance / keep,
                };
                if effective <= reach_m {
                    own.push(id);
                    let rank = if plan.is_pinned { PINNED_RANK } else { effective / scale };
                    let nearest = distances.entry(id).or_insert(rank);
                    *nearest = nearest.min(rank);
                }
            }
        }
        by_session.insert(session, own);
    }
    let mut order: Vec<_> = distances.into_iter().collect();
    order.sort_unstable_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    let mut bytes = 0u64;
    let mut nearest_first = Vec::new();
    for (id, _) in order {
        let own = chunks.get(id).map_or(0, |entry| entry.bytes);
        if own > config.decoded_bytes_max {
            continue;
        }
        bytes = bytes.saturating_add(own);
        if bytes > config.decoded_bytes_max {
            break;
        }
        nearest_first.push(id);
    }
    let admitted: BTreeSet<ChunkId> = nearest_first.iter().copied().collect();
    for own in by_session.values_mut() {
        own.retain(|id| admitted.contains(id));
    }
    Wants { nearest_first, by_session }
}

/// The next chunks to ask for: wanted, absent, due, and within the limits on flights and memory.
pub(crate) fn next_requests(
    nearest_first: &[ChunkId],
    chunks: &ChunkTable,
    config: &EngineConfig,
    now_s: f64,
) -> Vec<ChunkId> {
    let mut flights = config.tiles_in_flight_max.saturating_sub(chunks.in_flight());
    let mut bytes = chunks.decoded_bytes().saturating_add(chunks.in_flight_bytes());
    let mut requests = Vec::new();
    for &id in nearest_first {
        let Some(entry) = chunks.get(id) else { continue };
        if entry.state != ChunkState::Absent || entry.retry_at_s > now_s {
            continue;
        }
        bytes = bytes.saturating_add(entry.bytes);
        // The nearest waits for memory; a farther, smaller one must not take it.
        if flights == 0 || bytes > config.decoded_bytes_max {
            break;
        }
        flights -= 1;
        requests.push(id);
    }
    requests
}
