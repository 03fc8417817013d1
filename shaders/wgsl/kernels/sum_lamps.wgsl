// What arrives at each point of all lamps, summed lamp after lamp. One thread a point.
// CPU twin: `light::direct_irradiance_on`.

@group(0) @binding(1) var<storage, read> arriving: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> on_points: array<vec4<f32>>;

@compute @workgroup_size(64)
fn sum_lamps(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.x + group.y * GRID_WIDTH) * RAY_LANES + lane;
    if at >= pass_of.rows {
        return;
    }
    var sum = vec4<f32>(0.0);
    for (var lamp = 0u; lamp < pass_of.entry_count; lamp++) {
        sum += arriving[lamp * pass_of.rows + at];
    }
    on_points[at] = sum;
}
