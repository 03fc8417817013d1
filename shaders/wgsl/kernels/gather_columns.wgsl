// sums[part and section] = plane * (scale * right), 32 columns: the bound part of one plane, one section of its columns.
// `scale` is reflectance / area of the channel. One workgroup a stripe of results and a section; columns stripes without
// anything on the right are passed over. A tile below the diagonal is read for its own rows, and mirrored for its columns'.
// CPU twin: `radiosity::tile_kernel::StripeGather`.

@group(0) @binding(1) var<storage, read> plane: array<f32>;
@group(0) @binding(2) var<storage, read> right: array<f32>;
@group(0) @binding(3) var<storage, read> residents: array<Resident>;
@group(0) @binding(4) var<storage, read> is_named: array<u32>;
@group(0) @binding(5) var<storage, read_write> sums: array<f32>;

// Columns of a tile that are worked on at a time.
const DEPTH: u32 = 32u;
// One more than rows: neighbours along a column then lie in different banks.
const PITCH: u32 = 65u;

var<workgroup> tile_columns: array<f32, 2080>;
var<workgroup> right_rows: array<f32, 1024>;

// `tile_columns[k][row]` for DEPTH columns of the tile from `first`.
fn load_tile(stripe: u32, column: u32, first: u32, lane: u32) {
    let is_mirrored = column > stripe;
    let tile = tile_at(max(stripe, column), min(stripe, column));
    for (var at = lane; at < TILE_EDGE * DEPTH; at += LANES) {
        if is_mirrored {
            let k = at / TILE_EDGE;
            let row = at % TILE_EDGE;
            tile_columns[k * PITCH + row] = plane[tile + (first + k) * TILE_EDGE + row];
        } else {
            let row = at / DEPTH;
            let k = at % DEPTH;
            tile_columns[k * PITCH + row] = plane[tile + row * TILE_EDGE + first + k];
        }
    }
}

fn load_right(column: u32, first: u32, lane: u32) {
    for (var at = lane; at < DEPTH * BLOCK; at += LANES) {
        let slot = column * TILE_EDGE + first + at / BLOCK;
        let area = residents[slot].area;
        let scale = select(0.0, residents[slot].reflectance[pass_of.channel] / area, area > 0.0);
        let value = right[pass_of.channel * pass_of.channel_stride + slot * BLOCK + at % BLOCK];
        right_rows[at] = scale * value;
    }
}

@compute @workgroup_size(256)
fn gather_columns(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let stripe = group.x;
    let section = group.y;
    let row = lane / 16u * 4u;
    let place = lane % 16u * 2u;
    var total = array<vec2<f32>, 4>();
    for (var column = section; column < pass_of.stripe_count; column += SECTIONS) {
        if is_named[column] == 0u || !is_bound(max(stripe, column)) {
            continue;
        }
        for (var first = 0u; first < TILE_EDGE; first += DEPTH) {
            workgroupBarrier();
            load_tile(stripe, column, first, lane);
            load_right(column, first, lane);
            workgroupBarrier();
            for (var k = 0u; k < DEPTH; k++) {
                let factor = vec2<f32>(right_rows[k * BLOCK + place], right_rows[k * BLOCK + place + 1u]);
                let base = k * PITCH + row;
                total[0] += tile_columns[base] * factor;
                total[1] += tile_columns[base + 1u] * factor;
                total[2] += tile_columns[base + 2u] * factor;
                total[3] += tile_columns[base + 3u] * factor;
            }
        }
    }
    let block = (pass_of.channel * pass_of.part_count + pass_of.part) * SECTIONS + section;
    for (var r = 0u; r < 4u; r++) {
        let at = (block * pass_of.rows + stripe * TILE_EDGE + row + r) * BLOCK + place;
        sums[at] = total[r].x;
        sums[at + 1u] = total[r].y;
    }
}
