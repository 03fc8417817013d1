// Copies the columns of a block's members out of the bound part of one plane; zero where a row's slot is free. One thread
// a row and member; columns of places without a member are left as they are.
// CPU twin: `radiosity::local_matrix::LocalMatrix::copy_out`.

@group(0) @binding(1) var<storage, read> plane: array<f32>;
@group(0) @binding(2) var<storage, read> residents: array<Resident>;
@group(0) @binding(3) var<storage, read> members: array<Member>;
@group(0) @binding(4) var<storage, read_write> columns: array<f32>;

@compute @workgroup_size(256)
fn copy_columns(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = group.x * LANES + lane;
    let member = members[group.y];
    if slot >= pass_of.stripe_count * TILE_EDGE {
        return;
    }
    let high = max(slot, member.slot);
    let low = min(slot, member.slot);
    if is_bound(high / TILE_EDGE) {
        let value = select(0.0, plane[entry_at(high, low)], residents[slot].area > 0.0);
        columns[pass_of.channel * pass_of.channel_stride + slot * BLOCK + member.place] = value;
    }
}
