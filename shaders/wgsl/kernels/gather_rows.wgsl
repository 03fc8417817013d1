// What arrives at each of some slots: a sum over its row, and what comes from outside. 64 lanes a row, four rows a workgroup.
// CPU twin: `radiosity::solver::step_gather::bounce`.

@group(0) @binding(1) var<storage, read> slots: array<u32>;
@group(0) @binding(2) var<storage, read> rows: array<LiveRow>;
@group(0) @binding(3) var<storage, read> links: array<Link>;
@group(0) @binding(4) var<storage, read> sent: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> outside: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> gathered: array<vec4<f32>>;

// Lanes of a row.
const ROW_LANES: u32 = 64u;

var<workgroup> lane_lights: array<vec4<f32>, 256>;

@compute @workgroup_size(256)
fn gather_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.x + group.y * GRID_WIDTH) * (LANES / ROW_LANES) + lane / ROW_LANES;
    var slot = 0u;
    var sum = vec4<f32>(0.0);
    if at < pass_of.entry_count {
        slot = slots[at];
        let row = rows[slot];
        for (var item = lane % ROW_LANES; item < row.count; item += ROW_LANES) {
            let link = links[row.first + item];
            sum += link.share * sent[link.slot];
        }
    }
    lane_lights[lane] = sum;
    for (var half = ROW_LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane % ROW_LANES < half {
            lane_lights[lane] += lane_lights[lane + half];
        }
    }
    if at < pass_of.entry_count && lane % ROW_LANES == 0u {
        gathered[slot] = lane_lights[lane] + outside[slot];
    }
}
