//! A small town, for realistic rows: blocks of buildings on a 1 m grid, form factors between the centres
//! of voxel faces that see each other, with the scatter that rays would give.

use super::Dice;
use earthshine_world::{
    Chunk, ChunkCoord, ChunkId, ChunkRows, Column, Direction, OccluderMesh, Patch, Receivers, SamplePoint,
    Vec3, VoxelCoord,
};

const CHUNK_EDGE: i32 = 16;
/// Form factors below this are cut.
const SHARE_MIN: f32 = 2e-6;

/// Heights of the town's columns of voxels, in a square of `chunks` x `chunks` chunks.
struct Heights {
    edge: i32,
    heights: Vec<i32>,
}

impl Heights {
    fn new(chunks: i32, dice: &mut Dice) -> Self {
        let edge = chunks * CHUNK_EDGE;
        let mut heights = vec![0; (edge * edge) as usize];
        for lot_x in (0..edge).step_by(12) {
            for lot_z in (0..edge).step_by(12) {
                let height = 3 + dice.below(10) as i32;
                let inset = 2 + dice.below(3) as i32;
                for x in lot_x + inset..(lot_x + 11).min(edge) {
                    for z in lot_z + inset..(lot_z + 11).min(edge) {
                        heights[(x * edge + z) as usize] = height;
                    }
                }
            }
        }
        Self { edge, heights }
    }

    fn at(&self, x: i32, z: i32) -> i32 {
        if (0..self.edge).contains(&x) && (0..self.edge).contains(&z) {
            self.heights[(x * self.edge + z) as usize]
        } else {
            0
        }
    }

    fn sees(&self, from: Vec3, to: Vec3) -> bool {
        let steps = ((to - from).length() * 1.5).ceil();
        (1..steps as i32).all(|step| {
            let p = from.lerp(to, step as f32 / steps);
            p.y >= self.at(p.x.floor() as i32, p.z.floor() as i32) as f32
        })
    }

    /// The exposed faces of one chunk in storage order: direction, then Morton code of the voxel.
    fn faces(&self, chunk_x: i32, chunk_z: i32) -> Vec<(Vec3, Direction)> {
        let mut faces = Vec::new();
        for x in chunk_x * CHUNK_EDGE..(chunk_x + 1) * CHUNK_EDGE {
            for z in chunk_z * CHUNK_EDGE..(chunk_z + 1) * CHUNK_EDGE {
                let height = self.at(x, z);
                faces.push(([x, height, z], Direction::PosY));
                let sides = [
                    (1, 0, Direction::PosX),
                    (-1, 0, Direction::NegX),
                    (0, 1, Direction::PosZ),
                    (0, -1, Direction::NegZ),
                ];
                for (dx, dz, direction) in sides {
                    faces.extend((height..self.at(x - dx, z - dz)).map(|y| ([x, y, z], direction)));
                }
            }
        }
        faces.sort_by_key(|&(voxel, direction)| (direction, morton(voxel)));
        faces
            .into_iter()
            .map(|(voxel, direction)| {
                let centre = Vec3::from_array(voxel.map(|c| c as f32 + 0.5));
                (centre - direction.vector() * 0.49, direction)
            })
            .collect()
    }
}

fn morton([x, y, z]: [i32; 3]) -> u64 {
    (0..8)
        .map(|bit| {
            let at = |c: i32| u64::from((c >> bit & 1) as u32);
            (at(x) | at(y) << 1 | at(z) << 2) << (3 * bit)
        })
        .sum()
}

/// The chunks in the middle row of a town of `chunks` x `chunks` chunks. Their columns point into all.
pub(crate) fn town(chunks: i32, seed: u64) -> Vec<Chunk> {
    let mut dice = Dice::new(seed);
    let heights = Heights::new(chunks, &mut dice);
    let id = |x: i32, z: i32| ChunkId::new(0, ChunkCoord::new(x, 0, z));
    let places: Vec<(i32, i32)> = (0..chunks).flat_map(|x| (0..chunks).map(move |z| (x, z))).collect();
    let segments: Vec<ChunkId> = places.iter().map(|&(x, z)| id(x, z)).collect();
    let faces: Vec<Vec<(Vec3, Direction)>> = places.iter().map(|&(x, z)| heights.faces(x, z)).collect();
    (0..places.len())
        .filter(|&own| places[own].0 == chunks / 2)
        .map(|own| {
            let mut rows =
                ChunkRows { segments: segments.clone(), row_starts: vec![0], ..ChunkRows::default() };
            for &face in &faces[own] {
                push_row(&mut rows, face.1, row(face, &faces, &heights, &mut dice));
            }
            chunk(segments[own], &faces[own], rows, &mut dice)
        })
        .collect()
}

fn row(
    (from, facing): (Vec3, Direction),
    faces: &[Vec<(Vec3, Direction)>],
    heights: &Heights,
    dice: &mut Dice,
) -> Vec<(Column, f32)> {
    let mut entries = Vec::new();
    for (segment, faces) in faces.iter().enumerate() {
        for (local, &(to, other)) in faces.iter().enumerate() {
            let way = to - from;
            let (here, there) = (way.dot(facing.vector()), -way.dot(other.vector()));
            let square = way.length_squared();
            let share = here * there / (std::f32::consts::PI * square * square + 0.5);
            if here > 0.0 && there > 0.0 && share > SHARE_MIN && heights.sees(from, to) {
                let scatter = 0.6 + 0.8 * dice.unit();
                entries.push((Column { segment: segment as u16, local: local as u16 }, share * scatter));
            }
        }
    }
    entries
}

fn push_row(rows: &mut ChunkRows, direction: Direction, mut entries: Vec<(Column, f32)>) {
    let sum: f32 = entries.iter().map(|entry| entry.1).sum();
    if sum > 0.95 {
        entries.iter_mut().for_each(|entry| entry.1 *= 0.95 / sum);
    }
    let rest = 1.0 - entries.iter().map(|entry| f64::from(entry.1)).sum::<f64>();
    let mut sky = [0.0; 6];
    sky[Direction::PosY.index()] = (rest * 0.6) as f32;
    sky[direction.index()] += (rest * 0.37) as f32;
    rows.sky_shares.push(sky);
    rows.absorbed_shares.push((rest * 0.03) as f32);
    rows.columns.extend(entries.iter().map(|entry| entry.0));
    rows.shares.extend(entries.iter().map(|entry| entry.1));
    rows.row_starts.push(rows.columns.len() as u32);
}

fn chunk(id: ChunkId, faces: &[(Vec3, Direction)], rows: ChunkRows, dice: &mut Dice) -> Chunk {
    let mut points = Vec::new();
    let mut occluders = OccluderMesh::default();
    let patches = faces
        .iter()
        .enumerate()
        .map(|(index, &(centroid, direction))| {
            let across = Vec3::ONE - direction.vector().abs();
            points.extend((0..16).map(|_| SamplePoint {
                position: centroid + (dice.vector() - 0.5) * across,
                normal: direction.vector(),
            }));
            let first = occluders.vertices.len() as u32;
            occluders.vertices.extend((0..3).map(|_| centroid + (dice.vector() - 0.5) * across));
            occluders.triangles.push([first, first + 1, first + 2]);
            occluders.surfaces.push([128, 128, 128, 255]);
            Patch {
                voxel: VoxelCoord::from_array(centroid.floor().as_ivec3().to_array()),
                direction,
                area: 1.0,
                centroid,
                reflectance: dice.vector() * 0.9,
                emission: Vec3::ZERO,
                point_first: index as u32 * 16,
                point_count: 16,
            }
        })
        .collect();
    Chunk { id, patches, points, rows, receivers: Receivers::default(), occluders }
}
