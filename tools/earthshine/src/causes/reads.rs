//! Which patches a lookup reads, and with what weight: found by asking the lookup itself.
//!
//! The lookup is linear in the light of a volume, so that a volume of the same patches with unit light on one of them
//! answers with that patch's weight. The rule stands in `earthshine-volume` alone; nothing here repeats it.

use earthshine_volume::{Volume, VoxelLight, lookup};
use earthshine_world::{Grid, Vec3, VoxelCoord};
use glam::IVec3;

/// Voxels around a point that are asked, along each axis.
const REACH_VOXELS: i32 = 2;
/// Weights below this are nothing.
const WEIGHT_MIN: f32 = 1e-7;

/// One patch (or receiver) that a lookup reads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Read {
    /// Of which of the volumes.
    pub volume: usize,
    /// Where in it.
    pub voxel: VoxelCoord,
    /// 0..6.
    pub direction: usize,
    /// Share of the answer.
    pub weight: f32,
}

impl Read {
    /// Volume, voxel and direction.
    pub(crate) fn key(&self) -> (usize, [i32; 3], usize) {
        (self.volume, self.voxel.to_array(), self.direction)
    }
}

/// Volumes with the patches of others and no light.
#[derive(Debug, Clone)]
pub(crate) struct Unlit {
    volumes: Vec<Volume>,
}

/// Which volume, voxel and direction.
type Asked = (usize, VoxelCoord, usize);

impl Unlit {
    /// Puts out the light of `volumes`, finest first.
    pub(crate) fn new(volumes: &[Volume]) -> Self {
        let unlit = |volume: &Volume| {
            let mut unlit = volume.clone();
            for index in 0..volume.layout().voxel_count() {
                if let Some(mut light) = volume.get(index).copied() {
                    light.irradiance = [Vec3::ZERO; 6];
                    light.sky_irradiance = [Vec3::ZERO; 6];
                    unlit.set(index, &light);
                }
            }
            unlit
        };
        Self { volumes: volumes.iter().map(unlit).collect() }
    }

    /// What a lookup at `position` with `normal` reads; `None` where it has no answer.
    pub(crate) fn reads(&mut self, position: Vec3, normal: Vec3) -> Option<Vec<Read>> {
        lookup(&self.volumes, position, normal)?;
        let mut near = Vec::new();
        for (number, volume) in self.volumes.iter().enumerate() {
            for voxel in around(volume, position) {
                let Some(light) = volume.at(voxel) else { continue };
                let lit = (0..6).filter(|&direction| light.has(direction));
                near.extend(lit.map(|direction| (number, voxel, direction)));
            }
        }
        let mut found = Vec::new();
        // Six at once: three channels of all light, three of the sky's part.
        for asked in near.chunks(6) {
            let answer = self.answer(asked, position, normal)?;
            for (&(volume, voxel, direction), weight) in asked.iter().zip(answer) {
                if weight > WEIGHT_MIN {
                    found.push(Read { volume, voxel, direction, weight });
                }
            }
        }
        Some(found)
    }

    fn answer(&mut self, asked: &[Asked], position: Vec3, normal: Vec3) -> Option<[f32; 6]> {
        for (index, &asked) in asked.iter().enumerate() {
            self.light(asked, Some(index));
        }
        let answer = lookup(&self.volumes, position, normal);
        for &asked in asked {
            self.light(asked, None);
        }
        let found = answer?;
        let [a, b, c] = found.irradiance.to_array();
        let [d, e, f] = found.sky_irradiance.to_array();
        Some([a, b, c, d, e, f])
    }

    /// Puts unit light of kind `index` on one patch, or puts it out.
    fn light(&mut self, (volume, voxel, direction): Asked, index: Option<usize>) {
        let volume = &mut self.volumes[volume];
        let Some(&VoxelLight { quality, plane, tilt, barriers, .. }) = volume.at(voxel) else { return };
        let unit = |first: usize| match index {
            Some(index) if (first..first + 3).contains(&index) => Vec3::AXES[index - first],
            _ => Vec3::ZERO,
        };
        volume.set_patch(voxel, direction, unit(0), unit(3), quality[direction]);
        volume.set_plane(voxel, direction, plane[direction]);
        volume.set_tilt(voxel, direction, tilt[direction]);
        volume.set_barriers(voxel, direction, barriers[direction]);
    }
}

/// Voxels within reach of `position`.
fn around(volume: &Volume, position: Vec3) -> impl Iterator<Item = VoxelCoord> {
    let edge = volume.layout().voxel_edge_m;
    let centre = Grid { voxel_edge_m: edge, chunk_edge_voxels: 1 }.voxel_at(position);
    let reach = || -REACH_VOXELS..=REACH_VOXELS;
    reach().flat_map(move |x| reach().flat_map(move |y| reach().map(move |z| centre + IVec3::new(x, y, z))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_volume::Layout;
    use earthshine_world::random::{Purpose, hash, unit_f32};
    use glam::UVec3;

    /// Two in three patches of a box, each with light of its own, some beside a wall.
    fn volume() -> Volume {
        let layout =
            Layout { level: 0, origin: IVec3::new(-3, 1, -2), dims: UVec3::splat(6), voxel_edge_m: 0.5 };
        let mut volume = Volume::new(layout).unwrap();
        for index in 0..layout.voxel_count() {
            for direction in 0..6 {
                let bits = hash(3, Purpose::Simulation, index.into(), direction as u64);
                if !bits.is_multiple_of(3) {
                    let light = Vec3::splat(100.0 * unit_f32(bits));
                    volume.set_patch(layout.voxel_of(index), direction, light, light, 200);
                    // A wall close by, for some.
                    if bits.is_multiple_of(5) {
                        let wall = [1 + (bits >> 8) as u8 % 252, 100 + (bits >> 16) as u8 % 50];
                        volume.set_barriers(layout.voxel_of(index), direction, [wall, [0; 2]]);
                    }
                }
            }
        }
        volume
    }

    #[test]
    fn weights_times_light_are_what_the_lookup_answers() {
        let volume = volume();
        let mut unlit = Unlit::new(std::slice::from_ref(&volume));
        let mut answered = 0;
        for index in 0..200 {
            let number = |k: u64| unit_f32(hash(5, Purpose::Simulation, index, k));
            let position = Vec3::new(number(0) * 3.0 - 1.5, number(1) * 3.0 + 0.5, number(2) * 3.0 - 1.0);
            let normal = (Vec3::new(number(3), number(4), number(5)) - 0.5).normalize_or(Vec3::Y);
            let expected = lookup(&[&volume], position, normal);
            let reads = unlit.reads(position, normal);
            assert_eq!(expected.is_some(), reads.is_some());
            let (Some(expected), Some(reads)) = (expected, reads) else { continue };
            answered += 1;
            let light = |read: &Read| volume.at(read.voxel).unwrap().irradiance[read.direction].x;
            let sum: f32 = reads.iter().map(|read| read.weight * light(read)).sum();
            let weights: f32 = reads.iter().map(|read| read.weight).sum();
            assert!((weights - 1.0).abs() < 1e-4, "{weights}");
            assert!((sum - expected.irradiance.x).abs() < 1e-2, "{sum} {}", expected.irradiance.x);
        }
        assert!(answered > 150, "{answered}");
    }
}
