// What all lanes of a workgroup find together. Integers: the same in any order.

var<workgroup> lane_counts: array<vec4<u32>, 256>;

// Most mass in x, the first item that has it in y, the sum of masses in z; of all lanes.
fn heaviest_of(own: vec4<u32>, lane: u32) -> vec4<u32> {
    lane_counts[lane] = own;
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            let here = lane_counts[lane];
            let there = lane_counts[lane + half];
            let is_heavier = there.x > here.x || (there.x == here.x && there.y < here.y);
            let best = select(here, there, is_heavier);
            lane_counts[lane] = vec4<u32>(best.x, best.y, here.z + there.z, 0u);
        }
    }
    workgroupBarrier();
    let result = lane_counts[0];
    workgroupBarrier();
    return result;
}

// Sums of the lanes before this one; of all lanes in the last lane's entry, as is left in `lane_counts`.
fn sums_before(own: vec4<u32>, lane: u32) -> vec4<u32> {
    lane_counts[lane] = own;
    for (var reach = 1u; reach < LANES; reach *= 2u) {
        workgroupBarrier();
        var sum = lane_counts[lane];
        if lane >= reach {
            sum += lane_counts[lane - reach];
        }
        workgroupBarrier();
        lane_counts[lane] = sum;
    }
    workgroupBarrier();
    return lane_counts[lane] - own;
}
