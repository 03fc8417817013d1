// Sums of `measure_light`, by one workgroup: what of all light is unshot and the scale of light, or how much a bounce
// changed. CPU twins: the end of `radiosity::solver::shooting::Unshot::step`, `radiosity::solver::step_gather::change`.

@group(0) @binding(1) var<storage, read> light_sums: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> shot_words: array<u32>;

// What the remembered scale of light keeps a frame.
const SCALE_KEPT: f32 = 0.9;

@compute @workgroup_size(256)
fn sum_light(@builtin(local_invocation_index) lane: u32) {
    var first = vec4<f32>(0.0);
    var second = vec4<f32>(0.0);
    // Here entries are workgroups of the pass before.
    for (var at = lane; at < pass_of.entry_count; at += LANES) {
        first += light_sums[2u * at];
        second += light_sums[2u * at + 1u];
    }
    sum_pairs(first, second, lane);
    if lane > 0u {
        return;
    }
    let taken_count = f32(max(pass_of.taken_count, 1u));
    if pass_of.is_shot != 0u {
        let power = firsts[0].x;
        let mean = power / taken_count;
        let kept = SCALE_KEPT * bitcast<f32>(shot_words[SHOT_SCALE]);
        shot_words[SHOT_SCALE] = bitcast<u32>(max(kept, mean));
        shot_words[SHOT_UNSHOT_SHARE] = bitcast<u32>(select(0.0, seconds[0].x / power, power > 0.0));
    } else {
        shot_words[SHOT_CHANGE] = bitcast<u32>(largest_of(firsts[0]) / taken_count);
    }
}
