// What each patch has sent: its own light and what it reflects, but for what it has not shot yet. One thread a slot.
// CPU twin: `radiosity::solver::shooting::sent`.

@group(0) @binding(1) var<storage, read> residents: array<Resident>;
@group(0) @binding(2) var<storage, read> own_light: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> irradiance: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> unshot: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> sent: array<vec4<f32>>;

@compute @workgroup_size(256)
fn send_light(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if slot < pass_of.entry_count {
        let reflected = vec4<f32>(residents[slot].reflectance, 0.0) * irradiance[slot];
        sent[slot] = own_light[slot] + reflected - unshot[slot];
    }
}
