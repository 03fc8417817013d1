// The alias table of each span: masses, partition, split and pack. One workgroup a span; integers from the masses on, so
// that scans of any shape give the same bits. Spans know nothing of each other; no atomics.
// A device whose division is not correctly rounded may give masses one unit apart.
// CPU twins: `radiosity::tables::masses::masses_of`, `radiosity::tables::split_pack`.

// Units of mass a bin holds.
const UNITS: u32 = 65536u;

@group(0) @binding(1) var<storage, read> spans: array<TableSpan>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read_write> masses: array<u32>;
@group(0) @binding(4) var<storage, read_write> parts: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> bins: array<u32>;
@group(0) @binding(6) var<storage, read_write> totals: array<f32>;

fn write_masses(span: TableSpan, total: f32, lane: u32) {
    let all = span.item_count * UNITS;
    let scale = f32(all) / total;
    var best = vec4<u32>(0u, 0xFFFFFFFFu, 0u, 0u);
    for (var item = lane; item < span.item_count; item += LANES) {
        var mass = UNITS;
        if total >= TOTAL_MIN {
            mass = u32(round(max(weights[span.first_weight + item], 0.0) * scale));
        }
        masses[span.first_weight + item] = mass;
        if mass > best.x || (mass == best.x && item < best.y) {
            best = vec4<u32>(mass, item, best.z, 0u);
        }
        best.z += mass;
    }
    let heaviest = heaviest_of(best, lane);
    storageBarrier();
    if lane == 0u && total >= TOTAL_MIN {
        masses[span.first_weight + heaviest.y] += all - heaviest.z;
    }
    storageBarrier();
}

// Lists light items from the front and heavy ones from the back of `parts`, each with what it and those before it
// lack of a bin, or have to spare; returns how many are light.
fn write_partition(span: TableSpan, lane: u32) -> u32 {
    let first = span.item_count * lane / LANES;
    let end = span.item_count * (lane + 1u) / LANES;
    // Lights, heavy ones, deficits, surpluses.
    var own = vec4<u32>(0u);
    for (var item = first; item < end; item++) {
        let mass = masses[span.first_weight + item];
        own += select(vec4<u32>(0u, 1u, 0u, mass - UNITS), vec4<u32>(1u, 0u, UNITS - mass, 0u), mass < UNITS);
    }
    var at = sums_before(own, lane);
    let light_count = lane_counts[LANES - 1u].x;
    for (var item = first; item < end; item++) {
        let mass = masses[span.first_weight + item];
        if mass < UNITS {
            at.z += UNITS - mass;
            parts[span.first_weight + at.x] = vec2<u32>(item, at.z);
            at.x += 1u;
        } else {
            at.w += mass - UNITS;
            parts[span.first_weight + light_count + at.y] = vec2<u32>(item, at.w);
            at.y += 1u;
        }
    }
    storageBarrier();
    return light_count;
}

fn bin_of(place: u32, keep: u32, alias_item: u32) -> u32 {
    if keep >= UNITS {
        return ((UNITS - 1u) << 16u) | place;
    }
    return (keep << 16u) | alias_item;
}

// What the lights before light `i` lack.
fn deficit_before(span: TableSpan, i: u32) -> u32 {
    if i == 0u {
        return 0u;
    }
    return parts[span.first_weight + i - 1u].y;
}

// How many of the first `placed` bins are light: bisection along the diagonal.
fn split(span: TableSpan, light_count: u32, placed: u32) -> u32 {
    let heavy_count = span.item_count - light_count;
    var low = select(0u, placed - heavy_count, placed > heavy_count);
    var high = min(placed, light_count);
    while low < high {
        let i = (low + high) / 2u;
        if deficit_before(span, i) < parts[span.first_weight + light_count + placed - 1u - i].y {
            low = i + 1u;
        } else {
            high = i;
        }
    }
    return low;
}

@compute @workgroup_size(256)
fn build_alias(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    if number >= pass_of.entry_count {
        return;
    }
    let span = spans[number];
    let total = total_of(span.first_weight, span.item_count, lane);
    if lane == 0u {
        totals[number] = select(0.0, total, total >= TOTAL_MIN);
    }
    write_masses(span, total, lane);
    let light_count = write_partition(span, lane);
    let heavy_count = span.item_count - light_count;
    let first = span.item_count * lane / LANES;
    let end = span.item_count * (lane + 1u) / LANES;
    var i = split(span, light_count, first);
    var j = first - i;
    for (var step = first; step < end; step++) {
        var surplus = vec2<u32>(0u);
        if j < heavy_count {
            surplus = parts[span.first_weight + light_count + j];
        }
        let deficit = deficit_before(span, i);
        if i < light_count && j < heavy_count && deficit < surplus.y {
            let place = parts[span.first_weight + i].x;
            bins[span.first_bin + place] = bin_of(place, masses[span.first_weight + place], surplus.x);
            i += 1u;
        } else {
            var next = surplus.x;
            if j + 1u < heavy_count {
                next = parts[span.first_weight + light_count + j + 1u].x;
            }
            bins[span.first_bin + surplus.x] = bin_of(surplus.x, UNITS + surplus.y - deficit, next);
            j += 1u;
        }
    }
}
