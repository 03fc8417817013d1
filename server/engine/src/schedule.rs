//! Which chunks are wanted in memory, over all sessions, and in which order they are asked for.

use crate::SessionId;
use crate::chunks::ChunkTable;
use crate::config::EngineConfig;
use crate::priority::Outlook;
use crate::residency::ChunkState;
use earthshine_world::ChunkId;
use std::collections::{BTreeMap, BTreeSet};

/// The chunks wanted now.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Wants {
    /// All of them, most urgent for any camera first: the order to ask for them.
    pub(crate) most_urgent_first: Vec<ChunkId>,
    /// Each session's own, ascending.
    pub(crate) by_session: BTreeMap<SessionId, Vec<ChunkId>>,
}

/// How a chunk stands with all cameras.
#[derive(Debug, Clone, Copy)]
struct Rank {
    distance: f32,
    urgency: f32,
}

impl Rank {
    /// Chunks of a pinned level: before all distances.
    const FIRST: Self = Self { distance: -1.0, urgency: -1.0 };
    const LAST: Self = Self { distance: f32::INFINITY, urgency: f32::INFINITY };

    fn improve(&mut self, other: Self) {
        self.distance = self.distance.min(other.distance);
        self.urgency = self.urgency.min(other.urgency);
    }
}

/// Chunks within their level's load radius of any focus, or of where its camera is about to be, as many as fit the memory,
/// nearest first.
///
/// A pinned level comes before everything else, all of it. Distances count in chunks of their level: half as much for each
/// level up.
/// What is in memory or on its way counts as nearer by the hysteresis. A chunk that would not fit alone is passed
/// over; the first that does not fit beside the nearer ones ends the list.
pub(crate) fn wanted_chunks(
    outlooks: &BTreeMap<SessionId, Outlook>,
    chunks: &ChunkTable,
    config: &EngineConfig,
) -> Wants {
    let keep = 1.0 + config.hysteresis;
    let mut by_session = BTreeMap::new();
    let mut ranks: BTreeMap<ChunkId, Rank> = BTreeMap::new();
    for (&session, outlook) in outlooks {
        let mut own = Vec::new();
        for plan in chunks.levels() {
            let reach_m = if plan.is_pinned { f32::INFINITY } else { plan.load_radius_m };
            let scale = f32::from(1u16 << plan.level.min(15));
            let mut found: BTreeMap<ChunkId, Rank> = BTreeMap::new();
            for (place, way_m) in outlook.stops(plan.load_radius_m) {
                for (id, entry, distance) in chunks.near(plan, place, reach_m * keep) {
                    let effective = match entry.state {
                        ChunkState::Quarantined => continue,
                        ChunkState::Absent => distance,
                        _ => distance / keep,
                    };
                    if effective <= reach_m {
                        let urgency = outlook.urgency(way_m + distance, entry.bounds.centre());
                        let rank = Rank { distance: (way_m + effective) / scale, urgency: urgency / scale };
                        found.entry(id).or_insert(Rank::LAST).improve(rank);
                    }
                }
                if plan.is_pinned {
                    break;
                }
            }
            for (id, rank) in found {
                own.push(id);
                ranks.entry(id).or_insert(Rank::LAST).improve(if plan.is_pinned {
                    Rank::FIRST
                } else {
                    rank
                });
            }
        }
        by_session.insert(session, own);
    }
    let mut admitted = within_memory(ranks, chunks, config);
    let ids: BTreeSet<ChunkId> = admitted.iter().map(|&(id, _)| id).collect();
    for own in by_session.values_mut() {
        own.retain(|id| ids.contains(id));
    }
    admitted.sort_unstable_by(|a, b| a.1.urgency.total_cmp(&b.1.urgency).then(a.0.cmp(&b.0)));
    Wants { most_urgent_first: admitted.into_iter().map(|(id, _)| id).collect(), by_session }
}

/// The nearest of `ranks` that fit the memory together.
fn within_memory(
    ranks: BTreeMap<ChunkId, Rank>,
    chunks: &ChunkTable,
    config: &EngineConfig,
) -> Vec<(ChunkId, Rank)> {
    let mut order: Vec<_> = ranks.into_iter().collect();
    order.sort_unstable_by(|a, b| a.1.distance.total_cmp(&b.1.distance).then(a.0.cmp(&b.0)));
    let mut bytes = 0u64;
    let mut admitted = Vec::new();
    for (id, rank) in order {
        let own = chunks.get(id).map_or(0, |entry| entry.bytes);
        if own > config.decoded_bytes_max {
            continue;
        }
        bytes = bytes.saturating_add(own);
        if bytes > config.decoded_bytes_max {
            break;
        }
        admitted.push((id, rank));
    }
    admitted
}

/// The next chunks to ask for: wanted, absent, due, and within the limits on flights and memory, in which spare chunks do
/// not count.
pub(crate) fn next_requests(
    most_urgent_first: &[ChunkId],
    chunks: &ChunkTable,
    config: &EngineConfig,
    now_s: f64,
) -> Vec<ChunkId> {
    let mut flights = config.tiles_in_flight_max.saturating_sub(chunks.in_flight());
    if flights == 0 {
        return Vec::new();
    }
    let held = chunks.decoded_bytes().saturating_add(chunks.in_flight_bytes());
    let mut bytes = held.saturating_sub(chunks.spare_bytes());
    let mut requests = Vec::new();
    for &id in most_urgent_first {
        let Some(entry) = chunks.get(id) else { continue };
        if entry.state != ChunkState::Absent || entry.retry_at_s > now_s {
            continue;
        }
        bytes = bytes.saturating_add(entry.bytes);
        // The most urgent waits for memory; another, smaller one must not take it.
        if flights == 0 || bytes > config.decoded_bytes_max {
            break;
        }
        flights -= 1;
        requests.push(id);
    }
    requests
}
