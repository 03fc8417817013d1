// Links of the last class that shoots, of each workgroup of slots. CPU twin: the loop over slots in
// `radiosity::solver::shooting::Unshot`'s `shoot`.

@group(0) @binding(1) var<storage, read> residents: array<Resident>;
@group(0) @binding(2) var<storage, read> rows: array<LiveRow>;
@group(0) @binding(3) var<storage, read> unshot: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> shot_words: array<u32>;
@group(0) @binding(5) var<storage, read_write> group_counts: array<u32>;

fn word_of(which: u32) -> u32 {
    return shot_words[which];
}

@compute @workgroup_size(256)
fn count_last(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    let slot = number * LANES + lane;
    var own = 0u;
    if slot < pass_of.entry_count {
        own = links_of_last(slot);
    }
    let before = sums_before(vec4<u32>(own, 0u, 0u, 0u), lane).x;
    if lane == LANES - 1u && number * LANES < pass_of.entry_count {
        group_counts[number] = before + own;
    }
}
