// irradiance = sums of multiply_tiles / area + outside_weight * outside, for wanted slots; others keep what they had.
// One workgroup a stripe and channel: four threads a slot, each a quarter of the column stripes that carry light, added in
// order: the same bits every time. CPU twin: the end of `radiosity::LocalMatrix::multiply_rows`.

@group(0) @binding(1) var<storage, read> tile_sums: array<f32>;
@group(0) @binding(2) var<storage, read> marks: array<StripeMarks>;
@group(0) @binding(3) var<storage, read> residents: array<Resident>;
@group(0) @binding(4) var<storage, read> outside: array<f32>;
@group(0) @binding(5) var<storage, read_write> irradiance: array<f32>;

var<workgroup> quarters: array<f32, 256>;

@compute @workgroup_size(256)
fn sum_tiles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let stripe = group.x;
    let channel = group.y;
    let stripes = pass_of.rows / TILE_EDGE;
    let within = lane % TILE_EDGE;
    var sum = 0.0;
    for (var column = lane / TILE_EDGE; column < pass_of.stripe_count; column += 4u) {
        if is_any(marks[column].lit) {
            sum += tile_sums[((channel * stripes + stripe) * stripes + column) * TILE_EDGE + within];
        }
    }
    quarters[lane] = sum;
    workgroupBarrier();
    if lane >= TILE_EDGE || !is_marked(marks[stripe].wanted, within) {
        return;
    }
    let slot = stripe * TILE_EDGE + within;
    let at = channel * pass_of.rows + slot;
    let area = residents[slot].area;
    let flux = (quarters[within] + quarters[within + 64u]) + (quarters[within + 128u] + quarters[within + 192u]);
    let arriving = select(0.0, flux / area, area > 0.0);
    irradiance[at] = arriving + pass_of.outside_weight * outside[at];
}
