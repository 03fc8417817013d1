//! The lookup rule in WGSL against the client library's, over the patches and detail of a baked town.

use crate::device::GpuDevice;
use crate::readback::read_now;
use crate::twins::device_or_skip;
use earthshine_bake::{BakeOptions, Levels, Silent, bake};
use earthshine_gen::{GenOptions, WorldKind};
use earthshine_scene::{ImportOptions, load_bytes};
use earthshine_shaders::LOOKUP_IRRADIANCE;
use earthshine_tiles::{BakeParameters, DirStore, RowCodec, TileStore as _};
use earthshine_volume::{Layout, ShaderVolumes, Volume, lookup, plane, rgb9e5};
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{Barrier, Chunk, DetailVoxel, Direction, Grid, LightRig, Vec3};
use glam::IVec3;
use wgpu::{
    BindGroupDescriptor, BindGroupEntry, BufferUsages, ComputePipelineDescriptor, ShaderModuleDescriptor,
    ShaderSource,
};

/// Asks the rule at each place: two of its own bindings, and an entry point.
const ASKING: &str = "
@group(0) @binding(3) var<storage, read> places: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> found: array<vec4<f32>>;
@compute @workgroup_size(64)
fn ask(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&found) {
        found[id.x] = lookup_irradiance(places[2u * id.x].xyz, places[2u * id.x + 1u].xyz);
    }
}";

const VOXEL_M: f32 = 2.0;
const DETAIL: u32 = 4;

/// Every chunk of two levels of a town.
fn town() -> Vec<Chunk> {
    let options = GenOptions { town_size_m: 40.0, ..GenOptions::default() };
    let glb = earthshine_gen::generate(WorldKind::Town, &options, &|_, _| {}).expect("a town");
    let scene = load_bytes(&glb.bytes, "town", &ImportOptions::default()).expect("an importable town");
    let folder = tempfile::tempdir().expect("a folder");
    let parameters = BakeParameters {
        grid: Grid { voxel_edge_m: VOXEL_M, chunk_edge_voxels: 8 },
        rays_per_patch: 64,
        receiver_rays: 64,
        receiver_reach_voxels: 2,
        detail: DETAIL,
        detail_rays: 64,
        ..BakeParameters::default()
    };
    let options = BakeOptions {
        codec: RowCodec::Full,
        levels: Levels::Exactly(2),
        discard_work: true,
        ..BakeOptions::new("town", parameters, LightRig::emission_only())
    };
    bake(&scene, folder.path(), &options, &Silent).expect("a good scene");
    let store = DirStore::open(folder.path()).expect("a world");
    let ids = store.manifest().index().chunks.into_iter().map(|chunk| chunk.id);
    ids.map(|id| store.load(id).expect("a good tile")).collect()
}

/// Some light for a patch or receiver, different in each, as it would have travelled.
fn some_light(at: IVec3, direction: usize, layer: usize) -> Vec3 {
    let [x, y, z] = at.to_array().map(|along| u64::from(along.cast_unsigned()));
    let bits = hash(x << 32 | y, Purpose::Simulation, z, (direction * 8 + layer) as u64);
    let (red, green) = unit_pair(bits);
    let light = Vec3::new(red, green, 0.5 * (red + green)) * 3e4;
    rgb9e5::decode(rgb9e5::encode(light))
}

/// Walls beside a part of detail: none, one or two in or near its detail voxel, whatever the bake found there.
fn some_barriers(at: IVec3, part: DetailVoxel, direction: Direction) -> [[u8; 2]; 2] {
    let [x, y, z] = at.to_array().map(|along| u64::from(along.cast_unsigned()));
    let random = |k: u64| {
        let place = (direction.index() as u64) << 8 | u64::from(part.layer);
        unit_pair(hash(x << 32 | y, Purpose::Simulation, z, place << 8 | k))
    };
    let (count, _) = random(0);
    let wall = |k: u64| {
        let ((across, up), (along, distance)) = (random(2 * k), random(2 * k + 1));
        let towards = 2.0 * Vec3::new(across, up, along) - 1.0;
        Barrier::new(direction, towards, 1.2 * (distance - 0.5)).filter(|_| count * 3.0 > k as f32)
    };
    Barrier::codes([wall(1), wall(2)])
}

/// Detail, level 0 and level 1, the finer ones ending within the town.
fn volumes(chunks: &[Chunk]) -> Vec<Volume> {
    let cut = |level: u8, edge_m: f32, half_m: Vec3| {
        let half = (half_m / edge_m).round().as_ivec3();
        let layout = Layout { level, origin: -half, dims: (2 * half).as_uvec3(), voxel_edge_m: edge_m };
        Volume::new(layout).expect("a small box")
    };
    let detail_m = VOXEL_M / DETAIL as f32;
    let mut details = vec![cut(0, detail_m, Vec3::new(12.0, 8.0, 8.0)); 4];
    let mut levels =
        [cut(0, VOXEL_M, Vec3::new(16.0, 16.0, 12.0)), cut(1, 2.0 * VOXEL_M, Vec3::new(40.0, 24.0, 40.0))];
    for chunk in chunks {
        let volume = &mut levels[usize::from(chunk.id.level)];
        let edge = volume.layout().voxel_edge_m;
        for patch in &chunk.patches {
            let direction = patch.direction.index();
            let light = some_light(patch.voxel, direction, 5 + usize::from(chunk.id.level));
            volume.set_patch(patch.voxel, direction, light, Vec3::ZERO, 255);
            volume.set_plane(patch.voxel, direction, plane::encode(patch.plane_offset(edge)));
        }
        for place in &chunk.receivers.places {
            let direction = place.direction.index();
            let Some(part) = place.detail else {
                let light = some_light(place.voxel, direction, 7);
                volume.set_receiver(place.voxel, direction, light, Vec3::ZERO, 255);
                continue;
            };
            let (voxel, layer) = (part.coord(place.voxel, DETAIL), usize::from(part.layer));
            details[layer].set_patch(voxel, direction, some_light(voxel, direction, layer), Vec3::ZERO, 255);
            details[layer].set_tilt(voxel, direction, part.plane.code());
            details[layer].set_barriers(voxel, direction, some_barriers(voxel, part, place.direction));
        }
    }
    assert!(details[1].lit_voxels() > 0, "a second layer somewhere");
    details.into_iter().chain(levels).collect()
}

/// On surfaces, a little off them and turned a little, and anywhere.
fn places(chunks: &[Chunk], count: usize) -> Vec<(Vec3, Vec3)> {
    let points: Vec<_> = chunks.iter().flat_map(|chunk| &chunk.points).collect();
    let random = |at: usize, k: u64| {
        let ((x, y), (z, _)) = (
            unit_pair(hash(at as u64, Purpose::MeasurePoint, k, 0)),
            unit_pair(hash(at as u64, Purpose::MeasurePoint, k, 1)),
        );
        2.0 * Vec3::new(x, y, z) - 1.0
    };
    (0..count)
        .map(|at| {
            let point = points[hash(at as u64, Purpose::MeasurePoint, 9, 9) as usize % points.len()];
            let away = [0.0, 0.02, 0.5, 3.0][at % 4];
            let normal = (point.normal + [0.0, 0.1, 0.5][at % 3] * random(at, 1)).normalize_or(Vec3::Y);
            match at % 5 {
                4 => (Vec3::new(30.0, 14.0, 30.0) * random(at, 2), random(at, 3).normalize_or(Vec3::Y)),
                _ => (point.position + away * random(at, 2), normal),
            }
        })
        .collect()
}

fn on_device(device: &GpuDevice, volumes: &[Volume], places: &[(Vec3, Vec3)]) -> Vec<[f32; 4]> {
    let words = ShaderVolumes::of(volumes);
    let asked: Vec<[f32; 4]> = places
        .iter()
        .flat_map(|(at, normal)| [at.extend(0.0).to_array(), normal.extend(0.0).to_array()])
        .collect();
    let blank = vec![[f32::NAN; 4]; places.len()];
    let contents: [&[u8]; 5] = [
        bytemuck::cast_slice(&words.layouts),
        bytemuck::cast_slice(&words.places),
        bytemuck::cast_slice(&words.blocks),
        bytemuck::cast_slice(&asked),
        bytemuck::cast_slice(&blank),
    ];
    let buffers = contents.map(|bytes| {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let buffer = device.buffer("lookup", bytes.len() as u64, usage).expect("room");
        device.queue().write_buffer(&buffer, 0, bytes);
        buffer
    });
    let source = ShaderSource::Wgsl(format!("{LOOKUP_IRRADIANCE}{ASKING}").into());
    let module = device.wgpu().create_shader_module(ShaderModuleDescriptor { label: None, source });
    let pipeline = device.wgpu().create_compute_pipeline(&ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("ask"),
        compilation_options: Default::default(),
        cache: None,
    });
    let entries: Vec<BindGroupEntry<'_>> = (0..)
        .zip(&buffers)
        .zip(&contents)
        .map(|((binding, buffer), bytes)| BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer,
                offset: 0,
                size: wgpu::BufferSize::new(bytes.len() as u64),
            }),
        })
        .collect();
    let layout = pipeline.get_bind_group_layout(0);
    let group = device.wgpu().create_bind_group(&BindGroupDescriptor {
        label: None,
        layout: &layout,
        entries: &entries,
    });
    let bytes = contents[4].len() as u64;
    let found = read_now(device, "test", &buffers[4], bytes, |encoder| {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups((places.len() as u32).div_ceil(64), 1, 1);
    });
    bytemuck::pod_collect_to_vec(&found.expect("a device that stays"))
}

/// Goal: an engine's shader shows what the client library and all tools say. Method: a town's patches, receivers and layers of detail
/// with light and barriers of their own, boxes of three sizes so that each ends within the next; thousands of places on, near and off surfaces, by
/// the WGSL on whatever adapter there is.
#[test]
fn the_shader_reads_what_the_client_library_reads() {
    let Some(device) = device_or_skip() else { return };
    let chunks = town();
    let all = volumes(&chunks);
    let places = places(&chunks, 4000);
    let coarse = &all[5..];
    for volumes in [&all[..], &all[4..], coarse, &[]] {
        let found = on_device(&device, volumes, &places);
        let (mut lit, mut dark) = (0, 0);
        for (at, (&(position, normal), found)) in places.iter().zip(&found).enumerate() {
            let Some(expected) = lookup(volumes, position, normal) else {
                assert_eq!(found[3], 0.0, "{at}: {position} {normal}: {found:?} where nothing is known");
                dark += 1;
                continue;
            };
            lit += 1;
            let light = Vec3::new(found[0], found[1], found[2]);
            let off = (light - expected.irradiance).abs().max_element()
                / expected.irradiance.max_element().max(1.0);
            assert!(found[3] == 1.0 && off < 1e-3, "{at}: {position} {normal}: {found:?} for {expected:?}");
        }
        assert!(volumes.is_empty() || lit > 2000, "{lit} lit, {dark} dark");
        assert!(!volumes.is_empty() || lit == 0, "light of nothing");
    }
    // Places near the end of a volume share it with the next: without that some would be read otherwise.
    let blended = places.iter().filter(|&&(position, normal)| {
        let alone = lookup(&all[4..5], position, normal).map(|found| found.irradiance);
        let shared = lookup(&all[4..], position, normal).map(|found| found.irradiance);
        alone.is_some() && shared.is_some() && alone != shared
    });
    assert!(blended.count() > 50, "levels are blended somewhere");
}
