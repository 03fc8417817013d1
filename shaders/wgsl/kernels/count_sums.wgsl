// How many parts of sums of each workgroup are news. One thread a part. CPU twin: `list` in `server/gpu/src/twins/sums.rs`.

@group(0) @binding(1) var<storage, read> asked: array<ReceiverAsked>;
@group(0) @binding(2) var<storage, read> gathered: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> told: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> group_counts: array<u32>;

@compute @workgroup_size(256)
fn count_sums(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    let entry = number * LANES + lane;
    var own = 0u;
    if entry < pass_of.entry_count && is_news(entry) {
        own = 1u;
    }
    let before = sums_before(vec4<u32>(own, 0u, 0u, 0u), lane).x;
    if lane == LANES - 1u && number * LANES < pass_of.entry_count {
        group_counts[number] = before + own;
    }
}
