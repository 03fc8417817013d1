// The least important class that shoots in this round, and how many links of it: one workgroup, from the top down.
// CPU twin: the beginning of `radiosity::solver::shooting::Unshot`'s `shoot`.

@group(0) @binding(1) var<storage, read_write> classes: array<u32>;
@group(0) @binding(2) var<storage, read_write> shot_words: array<u32>;

@compute @workgroup_size(256)
fn choose_class(@builtin(local_invocation_index) lane: u32) {
    let width = SHOT_CLASSES / LANES;
    // Lane 0 has the most important.
    let top = SHOT_CLASSES - lane * width;
    var own = 0u;
    for (var class_number = top - width; class_number < top; class_number++) {
        own += classes[class_number];
    }
    var above = sums_before(vec4<u32>(own, 0u, 0u, 0u), lane).x;
    let all = lane_counts[LANES - 1u].x;
    let is_last = lane == LANES - 1u && all < pass_of.budget_links;
    if is_last || (above < pass_of.budget_links && above + own >= pass_of.budget_links) {
        var last = top;
        while last > top - width && above < pass_of.budget_links {
            last--;
            above += classes[last];
        }
        shot_words[SHOT_LAST_CLASS] = last;
        let higher = above - classes[last];
        shot_words[SHOT_LINKS_OF_LAST] = pass_of.budget_links - min(higher, pass_of.budget_links);
    }
    if lane == 0u {
        shot_words[SHOT_LISTED] = 0u;
        shot_words[SHOT_BRIGHTEST] = 0u;
    }
    storageBarrier();
    for (var class_number = top - width; class_number < top; class_number++) {
        classes[class_number] = 0u;
    }
}
