//! What parts of detail know of lamps by the lamps' own rays, against closed forms: layers under a lamp that is small beside a
//! voxel, what lies right behind a lamp, and a floor beside one.

use earthshine_bake::{BakeOptions, Levels, Silent, bake};
use earthshine_scene::{Material, Scene};
use earthshine_tiles::{BakeParameters, DirStore, TileStore};
use earthshine_world::{Chunk, Column, DetailVoxel, Direction, Grid, LightRig, Rgb, Vec3, VoxelCoord};
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

/// Of what does not emit, what emits ahead, and what emits on both sides.
fn scene([dark, glowing, sheets]: [Vec<[Vec3; 3]>; 3]) -> Scene {
    let grey = Material::grey("grey", 0.5);
    let glow = Material { name: "glow".to_owned(), emitted_radiance: Rgb::splat(100.0), ..grey.clone() };
    let sheet = Material { name: "sheet".to_owned(), double_sided: true, ..glow.clone() };
    let material_of = [vec![0; dark.len()], vec![1; glowing.len()], vec![2; sheets.len()]].concat();
    let triangles = [dark, glowing, sheets].concat();
    Scene {
        texture_coordinates: vec![[[0.0; 2]; 3]; triangles.len()],
        triangles,
        material_of,
        materials: vec![grey, glow, sheet],
        ..Scene::default()
    }
}

fn strips() -> Scene {
    let strip = |number: u16| {
        let height = if number.is_multiple_of(2) { LOW_M } else { HIGH_M };
        quad(Vec3::new(f32::from(number) * HALF_M, height, 0.0), Vec3::Z * EDGE_M, Vec3::X * HALF_M)
    };
    let lamp = quad(LAMP, Vec3::X * LAMP_EDGE_M, Vec3::Z * LAMP_EDGE_M);
    scene([(0..8).flat_map(strip).collect(), lamp.to_vec(), Vec::new()])
}

/// The only chunk of a bake in voxels of a metre, whose parts cast 64 rays, of which few meet a lamp: what they know of it is
/// the lamp's own rays, which begin on so many points of a voxel's face.
fn baked(scene: &Scene, samples_per_voxel_face: u32) -> Chunk {
    let folder = tempfile::tempdir().expect("a folder");
    let parameters = BakeParameters {
        grid: Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 4 },
        rays_per_patch: 1 << 18,
        detail: 2,
        detail_rays: 64,
        two_sided: false,
        samples_per_voxel_face,
        ..BakeParameters::default()
    };
    let options = BakeOptions {
        levels: Levels::Exactly(1),
        ..BakeOptions::new("lamps", parameters, LightRig::emission_only())
    };
    bake(scene, folder.path(), &options, &Silent).expect("a bake");
    let store = DirStore::open(folder.path()).expect("a world");
    let ids = store.manifest().index().chunks;
    let [chunk] = &ids[..] else { panic!("{} chunks", ids.len()) };
    store.load(chunk.id).expect("a sound tile")
}

/// Of each part that faces `direction`: its voxel and detail voxel, and the share of what emits in its row.
fn lamp_shares(chunk: &Chunk, direction: Direction) -> Vec<(VoxelCoord, DetailVoxel, f64)> {
    let of_lamp = |(column, _): &(Column, f32)| chunk.patches[usize::from(column.local)].emits();
    let share = |row: usize| {
        chunk.receivers.rows.row(row).filter(of_lamp).map(|(_, share)| f64::from(share)).sum::<f64>()
    };
    let places = chunk.receivers.places.iter().enumerate().filter(|(_, place)| place.direction == direction);
    places.filter_map(|(row, place)| Some((place.voxel, place.detail?, share(row)))).collect()
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

/// Goal: what an emitter sees of a layer is told of that layer. Method: strips of two heights under a small lamp.
#[test]
fn each_layer_has_the_light_of_a_lamp_that_its_own_rays_miss() {
    let chunk = baked(&strips(), 64);
    let (mut parts, mut worst) = (0, 0.0f64);
    for (voxel, detail, found) in lamp_shares(&chunk, Direction::PosY) {
        let coord = detail.coord(voxel, 2);
        let is_high = detail.plane.offset_along(1) > 0.1;
        let x = f64::from(coord.x) * 0.5 + if is_high { f64::from(HALF_M) } else { 0.0 };
        let height = f64::from(if is_high { HIGH_M } else { LOW_M });
        let wanted = expected(x, f64::from(coord.z) * 0.5, height);
        worst = worst.max((found / wanted - 1.0).abs());
        parts += 1;
    }
    assert_eq!(parts, 32, "two layers in each of sixteen detail voxels");
    assert!(worst < 0.08, "off by {worst}");
}

/// What a square of 1 m has of another right across from it, `distance` m off: the form factor of aligned squares.
fn across(distance: f64) -> f64 {
    let (x, one) = (1.0 / distance, 1.0 + distance.powi(-2));
    let log = 0.5 * (one * one / (1.0 + 2.0 * x * x)).ln();
    let root = one.sqrt();
    2.0 / (PI * x * x) * (log + 2.0 * x * (root * (x / root).atan() - x.atan()))
}

/// Goal: what lies behind a lamp has its light, though no patch stands for it. Method: a sheet that glows on both sides
/// below a ceiling that is hidden there by the size of voxels, and open by that of detail voxels; points lie close, as light falls
/// off within centimetres of the sheet's edge.
#[test]
fn what_lies_behind_a_lamp_has_its_light() {
    const BELOW_M: f32 = 0.12;
    let ceiling = quad(Vec3::new(0.0, 2.9, 0.0), Vec3::X, Vec3::Z);
    let sheet = quad(Vec3::new(0.0, 2.9 - BELOW_M, 0.0), Vec3::X, Vec3::Z);
    let chunk = baked(&scene([ceiling.to_vec(), Vec::new(), sheet.to_vec()]), 1024);
    let parts = lamp_shares(&chunk, Direction::NegY);
    assert_eq!(parts.len(), 4, "{parts:?}");
    for (voxel, detail, found) in parts {
        let wanted = across(f64::from(BELOW_M));
        assert!((found / wanted - 1.0).abs() < 0.03, "{voxel}, {detail:?}: {found}, not {wanted}");
    }
}

/// Goal: what lamps throw on each other is not their neighbours'. Method: a floor, half of each of whose detail voxels glows,
/// under a lamp of its size.
#[test]
fn a_floor_has_not_the_light_that_falls_on_a_lamp_in_it() {
    let half =
        |number: u16| quad(Vec3::new(0.25 * f32::from(number), 0.4, 0.0), Vec3::Z, Vec3::X * 0.25).to_vec();
    let floor = [half(0), half(2)].concat();
    let tiles = [half(1), half(3)].concat();
    let lamp = quad(Vec3::new(0.0, 1.4, 0.0), Vec3::X, Vec3::Z).to_vec();
    let chunk = baked(&scene([floor, [tiles, lamp].concat(), Vec::new()]), 64);
    let parts = lamp_shares(&chunk, Direction::PosY);
    assert_eq!(parts.len(), 4, "{parts:?}");
    // The strips lie as the whole floor does, in the mean.
    let found = parts.iter().map(|part| part.2).sum::<f64>() / 4.0;
    let wanted = across(1.0);
    assert!((found / wanted - 1.0).abs() < 0.03, "{found}, not {wanted}");
}
