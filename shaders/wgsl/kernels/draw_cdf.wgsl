// A frame of temporal radiosity by cumulative tables: systematic draws. One thread a row.
// CPU twins: `radiosity::solver::temporal`, `radiosity::tables::CdfTable`.

@group(0) @binding(7) var<storage, read> ends: array<u32>;
@group(0) @binding(8) var<storage, read> guide: array<u32>;

fn item_hit(span: RowSpan, bits: u32) -> u32 {
    let place = bits >> 1u;
    var item = guide[span.first_guide + (place >> (31u - guide_bits(span.item_count)))];
    while ends[span.first_bin + item] <= place {
        item++;
    }
    return item;
}

// Evenly along the table from one random start.
fn draw_bits(key: u32, draw: u32) -> u32 {
    let stratum = (0xFFFFFFFFu - pass_of.samples_per_row + 1u) / pass_of.samples_per_row + 1u;
    return mix_bits(key) + draw * stratum;
}

@compute @workgroup_size(256)
fn draw_cdf(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if slot < pass_of.entry_count {
        advance_row(slot);
    }
}
