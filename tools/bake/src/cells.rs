//! Which parts of a scene rays cross, and what is in them: the ground for leaving alone what cannot have changed.
//!
//! The scene's box is cut into cells of a voxel. [`Cells`] holds a hash of what is in each; [`Seen`] notes the
//! cells that some rays cross on their way to what they hit. If none of these cells has changed, the same rays hit
//! the same things: nothing beyond what they hit, and nothing beside their way, matters. Where rays can be cast again
//! from their seeds, `changes` tells more finely which of them an edit concerns.

use crate::content::SceneContent;
use crate::overlap::touched_cubes;
use crate::words::{Reader, Writer};
use earthshine_scene::Scene;
use earthshine_world::{Grid, Vec3, VoxelCoord};
use glam::{IVec3, UVec3};
use std::sync::atomic::{AtomicU64, Ordering};
use xxhash_rust::xxh3::Xxh3Default;

/// Most cells; worlds of more voxels have cells of 2, 4, .. voxels an edge.
const CELLS_MAX: u64 = 1 << 24;
/// The box of cells begins and ends at whole numbers of these: a scene that grows a little keeps its frame.
const FRAME_CELLS: i32 = 8;
/// Triangles nearer to a cell than this share of its edge are in it: a ray's way is known to rounding only.
const MARGIN: f32 = 0.01;

/// The contents of a scene, cell by cell.
#[derive(Debug, Clone)]
pub struct Cells {
    /// Voxels along a cell's edge.
    voxels: i32,
    edge_m: f32,
    low: IVec3,
    size: UVec3,
    contents: Vec<u64>,
}

impl Cells {
    /// What rays notice of `scene`.
    #[must_use]
    pub fn of(scene: &Scene, content: &SceneContent<'_>, grid: Grid) -> Self {
        let bounds = scene.bounds();
        let mut voxels = 1;
        let (edge_m, low, size) = loop {
            let edge_m = grid.voxel_edge_m * voxels as f32;
            // One more all around: rays begin a little off their surface.
            let frame = IVec3::splat(FRAME_CELLS);
            let low = ((bounds.min / edge_m).floor().as_ivec3() - 1).div_euclid(frame) * frame;
            let high = ((bounds.max / edge_m).floor().as_ivec3() + 1).div_euclid(frame) * frame + frame;
            let size = (high - low).as_uvec3();
            if size.to_array().iter().map(|&edge| u64::from(edge)).product::<u64>() <= CELLS_MAX {
                break (edge_m, low, size);
            }
            voxels *= 2;
        };
        let mut cells =
            Self { voxels, edge_m, low, size, contents: vec![0; size.element_product() as usize] };
        for (triangle, &corners) in scene.triangles.iter().enumerate() {
            let hash = content.traced(triangle);
            touched_cubes(corners, edge_m, MARGIN * edge_m, |cell| cells.add(cell - low, hash));
        }
        cells
    }

    /// Where the cells are: contents of other frames cannot be compared.
    #[must_use]
    pub fn frame(&self) -> u64 {
        let mut hash = Xxh3Default::new();
        hash.update(bytemuck::bytes_of(&self.edge_m));
        hash.update(bytemuck::cast_slice(&self.low.to_array()));
        hash.update(bytemuck::cast_slice(&self.size.to_array()));
        hash.digest()
    }

    /// Says that something with hash `content` is in the cell of `voxel`.
    pub fn add_at(&mut self, voxel: VoxelCoord, content: u64) {
        self.add(self.cell_of(voxel), content);
    }

    fn add(&mut self, cell: IVec3, content: u64) {
        if let Some(index) = self.index(cell) {
            // A sum: the order of things does not matter.
            self.contents[index] = self.contents[index].wrapping_add(content | 1);
        }
    }

    fn cell_of(&self, voxel: VoxelCoord) -> IVec3 {
        voxel.div_euclid(IVec3::splat(self.voxels)) - self.low
    }

    fn index(&self, cell: IVec3) -> Option<usize> {
        let inside = cell.cmpge(IVec3::ZERO).all() && cell.as_uvec3().cmplt(self.size).all();
        let at = cell.as_uvec3();
        inside.then(|| ((at.x * self.size.y + at.y) * self.size.z + at.z) as usize)
    }

    /// What is in cell number `index`; zero where there is none.
    #[must_use]
    pub fn content(&self, index: u32) -> u64 {
        self.contents.get(index as usize).copied().unwrap_or(0)
    }

    /// The middle of cell number `index`, m.
    #[must_use]
    pub fn centre(&self, index: u32) -> Vec3 {
        self.cell(index).as_vec3() * self.edge_m + 0.5 * self.edge_m
    }

    /// Where cell number `index` is, in cells from the middle of the world.
    fn cell(&self, index: u32) -> IVec3 {
        let UVec3 { y, z, .. } = self.size;
        UVec3::new(index / (y * z), index / z % y, index % z).as_ivec3() + self.low
    }

    /// What is in the cell at `cell`; zero where there is none.
    pub(crate) fn at(&self, cell: IVec3) -> u64 {
        self.index(cell - self.low).map_or(0, |index| self.contents[index])
    }

    /// Every cell with something in it, and what.
    pub(crate) fn filled(&self) -> impl Iterator<Item = (IVec3, u64)> + '_ {
        let filled = self.contents.iter().enumerate().filter(|(_, content)| **content != 0);
        filled.map(|(index, &content)| (self.cell(index as u32), content))
    }

    /// m.
    pub(crate) fn edge_m(&self) -> f32 {
        self.edge_m
    }

    /// m.
    pub(crate) fn voxel_edge_m(&self) -> f32 {
        self.edge_m / self.voxels as f32
    }

    /// Whether the cells of `other` are as large.
    pub(crate) fn has_edge_of(&self, other: &Self) -> bool {
        (self.voxels, self.edge_m.to_bits()) == (other.voxels, other.edge_m.to_bits())
    }

    /// Changes with anything that rays notice.
    pub(crate) fn state(&self) -> u64 {
        let mut hash = Xxh3Default::new();
        hash.update(&self.frame().to_le_bytes());
        hash.update(bytemuck::cast_slice(&self.contents));
        hash.digest()
    }

    /// As bytes: only what is not empty.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut out = Writer::default();
        out.u32(self.voxels.cast_unsigned());
        out.f32s([self.edge_m]);
        out.i32s(self.low.to_array());
        out.u32s(self.size.to_array());
        for (index, &content) in self.contents.iter().enumerate().filter(|(_, content)| **content != 0) {
            out.u32(index as u32);
            out.u64(content);
        }
        out.0
    }

    /// What [`Self::encode`] made; `None` for other bytes.
    pub(crate) fn decode(bytes: &[u8]) -> Option<Self> {
        let mut reader = Reader(bytes);
        let (voxels, edge_m) = (reader.u32()?.cast_signed(), reader.f32()?);
        let (low, size) = (IVec3::from(reader.i32s()?), IVec3::from(reader.i32s()?));
        let count = size.to_array().iter().try_fold(1u64, |count, &edge| {
            count.checked_mul(u64::try_from(edge).ok()?).filter(|&count| count <= CELLS_MAX)
        })?;
        let mut cells =
            Self { voxels, edge_m, low, size: size.as_uvec3(), contents: vec![0; count as usize] };
        while !reader.is_empty() {
            let (index, content) = (reader.u32()?, reader.u64()?);
            *cells.contents.get_mut(index as usize)? = content;
        }
        Some(cells)
    }

    /// Bytes that they take.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.contents.len() as u64 * 8
    }
}

/// The cells that rays have crossed.
#[derive(Debug)]
pub struct Seen<'a> {
    cells: &'a Cells,
    bits: Vec<AtomicU64>,
}

impl<'a> Seen<'a> {
    /// None yet.
    #[must_use]
    pub fn nothing(cells: &'a Cells) -> Self {
        let words = cells.contents.len().div_ceil(64);
        Self { cells, bits: (0..words).map(|_| AtomicU64::new(0)).collect() }
    }

    /// Their numbers with what is in them, ascending.
    #[must_use]
    pub fn list(&self) -> Vec<(u32, u64)> {
        let mut seen = Vec::new();
        for (word, bits) in self.bits.iter().enumerate() {
            let mut left = bits.load(Ordering::Relaxed);
            while left != 0 {
                let index = word as u32 * 64 + left.trailing_zeros();
                seen.push((index, self.cells.content(index)));
                left &= left - 1;
            }
        }
        seen
    }

    /// Notes the cell of `voxel`.
    pub(crate) fn mark_voxel(&self, voxel: VoxelCoord) {
        if let Some(index) = self.cells.index(self.cells.cell_of(voxel)) {
            self.mark(index);
        }
    }

    /// Notes cell number `index`.
    pub(crate) fn mark(&self, index: usize) {
        let (word, bit) = (&self.bits[index / 64], 1u64 << (index % 64));
        if word.load(Ordering::Relaxed) & bit == 0 {
            word.fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// Notes the cells from `origin` along unit `direction` up to `distance` m (Amanatides and Woo, 1987).
    ///
    /// Every ray of a stage comes by here, and which way it goes next is nobody's guess: so the loop chooses without branches.
    pub(crate) fn mark_way(&self, origin: Vec3, direction: Vec3, distance: f32) {
        let from = origin / self.cells.edge_m - self.cells.low.as_vec3();
        if from.cmplt(Vec3::ZERO).any() {
            return;
        }
        let cell = from.as_ivec3();
        let Some(mut index) = self.cells.index(cell) else { return };
        let end = distance / self.cells.edge_m + MARGIN;
        let is_up = direction.cmpgt(Vec3::ZERO);
        let per_cell = direction.abs().recip();
        let ahead = Vec3::select(is_up, Vec3::ONE, Vec3::ZERO);
        let next = ((cell.as_vec3() + ahead - from).abs()) * per_cell;
        // Along an axis that the ray does not follow there is no next cell.
        let mut next = Vec3::select(next.is_nan_mask(), Vec3::INFINITY, next);
        let UVec3 { y, z, .. } = self.cells.size;
        // What the number of a cell changes by along each axis, and how often before the world ends.
        let steps = IVec3::select(is_up, IVec3::ONE, IVec3::NEG_ONE) * UVec3::new(y * z, z, 1).as_ivec3();
        let mut left = IVec3::select(is_up, self.cells.size.as_ivec3() - 1 - cell, cell);
        loop {
            self.mark(index);
            // What is not a number must end, too.
            let goes_on = next.x.min(next.y).min(next.z) < end;
            if !goes_on {
                return;
            }
            let is_x = (next.x <= next.y) & (next.x <= next.z);
            let is_z = !is_x & (next.z < next.y);
            let is_y = !is_x & !is_z;
            left -= IVec3::new(i32::from(is_x), i32::from(is_y), i32::from(is_z));
            if left.x | left.y | left.z < 0 {
                return;
            }
            let step = if is_x { steps.x } else { 0 }
                | if is_y { steps.y } else { 0 }
                | if is_z { steps.z } else { 0 };
            index = index.wrapping_add_signed(step as isize);
            next += Vec3::new(
                if is_x { per_cell.x } else { 0.0 },
                if is_y { per_cell.y } else { 0.0 },
                if is_z { per_cell.z } else { 0.0 },
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells() -> Cells {
        let size = UVec3::new(12, 6, 9);
        let contents = (0..size.element_product()).map(u64::from).collect();
        Cells { voxels: 4, edge_m: 2.0, low: IVec3::new(-3, -2, -4), size, contents }
    }

    #[test]
    fn a_ray_marks_every_cell_on_its_way_and_none_beside_it() {
        let cells = cells();
        let seen = Seen::nothing(&cells);
        let (origin, end) = (Vec3::new(-4.3, -1.9, 7.2), Vec3::new(13.1, 5.5, -5.8));
        let direction = (end - origin).normalize_or_zero();
        seen.mark_way(origin, direction, end.distance(origin));
        let marked: Vec<u32> = seen.list().iter().map(|entry| entry.0).collect();
        for step in 0..=1000 {
            let place = origin.lerp(end, step as f32 / 1000.0);
            let cell = (place / 2.0).floor().as_ivec3() - cells.low;
            let index = cells.index(cell).expect("inside") as u32;
            assert!(marked.contains(&index), "{place}");
        }
        assert!(marked.iter().all(|&index| {
            let away = cells.centre(index) - origin;
            (away - direction * away.dot(direction)).length() < 2.0
        }));
        assert!(marked.len() > 12 && marked.len() < 24, "{}", marked.len());
    }

    #[test]
    fn cells_come_back_from_their_bytes() {
        let cells = cells();
        let bytes = cells.encode();
        let again = Cells::decode(&bytes).expect("sound bytes");
        assert_eq!((again.state(), again.at(IVec3::new(-3, -2, -3))), (cells.state(), 1));
        assert!(again.filled().eq(cells.filled()));
        for end in 0..bytes.len() {
            assert!(
                Cells::decode(&bytes[..end]).is_none_or(|cut| cut.state() != cells.state()),
                "cut at {end}"
            );
        }
        let mut vast = bytes;
        vast[20..32].fill(0x7F);
        assert!(Cells::decode(&vast).is_none());
    }

    #[test]
    fn rays_along_an_axis_end_at_the_edge_of_the_world() {
        let cells = cells();
        let seen = Seen::nothing(&cells);
        seen.mark_way(Vec3::new(0.5, 0.5, 0.5), Vec3::new(0.0, 0.0, 1.0), f32::INFINITY);
        seen.mark_way(Vec3::new(0.5, 0.5, 0.5), Vec3::new(-0.0, 1.0, 0.0), 2.5);
        assert_eq!(seen.list().len(), 5 + 1);
    }
}
