//! From the row of a receiver to the light that is told of it: gathered here, or told from sums gathered elsewhere.
//!
//! A receiver in the air is told if it knows enough. Detail stands for parts of a patch: it speaks only where its patch is
//! resident, and has as much light from afar, for its far share, as that has; of a patch near by it sees the part that it
//! faces ([`Viewer`]), which is added here wherever the row was gathered.

use crate::PatchLight;
use crate::air::{AirVoxel, Told};
use crate::far::FarSenders;
use crate::local_set::{LocalSet, Resident};
use crate::slots::{FREE, parts_of_row};
use earthshine_light::{NEAR_SHARE_MIN, NearPatch, Viewer};
use earthshine_radiosity::receivers::ReceiverSums;
use earthshine_world::{
    Barrier, Chunk, DetailVoxel, Direction, Grid, LightRig, Patch, ReceiverPlace, Rgb, Vec4,
};
use std::collections::BTreeMap;

/// A receiver that rests on less than this share of its row, what coarse levels bring included, says nothing: half of a room is not its light.
const KNOWN_SHARE_MIN: f32 = 0.5;

/// What a row gathers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RowLight {
    /// From resident patches, lx.
    irradiance: Rgb,
    resident: f64,
    far: f64,
    /// From coarse parents, lx, and how much of the row they stand for.
    far_light: Vec4,
    /// From the sky, lx.
    sky: Rgb,
}

/// One segment of a chunk's rows.
pub(crate) struct Segment<'a> {
    /// By patch, or none.
    slots: &'a [u32],
    /// Where what stands for its patches is listed.
    senders: usize,
}

/// Of rows gathered here: what leaves slots and what stands for patches without one.
pub(crate) struct RowSources<'a> {
    local: &'a LocalSet,
    rig: &'a LightRig,
    far: FarSenders<'a>,
    /// By slot, lm/m2.
    exitance: Vec<Rgb>,
}

impl<'a> RowSources<'a> {
    pub(crate) fn new(local: &'a LocalSet, rig: &'a LightRig, far: FarSenders<'a>) -> Self {
        Self { local, rig, far, exitance: local.exitances() }
    }

    /// The segments of the rows of `voxel`'s chunk.
    pub(crate) fn segments(&mut self, voxel: &AirVoxel) -> Vec<Segment<'a>> {
        let rows = &voxel.chunk.receivers.rows;
        let slots = self.local.segment_slots(rows);
        let ids = rows.segments.iter().zip(slots);
        ids.map(|(&id, slots)| Segment { slots, senders: self.far.place(id, &voxel.lineage) }).collect()
    }

    /// What row `row` of `chunk` gathers; with a viewer, of patches near by what that sees.
    pub(crate) fn gather(
        &self,
        chunk: &Chunk,
        row: usize,
        segments: &[Segment<'_>],
        near: Option<&NearBy<'_>>,
    ) -> RowLight {
        let rows = &chunk.receivers.rows;
        let (mut resident, mut far) = (0.0f64, 0.0f64);
        let (mut irradiance, mut far_light) = (Rgb::ZERO, Vec4::ZERO);
        for (column, share) in rows.row(row) {
            let (segment, patch) = (&segments[usize::from(column.segment)], usize::from(column.local));
            match segment.slots.get(patch) {
                Some(&slot) if slot != FREE => {
                    resident += f64::from(share);
                    irradiance += share * self.exitance[slot as usize];
                    if let Some(near) = near.filter(|_| share >= NEAR_SHARE_MIN) {
                        irradiance += share * near.excess(slot);
                    }
                }
                _ => {
                    far += f64::from(share);
                    far_light += share * self.far.sent(segment.senders, patch);
                }
            }
        }
        let sky = self.rig.sky.irradiance(&rows.sky_shares[row]);
        RowLight { irradiance, resident, far, far_light, sky }
    }
}

/// A viewer among resident patches.
pub(crate) struct NearBy<'a> {
    local: &'a LocalSet,
    viewer: Viewer,
}

impl NearBy<'_> {
    /// By how much what the viewer sees of the patch in `slot` is brighter than the whole of it, lm/m2.
    fn excess(&self, slot: u32) -> Rgb {
        let resident = self.local.resident(slot);
        let Some((mean, irradiance)) = resident.light.on_points() else { return Rgb::ZERO };
        let points = self.local.chunk_of(resident.id).points_of(&resident.patch);
        let seen = self.viewer.sees(NearPatch { points, irradiance });
        let reflectance = resident.patch.reflectance.min(Rgb::splat(Patch::REFLECTANCE_MAX));
        seen.map_or(Rgb::ZERO, |seen| reflectance * (seen - mean))
    }

    /// The same of all that row `row` of `chunk` sees near by, by share, lx.
    fn excess_of_row(&self, chunk: &Chunk, row: usize, segments: &[&[u32]]) -> Rgb {
        let near = chunk.receivers.rows.row(row).filter(|&(_, share)| share >= NEAR_SHARE_MIN);
        near.map(|(column, share)| {
            let slots = segments[usize::from(column.segment)];
            let slot = slots.get(usize::from(column.local)).filter(|&&slot| slot != FREE);
            slot.map_or(Rgb::ZERO, |&slot| share * self.excess(slot))
        })
        .sum()
    }
}

/// Makes of what rows gather what is told of receivers.
pub(crate) struct Teller<'a> {
    local: &'a LocalSet,
    /// Slots of patches by place, where there is detail.
    by_place: BTreeMap<([i32; 3], Direction), u32>,
    /// Detail voxels along a voxel's edge, and voxels.
    detail: u32,
    grid: Grid,
    /// Whether any patch has light that differs between its points.
    has_near: bool,
}

impl<'a> Teller<'a> {
    pub(crate) fn new(local: &'a LocalSet, detail: u32, grid: Grid) -> Self {
        let place = |(slot, resident): (u32, &Resident)| {
            ((resident.patch.voxel.to_array(), resident.patch.direction), slot)
        };
        let told = || local.iter().filter(|(_, resident)| resident.is_told);
        let by_place = if detail > 1 { told().map(place).collect() } else { BTreeMap::new() };
        let has_near = detail > 1 && local.iter().any(|(_, resident)| resident.light.on_points().is_some());
        Self { local, by_place, detail, grid, has_near }
    }

    /// Appends to `out` the light of the receivers of `voxel`, of its air and of its detail voxels, of which each row gathers what `gather`
    /// says.
    pub(crate) fn tell(
        &self,
        voxel: &AirVoxel,
        mut gather: impl FnMut(usize, Option<NearBy<'a>>) -> RowLight,
        out: &mut Told,
    ) {
        for row in voxel.rows.clone() {
            let place = voxel.chunk.receivers.places[row];
            let Some(detail) = place.detail else {
                let gathered = gather(row, None);
                let (light, far_light) = (told(&voxel.chunk, row, &gathered), gathered.far_light);
                let light = PatchLight {
                    irradiance: finite(light.irradiance + far_light.truncate()),
                    fed_share: far_light.w.clamp(0.0, 1.0),
                    ..light
                };
                out.lights.extend((light.known_share + light.fed_share >= KNOWN_SHARE_MIN).then_some(light));
                continue;
            };
            let slot = self.by_place.get(&(place.voxel.to_array(), place.direction));
            let Some(&slot) = slot.filter(|_| voxel.has_detail) else { continue };
            let resident = self.local.resident(slot);
            let near = self.has_near.then(|| self.near(&place, detail, resident));
            let light = fed_as(resident, told(&voxel.chunk, row, &gather(row, near)));
            let DetailVoxel { layer, plane, barriers, .. } = detail;
            let plane_offset = Some(plane.offset_along(place.direction.axis()));
            let voxel = detail.coord(light.voxel, self.detail);
            out.details.push(PatchLight { voxel, plane_offset, layer, tilt: Some(plane), barriers, ..light });
        }
    }

    /// The same, from `sums` of all rows of `voxel`, gathered elsewhere.
    pub(crate) fn tell_sums(&self, voxel: &AirVoxel, sums: &[ReceiverSums], out: &mut Told) {
        let segments = self.has_near.then(|| self.local.segment_slots(&voxel.chunk.receivers.rows));
        let gather = |row: usize, near: Option<NearBy<'a>>| {
            let of = &sums[row - voxel.rows.start];
            let excess = near.zip(segments.as_ref());
            let excess =
                excess.map_or(Rgb::ZERO, |(near, slots)| near.excess_of_row(&voxel.chunk, row, slots));
            RowLight {
                irradiance: of.irradiance + excess,
                resident: f64::from(of.resident_share),
                far: f64::from(of.far_share),
                far_light: of.far_irradiance.extend(of.fed_share),
                sky: of.sky_irradiance,
            }
        };
        self.tell(voxel, gather, out);
    }

    /// The surface in part `detail` of `resident`, as it looks out.
    fn near(&self, place: &ReceiverPlace, detail: DetailVoxel, resident: &Resident) -> NearBy<'a> {
        let own = self.local.chunk_of(resident.id).points_of(&resident.patch);
        NearBy { local: self.local, viewer: Viewer::new(place, detail, self.detail, &self.grid, own) }
    }
}

/// Light of the receiver in row `row`, without that of far columns.
fn told(chunk: &Chunk, row: usize, of: &RowLight) -> PatchLight {
    let parts = parts_of_row(&chunk.receivers.rows, row, of.resident, of.far);
    let place = chunk.receivers.places[row];
    PatchLight {
        voxel: place.voxel,
        direction: place.direction,
        irradiance: finite(of.irradiance + of.sky),
        sky_irradiance: finite(of.sky),
        plane_offset: None,
        layer: 0,
        tilt: None,
        barriers: [None; Barrier::PER_LAYER_MAX],
        known_share: parts.known(),
        far_share: parts.far.clamp(0.0, 1.0),
        fed_share: 0.0,
        staleness: 0,
    }
}

/// `light` of a detail voxel with what comes from afar to the patch that it is part of, for its own far share.
fn fed_as(patch: &Resident, light: PatchLight) -> PatchLight {
    if patch.parts().far <= 0.0 {
        return light;
    }
    let ratio = light.far_share / patch.parts().far;
    PatchLight {
        irradiance: finite(light.irradiance + patch.light.far_irradiance * ratio),
        fed_share: (patch.fed_share * ratio).clamp(0.0, light.far_share),
        ..light
    }
}

/// Light that an `f32` cannot carry is as bright as it can be.
fn finite(light: Rgb) -> Rgb {
    light.max(Rgb::ZERO).min(Rgb::splat(f32::MAX))
}
