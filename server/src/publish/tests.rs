//! A store is right if a client that applies its deltas, any of them skipped, holds the frame's light.

use super::*;
use earthshine_engine::SessionId;
use earthshine_world::{Barrier, Direction, random};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// Goal: a device tells what the published code of is another. Method: its unit is this one; its codes are held against
/// `rgb9e5` by the tests of `earthshine-gpu`.
#[test]
fn the_unit_of_light_is_the_devices() {
    let declared = format!("const LIGHT_UNIT_LX: f32 = {LIGHT_UNIT_LX:?};");
    for kernel in [earthshine_shaders::kernel::COUNT_NEWS, earthshine_shaders::kernel::LIST_NEWS] {
        assert!(kernel.source.contains(&declared), "{} does not say {declared}", kernel.name);
    }
}

fn frame(lights: &[(IVec3, f32)]) -> Frame {
    static NUMBER: AtomicU64 = AtomicU64::new(1);
    let mut patches: Vec<_> = lights
        .iter()
        .map(|&(voxel, light)| PatchLight {
            voxel,
            direction: Direction::PosY,
            irradiance: Vec3::splat(light),
            sky_irradiance: Vec3::splat(light * 0.5),
            plane_offset: Some(0.5),
            layer: 0,
            tilt: None,
            barriers: [None; Barrier::PER_LAYER_MAX],
            known_share: 1.0,
            far_share: 0.0,
            fed_share: 0.0,
            staleness: 0,
        })
        .collect();
    patches.sort_by_key(|patch| patch.voxel.to_array());
    Frame {
        session: SessionId(1),
        number: NUMBER.fetch_add(1, Ordering::Relaxed),
        time_s: 1.0,
        voxel_edge_m: 1.0,
        patches: patches.into(),
        receivers: Arc::default(),
        details: Arc::default(),
        coarse: Vec::new(),
        quality: FrameQuality::default(),
    }
}

fn at(x: f32) -> Answered {
    Answered { sequence: 1, position: Vec3::new(x, 0.5, 0.5) }
}

fn store() -> DeltaStore {
    DeltaStore::new(0, UVec3::splat(16), 1.0, 4)
}

/// A client as the schema describes it.
#[derive(Default)]
struct Model {
    voxels: BTreeMap<[i32; 3], VoxelCodes>,
    generation: u64,
}

impl Model {
    fn follow(&mut self, layout: &Layout) {
        self.voxels.retain(|&voxel, _| layout.index_of(IVec3::from_array(voxel)).is_some());
    }

    fn apply(&mut self, layout: &Layout, changes: &Changes) {
        assert!(changes.from <= self.generation && self.generation <= changes.to);
        if changes.from == 0 {
            self.voxels.clear();
        }
        for &(index, codes) in &changes.voxels {
            self.voxels.insert(layout.voxel_of(index).to_array(), codes);
        }
        self.voxels.retain(|_, codes| codes.present != 0);
        self.generation = changes.to;
    }
}

#[test]
fn only_what_changed_is_sent_and_what_vanished_is_said() {
    let mut store = store();
    let (a, b) = (IVec3::new(1, 0, 0), IVec3::new(2, 0, 0));
    assert!(store.absorb(&frame(&[(a, 1.0), (b, 2.0)]), at(0.0), true));
    let first = store.delta_since(0).unwrap();
    assert_eq!((first.from, first.to, first.voxels.len()), (0, 1, 2));

    assert!(!store.absorb(&frame(&[(a, 1.0), (b, 3.0)]), at(0.0), true));
    assert_eq!(store.delta_since(1).unwrap().voxels.len(), 1);
    store.absorb(&frame(&[(b, 3.0)]), at(0.0), true);
    let gone = store.delta_since(2).unwrap();
    assert_eq!((gone.voxels.len(), gone.voxels[0].1.present), (1, 0));
    // From 0 the client starts empty: nothing to say of what is not there.
    assert_eq!(store.delta_since(0).unwrap().voxels.len(), 1);
}

#[test]
fn a_change_too_small_for_the_wire_is_no_news() {
    let mut store = store();
    let voxel = IVec3::ZERO;
    store.absorb(&frame(&[(voxel, 1.0)]), at(0.0), true);
    store.absorb(&frame(&[(voxel, 1.000_01)]), at(0.0), true);
    assert_eq!(store.generation(), 1);
    assert_eq!(store.delta_since(1), None);
}

#[test]
fn a_newer_camera_is_news_without_voxels() {
    let mut store = store();
    store.absorb(&frame(&[(IVec3::ZERO, 1.0)]), at(0.0), true);
    store.absorb(&frame(&[(IVec3::ZERO, 1.0)]), Answered { sequence: 2, ..at(0.1) }, true);
    let changes = store.delta_since(1).unwrap();
    assert_eq!((changes.voxels.len(), changes.caption.camera_sequence), (0, 2));
}

#[test]
fn a_client_from_before_the_forgotten_starts_over() {
    let mut store = store();
    store.absorb(&frame(&[(IVec3::ZERO, 1.0), (IVec3::ONE, 1.0)]), at(0.0), true);
    store.absorb(&frame(&[(IVec3::ONE, 1.0)]), at(0.0), true);
    store.absorb(&frame(&[(IVec3::ONE, 2.0)]), at(0.0), true);
    store.forget_emptied(2);
    assert_eq!(store.delta_since(1).unwrap().from, 0);
    assert_eq!(store.delta_since(2).unwrap().from, 2);
}

#[test]
fn a_trembling_camera_does_not_move_the_volume_and_a_travelling_one_does() {
    let mut store = store();
    store.absorb(&frame(&[]), at(0.1), true);
    for x in [-0.1, 3.9, 0.2, -3.5] {
        assert!(!store.absorb(&frame(&[]), at(x), true), "{x}");
    }
    assert!(store.absorb(&frame(&[]), at(9.0), true));
    assert!(!store.absorb(&frame(&[]), at(8.9), true) && !store.absorb(&frame(&[]), at(9.1), true));
    let middle = store.layout().origin + 8;
    assert!((9 - middle.x).abs() <= 4, "{middle}");
    // Far out, where voxels can hardly be numbered.
    assert!(store.absorb(&frame(&[]), at(-1e30), true));
    store.layout().validate().unwrap();
}

/// Goal: whatever a slow client skips, it ends with the frame's light.
/// Method: random lights appear, change and vanish while the camera travels; a client takes every third
/// state, one every eleventh, one loses everything now and then.
#[test]
fn clients_of_any_pace_end_with_the_same_light() {
    let mut store = store();
    let mut clients = [Model::default(), Model::default(), Model::default()];
    for step in 0..400u64 {
        let random = |a: u64, b: u64| random::hash(step / 3, random::Purpose::Simulation, a, b);
        let centre = (random(0, 0) % 5) as i32 * 4;
        let lights: Vec<_> = (0..12u64)
            .map(|i| {
                let offset = |axis: u64| (random(i, axis) % 10) as i32 - 5;
                ([centre + offset(1), offset(2), offset(3)], (random(i, 4) % 3) as f32)
            })
            .collect::<BTreeMap<_, _>>()
            .into_iter()
            .map(|(voxel, light)| (IVec3::from_array(voxel), light))
            .collect();
        if store.absorb(&frame(&lights), at(centre as f32), true) {
            // Every move is announced, whether or not a delta follows.
            clients.iter_mut().for_each(|client| client.follow(store.layout()));
        }
        for (client, pace) in clients.iter_mut().zip([3, 11, 7]) {
            if step % pace == 0 {
                if pace == 7 && step % 5 == 0 {
                    *client = Model::default();
                }
                if let Some(changes) = store.delta_since(client.generation) {
                    client.apply(store.layout(), &changes);
                }
            }
        }
        if step == 150 {
            store.forget_emptied(store.generation() - 4);
        }
    }
    let layout = *store.layout();
    let whole = store.delta_since(0).unwrap();
    let mut fresh = Model::default();
    fresh.apply(&layout, &whole);
    assert!(!fresh.voxels.is_empty());
    for client in &mut clients {
        if let Some(changes) = store.delta_since(client.generation) {
            client.apply(&layout, &changes);
        }
        assert_eq!(client.voxels, fresh.voxels);
    }
}

/// Goal: clients read planes as the bake wrote them. Method: normals of all octants and along all axes, points in their planes and
/// beside them.
#[test]
fn clients_read_planes_as_they_were_written() {
    for at in 0..27 {
        let axis = |place: i32| (at / place % 3 - 1) as f32;
        let Some(normal) = Vec3::new(axis(1), axis(3) * 0.7, axis(9) * 0.4).try_normalize() else { continue };
        for distance in [-0.45, 0.0, 0.3] {
            let code = SurfacePlane::new(normal, distance).code();
            let trust = |along: f32, normal: Vec3| {
                let distance = tilt::distance(code, normal * along).expect("it is told");
                tilt::trust(code, distance, normal)
            };
            assert!(trust(distance, normal) > 0.8, "{normal} {distance}: {}", trust(distance, normal));
            assert!(trust(distance + 0.3, normal) < 0.1);
            assert!(trust(distance, -normal) < 0.01);
        }
    }
}

/// Goal: clients read barriers as the bake wrote them. Method: walls of all directions all around and at all distances, points on
/// and a little off them.
#[test]
fn clients_read_barriers_as_they_were_written() {
    let codes = (0..=255u8).flat_map(|angle| (0..=255u8).map(move |distance| [angle, distance]));
    for code in codes {
        assert_eq!(barrier::is_code(code), Barrier::from_code(code).is_ok(), "{code:?}");
        let Ok(Some(wall)) = Barrier::from_code(code) else { continue };
        for direction in Direction::ALL {
            let along = wall.towards(direction).cross(direction.vector()) + 3.0 * direction.vector();
            let trust = |beyond: f32| {
                let at = wall.towards(direction) * (wall.middle_distance() + beyond) + along;
                barrier::trust(Barrier::codes([None, Some(wall)]), direction.axis(), at)
            };
            assert_eq!(trust(-1e-4), 1.0, "{wall:?} {direction:?}");
            assert!((trust(barrier::BEYOND_REACH_VOXELS) - 0.0625).abs() < 1e-4, "{wall:?} {direction:?}");
        }
    }
    assert_eq!(barrier::BARRIER_REACH_VOXELS, Barrier::REACH);
    assert_eq!(Barrier::codes([None; Barrier::PER_LAYER_MAX]), barrier::NONE);
}

/// Goal: each layer of detail is a volume of its own, in one place, and says in which planes its surfaces lie and where walls end
/// them. Method: two layers in one detail voxel, one alone in another.
#[test]
fn layers_of_detail_go_into_volumes_of_their_own() {
    let tilt = |distance: f32| SurfacePlane::new(Vec3::Y, distance);
    let wall = Barrier::new(Direction::PosY, Vec3::X, 0.25);
    let mut frame = frame(&[(IVec3::ZERO, 1.0), (IVec3::ZERO, 2.0), (IVec3::X, 3.0)]);
    let details: Vec<PatchLight> = frame
        .patches
        .iter()
        .zip([(0, tilt(0.25)), (1, tilt(-0.5)), (0, tilt(0.0))])
        .map(|(light, (layer, plane))| {
            let barriers = [wall.filter(|_| layer == 1), None];
            PatchLight { layer, tilt: Some(plane), barriers, ..*light }
        })
        .collect();
    frame.details = details.into();
    let told = |layer: u8| {
        let mut store = DeltaStore::of_detail(layer, UVec3::splat(16), 1.0, 4);
        assert!(store.absorb(&frame, at(0.0), true));
        let changes = store.delta_since(0).unwrap();
        assert_eq!(changes.volume, DETAIL_VOLUME + u32::from(layer));
        let code = |&(_, codes): &(u32, VoxelCodes)| {
            (rgb9e5::decode(codes.irradiance[2]).x * LIGHT_UNIT_LX, codes.tilt[2], codes.barriers[2])
        };
        (*store.layout(), changes.voxels.iter().map(code).collect::<Vec<_>>())
    };
    let (first, second, third) = (told(0), told(1), told(2));
    let expected = [(1.0, tilt(0.25).code(), barrier::NONE), (3.0, tilt(0.0).code(), barrier::NONE)];
    assert_eq!(first.1, expected);
    assert_eq!(second.1, [(2.0, tilt(-0.5).code(), Barrier::codes([wall, None]))]);
    assert!(third.1.is_empty());
    assert_eq!((first.0, first.0), (second.0, third.0));
}
