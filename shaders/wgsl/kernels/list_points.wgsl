// Lists light on the points of the patches that have points to tell of, in order, three words a point; the first word says how
// many. `group_counts` are sums over the workgroups before. One thread a patch. CPU twin: `light::told_apart`.

@group(0) @binding(1) var<storage, read> spans: array<PointSpan>;
@group(0) @binding(2) var<storage, read> on_points: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> lit: array<LitPatch>;
@group(0) @binding(4) var<storage, read> group_counts: array<u32>;
// Words, not a struct of floats: a count among floats could be taken for a number too small to keep.
@group(0) @binding(5) var<storage, read_write> listed: array<u32>;

@compute @workgroup_size(256)
fn list_points(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    let patch_index = number * LANES + lane;
    var own = 0u;
    if patch_index < pass_of.entry_count {
        own = lit[patch_index].told_points;
    }
    let before = sums_before(vec4<u32>(own, 0u, 0u, 0u), lane).x;
    if patch_index >= pass_of.entry_count {
        return;
    }
    let at = group_counts[number] + before;
    let first = spans[patch_index].first_point;
    for (var point = 0u; point < own; point++) {
        let light = bitcast<vec4<u32>>(on_points[first + point]);
        let word = 3u * (1u + at + point);
        listed[word] = light.x;
        listed[word + 1u] = light.y;
        listed[word + 2u] = light.z;
    }
    if patch_index + 1u == pass_of.entry_count {
        listed[0] = at + own;
    }
}
