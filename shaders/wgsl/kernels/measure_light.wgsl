// Sums over slots, a pair a workgroup: where light is shot, the power of all patches and what of it is unshot; otherwise
// squares of what a bounce changes, as shares of each patch's light. One thread a slot, no atomics.
// CPU twins: `radiosity::solver::shooting::Unshot`'s `power`, `radiosity::solver::step_gather::change`.

// Light that is as good as none, lx.
const DARKEST: f32 = 1e-6;

@group(0) @binding(1) var<storage, read> residents: array<Resident>;
@group(0) @binding(2) var<storage, read> own_light: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> irradiance: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> unshot: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> gathered: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> light_sums: array<vec4<f32>>;

@compute @workgroup_size(256)
fn measure_light(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    let slot = number * LANES + lane;
    var first = vec4<f32>(0.0);
    var second = vec4<f32>(0.0);
    if slot < pass_of.entry_count {
        if pass_of.is_shot != 0u {
            let leaving = own_light[slot] + vec4<f32>(residents[slot].reflectance, 0.0) * irradiance[slot];
            first.x = residents[slot].area * largest_of(leaving);
            second.x = residents[slot].area * largest_of(unshot[slot]);
        } else {
            let share = (gathered[slot] - irradiance[slot]) / max(largest_of(gathered[slot]), DARKEST);
            first = share * share;
        }
    }
    sum_pairs(first, second, lane);
    if lane == 0u && number * LANES < pass_of.entry_count {
        light_sums[2u * number] = firsts[0];
        light_sums[2u * number + 1u] = seconds[0];
    }
}
