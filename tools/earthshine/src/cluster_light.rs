//! The light of clustered patches in a volume of six directions.
//!
//! A cluster has a normal of its own. Its light goes to each direction that it faces with the weight `area * n_a^2`,
//! and a voxel's direction holds the mean over its clusters by these weights. What a cluster's normal is, its sample
//! points say: each stands for an equal share of the area.

use crate::whole_world::WholeLight;
use earthshine_bake::sample::side_weights;
use earthshine_volume::Volume;
use earthshine_world::{AxisWeights, Chunk, Rgb, VoxelCoord};

/// One cluster's part in one voxel and direction.
struct Part {
    voxel: VoxelCoord,
    direction: usize,
    /// m2.
    weight: f32,
    irradiance: Rgb,
    sky_irradiance: Rgb,
}

/// Puts the light of all patches of `chunks` into `volume`.
pub(crate) fn fill(volume: &mut Volume, chunks: &[Chunk], light: &WholeLight) {
    let patches = chunks.iter().flat_map(|chunk| chunk.patches.iter().map(move |patch| (chunk, patch)));
    let mut parts = Vec::new();
    for (index, (chunk, patch)) in patches.enumerate() {
        let points = chunk.points_of(patch);
        let mut weights = [0.0f32; 6];
        for point in points {
            for (direction, weight) in side_weights(AxisWeights::Squared, point.normal) {
                weights[direction.index()] += weight * patch.area / points.len() as f32;
            }
        }
        let lit = (0..6).filter(|&direction| weights[direction] > 0.0);
        parts.extend(lit.map(|direction| Part {
            voxel: patch.voxel,
            direction,
            weight: weights[direction],
            irradiance: light.irradiance[index],
            sky_irradiance: light.sky_irradiance[index],
        }));
    }
    let place = |part: &Part| (part.voxel.to_array(), part.direction);
    parts.sort_by_key(place);
    for run in parts.chunk_by(|a, b| place(a) == place(b)) {
        let total: f32 = run.iter().map(|part| part.weight).sum();
        let mean = |of: fn(&Part) -> Rgb| run.iter().map(|part| of(part) * part.weight).sum::<Rgb>() / total;
        let (all, sky) = (mean(|part| part.irradiance), mean(|part| part.sky_irradiance));
        volume.set_patch(run[0].voxel, run[0].direction, all, sky, u8::MAX);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_volume::Layout;
    use earthshine_world::{ChunkId, ChunkRows, Direction, Patch, SamplePoint, Vec3};

    fn chunk(clusters: &[(Vec3, f32)]) -> Chunk {
        let patch = |(index, &(_, area)): (usize, &(Vec3, f32))| Patch {
            voxel: VoxelCoord::ZERO,
            direction: Direction::PosY,
            area,
            centroid: Vec3::splat(0.5),
            reflectance: Rgb::ONE,
            emission: Rgb::ZERO,
            point_first: index as u32,
            point_count: 1,
        };
        let point = |&(normal, _): &(Vec3, f32)| SamplePoint {
            position: Vec3::splat(0.5),
            normal: normal.normalize_or(Vec3::Y),
        };
        Chunk {
            id: ChunkId::new(0, glam::IVec3::ZERO),
            patches: clusters.iter().enumerate().map(patch).collect(),
            points: clusters.iter().map(point).collect(),
            rows: ChunkRows::default(),
            receivers: earthshine_world::Receivers::default(),
            occluders: earthshine_world::OccluderMesh::default(),
        }
    }

    #[test]
    fn clusters_of_a_voxel_share_a_direction_by_area_and_squared_cosine() {
        // Two floors, and a slope that leans to +X and +Y alike.
        let chunk = chunk(&[(Vec3::Y, 1.0), (Vec3::Y, 3.0), (Vec3::new(1.0, 1.0, 0.0), 4.0)]);
        let light = WholeLight {
            irradiance: vec![Rgb::splat(10.0), Rgb::splat(20.0), Rgb::splat(40.0)],
            sky_irradiance: vec![Rgb::ZERO, Rgb::ZERO, Rgb::splat(8.0)],
            direct_exitance: vec![],
            near: vec![],
            sky: earthshine_world::Sky::default(),
        };
        let layout = Layout { level: 0, origin: VoxelCoord::ZERO, dims: glam::UVec3::ONE, voxel_edge_m: 1.0 };
        let mut volume = Volume::new(layout).expect("a layout");
        fill(&mut volume, &[chunk], &light);
        let voxel = volume.at(VoxelCoord::ZERO).expect("light");
        let up = Direction::PosY.index();
        assert!((voxel.irradiance[up].x - (10.0 + 3.0 * 20.0 + 2.0 * 40.0) / 6.0).abs() < 1e-4);
        assert!((voxel.sky_irradiance[up].x - 2.0 * 8.0 / 6.0).abs() < 1e-5);
        assert!((voxel.irradiance[Direction::PosX.index()].x - 40.0).abs() < 1e-4);
        assert_eq!(voxel.present, 0b101);
    }
}
