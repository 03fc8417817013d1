// Sets the rows and columns of a block's members in the bound part of one plane to what `finals` holds. One thread a row
// and member. Two members name the same entry twice: the one in the higher slot writes it, so no two threads meet. Who did
// not enter writes nothing.
// CPU twin: `radiosity::local_matrix::workspace::settle`.

@group(0) @binding(1) var<storage, read_write> plane: array<f32>;
@group(0) @binding(2) var<storage, read> finals: array<f32>;
@group(0) @binding(3) var<storage, read> members: array<Member>;

@compute @workgroup_size(256)
fn write_columns(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = group.x * LANES + lane;
    let member = members[group.y];
    if slot >= pass_of.stripe_count * TILE_EDGE || member.slot == NO_SLOT {
        return;
    }
    for (var other = 0u; other < pass_of.entry_count; other++) {
        if members[other].slot == slot && slot < member.slot {
            return;
        }
    }
    let high = max(slot, member.slot);
    let low = min(slot, member.slot);
    if !is_bound(high / TILE_EDGE) {
        return;
    }
    let value = finals[pass_of.channel * pass_of.channel_stride + slot * BLOCK + member.place];
    plane[entry_at(high, low)] = value;
    if high / TILE_EDGE == low / TILE_EDGE {
        plane[entry_at(low, high)] = value;
    }
}
