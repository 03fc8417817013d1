// Sums of pairs by a workgroup, halves first, in the order of `common/pair_sum.wgsl`, so to the same bits.

var<workgroup> firsts: array<vec4<f32>, 256>;
var<workgroup> seconds: array<vec4<f32>, 256>;

// Leaves the sums of all lanes in the first entries, for lane 0 to read.
fn sum_pairs(first: vec4<f32>, second: vec4<f32>, lane: u32) {
    var here = first;
    var there = second;
    firsts[lane] = here;
    seconds[lane] = there;
    for (var half = LANES / 2u; half >= SUBGROUP_LANES; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            here += firsts[lane + half];
            there += seconds[lane + half];
            firsts[lane] = here;
            seconds[lane] = there;
        }
    }
    for (var half = SUBGROUP_LANES / 2u; half > 0u; half /= 2u) {
        here += subgroupShuffleDown(here, half);
        there += subgroupShuffleDown(there, half);
    }
    if lane == 0u {
        firsts[0] = here;
        seconds[0] = there;
    }
}
