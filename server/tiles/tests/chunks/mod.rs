//! Chunks and worlds to test with: random ones for structure, a town for sizes and rates.
#![expect(dead_code, reason = "each test file uses its part")]

pub(crate) mod town;

use earthshine_tiles::{
    BakeParameters, ChunkEntry, EncodeOptions, Manifest, RowCodec, encode, format, tile_file_name, tile_hash,
    write_atomic,
};
use earthshine_world::random::{Purpose, hash, unit_f32};
use earthshine_world::{
    Barrier, Bounds, Chunk, ChunkCoord, ChunkId, ChunkRows, Column, DetailVoxel, Direction, LightRig,
    OccluderMesh, Patch, ReceiverPlace, Receivers, SamplePoint, SurfacePlane, Vec3, VoxelCoord,
};
use std::path::Path;

/// Random numbers in order.
pub(crate) struct Dice {
    seed: u64,
    count: u64,
}

impl Dice {
    pub(crate) fn new(seed: u64) -> Self {
        Self { seed, count: 0 }
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.count += 1;
        hash(self.seed, Purpose::Simulation, self.count, 0)
    }

    pub(crate) fn below(&mut self, limit: usize) -> usize {
        (self.bits() % limit as u64) as usize
    }

    pub(crate) fn unit(&mut self) -> f32 {
        unit_f32(self.bits())
    }

    pub(crate) fn vector(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit())
    }
}

pub(crate) fn options(codec: RowCodec) -> EncodeOptions {
    EncodeOptions { codec, ..EncodeOptions::new(0xE4) }
}

/// A chunk with `patch_count` patches and up to `row_max` non-zeros a row, some rows empty, shares
/// from 1 down to 1e-9.
pub(crate) fn random_chunk(seed: u64, patch_count: usize, row_max: usize) -> Chunk {
    let mut dice = Dice::new(seed);
    let id = ChunkId::new((seed % 3) as u8, ChunkCoord::new(-2, 0, 5));
    let mut points = Vec::new();
    let patches: Vec<Patch> =
        (0..patch_count).map(|index| random_patch(index, &mut points, &mut dice)).collect();
    let corners = 3 + dice.below(20);
    let triangle_count = dice.below(30);
    let occluders = OccluderMesh {
        vertices: (0..corners).map(|_| dice.vector() * 40.0 - 20.0).collect(),
        triangles: (0..triangle_count).map(|_| [(); 3].map(|()| dice.below(corners) as u32)).collect(),
        surfaces: (0..triangle_count).map(|_| [(); 4].map(|()| dice.bits() as u8)).collect(),
    };
    let rows = random_rows(id, patch_count, patch_count, row_max, &mut dice);
    let receivers = random_receivers(id, &patches, row_max, &mut dice);
    Chunk { id, patches, points, rows, receivers, occluders }
}

/// Receivers one voxel behind the patches, about as many, and layers in a detail voxel of every third patch.
fn random_receivers(id: ChunkId, patches: &[Patch], row_max: usize, dice: &mut Dice) -> Receivers {
    let patch_count = patches.len();
    let mut places = Vec::new();
    for patch in patches.iter().step_by(3) {
        let most = DetailVoxel::PER_EDGE_MAX as usize;
        let mut along = || dice.below(most) as i32;
        let offset = VoxelCoord::new(along(), along(), along());
        for layer in 0..=dice.below(DetailVoxel::LAYERS_MAX.into()) as u8 {
            let normal = (dice.vector() - 0.5).normalize_or(Vec3::X);
            let plane = SurfacePlane::new(normal, dice.unit() - 0.5);
            let (first, second) = (barrier(patch.direction, dice), barrier(patch.direction, dice));
            let barriers = if first.is_none() { [second, first] } else { [first, second] };
            let detail = Some(DetailVoxel { barriers, ..DetailVoxel::new(offset, layer, plane) });
            places.push(ReceiverPlace { voxel: patch.voxel, direction: patch.direction, detail });
        }
    }
    for index in 0..patch_count {
        let voxel = VoxelCoord::new(-32 + index as i32 / 9, index as i32 % 9, 81);
        let facing = Direction::ALL.into_iter().filter(|_| dice.below(6) == 0);
        places.extend(facing.map(|direction| ReceiverPlace::in_air(voxel, direction)));
    }
    places.sort_by_key(ReceiverPlace::order);
    let rows = random_rows(id, places.len(), patch_count, row_max, dice);
    Receivers { places, rows }
}

/// A barrier of a layer that faces `direction`, or in two of three cases none.
fn barrier(direction: Direction, dice: &mut Dice) -> Option<Barrier> {
    let towards = dice.vector() - 0.5;
    let distance = Barrier::REACH * (2.0 * dice.unit() - 1.0);
    if dice.below(3) == 0 { Barrier::new(direction, towards, distance) } else { None }
}

fn random_patch(index: usize, points: &mut Vec<SamplePoint>, dice: &mut Dice) -> Patch {
    let point_first = points.len() as u32;
    for _ in 0..1 + dice.below(4) {
        let position = Vec3::new(-32.0, 0.0, 80.0) + dice.vector() * 16.2;
        points.push(SamplePoint { position, normal: (dice.vector() - 0.5).normalize_or(Vec3::X) });
    }
    Patch {
        voxel: VoxelCoord::new(-32 + index as i32 % 16, index as i32 / 16, 80),
        direction: Direction::ALL[dice.below(6)],
        area: 0.01 + dice.unit(),
        centroid: dice.vector() * 16.0,
        reflectance: dice.vector() * 0.98,
        emission: if dice.below(8) == 0 { dice.vector() * 1e4 } else { Vec3::ZERO },
        point_first,
        point_count: points.len() as u32 - point_first,
    }
}

fn random_rows(
    id: ChunkId,
    row_count: usize,
    patch_count: usize,
    row_max: usize,
    dice: &mut Dice,
) -> ChunkRows {
    let mut segments = vec![id];
    for _ in 0..dice.below(5) {
        segments.push(ChunkId::new(id.level, id.coord + ChunkCoord::X * (1 + dice.below(4) as i32)));
    }
    segments.sort_unstable();
    segments.dedup();
    let mut rows = ChunkRows { segments, row_starts: vec![0], ..ChunkRows::default() };
    for _ in 0..row_count {
        let length = if dice.below(5) == 0 { 0 } else { dice.below(row_max + 1) };
        let mut columns: Vec<Column> = (0..length)
            .map(|_| {
                let segment = dice.below(rows.segments.len());
                let own = rows.segments[segment] == id;
                let spread = if own { patch_count } else { [40, 3000, 1 << 16][dice.below(3)] };
                Column { segment: segment as u16, local: dice.below(spread) as u16 }
            })
            .collect();
        columns.sort_unstable();
        columns.dedup();
        let mut values: Vec<f64> =
            (0..columns.len() + 7).map(|_| 10f64.powf(f64::from(dice.unit()) * -9.0)).collect();
        if dice.below(3) == 0 {
            values[0] = 0.0;
        }
        let sum: f64 = values.iter().sum();
        let mut values = values.into_iter().map(|value| (value / sum) as f32);
        rows.sky_shares.push(std::array::from_fn(|_| values.next().expect("seven more than columns")));
        rows.absorbed_shares.push(values.next().expect("seven more than columns"));
        rows.shares.extend(values);
        rows.columns.extend(columns);
        rows.row_starts.push(rows.columns.len() as u32);
    }
    rows
}

/// Writes `chunks` (ascending by id) as a world into `folder`.
pub(crate) fn write_world(folder: &Path, chunks: &[Chunk], options: &EncodeOptions) -> Manifest {
    let mut entries = Vec::new();
    for chunk in chunks {
        let bytes = encode(chunk, options).expect("a sound chunk");
        let file = tile_file_name(chunk.id, tile_hash(&bytes));
        write_atomic(&folder.join(&file), &bytes).expect("a folder with room");
        entries.push(ChunkEntry {
            level: chunk.id.level,
            coord: chunk.id.coord.to_array(),
            file,
            tile_bytes: bytes.len() as u64,
            tile_hash: tile_hash(&bytes),
            input_hash: u64::MAX - entries.len() as u64,
            patch_count: chunk.patches.len() as u32,
            nonzero_count: chunk.rows.columns.len() as u64,
            receiver_count: chunk.receivers.places.len() as u32,
            receiver_nonzero_count: chunk.receivers.rows.columns.len() as u64,
        });
    }
    let manifest = Manifest {
        format_version: format::VERSION,
        world_hash: options.world_hash,
        content_hash: 1,
        scene: "test".to_owned(),
        parameters: BakeParameters::default(),
        bounds: Bounds { min: Vec3::splat(-100.0), max: Vec3::splat(100.0) },
        lights: LightRig::emission_only(),
        chunks: entries,
    };
    manifest.save(folder).expect("a folder with room");
    manifest
}
