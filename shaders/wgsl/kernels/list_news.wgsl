// Lists what is news, ascending by slot, and takes it for told; `group_counts` are sums over the workgroups before. One
// thread a slot. CPU twin: `list` in `server/gpu/src/twins/news.rs`.

@group(0) @binding(1) var<storage, read> light: array<f32>;
@group(0) @binding(2) var<storage, read> marks: array<NewsMarks>;
@group(0) @binding(3) var<storage, read_write> told: array<u32>;
@group(0) @binding(4) var<storage, read> group_counts: array<u32>;
@group(0) @binding(5) var<storage, read_write> news: array<NewsEntry>;

@compute @workgroup_size(256)
fn list_news(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    let slot = number * LANES + lane;
    var own = 0u;
    if slot < pass_of.entry_count && is_news(slot) {
        own = 1u;
    }
    let before = sums_before(vec4<u32>(own, 0u, 0u, 0u), lane).x;
    if slot >= pass_of.entry_count {
        return;
    }
    let at = group_counts[number] + before;
    if own == 1u {
        let of_slot = light_of(slot);
        news[1u + at] = NewsEntry(slot, of_slot.x, of_slot.y, of_slot.z);
        told[slot] = code_of(of_slot);
    }
    if slot + 1u == pass_of.entry_count {
        news[0].slot = at + own;
    }
}
