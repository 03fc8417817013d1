// What all lanes of a workgroup find together, by way of subgroups. Integers: the words of `common/lane_scan.wgsl`.

// Of each subgroup; in the last entry sums of all lanes.
var<workgroup> lane_counts: array<vec4<u32>, 256>;

// Most mass in x, the first item that has it in y, the sum of masses in z; of all lanes.
fn heaviest_of(own: vec4<u32>, lane: u32) -> vec4<u32> {
    let most = subgroupMax(own.x);
    let first = subgroupMin(select(0xFFFFFFFFu, own.y, own.x == most));
    let sum = subgroupAdd(own.z);
    if lane % SUBGROUP_LANES == 0u {
        lane_counts[lane / SUBGROUP_LANES] = vec4<u32>(most, first, sum, 0u);
    }
    workgroupBarrier();
    var best = lane_counts[0];
    for (var group = 1u; group < LANES / SUBGROUP_LANES; group++) {
        let there = lane_counts[group];
        let is_heavier = there.x > best.x || (there.x == best.x && there.y < best.y);
        best = vec4<u32>(select(best.xy, there.xy, is_heavier), best.z + there.z, 0u);
    }
    workgroupBarrier();
    return best;
}

// Sums of the lanes before this one; of all lanes in the last lane's entry, as is left in `lane_counts`.
fn sums_before(own: vec4<u32>, lane: u32) -> vec4<u32> {
    let up_to = subgroupInclusiveAdd(own);
    if lane % SUBGROUP_LANES == SUBGROUP_LANES - 1u {
        lane_counts[lane / SUBGROUP_LANES] = up_to;
    }
    workgroupBarrier();
    var before = up_to - own;
    for (var group = 0u; group < lane / SUBGROUP_LANES; group++) {
        before += lane_counts[group];
    }
    // No subgroup's entry: there are at least four lanes to each.
    if lane == LANES - 1u {
        lane_counts[lane] = before + own;
    }
    workgroupBarrier();
    return before;
}
