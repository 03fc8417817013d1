// What each listed tile of the bound part adds to the product plane * sent: once for its rows, once mirrored for its
// columns. One workgroup a tile; a thread holds four numbers of four rows. Rows that neither carry light nor are wanted
// are not read. `tile_sums[channel][row stripe][column stripe]` are 64 numbers each, summed by sum_tiles.
// CPU twin: `radiosity::tile_kernel::BandProduct`.

@group(0) @binding(1) var<storage, read> plane: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> tiles: array<u32>;
@group(0) @binding(3) var<storage, read> marks: array<StripeMarks>;
@group(0) @binding(4) var<storage, read> sent: array<f32>;
@group(0) @binding(5) var<storage, read_write> tile_sums: array<f32>;

// One more than the sixteen threads of a row: rows then lie in different banks.
const PITCH: u32 = 17u;

var<workgroup> of_rows: array<f32, 1088>;
var<workgroup> of_columns: array<vec4<f32>, 256>;

@compute @workgroup_size(256)
fn multiply_tiles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    if number >= pass_of.entry_count {
        return;
    }
    let stripe = tiles[number] >> 16u;
    let column = tiles[number] & 65535u;
    if !is_bound(stripe) {
        return;
    }
    let quad = lane % 16u;
    let vector = pass_of.channel * pass_of.rows;
    let across = vector + column * TILE_EDGE + quad * 4u;
    let light = vec4<f32>(sent[across], sent[across + 1u], sent[across + 2u], sent[across + 3u]);
    let tile = tile_at(stripe, column) / 4u;
    var mirrored = vec4<f32>(0.0);
    for (var r = 0u; r < 4u; r++) {
        let row = lane / 16u + 16u * r;
        var sum = 0.0;
        if is_marked(marks[stripe].lit | marks[stripe].wanted, row) {
            let numbers = plane[tile + row * (TILE_EDGE / 4u) + quad];
            sum = dot(numbers, light);
            mirrored += numbers * sent[vector + stripe * TILE_EDGE + row];
        }
        of_rows[row * PITCH + quad] = sum;
    }
    of_columns[lane] = mirrored;
    workgroupBarrier();
    let stripes = pass_of.rows / TILE_EDGE;
    let slot = lane % TILE_EDGE;
    if lane < TILE_EDGE {
        var total = 0.0;
        for (var k = 0u; k < 16u; k++) {
            total += of_rows[slot * PITCH + k];
        }
        tile_sums[((pass_of.channel * stripes + stripe) * stripes + column) * TILE_EDGE + slot] = total;
    } else if lane < 2u * TILE_EDGE && stripe != column {
        var total = 0.0;
        for (var k = 0u; k < 16u; k++) {
            total += of_columns[k * 16u + slot / 4u][slot % 4u];
        }
        tile_sums[((pass_of.channel * stripes + column) * stripes + stripe) * TILE_EDGE + slot] = total;
    }
}
