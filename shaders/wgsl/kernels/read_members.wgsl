// Copies what a block's members exchange among themselves out of the bound part of one plane: the 32 x 32 numbers that
// `solve_block` solves for. One thread a pair. CPU twin: the loop of `radiosity::local_matrix::LocalMatrix::correction`.

@group(0) @binding(1) var<storage, read> plane: array<f32>;
@group(0) @binding(2) var<storage, read> members: array<Member>;
@group(0) @binding(3) var<storage, read_write> among: array<f32>;

@compute @workgroup_size(256)
fn read_members(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = group.x * LANES + lane;
    let receiver = at / BLOCK;
    let sender = at % BLOCK;
    if max(receiver, sender) >= pass_of.entry_count {
        return;
    }
    let high = max(members[receiver].slot, members[sender].slot);
    let low = min(members[receiver].slot, members[sender].slot);
    if is_bound(high / TILE_EDGE) {
        let to = members[receiver].place * BLOCK + members[sender].place;
        among[pass_of.channel * BLOCK * BLOCK + to] = plane[entry_at(high, low)];
    }
}
