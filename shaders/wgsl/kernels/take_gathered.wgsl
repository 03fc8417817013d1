// Takes what was gathered for light, where it differs by more than a share of it. Where light is shot, what is reflected of
// the difference has to be. One thread a slot. CPU twin: `radiosity::solver::shooting::Unshot`'s `refresh`.

@group(0) @binding(1) var<storage, read> slots: array<u32>;
@group(0) @binding(2) var<storage, read> residents: array<Resident>;
@group(0) @binding(3) var<storage, read> gathered: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> irradiance: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> unshot: array<vec4<f32>>;

@compute @workgroup_size(256)
fn take_gathered(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if at >= pass_of.entry_count {
        return;
    }
    let slot = slots[at];
    let fresh = gathered[slot];
    let gap = fresh - irradiance[slot];
    // The first weight is the tolerance.
    let differs = abs(gap) > pass_of.first_weight * abs(fresh);
    irradiance[slot] = select(irradiance[slot], fresh, differs);
    if pass_of.is_shot != 0u {
        let more = vec4<f32>(residents[slot].reflectance, 0.0) * gap;
        unshot[slot] += select(vec4<f32>(0.0), more, differs);
    }
}
