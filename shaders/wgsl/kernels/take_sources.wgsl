// Takes new sources of all slots. Where light is shot, what they changed by has to be. One thread a slot.
// CPU twin: `radiosity::solver::CpuRowLight`'s `change`.

@group(0) @binding(1) var<storage, read> residents: array<Resident>;
@group(0) @binding(2) var<storage, read> new_own_light: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> new_outside: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> own_light: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> outside: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> irradiance: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> unshot: array<vec4<f32>>;

@compute @workgroup_size(256)
fn take_sources(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if slot >= pass_of.entry_count {
        return;
    }
    if pass_of.is_shot != 0u {
        let more = new_own_light[slot] - own_light[slot];
        let more_in = new_outside[slot] - outside[slot];
        irradiance[slot] += more_in;
        unshot[slot] += more + vec4<f32>(residents[slot].reflectance, 0.0) * more_in;
    }
    own_light[slot] = new_own_light[slot];
    outside[slot] = new_outside[slot];
}
