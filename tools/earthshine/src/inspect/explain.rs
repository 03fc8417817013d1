//! One chunk, or one row, in words.

use crate::output::out;
use anyhow::bail;
use earthshine_tiles::{DirStore, TileStore};
use earthshine_world::{Barrier, Chunk, ChunkId, Direction, PatchId, ReceiverPlace, Receivers, Rgb, Vec3};
use glam::IVec3;
use std::collections::BTreeMap;

/// Entries of a row that are listed one by one.
const LISTED_MAX: usize = 12;

/// What chunk `id` holds.
pub(crate) fn chunk(store: &DirStore, id: ChunkId, json: bool) -> anyhow::Result<()> {
    let chunk = store.load(id)?;
    let bounds = store.manifest().parameters.grid.at_level(id.level).chunk_bounds(id.coord);
    let area: f32 = chunk.patches.iter().map(|patch| patch.area).sum();
    let by_direction = Direction::ALL.map(|d| chunk.patches.iter().filter(|p| p.direction == d).count());
    let rows = chunk.rows.row_count().max(1) as f64;
    let mean = |shares: &mut dyn Iterator<Item = f32>| shares.map(f64::from).sum::<f64>() / rows;
    let sky = mean(&mut chunk.rows.sky_shares.iter().map(|shares| shares.iter().sum()));
    let absorbed = mean(&mut chunk.rows.absorbed_shares.iter().copied());
    let (nonzeros, segments) = (chunk.rows.columns.len(), chunk.rows.segments.len());
    let emitted: Rgb = chunk.patches.iter().map(|patch| patch.emission * patch.area).sum();
    let emitters = chunk.patches.iter().filter(|patch| patch.emission.max_element() > 0.0).count();
    if json {
        let summary = serde_json::json!({
            "level": id.level, "chunk": id.coord.to_array(), "patches": chunk.patches.len(), "patches_by_direction": by_direction,
            "area_m2": area, "points": chunk.points.len(), "nonzeros": nonzeros, "seen_chunks": segments,
            "sky_share_mean": sky, "absorbed_share_mean": absorbed, "emitters": emitters,
            "emitted_lm": emitted.to_array(),
            "receivers": chunk.receivers.places.len(), "receiver_nonzeros": chunk.receivers.rows.columns.len(),
            "occluder_triangles": chunk.occluders.triangles.len(),
        });
        out!("{summary}");
        return Ok(());
    }
    out!("chunk {id} spans {:.2} to {:.2} m", bounds.min, bounds.max);
    out!(
        "{} patches, {area:.1} m2, {} sample points; {emitters} emit {emitted:.3} lm",
        chunk.patches.len(),
        chunk.points.len()
    );
    for (direction, count) in Direction::ALL.iter().zip(by_direction) {
        out!("  {direction:?} {count}");
    }
    out!("{nonzeros} form factors into {segments} chunks, {:.0} a row", nonzeros as f64 / rows);
    out!(
        "of the light that arrives, {:.1} % is sky, {:.2} % hits nothing that reflects",
        sky * 100.0,
        absorbed * 100.0
    );
    let receivers = &chunk.receivers;
    let details = || receivers.places.iter().filter_map(|place| place.detail);
    out!(
        "{} receivers ({} of them of surfaces, in detail voxels; {} in layers above the first, {} that walls end) in {} \
         voxels, {:.0} form factors each",
        receivers.places.len(),
        details().count(),
        details().filter(|detail| detail.layer > 0).count(),
        details().filter(|detail| detail.barriers[0].is_some()).count(),
        receivers.places.chunk_by(|a, b| a.voxel == b.voxel).count(),
        receivers.rows.columns.len() as f64 / receivers.places.len().max(1) as f64
    );
    out!("{} triangles cast shadows", chunk.occluders.triangles.len());
    Ok(())
}

/// Where the light of the receivers in voxel `voxel` comes from.
pub(crate) fn air(store: &DirStore, voxel: IVec3, json: bool) -> anyhow::Result<()> {
    let id = ChunkId::new(0, store.manifest().parameters.grid.chunk_of(voxel));
    let chunk = store.load(id)?;
    let Receivers { places, rows } = &chunk.receivers;
    let own: Vec<usize> = (0..places.len()).filter(|&row| places[row].voxel == voxel).collect();
    if own.is_empty() {
        bail!(
            "no receiver is in voxel {voxel}: it is inside of something, far from surfaces, or all patches"
        );
    }
    let sky = |row: usize| rows.sky_shares[row].iter().sum::<f32>();
    let per_edge = store.manifest().parameters.detail;
    if json {
        let receivers: Vec<_> = own
            .iter()
            .map(|&row| {
                serde_json::json!({
                    "direction": format!("{:?}", places[row].direction), "nonzeros": rows.row(row).len(),
                    "surface": surface(&places[row], per_edge).map(|surface| surface.json()),
                    "sky_shares": rows.sky_shares[row], "absorbed_share": rows.absorbed_shares[row],
                    "row_sum": rows.row_sum(row),
                })
            })
            .collect();
        out!("{}", serde_json::json!({"voxel": voxel.to_array(), "receivers": receivers}));
        return Ok(());
    }
    out!("{} receivers in voxel {voxel} of chunk {id}", own.len());
    for row in own {
        out!(
            "  {:?}{}: light from {} patches, {:.1} % from the sky, {:.2} % from nothing",
            places[row].direction,
            surface(&places[row], per_edge).map_or_else(String::new, |surface| surface.words()),
            rows.row(row).len(),
            sky(row) * 100.0,
            rows.absorbed_shares[row] * 100.0
        );
    }
    Ok(())
}

/// What a receiver on surfaces stands for.
struct LayerWords {
    /// In detail voxels.
    coord: IVec3,
    layer: u8,
    normal: Vec3,
    /// Where its plane lies along the normal, and where walls end it along each way, from the middle, in detail voxel edges.
    plane: f32,
    barriers: Vec<(Vec3, f32)>,
}

fn surface(place: &ReceiverPlace, per_edge: u32) -> Option<LayerWords> {
    let detail = place.detail?;
    let barrier = |barrier: &Barrier| (barrier.towards(place.direction), barrier.middle_distance());
    Some(LayerWords {
        coord: detail.coord(place.voxel, per_edge),
        layer: detail.layer,
        normal: detail.plane.unit_normal(),
        plane: detail.plane.middle_distance(),
        barriers: detail.barriers.iter().flatten().map(barrier).collect(),
    })
}

impl LayerWords {
    fn json(&self) -> serde_json::Value {
        let barrier = |(towards, distance): &(Vec3, f32)| serde_json::json!({"towards": towards.to_array(), "distance": distance});
        serde_json::json!({
            "detail_voxel": self.coord.to_array(), "layer": self.layer, "normal": self.normal.to_array(),
            "distance": self.plane, "barriers": self.barriers.iter().map(barrier).collect::<Vec<_>>(),
        })
    }

    fn words(&self) -> String {
        let Self { coord, layer, normal, plane, barriers } = self;
        let ends =
            barriers.iter().map(|(towards, distance)| format!(", ends {distance:.2} towards {towards:.2}"));
        format!(
            " in detail voxel {coord}, layer {layer}, plane {plane:.2} along {normal:.2}{}",
            ends.collect::<String>()
        )
    }
}

/// Where the light of patch `local` of chunk `id` comes from.
pub(crate) fn row(store: &DirStore, id: ChunkId, local: u16, json: bool) -> anyhow::Result<()> {
    let chunk = store.load(id)?;
    let Some(patch) = chunk.patches.get(usize::from(local)) else {
        bail!("chunk {id} has {} patches; {local} is not one of them", chunk.patches.len());
    };
    let index = usize::from(local);
    let sky: f32 = chunk.rows.sky_shares[index].iter().sum();
    let absorbed = chunk.rows.absorbed_shares[index];
    let mut entries: Vec<(PatchId, f32)> =
        chunk.rows.row(index).map(|(column, share)| (chunk.rows.patch_id(column), share)).collect();
    entries.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    if json {
        let entries: Vec<_> = entries
            .iter()
            .map(|(patch, share)| serde_json::json!({"chunk": patch.chunk.coord.to_array(), "patch": patch.local, "share": share}))
            .collect();
        let summary = serde_json::json!({
            "level": id.level, "chunk": id.coord.to_array(), "patch": local, "area_m2": patch.area, "sky_shares": chunk.rows.sky_shares[index],
            "absorbed_share": absorbed, "row_sum": chunk.rows.row_sum(index), "entries": entries,
        });
        out!("{summary}");
        return Ok(());
    }
    out!("patch {local} of chunk {id}: voxel {}, facing {:?}", patch.voxel, patch.direction);
    out!(
        "area {:.4} m2 around {:.2}, reflectance {:.3}, emission {:.1} lm/m2",
        patch.area,
        patch.centroid,
        patch.reflectance,
        patch.emission
    );
    out!(
        "light arrives from {} patches, {:.1} % from the sky, {:.2} % from nothing",
        entries.len(),
        sky * 100.0,
        absorbed * 100.0
    );
    print_chunks(&entries);
    for (patch, share) in entries.iter().take(LISTED_MAX) {
        out!("  {:6.3} % patch {} of {}{}", share * 100.0, patch.local, patch.chunk, facing(&chunk, *patch));
    }
    out!("row sum {:.6}", chunk.rows.row_sum(index));
    Ok(())
}

fn facing(chunk: &Chunk, patch: PatchId) -> String {
    match chunk.patches.get(usize::from(patch.local)) {
        Some(own) if patch.chunk == chunk.id => {
            format!(", facing {:?} at {:.2}", own.direction, own.centroid)
        }
        _ => String::new(),
    }
}

fn print_chunks(entries: &[(PatchId, f32)]) {
    let mut by_chunk: BTreeMap<ChunkId, f32> = BTreeMap::new();
    for (patch, share) in entries {
        *by_chunk.entry(patch.chunk).or_default() += share;
    }
    for (chunk, share) in by_chunk {
        out!("  {:6.2} % from chunk {chunk}", share * 100.0);
    }
}
