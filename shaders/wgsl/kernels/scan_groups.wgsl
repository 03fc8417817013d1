// Counts of workgroups to counts of those before: one workgroup. CPU twin: a running sum.

@group(0) @binding(1) var<storage, read_write> group_counts: array<u32>;

@compute @workgroup_size(256)
fn scan_groups(@builtin(local_invocation_index) lane: u32) {
    let first = pass_of.entry_count * lane / LANES;
    let end = pass_of.entry_count * (lane + 1u) / LANES;
    var own = 0u;
    for (var at = first; at < end; at++) {
        own += group_counts[at];
    }
    var before = sums_before(vec4<u32>(own, 0u, 0u, 0u), lane).x;
    for (var at = first; at < end; at++) {
        let count = group_counts[at];
        group_counts[at] = before;
        before += count;
    }
}
