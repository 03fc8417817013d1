// No light in slots that somebody leaves. One thread a slot.
// CPU twin: `radiosity::solver::CpuRowLight`'s `leave`.

@group(0) @binding(1) var<storage, read> slots: array<u32>;
@group(0) @binding(2) var<storage, read_write> own_light: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> outside: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> irradiance: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> unshot: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> arriving: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> rest: array<vec4<f32>>;

@compute @workgroup_size(256)
fn clear_slots(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if at >= pass_of.entry_count {
        return;
    }
    let slot = slots[at];
    own_light[slot] = vec4<f32>(0.0);
    outside[slot] = vec4<f32>(0.0);
    irradiance[slot] = vec4<f32>(0.0);
    unshot[slot] = vec4<f32>(0.0);
    arriving[slot] = vec4<f32>(0.0);
    rest[slot] = vec4<f32>(0.0);
}
