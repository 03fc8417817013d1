//! A lamp that is small beside a voxel, over a floor whose detail voxels have two layers each, against its closed form.

use earthshine_bake::{BakeOptions, Levels, MemoryLimit, Shard, Silent, bake};
use earthshine_scene::{Material, Scene};
use earthshine_tiles::{BakeParameters, DirStore, RowCodec, TileStore};
use earthshine_world::{Chunk, Direction, Grid, LightRig, Rgb, Vec3};
use std::f64::consts::PI;

/// Half of each strip's period, m: a detail voxel has one of each height.
const HALF_M: f32 = 0.25;
/// Heights of the strips, m.
const LOW_M: f32 = 0.5;
const HIGH_M: f32 = 0.6;
/// Edge of the floor, m.
const EDGE_M: f32 = 2.0;
/// Low corner of the lamp, which faces down, and its edge, m.
const LAMP: Vec3 = Vec3::new(1.2, 1.7, 1.2);
const LAMP_EDGE_M: f32 = 0.1;

fn quad(corner: Vec3, e1: Vec3, e2: Vec3) -> [[Vec3; 3]; 2] {
    [[corner, corner + e1, corner + e1 + e2], [corner, corner + e1 + e2, corner + e2]]
}

fn scene() -> Scene {
    let strip = |number: u16| {
        let height = if number.is_multiple_of(2) { LOW_M } else { HIGH_M };
        quad(Vec3::new(f32::from(number) * HALF_M, height, 0.0), Vec3::Z * EDGE_M, Vec3::X * HALF_M)
    };
    let floor: Vec<_> = (0..8).flat_map(strip).collect();
    let lamp = quad(LAMP, Vec3::X * LAMP_EDGE_M, Vec3::Z * LAMP_EDGE_M);
    let grey = Material {
        name: "grey".to_owned(),
        base_colour: [0.5; 4],
        base_colour_texture: None,
        emitted_radiance: Rgb::ZERO,
        emissive_texture: None,
        alpha_cutoff: None,
        double_sided: false,
        metallic: 0.0,
    };
    let glow = Material { name: "glow".to_owned(), emitted_radiance: Rgb::splat(100.0), ..grey.clone() };
    let material_of = [vec![0; floor.len()], vec![1; 2]].concat();
    let triangles = [floor, lamp.to_vec()].concat();
    Scene {
        texture_coordinates: vec![[[0.0; 2]; 3]; triangles.len()],
        triangles,
        material_of,
        materials: vec![grey, glow],
        ..Scene::default()
    }
}

fn chunks(parameters: BakeParameters) -> Vec<Chunk> {
    let folder = tempfile::tempdir().expect("a folder");
    let options = BakeOptions {
        parameters,
        codec: RowCodec::Half,
        scene_name: "strips".to_owned(),
        lights: LightRig::emission_only(),
        overwrite: false,
        levels: Levels::Exactly(1),
        shard: Shard::default(),
        memory: MemoryLimit::default(),
        discard_work: false,
    };
    bake(&scene(), folder.path(), &options, &Silent).expect("a bake");
    let store = DirStore::open(folder.path()).expect("a world");
    let ids = store.manifest().index().chunks;
    ids.iter().map(|chunk| store.load(chunk.id).expect("a sound tile")).collect()
}

/// Share of the lamp in what arrives at the strip of `height` that begins at `x`, between `z` and a strip's two widths on.
fn expected(x: f64, z: f64, height: f64) -> f64 {
    const STEPS: u32 = 24;
    let middle = |i: u32, edge: f64, steps: u32| (f64::from(i) + 0.5) / f64::from(steps) * edge;
    let (half, lamp) = (f64::from(HALF_M), LAMP.as_dvec3());
    let edge = f64::from(LAMP_EDGE_M);
    let rise = lamp.y - height;
    // Where a ray from a low strip passes the height of the others.
    let at = (f64::from(HIGH_M) - height) / rise;
    let mut sum = 0.0;
    for i in 0..STEPS * STEPS {
        let (px, pz) = (x + middle(i % STEPS, half, STEPS), z + middle(i / STEPS, 2.0 * half, STEPS));
        for j in 0..16 {
            let (across, along) =
                (lamp.x + middle(j % 4, edge, 4) - px, lamp.z + middle(j / 4, edge, 4) - pz);
            let is_shaded = at > 0.0 && ((px + across * at) / half).floor().rem_euclid(2.0) == 1.0;
            let squared = across * across + along * along + rise * rise;
            sum += if is_shaded { 0.0 } else { rise * rise / (PI * squared * squared) };
        }
    }
    sum / f64::from(STEPS * STEPS * 16) * edge * edge
}

/// Goal: what an emitter sees of a layer is told of that layer. Method: parts cast 64 rays, of which hardly any meets the lamp,
/// so what they know of it is the lamp's own rays.
#[test]
fn each_layer_has_the_light_of_a_lamp_that_its_own_rays_miss() {
    let chunks = chunks(BakeParameters {
        grid: Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 4 },
        rays_per_patch: 1 << 18,
        detail: 2,
        detail_rays: 64,
        two_sided: false,
        samples_per_voxel_face: 64,
        ..BakeParameters::default()
    });
    let [chunk] = &chunks[..] else { panic!("{} chunks", chunks.len()) };
    let (mut parts, mut worst) = (0, 0.0f64);
    for (row, place) in chunk.receivers.places.iter().enumerate() {
        let Some(detail) = place.detail.filter(|_| place.direction == Direction::PosY) else { continue };
        let coord = detail.coord(place.voxel, 2);
        let is_high = detail.plane.offset_along(1) > 0.1;
        let x = f64::from(coord.x) * 0.5 + if is_high { f64::from(HALF_M) } else { 0.0 };
        let height = f64::from(if is_high { HIGH_M } else { LOW_M });
        let of_lamp =
            |(column, _): &(earthshine_world::Column, f32)| chunk.patches[usize::from(column.local)].emits();
        let found: f64 =
            chunk.receivers.rows.row(row).filter(of_lamp).map(|(_, share)| f64::from(share)).sum();
        let wanted = expected(x, f64::from(coord.z) * 0.5, height);
        worst = worst.max((found / wanted - 1.0).abs());
        parts += 1;
    }
    assert_eq!(parts, 32, "two layers in each of sixteen detail voxels");
    assert!(worst < 0.08, "off by {worst}");
}
