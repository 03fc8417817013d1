// result = first_weight * first + second_weight * second + the sums of `gather_columns`, for all channels.
// One thread a number. CPU twin: the loops after `gather_named` in `radiosity::local_matrix`.

@group(0) @binding(1) var<storage, read> first: array<f32>;
@group(0) @binding(2) var<storage, read> second: array<f32>;
@group(0) @binding(3) var<storage, read> sums: array<f32>;
@group(0) @binding(4) var<storage, read_write> result: array<f32>;

@compute @workgroup_size(256)
fn combine_columns(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let within = group.x * LANES + lane;
    let channel = group.y;
    let stride = pass_of.rows * BLOCK;
    let sections = pass_of.part_count * SECTIONS;
    var echo = 0.0;
    for (var section = 0u; section < sections; section++) {
        echo += sums[(channel * sections + section) * stride + within];
    }
    let at = channel * stride + within;
    // What has no weight is not read: it may hold anything.
    if pass_of.second_weight != 0.0 {
        echo += pass_of.second_weight * second[at];
    }
    result[at] = pass_of.first_weight * first[channel * pass_of.channel_stride + within] + echo;
}
