// Where the rays of runs end: what patches, the lobes of the sky and sides without patches take of them, in parts of a ray.
// One workgroup a run; integers only, so that the sums do not hang on the order.
// CPU twin: `trace::ends::count_ends`.

// A slot of the table of voxels with patches, places left out, or buried sides; an empty one ends a search.
struct EndVoxel {
    voxel: vec3<i32>,        //  0
    is_taken: u32,           // 12
    along: vec3<u32>,        // 16  patches that face along each axis, or NO_KEY
    asks_host: u32,          // 28  1 where rays that meet sides with SIDE_FOR_HOST_IN_PLACES are the host's
    against: vec3<u32>,      // 32  patches that face the other way
    buried: u32,             // 44  bits by direction: of sides that are buried here, and of those open here but not elsewhere
}                            // 48

struct EndRun {
    first_ray: u32,          //  0
    ray_count: u32,          //  4  at most RUN_RAYS
    sum: u32,                //  8  the direction whose way rays have to go, SUM_WHOLE or SUM_ABSORBED
}                            // 12

// What one patch, lobe or the like takes of a run.
struct EndPart {
    key: u32,                //  0
    parts: u32,              //  4
}                            //  8

// The parts of a run, in any order.
struct EndSpan {
    first_part: u32,         //  0
    part_count: u32,         //  4
}                            //  8

@group(0) @binding(1) var<storage, read> queries: array<RayQuery>;
@group(0) @binding(2) var<storage, read> hits: array<RayHit>;
@group(0) @binding(3) var<storage, read> sides: array<EndSide>;
@group(0) @binding(4) var<storage, read> voxels: array<EndVoxel>;
@group(0) @binding(5) var<storage, read> runs: array<EndRun>;
@group(0) @binding(6) var<storage, read_write> parts: array<EndPart>;
@group(0) @binding(7) var<storage, read_write> part_spans: array<EndSpan>;
@group(0) @binding(8) var<storage, read_write> parts_taken: array<atomic<u32>>;

// The run's own table. A ray has three keys at most, so it is never full.
var<workgroup> keys: array<atomic<u32>, 1792>;
var<workgroup> sums: array<atomic<u32>, 1792>;
var<workgroup> listed: atomic<u32>;
var<workgroup> first_part: u32;

fn add_part(key: u32, part: u32) {
    if part == 0u {
        return;
    }
    var slot = ((mix_bits(key) >> 16u) * RUN_KEYS) >> 16u;
    loop {
        let found = atomicCompareExchangeWeak(&keys[slot], NO_KEY, key);
        if found.exchanged || found.old_value == key {
            break;
        }
        // An exchange may fail though the slot is free.
        if found.old_value != NO_KEY {
            slot = select(slot + 1u, 0u, slot + 1u == RUN_KEYS);
        }
    }
    atomicAdd(&sums[slot], part);
}

fn voxel_slot(voxel: vec3<i32>) -> u32 {
    let bits = bitcast<vec3<u32>>(voxel);
    let last = pass_of.voxel_slots - 1u;
    var slot = mix_bits(bits.x + mix_bits(bits.y + mix_bits(bits.z))) & last;
    while voxels[slot].is_taken != 0u && any(voxels[slot].voxel != voxel) {
        slot = (slot + 1u) & last;
    }
    return slot;
}

// The bit of the direction that a side with `normal` faces most.
fn main_direction(normal: vec3<f32>) -> u32 {
    let length = abs(normal);
    var axis = select(0u, 1u, length.y > length.x);
    axis = select(axis, 2u, length.z > length[axis]);
    return 1u << (2u * axis + select(0u, 1u, normal[axis] < 0.0));
}

const BURIED_NO: u32 = 0u;
const BURIED_YES: u32 = 1u;
const BURIED_UNKNOWN: u32 = 2u;

// Whether who meets that side in a voxel with `buried` is absorbed.
fn is_buried(side: EndSide, is_forward: bool, normal: vec3<f32>, buried: u32) -> u32 {
    let everywhere = select(SIDE_BACK_BURIED, SIDE_FRONT_BURIED, is_forward);
    if has_flag(side, everywhere) {
        return BURIED_YES;
    }
    let bit = main_direction(normal);
    if !has_flag(side, everywhere << BURIED_IN_PLACES) || (buried & bit) == 0u {
        return BURIED_NO;
    }
    return select(BURIED_YES, BURIED_UNKNOWN, (buried & (bit << BURIED_OPEN)) != 0u);
}

// Whether it is known here who takes the ray.
fn add_surface(side: EndSide, query: RayQuery, distance: f32, weight: f32, sum: u32) -> bool {
    let is_forward = is_front(side, query.direction);
    let normal = select(-side.normal, side.normal, is_forward);
    let position = query.origin + query.direction * distance;
    let before = position + normal * pass_of.off_surface_m;
    let slot = voxel_slot(vec3<i32>(floor(before / pass_of.voxel_edge_m)));
    let buried = is_buried(side, is_forward, normal, voxels[slot].buried);
    let asks_host = has_flag(side, SIDE_FOR_HOST_IN_PLACES) && voxels[slot].asks_host != 0u;
    if has_flag(side, SIDE_FOR_HOST) || buried == BURIED_UNKNOWN || (asks_host && buried != BURIED_YES) {
        return false;
    }
    if buried == BURIED_YES {
        add_part(KEY_ABSORBED, u32(f32(RAY_PARTS) * weight + 0.5));
        return true;
    }
    let facing = select(voxels[slot].along, voxels[slot].against, normal < vec3<f32>(0.0));
    let owners = select(vec3<u32>(NO_KEY), facing, voxels[slot].is_taken != 0u);
    let weighed = vec3<u32>(vec3<f32>(side.parts) * weight + 0.5);
    for (var axis = 0u; axis < 3u; axis++) {
        if owners[axis] == NO_KEY {
            add_part(KEY_ABSORBED, weighed[axis]);
        } else if sum != SUM_ABSORBED {
            add_part(owners[axis], weighed[axis]);
        }
    }
    return true;
}

fn add_sky(direction: vec3<f32>, weight: f32) {
    let weighed = vec3<u32>(f32(RAY_PARTS) * direction * direction * weight + 0.5);
    for (var axis = 0u; axis < 3u; axis++) {
        add_part(KEY_SKY + 2u * axis + select(0u, 1u, direction[axis] < 0.0), weighed[axis]);
    }
}

fn add_ray(run: EndRun, place: u32) {
    let query = queries[run.first_ray + place];
    let hit = hits[run.first_ray + place];
    var weight = 1.0;
    if run.sum < 6u {
        let component = query.direction[run.sum / 2u];
        weight = max(select(component, -component, (run.sum & 1u) == 1u), 0.0);
    }
    if hit.triangle == NO_TRIANGLE {
        if run.sum != SUM_ABSORBED {
            add_sky(query.direction, weight);
        }
        return;
    }
    let is_known = add_surface(sides[hit.triangle], query, hit.distance_m, weight, run.sum);
    if !is_known && run.sum >= 6u {
        add_part(KEY_UNKNOWN + place, 1u);
    }
}

@compute @workgroup_size(256)
fn count_ends(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = group.x + group.y * GRID_WIDTH;
    if at >= pass_of.entry_count {
        return;
    }
    for (var slot = lane; slot < RUN_KEYS; slot += LANES) {
        atomicStore(&keys[slot], NO_KEY);
        atomicStore(&sums[slot], 0u);
    }
    if lane == 0u {
        atomicStore(&listed, 0u);
    }
    workgroupBarrier();
    let run = runs[at];
    for (var place = lane; place < run.ray_count; place += LANES) {
        add_ray(run, place);
    }
    workgroupBarrier();
    var own = 0u;
    for (var slot = lane; slot < RUN_KEYS; slot += LANES) {
        own += select(0u, 1u, atomicLoad(&keys[slot]) != NO_KEY);
    }
    var part = atomicAdd(&listed, own);
    workgroupBarrier();
    if lane == 0u {
        let count = atomicLoad(&listed);
        first_part = atomicAdd(&parts_taken[0], count);
        part_spans[at] = EndSpan(first_part, count);
    }
    workgroupBarrier();
    part += first_part;
    for (var slot = lane; slot < RUN_KEYS; slot += LANES) {
        let key = atomicLoad(&keys[slot]);
        if key != NO_KEY {
            parts[part] = EndPart(key, atomicLoad(&sums[slot]));
            part++;
        }
    }
}
