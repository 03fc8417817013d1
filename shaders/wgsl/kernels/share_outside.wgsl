// What a draw of what is far, and one of the sky, bring to each row: light over share. One thread a slot.
// CPU twin: `radiosity::solver::CpuRowLight`'s `prepare_outside`.

@group(0) @binding(1) var<storage, read> outside_shares: array<f32>;
@group(0) @binding(2) var<storage, read> sky_shares: array<f32>;
@group(0) @binding(3) var<storage, read> outside: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> sky: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> outside_draws: array<vec4<f32>>;

fn over(light: vec4<f32>, share: f32) -> vec4<f32> {
    if share > 0.0 {
        return light / share;
    }
    return vec4<f32>(0.0);
}

@compute @workgroup_size(256)
fn share_outside(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if slot >= pass_of.entry_count {
        return;
    }
    let all = outside_shares[slot];
    let sky_share = clamp(sky_shares[slot], 0.0, max(all, 0.0));
    // A sky without a share is far: nobody draws it.
    let from_sky = select(vec4<f32>(0.0), sky[slot], sky_share > 0.0);
    outside_draws[2u * slot] = over(max(outside[slot] - from_sky, vec4<f32>(0.0)), all - sky_share);
    outside_draws[2u * slot + 1u] = over(from_sky, sky_share);
}
