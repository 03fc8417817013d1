// The cumulative table of each row: masses along a line, where each item ends, and a guide into it. One workgroup a row;
// integers from the masses on, so that scans of any shape give the same bits.
// A device whose division is not correctly rounded may give masses one unit apart.
// CPU twins: `radiosity::tables::masses::masses_of`, `radiosity::tables::CdfTable`.

@group(0) @binding(1) var<storage, read> spans: array<RowSpan>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read_write> ends: array<u32>;
@group(0) @binding(4) var<storage, read_write> guide: array<u32>;
@group(0) @binding(5) var<storage, read_write> totals: array<f32>;

fn write_masses(span: RowSpan, total: f32, lane: u32) {
    let scale = f32(LINE) / total;
    var best = vec4<u32>(0u, 0xFFFFFFFFu, 0u, 0u);
    for (var item = lane; item < span.item_count; item += LANES) {
        let mass = u32(round(max(weights[span.first_item + item], 0.0) * scale));
        ends[span.first_bin + item] = mass;
        if mass > best.x || (mass == best.x && item < best.y) {
            best = vec4<u32>(mass, item, best.z, 0u);
        }
        best.z += mass;
    }
    let heaviest = heaviest_of(best, lane);
    storageBarrier();
    if lane == 0u {
        ends[span.first_bin + heaviest.y] += LINE - heaviest.z;
    }
    storageBarrier();
}

// Masses to ends, each lane a run of items.
fn add_up(span: RowSpan, lane: u32) {
    let first = span.item_count * lane / LANES;
    let end = span.item_count * (lane + 1u) / LANES;
    var own = 0u;
    for (var item = first; item < end; item++) {
        own += ends[span.first_bin + item];
    }
    var at = sums_before(vec4<u32>(own, 0u, 0u, 0u), lane).x;
    for (var item = first; item < end; item++) {
        at += ends[span.first_bin + item];
        ends[span.first_bin + item] = at;
    }
    storageBarrier();
}

// The first item that ends beyond `place`.
fn item_at(span: RowSpan, place: u32) -> u32 {
    var low = 0u;
    var high = span.item_count - 1u;
    while low < high {
        let middle = (low + high) / 2u;
        if ends[span.first_bin + middle] <= place {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low;
}

@compute @workgroup_size(256)
fn build_cdf(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = group.x + group.y * GRID_WIDTH;
    if slot >= pass_of.entry_count {
        return;
    }
    let span = spans[slot];
    if span.item_count == 0u {
        return;
    }
    let total = total_of(span.first_item, span.item_count, lane);
    let has_weight = total >= TOTAL_MIN;
    if lane == 0u {
        totals[span.total_at] = select(0.0, total, has_weight);
    }
    if has_weight {
        write_masses(span, total, lane);
        add_up(span, lane);
    } else {
        // Nobody looks, but whoever does shall find an item.
        for (var item = lane; item < span.item_count; item += LANES) {
            ends[span.first_bin + item] = LINE;
        }
        storageBarrier();
    }
    let bits = guide_bits(span.item_count);
    for (var part = lane; part < (1u << bits); part += LANES) {
        guide[span.first_guide + part] = item_at(span, part << (31u - bits));
    }
}
