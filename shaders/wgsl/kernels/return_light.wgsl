// returned[band][channel] = (scale * exchange)' * columns, 32 x 32: what comes back to the patches of a block, by bands of
// rows that `solve_block` adds up. One workgroup a band and channel. CPU twin: `radiosity::tile_kernel::BlockProduct`.

@group(0) @binding(1) var<storage, read> exchange: array<f32>;
@group(0) @binding(2) var<storage, read> columns: array<f32>;
@group(0) @binding(3) var<storage, read> residents: array<Resident>;
@group(0) @binding(4) var<storage, read_write> returned: array<f32>;

// TILE_EDGE rows of a block each.
var<workgroup> sent: array<f32, 2048>;
var<workgroup> arrived: array<f32, 2048>;

@compute @workgroup_size(256)
fn return_light(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let band = group.x;
    let channel = group.y;
    let sender = lane / 8u;
    let to = lane % 8u * 4u;
    var total = vec4<f32>(0.0);
    for (var stripe = band; stripe < pass_of.stripe_count; stripe += RETURN_BANDS) {
        workgroupBarrier();
        for (var at = lane; at < TILE_EDGE * BLOCK; at += LANES) {
            let slot = stripe * TILE_EDGE + at / BLOCK;
            let area = residents[slot].area;
            let scale = select(0.0, residents[slot].reflectance[channel] / area, area > 0.0);
            sent[at] = scale * exchange[slot * BLOCK + at % BLOCK];
            arrived[at] = columns[(channel * pass_of.rows + slot) * BLOCK + at % BLOCK];
        }
        workgroupBarrier();
        for (var row = 0u; row < TILE_EDGE; row++) {
            let at = row * BLOCK + to;
            let here = vec4<f32>(arrived[at], arrived[at + 1u], arrived[at + 2u], arrived[at + 3u]);
            total += sent[row * BLOCK + sender] * here;
        }
    }
    let out = ((band * 3u + channel) * BLOCK + sender) * BLOCK + to;
    for (var k = 0u; k < 4u; k++) {
        returned[out + k] = total[k];
    }
}
