// Lists who shoots in this round and takes what they shoot; within the last class it goes by slot, until its links are used
// up. One thread a slot. The list is in no order; nothing that is summed over it depends on that.
// CPU twin: the loop over slots in `radiosity::solver::shooting::Unshot`'s `shoot`.

@group(0) @binding(1) var<storage, read> residents: array<Resident>;
@group(0) @binding(2) var<storage, read> rows: array<LiveRow>;
@group(0) @binding(3) var<storage, read_write> unshot: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> shot_words: array<atomic<u32>>;
@group(0) @binding(5) var<storage, read> group_counts: array<u32>;
@group(0) @binding(6) var<storage, read_write> shooters: array<u32>;
@group(0) @binding(7) var<storage, read_write> shot: array<vec4<f32>>;

fn word_of(which: u32) -> u32 {
    return atomicLoad(&shot_words[which]);
}

@compute @workgroup_size(256)
fn take_shooters(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    let slot = number * LANES + lane;
    let is_there = slot < pass_of.entry_count;
    var own = 0u;
    if is_there {
        own = links_of_last(slot);
    }
    let before = sums_before(vec4<u32>(own, 0u, 0u, 0u), lane).x;
    if !is_there {
        return;
    }
    let importance = importance_of(slot);
    if importance == 0.0 || class_of(importance) < word_of(SHOT_LAST_CLASS) {
        return;
    }
    if own > 0u && group_counts[number] + before >= word_of(SHOT_LINKS_OF_LAST) {
        return;
    }
    let at = atomicAdd(&shot_words[SHOT_LISTED], 1u);
    atomicAdd(&shot_words[SHOT_SHOOTERS], 1u);
    atomicMax(&shot_words[SHOT_BRIGHTEST], bitcast<u32>(largest_of(unshot[slot])));
    shooters[at] = slot;
    shot[slot] = unshot[slot];
    unshot[slot] = vec4<f32>(0.0);
}
