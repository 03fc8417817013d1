// How many rays of each fan meet backs, what is near, and what only the host can judge, and how far they get. One thread
// a fan.
// CPU twin: `trace::ends::face_fans`.

@group(0) @binding(1) var<storage, read> fans: array<RayFan>;
@group(0) @binding(2) var<storage, read> queries: array<RayQuery>;
@group(0) @binding(3) var<storage, read> hits: array<RayHit>;
@group(0) @binding(4) var<storage, read> sides: array<EndSide>;
// Ten bits each, in this order from the lowest; and the bits of a distance, m.
@group(0) @binding(5) var<storage, read_write> faced: array<vec2<u32>>;

@compute @workgroup_size(256)
fn face_fans(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if at >= pass_of.entry_count {
        return;
    }
    let first = fans[at].first_ray;
    let end = first + fans[at].ray_count;
    var counts = 0u;
    var reach = 0.0;
    for (var ray = first; ray < end; ray++) {
        let hit = hits[ray];
        let query = queries[ray];
        // Of a ray that meets nothing, as far as it was followed.
        let distance = hit.distance_m - query.distance_min_m;
        reach = max(reach, distance);
        if hit.triangle == NO_TRIANGLE {
            continue;
        }
        let side = sides[hit.triangle];
        let is_back = !has_flag(side, SIDE_TWO_SIDED) && !is_front(side, query.direction);
        let is_near = distance < pass_of.near_m;
        let met = select(0u, 1u, is_back) + select(0u, 1u << 10u, is_near);
        counts += select(met, 1u << 20u, has_flag(side, SIDE_FOR_HOST));
    }
    faced[at] = vec2<u32>(counts, bitcast<u32>(reach));
}
