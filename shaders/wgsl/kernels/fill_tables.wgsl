// Weights and outcomes of rows whose tables are built next: their links, then what is far and the sky. From here on draws
// look at these. One workgroup a row. CPU twins: `radiosity::solver::sampler::RowSampler::rebuild`, `sky_part`.

@group(0) @binding(1) var<storage, read> builds: array<RowSpan>;
@group(0) @binding(2) var<storage, read> rows: array<LiveRow>;
@group(0) @binding(3) var<storage, read> links: array<Link>;
@group(0) @binding(4) var<storage, read> sky_shares: array<f32>;
@group(0) @binding(5) var<storage, read_write> weights: array<f32>;
@group(0) @binding(6) var<storage, read_write> outcomes: array<u32>;
@group(0) @binding(7) var<storage, read_write> spans: array<RowSpan>;
@group(0) @binding(8) var<storage, read_write> totals: array<f32>;

@compute @workgroup_size(256)
fn fill_tables(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    if number >= pass_of.entry_count {
        return;
    }
    let build = builds[number];
    let slot = build.total_at;
    let row = rows[slot];
    // A lane sums what it wrote itself.
    for (var item = lane; item < row.count; item += LANES) {
        let link = links[row.first + item];
        weights[build.first_item + item] = link.share;
        outcomes[build.first_bin + item] = link.slot;
    }
    let outside = 1.0 - total_of(build.first_item, row.count, lane);
    workgroupBarrier();
    if lane == 0u {
        let sky = clamp(sky_shares[slot], 0.0, max(outside, 0.0));
        weights[build.first_item + row.count] = outside - sky;
        weights[build.first_item + row.count + 1u] = sky;
        outcomes[build.first_bin + row.count] = FAR;
        outcomes[build.first_bin + row.count + 1u] = SKY;
        let first_table_bin = build.first_bin;
        spans[slot] = RowSpan(first_table_bin, build.item_count, first_table_bin, first_table_bin, slot);
    }
    storageBarrier();
    let total = total_of(build.first_item, build.item_count, lane);
    if lane == 0u {
        totals[slot] = select(0.0, total, total >= TOTAL_MIN);
    }
}
