// What arrives at receivers from slots, from coarse parents and from the sky. 32 lanes a receiver, eight a workgroup.
// CPU twin: `radiosity::receivers::gather_receivers`.

@group(0) @binding(1) var<storage, read> asked: array<ReceiverAsked>;
@group(0) @binding(2) var<storage, read> rows: array<ReceiverSpan>;
@group(0) @binding(3) var<storage, read> columns: array<u32>;
@group(0) @binding(4) var<storage, read> spans: array<SegmentSpan>;
@group(0) @binding(5) var<storage, read> source_of: array<u32>;
@group(0) @binding(6) var<storage, read> sources: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> sky: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> gathered: array<ReceiverLight>;

// Lanes of a row: receivers in the air have some 24 columns.
const ROW_LANES: u32 = 32u;

const PI: f32 = 3.14159274;

// Light and share from slots, light and fed share from parents, share of what is far.
var<workgroup> lane_near: array<vec4<f32>, 256>;
var<workgroup> lane_far: array<vec4<f32>, 256>;
var<workgroup> lane_far_share: array<f32, 256>;

// Segment of its chunk, and the patch in it times 2^16.
fn target_of(receiver: ReceiverAsked, row: ReceiverSpan, item: u32) -> u32 {
    if receiver.first_target == NO_TARGETS {
        return columns[row.first + 2u * item];
    }
    return columns[receiver.first_target + (columns[row.first + item] & 0xFFFFu)];
}

// Exact: every half float over a power of two that is asked for is a normal f32, or zero.
fn share_of(receiver: ReceiverAsked, row: ReceiverSpan, item: u32) -> f32 {
    if receiver.first_target == NO_TARGETS {
        return bitcast<f32>(columns[row.first + 2u * item + 1u]);
    }
    let half = columns[row.first + item] >> 16u;
    let exponent = half >> 10u;
    let whole = (half & 0x3FFu) + select(1024u, 0u, exponent == 0u);
    let scale = 127 + i32(max(exponent, 1u)) - 25 - i32(row.count >> 24u);
    return f32(whole) * bitcast<f32>(u32(scale) << 23u);
}

@compute @workgroup_size(256)
fn gather_receivers(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.x + group.y * GRID_WIDTH) * (LANES / ROW_LANES) + lane / ROW_LANES;
    var near = vec4<f32>(0.0);
    var far = vec4<f32>(0.0);
    var far_share = 0.0;
    if at < pass_of.entry_count {
        let receiver = asked[at];
        let row = rows[receiver.row];
        for (var item = lane % ROW_LANES; item < (row.count & ROW_COLUMNS_MAX); item += ROW_LANES) {
            let patch_of = target_of(receiver, row, item);
            let share = share_of(receiver, row, item);
            let span = spans[receiver.first_span + (patch_of & 0xFFFFu)];
            let local = patch_of >> 16u;
            var source = NO_SOURCE;
            if local < span.count {
                source = source_of[span.first + local];
            }
            if source < pass_of.rows {
                near += share * vec4<f32>(sources[source].xyz, 1.0);
            } else {
                far_share += share;
                if source != NO_SOURCE {
                    far += share * sources[source];
                }
            }
        }
    }
    lane_near[lane] = near;
    lane_far[lane] = far;
    lane_far_share[lane] = far_share;
    for (var half = ROW_LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane % ROW_LANES < half {
            lane_near[lane] += lane_near[lane + half];
            lane_far[lane] += lane_far[lane + half];
            lane_far_share[lane] += lane_far_share[lane + half];
        }
    }
    if at < pass_of.entry_count && lane % ROW_LANES == 0u {
        let row = rows[asked[at].row];
        let first = row.first_sky.x * sky[0] + row.first_sky.y * sky[1] + row.first_sky.z * sky[2];
        let last = row.last_sky.x * sky[3] + row.last_sky.y * sky[4] + row.last_sky.z * sky[5];
        gathered[at] = ReceiverLight(
            lane_near[lane].xyz,
            lane_near[lane].w,
            lane_far[lane].xyz,
            lane_far[lane].w,
            PI * (first.xyz + last.xyz),
            lane_far_share[lane],
        );
    }
}
