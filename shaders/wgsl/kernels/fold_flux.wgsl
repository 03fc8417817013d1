// Brings flux that has arrived into light and into what is to be shot, and counts the links of those that matter by their
// importance. One thread a slot; counts by integer atomics. CPU twin: `radiosity::solver::shooting::Unshot`'s `fold`.

@group(0) @binding(1) var<storage, read> residents: array<Resident>;
@group(0) @binding(2) var<storage, read> rows: array<LiveRow>;
@group(0) @binding(3) var<storage, read> shot_words: array<u32>;
@group(0) @binding(4) var<storage, read_write> arrived: array<i32>;
@group(0) @binding(5) var<storage, read_write> arriving: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> irradiance: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> unshot: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> classes: array<atomic<u32>>;

@compute @workgroup_size(256)
fn fold_flux(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if slot >= pass_of.entry_count || residents[slot].area == 0.0 {
        return;
    }
    let at = 3u * slot;
    let units = vec4<f32>(vec3<f32>(f32(arrived[at]), f32(arrived[at + 1u]), f32(arrived[at + 2u])), 0.0);
    let unit = max(bitcast<f32>(shot_words[SHOT_BRIGHTEST]), BRIGHTEST_MIN) / UNITS_OF_BRIGHTEST;
    let more = arriving[slot] + unit * units;
    for (var channel = 0u; channel < 3u; channel++) {
        arrived[at + channel] = 0;
    }
    arriving[slot] = vec4<f32>(0.0);
    irradiance[slot] += more;
    let left = unshot[slot] + vec4<f32>(residents[slot].reflectance, 0.0) * more;
    unshot[slot] = left;
    let importance = largest_of(left) * residents[slot].area;
    if importance > UNSHOT_TOLERANCE * bitcast<f32>(shot_words[SHOT_SCALE]) {
        atomicAdd(&classes[class_of(importance)], max(rows[slot].count, 1u));
    }
}
