// Light and what a hybrid estimates beside it, which is nothing where what is unshot is not worth a draw; a channel after
// the other. One thread a slot.
// CPU twin: `radiosity::solver::CpuRowLight`'s `published`.

@group(0) @binding(1) var<storage, read> irradiance: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> shot_words: array<u32>;
@group(0) @binding(3) var<storage, read_write> rest: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> published: array<f32>;

// Below this share of all light the rest is not worth a draw.
const UNSHOT_MIN: f32 = 1e-3;

@compute @workgroup_size(256)
fn publish_light(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if slot >= pass_of.entry_count {
        return;
    }
    if bitcast<f32>(shot_words[SHOT_UNSHOT_SHARE]) <= UNSHOT_MIN {
        rest[slot] = vec4<f32>(0.0);
    }
    let light = irradiance[slot] + rest[slot];
    let stride = pass_of.channel_stride;
    published[slot] = light.x;
    published[stride + slot] = light.y;
    published[2u * stride + slot] = light.z;
}
