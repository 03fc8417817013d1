//! Volumes as words for a shader: what `lookup_irradiance.wgsl` reads from its three buffers.
//!
//! Light becomes RGB9E5, as it travelled: what came over the wire stays what it was. Sky light, quality and age stay behind.

use crate::{Layout, Volume, VoxelLight, rgb9e5};
use std::borrow::Borrow;

/// Words of a volume's layout.
const LAYOUT_WORDS: usize = 12;
/// Words of a lit voxel.
const BLOCK_WORDS: usize = 19;

/// Three storage buffers, in the order of their bindings, as 32-bit words of the machine's byte order. None is empty: a
/// binding without bytes is not allowed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ShaderVolumes {
    /// A volume each, finest first; layers of detail share one. Twelve words: origin (`i32`) and voxel edge (`f32`, m), dims and
    /// level, layers, number of the first place, two of padding.
    pub layouts: Vec<u32>,
    /// For each voxel of each layer 0 for no light, else one more than the number of its block.
    pub places: Vec<u32>,
    /// Lit voxels, nineteen words each: bits of present and, from bit 8 on, of air; six lights as RGB9E5; six planes, the place along the
    /// axis in the lowest byte, the tilt above it; six pairs of barriers, the first one's angle in the lowest byte.
    pub blocks: Vec<u32>,
}

impl ShaderVolumes {
    /// Of `volumes` as [`lookup`](crate::lookup()) is given them. Of a layer that lies elsewhere than the first of its volume,
    /// what is outside of that one's box stays behind.
    ///
    /// Costs four bytes a voxel of every box, and 76 a lit voxel.
    #[must_use]
    pub fn of<V: Borrow<Volume>>(volumes: &[V]) -> Self {
        let (mut layouts, mut places, mut blocks) = (Vec::new(), Vec::new(), Vec::new());
        let mut rest = volumes;
        while let Some(first) = rest.first().map(Borrow::borrow) {
            let layers;
            (layers, rest) = rest.split_at(first.layer_count(rest));
            let layout = first.layout();
            layouts.extend(layout_words(layout, layers.len(), places.len()));
            for layer in layers.iter().map(Borrow::borrow) {
                let start = places.len();
                places.resize(start + layout.voxel_count() as usize, 0);
                for (voxel, light) in layer.iter() {
                    if let Some(index) = layout.index_of(voxel) {
                        blocks.extend(block_words(light));
                        places[start + index as usize] = (blocks.len() / BLOCK_WORDS) as u32;
                    }
                }
            }
        }
        for (words, least) in [(&mut layouts, LAYOUT_WORDS), (&mut places, 1), (&mut blocks, BLOCK_WORDS)] {
            words.resize(words.len().max(least), 0);
        }
        Self { layouts, places, blocks }
    }
}

fn layout_words(layout: &Layout, layers: usize, first_place: usize) -> [u32; LAYOUT_WORDS] {
    let [x, y, z] = layout.origin.to_array().map(i32::cast_unsigned);
    let [across, up, along] = layout.dims.to_array();
    let edge = layout.voxel_edge_m.to_bits();
    let (layers, first_place) = (layers as u32, first_place as u32);
    [x, y, z, edge, across, up, along, layout.level.into(), layers, first_place, 0, 0]
}

fn block_words(light: &VoxelLight) -> [u32; BLOCK_WORDS] {
    let mut words = [0; BLOCK_WORDS];
    words[0] = u32::from(light.present) | u32::from(light.air) << 8;
    for direction in 0..6 {
        words[1 + direction] = rgb9e5::encode(light.irradiance[direction]);
        let [x, y, distance] = light.tilt[direction];
        words[7 + direction] = u32::from_le_bytes([light.plane[direction], x, y, distance]);
        let [[angle, distance], [other_angle, other_distance]] = light.barriers[direction];
        words[13 + direction] = u32::from_le_bytes([angle, distance, other_angle, other_distance]);
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{IVec3, UVec3, Vec3};

    fn volume(level: u8, edge: f32, origin: IVec3) -> Volume {
        Volume::new(Layout { level, origin, dims: UVec3::new(2, 3, 4), voxel_edge_m: edge }).unwrap()
    }

    #[test]
    fn words_hold_what_volumes_hold() {
        let mut layers = [volume(0, 0.5, IVec3::new(-1, 0, 2)), volume(0, 0.5, IVec3::new(-1, 0, 2))];
        let coarse = volume(1, 2.0, IVec3::ZERO);
        let voxel = IVec3::new(0, 1, 3);
        layers[1].set_patch(voxel, 3, Vec3::new(1.0, 2.0, 4.0), Vec3::ONE, 9);
        layers[1].set_tilt(voxel, 3, [5, 6, 7]);
        layers[1].set_plane(voxel, 3, 8);
        layers[1].set_barriers(voxel, 3, [[9, 10], [11, 12]]);
        layers[1].set_receiver(voxel, 0, Vec3::ONE, Vec3::ZERO, 9);
        let [one, two] = &layers;
        let words = ShaderVolumes::of(&[one, two, &coarse]);
        let expected = [u32::MAX, 0, 2, 0.5f32.to_bits(), 2, 3, 4, 0, 2, 0, 0, 0];
        assert_eq!(words.layouts[..12], expected);
        assert_eq!(words.layouts[12..], [0, 0, 0, 2f32.to_bits(), 2, 3, 4, 1, 1, 48, 0, 0]);
        assert_eq!((words.places.len(), words.blocks.len()), (3 * 24, 19));
        let lit: Vec<usize> = (0..72).filter(|&at| words.places[at] != 0).collect();
        // Of the second layer, at x + 2 (y + 3 z).
        assert_eq!((lit, words.places[24 + 1 + 2 * (1 + 3)]), (vec![24 + 9], 1));
        assert_eq!(words.blocks[0], 0b1001 | 1 << 8);
        assert_eq!(words.blocks[1 + 3], rgb9e5::encode(Vec3::new(1.0, 2.0, 4.0)));
        assert_eq!(words.blocks[7 + 3], 0x0706_0508);
        assert_eq!(words.blocks[13 + 3], 0x0c0b_0a09);
    }

    #[test]
    fn nothing_still_binds() {
        let words = ShaderVolumes::of::<Volume>(&[]);
        assert_eq!((words.layouts.len(), words.places.len(), words.blocks.len()), (12, 1, 19));
        assert!(words.layouts.iter().chain(&words.places).chain(&words.blocks).all(|&word| word == 0));
    }
}
