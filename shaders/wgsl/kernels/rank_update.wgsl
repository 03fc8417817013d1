// plane += columns * update' of one channel: rank 32. One workgroup a tile of the bound part, 4 x 4 numbers a thread.
// On the diagonal the lower half is computed and written twice, so that a plane stays symmetric to the bit.
// CPU twin: `radiosity::tile_kernel::StripeUpdate`.

@group(0) @binding(1) var<storage, read_write> plane: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> columns: array<f32>;
@group(0) @binding(3) var<storage, read> update: array<f32>;

// For each of the block's patches, four rows at a time.
var<workgroup> left: array<vec4<f32>, 512>;
var<workgroup> right: array<vec4<f32>, 512>;

fn load(stripe: u32, column: u32, lane: u32) {
    let base = (pass_of.channel * pass_of.rows) * BLOCK;
    for (var at = lane; at < 512u; at += LANES) {
        let k = at % BLOCK;
        let quad = at / BLOCK;
        let row = base + (stripe * TILE_EDGE + quad * 4u) * BLOCK + k;
        left[k * 16u + quad] =
            vec4<f32>(columns[row], columns[row + BLOCK], columns[row + 2u * BLOCK], columns[row + 3u * BLOCK]);
        let across = base + (column * TILE_EDGE + quad * 4u) * BLOCK + k;
        right[k * 16u + quad] =
            vec4<f32>(update[across], update[across + BLOCK], update[across + 2u * BLOCK], update[across + 3u * BLOCK]);
    }
}

@compute @workgroup_size(256)
fn rank_update(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let column = group.x;
    let stripe = group.y + pass_of.first_stripe;
    if column > stripe {
        return;
    }
    load(stripe, column, lane);
    workgroupBarrier();
    let down = lane / 16u;
    let across = lane % 16u;
    let is_diagonal = stripe == column;
    if is_diagonal && across > down {
        return;
    }
    var total = mat4x4<f32>();
    for (var k = 0u; k < BLOCK; k++) {
        let here = left[k * 16u + down];
        let there = right[k * 16u + across];
        total[0] += here.x * there;
        total[1] += here.y * there;
        total[2] += here.z * there;
        total[3] += here.w * there;
    }
    let quads = TILE_EDGE / 4u;
    let tile = tile_at(stripe, column) / 4u;
    var rows = mat4x4<f32>();
    for (var r = 0u; r < 4u; r++) {
        rows[r] = plane[tile + (down * 4u + r) * quads + across] + total[r];
    }
    if is_diagonal && across == down {
        for (var r = 0u; r < 4u; r++) {
            for (var c = r + 1u; c < 4u; c++) {
                rows[r][c] = rows[c][r];
            }
        }
    }
    for (var r = 0u; r < 4u; r++) {
        plane[tile + (down * 4u + r) * quads + across] = rows[r];
    }
    if is_diagonal && across < down {
        let mirrored = transpose(rows);
        for (var r = 0u; r < 4u; r++) {
            plane[tile + (across * 4u + r) * quads + down] = mirrored[r];
        }
    }
}
