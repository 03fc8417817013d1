// sent = own + reflectance * arriving for all channels: what a product is to spread. One thread a slot.
// CPU twin: the loop over slots in `radiosity::CpuBackend::step`.

@group(0) @binding(1) var<storage, read> own: array<f32>;
@group(0) @binding(2) var<storage, read> arriving: array<f32>;
@group(0) @binding(3) var<storage, read> residents: array<Resident>;
@group(0) @binding(4) var<storage, read_write> sent: array<f32>;

@compute @workgroup_size(256)
fn emit_exitance(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = group.x * LANES + lane;
    if slot >= pass_of.rows {
        return;
    }
    for (var channel = 0u; channel < 3u; channel++) {
        let at = channel * pass_of.rows + slot;
        sent[at] = own[at] + residents[slot].reflectance[channel] * arriving[at];
    }
}
