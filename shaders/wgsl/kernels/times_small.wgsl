// finals = columns * N and update = columns * K for all channels, N and K the 32 x 32 matrices of `solve_block`.
// Rows of the block's own members are not sums: they are `among`. One thread a number.
// CPU twin: `radiosity::local_matrix::workspace::times_small`.

// For each channel: N, K, `among`, each row-major.
const MATRIX_LEN: u32 = 1024u;

@group(0) @binding(1) var<storage, read> columns: array<f32>;
@group(0) @binding(2) var<storage, read> small: array<f32>;
@group(0) @binding(3) var<storage, read> members: array<Member>;
@group(0) @binding(4) var<storage, read_write> finals: array<f32>;
@group(0) @binding(5) var<storage, read_write> update: array<f32>;

@compute @workgroup_size(256)
fn times_small(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let within = group.x * LANES + lane;
    let channel = group.y;
    let slot = within / BLOCK;
    let place = within % BLOCK;
    let row = (channel * pass_of.rows + slot) * BLOCK;
    let inverse = channel * 3u * MATRIX_LEN;
    let factor = inverse + MATRIX_LEN;
    var final_value = 0.0;
    var update_value = 0.0;
    for (var k = 0u; k < BLOCK; k++) {
        let value = columns[row + k];
        final_value += value * small[inverse + k * BLOCK + place];
        update_value += value * small[factor + k * BLOCK + place];
    }
    for (var at = 0u; at < pass_of.entry_count; at++) {
        if members[at].slot == slot {
            final_value = small[factor + MATRIX_LEN + members[at].place * BLOCK + place];
        }
    }
    finals[row + place] = final_value;
    update[row + place] = update_value;
}
