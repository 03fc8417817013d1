// Temporal radiosity: draws of a row, blended with its past.
// CPU twin: `radiosity::solver::temporal`.

@group(0) @binding(1) var<storage, read> spans: array<RowSpan>;
@group(0) @binding(2) var<storage, read> outcomes: array<u32>;
@group(0) @binding(3) var<storage, read> totals: array<f32>;
@group(0) @binding(4) var<storage, read> sent: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> outside_draws: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> irradiance: array<vec4<f32>>;

// What `item` of the row of `slot` brings.
fn light_of(slot: u32, span: RowSpan, item: u32) -> vec4<f32> {
    let outcome = outcomes[span.first_item + item];
    if outcome == FAR {
        return outside_draws[2u * slot];
    }
    if outcome == SKY {
        return outside_draws[2u * slot + 1u];
    }
    return sent[outcome];
}

// A frame of the row of `slot`: the mean of its draws, blended with the past. The kernel says which bits a draw has, and
// which item they hit.
fn advance_row(slot: u32) {
    let span = spans[slot];
    if span.item_count == 0u {
        return;
    }
    let key = row_key(slot);
    var sum = vec4<f32>(0.0);
    for (var draw = 0u; draw < pass_of.samples_per_row; draw++) {
        sum += light_of(slot, span, item_hit(span, draw_bits(key, draw)));
    }
    let now = sum * (totals[span.total_at] / f32(pass_of.samples_per_row));
    let weight = pass_of.first_weight;
    irradiance[slot] = weight * irradiance[slot] + (1.0 - weight) * now;
}
