// Direct light of patches: the mean over their points, summed point after point, and whether it differs between them; how many
// points each workgroup has to tell of. One thread a patch. CPU twins: `light::direct_irradiance_on`, `light::told_apart`.

@group(0) @binding(1) var<storage, read> spans: array<PointSpan>;
@group(0) @binding(2) var<storage, read> on_points: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> lit: array<LitPatch>;
@group(0) @binding(4) var<storage, read_write> group_counts: array<u32>;

@compute @workgroup_size(256)
fn sum_points(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    let patch_index = number * LANES + lane;
    var own = 0u;
    if patch_index < pass_of.entry_count {
        let span = spans[patch_index];
        var sum = vec3<f32>(0.0);
        for (var point = 0u; point < span.point_count; point++) {
            let light = on_points[span.first_point + point].xyz;
            sum += light;
            if point > 0u && any(light != on_points[span.first_point + point - 1u].xyz) {
                own = span.point_count;
            }
        }
        lit[patch_index] = LitPatch(sum / f32(max(span.point_count, 1u)), own);
    }
    let before = sums_before(vec4<u32>(own, 0u, 0u, 0u), lane).x;
    if lane == LANES - 1u && number * LANES < pass_of.entry_count {
        group_counts[number] = before + own;
    }
}
