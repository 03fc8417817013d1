// A frame of temporal radiosity by alias tables: independent draws. One thread a row.
// CPU twins: `radiosity::solver::temporal`, `radiosity::tables::AliasTable`.

@group(0) @binding(7) var<storage, read> bins: array<u32>;

// Most items of a section.
const SECTION_ITEMS_MAX: u32 = 4096u;

// The place that `bits` hit among `count` bins from `first` on: the upper bits of their product.
fn hit(first: u32, count: u32, bits: u32) -> u32 {
    let position = (bits >> 16u) * count + (((bits & 0xFFFFu) * count) >> 16u);
    let place = position >> 16u;
    let bin = bins[first + place];
    // Strictly: what keeps nothing is never drawn.
    return select(bin & 0xFFFFu, place, (position & 0xFFFFu) < (bin >> 16u));
}

fn item_hit(span: RowSpan, bits: u32) -> u32 {
    if span.item_count <= SECTION_ITEMS_MAX {
        return hit(span.first_bin, span.item_count, bits);
    }
    let sections = (span.item_count + SECTION_ITEMS_MAX - 1u) / SECTION_ITEMS_MAX;
    let first = hit(span.first_bin, sections, bits) * SECTION_ITEMS_MAX;
    let count = min(SECTION_ITEMS_MAX, span.item_count - first);
    return first + hit(span.first_bin + sections + first, count, mix_bits(bits));
}

// Each draw for itself.
fn draw_bits(key: u32, draw: u32) -> u32 {
    return mix_bits(key + draw);
}

@compute @workgroup_size(256)
fn draw_alias(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if slot < pass_of.entry_count {
        advance_row(slot);
    }
}
