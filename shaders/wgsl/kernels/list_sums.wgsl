// Lists the parts of sums that are news, in the order in which rows were asked for, and takes them for told; `group_counts`
// are sums over the workgroups before. One thread a part. CPU twin: `list` in `server/gpu/src/twins/sums.rs`.

@group(0) @binding(1) var<storage, read> asked: array<ReceiverAsked>;
@group(0) @binding(2) var<storage, read> gathered: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> told: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> group_counts: array<u32>;
@group(0) @binding(5) var<storage, read_write> news: array<SumsEntry>;

@compute @workgroup_size(256)
fn list_sums(
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
    if entry >= pass_of.entry_count {
        return;
    }
    let at = group_counts[number] + before;
    if own == 1u {
        let sums = gathered[gathered_at(entry)];
        news[1u + at] = SumsEntry(told_at(entry), sums.x, sums.y, sums.z, sums.w);
        told[told_at(entry)] = sums;
    }
    if entry + 1u == pass_of.entry_count {
        news[0].at = at + own;
    }
}
