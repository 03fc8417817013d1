// Writes what the patches of a block exchange with residents into the block's columns, which are zero. Who was refused, and
// the host does not know yet, is passed over. One thread an entry; no two entries name the same place. Host side: `gpu::matrix::add`.

struct ExchangeEntry {
    at: u32,            // 0  slot * BLOCK + place
    exchange_m2: f32,   // 4
}                       // 8

@group(0) @binding(1) var<storage, read> entries: array<ExchangeEntry>;
@group(0) @binding(2) var<storage, read> residents: array<Resident>;
@group(0) @binding(3) var<storage, read_write> columns: array<f32>;

@compute @workgroup_size(256)
fn scatter_exchange(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if at < pass_of.entry_count && residents[entries[at].at / BLOCK].area > 0.0 {
        columns[entries[at].at] = entries[at].exchange_m2;
    }
}
