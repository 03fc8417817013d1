// Sums of pairs by a workgroup, halves first: the same bits every time.

var<workgroup> firsts: array<vec4<f32>, 256>;
var<workgroup> seconds: array<vec4<f32>, 256>;

// Leaves the sums of all lanes in the first entries, for lane 0 to read.
fn sum_pairs(first: vec4<f32>, second: vec4<f32>, lane: u32) {
    firsts[lane] = first;
    seconds[lane] = second;
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            firsts[lane] += firsts[lane + half];
            seconds[lane] += seconds[lane + half];
        }
    }
}
