// What leaves patches of what is not shot yet, with bounces of the estimate. One thread a slot.
// CPU twin: the beginning of `radiosity::solver::remainder::step`.

@group(0) @binding(1) var<storage, read> residents: array<Resident>;
@group(0) @binding(2) var<storage, read> unshot: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> rest: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> sent: array<vec4<f32>>;

@compute @workgroup_size(256)
fn send_rest(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if slot < pass_of.entry_count {
        sent[slot] = unshot[slot] + vec4<f32>(residents[slot].reflectance, 0.0) * rest[slot];
    }
}
