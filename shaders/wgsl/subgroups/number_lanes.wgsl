// How subgroups lie in a workgroup: for each lane the lanes of its subgroup, its first, and the lane's place in it. Hosts run
// this before they trust kernels that count on subgroups of consecutive lanes.

@group(0) @binding(1) var<storage, read_write> lanes: array<vec4<u32>>;

@compute @workgroup_size(256)
fn number_lanes(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let count = subgroupAdd(1u);
    let first = subgroupMin(lane);
    let place = subgroupExclusiveAdd(1u);
    lanes[group.x * LANES + lane] = vec4<u32>(count, first, place, subgroupShuffleDown(lane, 1u));
}
