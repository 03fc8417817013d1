// What of each row does not lead to residents, split in what is far and the sky: its last two weights. One workgroup a row.
// CPU twins: `radiosity::solver::links::LinkRows::outside_share`, `radiosity::solver::sampler::sky_part`.

@group(0) @binding(1) var<storage, read> spans: array<RowSpan>;
@group(0) @binding(2) var<storage, read> sky_shares: array<f32>;
@group(0) @binding(3) var<storage, read_write> weights: array<f32>;

@compute @workgroup_size(256)
fn split_outside(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = group.x + group.y * GRID_WIDTH;
    if slot >= pass_of.entry_count {
        return;
    }
    let span = spans[slot];
    if span.item_count < 2u {
        return;
    }
    let link_count = span.item_count - 2u;
    let outside = 1.0 - total_of(span.first_item, link_count, lane);
    if lane == 0u {
        let sky = clamp(sky_shares[slot], 0.0, max(outside, 0.0));
        weights[span.first_item + link_count] = outside - sky;
        weights[span.first_item + link_count + 1u] = sky;
    }
}
