// The sum of a row's weights by a workgroup, in the order of `common/span_sum.wgsl`, so to the same bits: lane by lane, then
// halves, those within a subgroup without memory between.
// CPU twin: `radiosity::tables::masses::total_of`.

// Weights that sum to less are none.
const TOTAL_MIN: f32 = 1e-30;

var<workgroup> lane_sums: array<f32, 256>;

fn total_of(first_weight: u32, item_count: u32, lane: u32) -> f32 {
    var sum = 0.0;
    for (var item = lane; item < item_count; item += LANES) {
        sum += max(weights[first_weight + item], 0.0);
    }
    lane_sums[lane] = sum;
    for (var half = LANES / 2u; half >= SUBGROUP_LANES; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            sum += lane_sums[lane + half];
            lane_sums[lane] = sum;
        }
    }
    for (var half = SUBGROUP_LANES / 2u; half > 0u; half /= 2u) {
        sum += subgroupShuffleDown(sum, half);
    }
    if lane == 0u {
        lane_sums[0] = sum;
    }
    workgroupBarrier();
    return lane_sums[0];
}
