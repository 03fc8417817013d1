// In tables that are older than their rows, whoever leaves looks far from now on; tables of those who leave are no more.
// One workgroup a row. CPU twin: `radiosity::solver::sampler::RowSampler::forget`.

@group(0) @binding(3) var<storage, read_write> spans: array<RowSpan>;
@group(0) @binding(4) var<storage, read_write> outcomes: array<u32>;

@compute @workgroup_size(256)
fn forget_leaving(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    if number >= pass_of.entry_count {
        return;
    }
    let slot = edits[number].slot;
    if is_leaving(slot) {
        if lane == 0u {
            spans[slot] = RowSpan();
        }
        return;
    }
    let span = spans[slot];
    for (var item = lane; item < span.item_count; item += LANES) {
        let outcome = outcomes[span.first_item + item];
        if outcome < SKY && is_leaving(outcome) {
            outcomes[span.first_item + item] = FAR;
        }
    }
}
