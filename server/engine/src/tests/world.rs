//! Worlds made in memory: random chunks whose rows are reciprocal and sum to one.

use earthshine_light::Occluders;
use earthshine_world::random::{Purpose, hash, unit_f32};
use earthshine_world::{
    Chunk, ChunkCoord, ChunkId, ChunkRows, ChunkSummary, Column, Direction, Grid, LightRig, OccluderMesh,
    Patch, PatchId, ReceiverPlace, Receivers, Rgb, SamplePoint, Vec3, VoxelCoord, WorldIndex,
};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Numbers in sequence: hashes of (seed, counter).
#[derive(Debug, Clone)]
pub(crate) struct Dice {
    seed: u64,
    rolls: u64,
}

impl Dice {
    pub(crate) fn new(seed: u64, purpose: u64) -> Self {
        Self { seed: hash(seed, Purpose::Simulation, purpose, 0), rolls: 0 }
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.rolls += 1;
        hash(self.seed, Purpose::Simulation, self.rolls, 1)
    }

    pub(crate) fn below(&mut self, limit: u64) -> u64 {
        self.bits() % limit.max(1)
    }

    pub(crate) fn unit(&mut self) -> f32 {
        unit_f32(self.bits())
    }

    pub(crate) fn chance(&mut self, probability: f32) -> bool {
        self.unit() < probability
    }

    pub(crate) fn vector(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit())
    }

    pub(crate) fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u64) as usize]
    }
}

/// How large a random world is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WorldShape {
    pub(crate) chunks: [i32; 3],
    pub(crate) patches_per_chunk_max: u64,
    pub(crate) links_per_patch: u64,
    pub(crate) has_occluders: bool,
}

impl Default for WorldShape {
    fn default() -> Self {
        Self { chunks: [4, 1, 3], patches_per_chunk_max: 10, links_per_patch: 3, has_occluders: true }
    }
}

/// Index and tiles of a world that was never on disk.
#[derive(Debug, Clone)]
pub(crate) struct RandomWorld {
    pub(crate) index: WorldIndex,
    pub(crate) chunks: BTreeMap<ChunkId, Arc<Chunk>>,
    pub(crate) occluders: BTreeMap<ChunkId, Arc<Occluders>>,
}

/// A patch and what lights it, before it is sorted into chunks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PatchDraft {
    pub(crate) voxel: VoxelCoord,
    pub(crate) direction: Direction,
    pub(crate) area: f32,
    pub(crate) reflectance: Rgb,
    pub(crate) emission: Rgb,
    /// Of what the row leaves over.
    pub(crate) sky_portion: f32,
}

pub(crate) const GRID: Grid = Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 4 };

impl RandomWorld {
    /// What a shell would promise of an engine of `config`.
    pub(crate) fn prospect(&self, config: &crate::EngineConfig) -> crate::Prospect {
        let mut crowding = crate::Crowding::new(self.index.grid.voxel_edge_m);
        let finest = self.chunks.values().filter(|chunk| chunk.id.level == 0);
        let patches: Vec<Vec3> =
            finest.flat_map(|chunk| &chunk.patches).map(|patch| patch.centroid).collect();
        crowding.look(&patches, &patches);
        crate::Prospect::of(&self.index, config, &[crowding])
    }

    pub(crate) fn new(seed: u64, shape: WorldShape) -> Self {
        let mut dice = Dice::new(seed, 1);
        let mut drafts = Vec::new();
        let mut chunks = Vec::new();
        for x in 0..shape.chunks[0] {
            for y in 0..shape.chunks[1] {
                for z in 0..shape.chunks[2] {
                    // Around the origin, so that negative coordinates take part.
                    let coord = ChunkCoord::new(x - 1, y, z - 1);
                    chunks.push(coord);
                    draft_chunk(&mut dice, coord, shape.patches_per_chunk_max, &mut drafts);
                }
            }
        }
        let links = draft_links(&mut dice, &drafts, shape.links_per_patch);
        let mut world = Self::from_drafts(&chunks, &drafts, &links);
        if shape.has_occluders {
            world.add_occluders(&mut dice);
        }
        world
    }

    /// `links` are `(i, j, F_ij)` over `drafts`, one direction each: the other follows by reciprocity.
    pub(crate) fn from_drafts(
        coords: &[ChunkCoord],
        drafts: &[PatchDraft],
        links: &[(usize, usize, f32)],
    ) -> Self {
        let mut owned: BTreeMap<ChunkId, Vec<usize>> =
            coords.iter().map(|&coord| (ChunkId::new(0, coord), Vec::new())).collect();
        let mut ids = Vec::new();
        for (number, draft) in drafts.iter().enumerate() {
            let chunk = ChunkId::new(0, GRID.chunk_of(draft.voxel));
            let list = owned.get_mut(&chunk).unwrap();
            ids.push(PatchId { chunk, local: list.len() as u16 });
            list.push(number);
        }
        let mut rows: Vec<BTreeMap<PatchId, f32>> = vec![BTreeMap::new(); drafts.len()];
        for &(i, j, share) in links {
            rows[i].insert(ids[j], share);
            rows[j].insert(ids[i], share * drafts[i].area / drafts[j].area);
        }
        let chunks: BTreeMap<_, _> =
            owned.iter().map(|(&id, list)| (id, Arc::new(build_chunk(id, list, drafts, &rows)))).collect();
        let summaries = chunks.values().map(|chunk| ChunkSummary {
            id: chunk.id,
            patch_count: chunk.patches.len() as u32,
            nonzero_count: chunk.rows.columns.len() as u64,
            tile_bytes: 100,
        });
        let bounds = earthshine_world::Bounds { min: Vec3::splat(-10.0), max: Vec3::splat(100.0) };
        let lights = LightRig::emission_only();
        let index = WorldIndex { detail: 1, grid: GRID, bounds, chunks: summaries.collect(), lights };
        let occluders =
            chunks.keys().map(|&id| (id, Arc::new(Occluders::build(&OccluderMesh::default())))).collect();
        Self { index, chunks, occluders }
    }

    /// A wall in most chunks.
    fn add_occluders(&mut self, dice: &mut Dice) {
        for (id, chunk) in &mut self.chunks {
            if dice.chance(0.2) {
                continue;
            }
            let corner = GRID.chunk_bounds(id.coord).min + dice.vector() * 2.0;
            let (u, v) = (dice.vector() * 2.0, dice.vector() * 2.0);
            let mesh = OccluderMesh {
                vertices: vec![corner, corner + u, corner + u + v, corner + v],
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                surfaces: vec![[200, 200, 200, 255]; 2],
            };
            self.occluders.insert(*id, Arc::new(Occluders::build(&mesh)));
            let mut with_walls = Chunk::clone(chunk);
            with_walls.occluders = mesh;
            *chunk = Arc::new(with_walls);
        }
    }

    pub(crate) fn patch_count(&self) -> usize {
        self.chunks.values().map(|chunk| chunk.patches.len()).sum()
    }

    /// Every patch by distance from `point`, nearest first.
    pub(crate) fn nearest(&self, point: Vec3) -> Vec<(f32, VoxelCoord, Direction)> {
        let mut all: Vec<_> = self
            .chunks
            .values()
            .flat_map(|chunk| &chunk.patches)
            .map(|patch| (patch.centroid.distance(point), patch.voxel, patch.direction))
            .collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    }
}

fn draft_chunk(dice: &mut Dice, coord: ChunkCoord, patches_max: u64, drafts: &mut Vec<PatchDraft>) {
    let edge = GRID.chunk_edge_voxels as i32;
    let mut places = BTreeSet::new();
    for _ in 0..dice.below(patches_max + 1) {
        let offset = VoxelCoord::new(
            dice.below(edge as u64) as i32,
            dice.below(edge as u64) as i32,
            dice.below(edge as u64) as i32,
        );
        let direction = dice.pick(&Direction::ALL);
        if !places.insert((offset.to_array(), direction)) {
            continue;
        }
        let emission = if dice.chance(0.2) { dice.vector() * 10.0 } else { Rgb::ZERO };
        drafts.push(PatchDraft {
            voxel: coord * edge + offset,
            direction,
            area: 0.05 + dice.unit(),
            reflectance: dice.vector() * 0.9,
            emission,
            sky_portion: dice.unit(),
        });
    }
}

fn draft_links(dice: &mut Dice, drafts: &[PatchDraft], per_patch: u64) -> Vec<(usize, usize, f32)> {
    let mut pairs = BTreeSet::new();
    let mut degrees = vec![0u32; drafts.len()];
    for i in 0..drafts.len() {
        for _ in 0..per_patch {
            let j = dice.below(drafts.len() as u64) as usize;
            if i != j && pairs.insert((i.min(j), i.max(j))) {
                degrees[i] += 1;
                degrees[j] += 1;
            }
        }
    }
    let most = degrees.iter().copied().max().unwrap_or(1).max(1) as f32;
    pairs
        .into_iter()
        .map(|(i, j)| {
            let exchange = drafts[i].area.min(drafts[j].area) * (0.2 + 0.8 * dice.unit()) / most;
            (i, j, exchange / drafts[i].area)
        })
        .collect()
}

/// A receiver behind each patch that has nothing there, with the patch's own row.
fn build_receivers(patches: &[Patch], rows: &ChunkRows) -> Receivers {
    let taken: BTreeSet<_> = patches.iter().map(|patch| (patch.voxel.to_array(), patch.direction)).collect();
    let mut places: Vec<(ReceiverPlace, usize)> = Vec::new();
    for (local, patch) in patches.iter().enumerate() {
        let direction = Direction::ALL[patch.direction.index() ^ 1];
        let place = ReceiverPlace::in_air(patch.voxel, direction);
        if !taken.contains(&(place.voxel.to_array(), place.direction)) {
            places.push((place, local));
        }
    }
    places.sort_by_key(|(place, _)| place.order());
    places.dedup_by_key(|(place, _)| *place);
    let segments = rows.segments.clone();
    let mut copied = ChunkRows { segments, row_starts: vec![0], ..ChunkRows::default() };
    for &(_, local) in &places {
        for (column, share) in rows.row(local) {
            copied.columns.push(column);
            copied.shares.push(share);
        }
        copied.row_starts.push(copied.columns.len() as u32);
        copied.sky_shares.push(rows.sky_shares[local]);
        copied.absorbed_shares.push(rows.absorbed_shares[local]);
    }
    Receivers { places: places.into_iter().map(|(place, _)| place).collect(), rows: copied }
}

fn build_chunk(id: ChunkId, list: &[usize], drafts: &[PatchDraft], all: &[BTreeMap<PatchId, f32>]) -> Chunk {
    let segments: BTreeSet<ChunkId> =
        list.iter().flat_map(|&number| all[number].keys().map(|column| column.chunk)).collect();
    let segments: Vec<ChunkId> = segments.into_iter().collect();
    let mut rows = ChunkRows { segments, row_starts: vec![0], ..ChunkRows::default() };
    let (mut patches, mut points) = (Vec::new(), Vec::new());
    for &number in list {
        let draft = &drafts[number];
        let mut rest = 1.0f32;
        for (column, &share) in &all[number] {
            let segment = rows.segments.binary_search(&column.chunk).unwrap() as u16;
            rows.columns.push(Column { segment, local: column.local });
            rows.shares.push(share);
            rest -= share;
        }
        assert!(rest > -1e-5, "the test world's rows sum to at most one");
        let sky = rest.max(0.0) * draft.sky_portion;
        let mut lobes = [0.0; 6];
        lobes[draft.direction.index()] = sky * 0.75;
        lobes[Direction::PosY.index()] += sky * 0.25;
        rows.sky_shares.push(lobes);
        rows.absorbed_shares.push(rest.max(0.0) * (1.0 - draft.sky_portion));
        rows.row_starts.push(rows.columns.len() as u32);
        let centroid = GRID.voxel_centre(draft.voxel) + draft.direction.vector() * 0.25;
        let point_count = 1 + number as u32 % 3;
        patches.push(Patch {
            voxel: draft.voxel,
            direction: draft.direction,
            area: draft.area,
            centroid,
            reflectance: draft.reflectance,
            emission: draft.emission,
            point_first: points.len() as u32,
            point_count,
        });
        for point in 0..point_count {
            let position = centroid + Vec3::splat(0.01) * point as f32;
            points.push(SamplePoint { position, normal: draft.direction.vector() });
        }
    }
    let receivers = build_receivers(&patches, &rows);
    Chunk { id, patches, points, rows, receivers, occluders: OccluderMesh::default() }
}

#[test]
fn rows_of_random_worlds_are_reciprocal_and_sum_to_one() {
    let world = RandomWorld::new(3, WorldShape::default());
    let share = |from: PatchId, to: PatchId| {
        let rows = &world.chunks[&from.chunk].rows;
        rows.row(usize::from(from.local))
            .find(|&(column, _)| rows.patch_id(column) == to)
            .map(|(_, share)| share)
    };
    let mut links = 0;
    for (&id, chunk) in &world.chunks {
        for (local, patch) in chunk.patches.iter().enumerate() {
            assert!((chunk.rows.row_sum(local) - 1.0).abs() < 1e-5);
            let from = PatchId { chunk: id, local: local as u16 };
            for (column, forth) in chunk.rows.row(local) {
                let to = chunk.rows.patch_id(column);
                let back = share(to, from).expect("links go both ways");
                let other = world.chunks[&to.chunk].patches[usize::from(to.local)].area;
                assert!((patch.area * forth - other * back).abs() < 1e-6);
                links += 1;
            }
        }
    }
    assert!(links > 50, "{links}");
}
