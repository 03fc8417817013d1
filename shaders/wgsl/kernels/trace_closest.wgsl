// The closest triangle along each ray; of several as near, the first. One thread a ray.
// CPU twin: `trace::SceneTracer::closest`, without its holes.

@group(0) @binding(4) var<storage, read> queries: array<RayQuery>;
@group(0) @binding(5) var<storage, read_write> hits: array<RayHit>;

// Boxes that begin this share of a hit's distance behind it, and this far, are still looked into: what is as near as the
// hit may lie in one.
const TIE_ROOM: f32 = 2e-6;

var<private> closest: RayHit;
var<private> distance_min_m: f32;

fn meet(at: u32, origin: vec3<f32>, direction: vec3<f32>) -> bool {
    let distance = crossing_m(at, origin, direction, distance_min_m);
    if distance < 0.0 {
        return false;
    }
    let index = triangles[at].index;
    if distance < closest.distance_m || (distance == closest.distance_m && index < closest.triangle) {
        closest = RayHit(index, distance);
        reach_m = min(reach_m, distance * (1.0 + TIE_ROOM) + RUN_UP_M);
    }
    return false;
}

@compute @workgroup_size(64)
fn trace_closest(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.x + group.y * GRID_WIDTH) * RAY_LANES + lane;
    if at >= pass_of.entry_count {
        return;
    }
    let query = queries[at];
    distance_min_m = query.distance_min_m;
    reach_m = query.distance_max_m;
    closest = RayHit(NO_TRIANGLE, query.distance_max_m);
    walk_trees(query.origin, query.direction);
    hits[at] = closest;
}
