// Strikes who leaves from rows, in order, appends who comes, and sums what is left for the outside. What a row loses of the
// light of those who leave is booked to it. One workgroup a row. CPU twin: `radiosity::solver::links::LinkRows`.

@group(0) @binding(3) var<storage, read> newcomers: array<Link>;
@group(0) @binding(4) var<storage, read_write> links: array<Link>;
@group(0) @binding(5) var<storage, read_write> rows: array<LiveRow>;
@group(0) @binding(6) var<storage, read_write> outside_shares: array<f32>;
@group(0) @binding(7) var<storage, read> sent: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> arriving: array<vec4<f32>>;

var<workgroup> lane_lights: array<vec4<f32>, 256>;

// Light that those who leave have sent, less of which arrives from now on.
fn take_back(slot: u32, own: vec4<f32>, lane: u32) {
    lane_lights[lane] = own;
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            lane_lights[lane] += lane_lights[lane + half];
        }
    }
    if lane == 0u {
        arriving[slot] -= lane_lights[0];
    }
}

// The sum of a row, lane by lane, then halves. CPU twin: `radiosity::tables::masses::total_of`.
fn sum_of(first: u32, count: u32, lane: u32) -> f32 {
    var sum = 0.0;
    for (var item = lane; item < count; item += LANES) {
        sum += max(links[first + item].share, 0.0);
    }
    lane_lights[lane].x = sum;
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            lane_lights[lane].x += lane_lights[lane + half].x;
        }
    }
    return lane_lights[0].x;
}

@compute @workgroup_size(256)
fn edit_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.x + group.y * GRID_WIDTH;
    if number >= pass_of.entry_count {
        return;
    }
    let edit = edits[number];
    var kept = edit.old_count;
    if pass_of.is_leaving != 0u || edit.first != edit.old_first {
        kept = 0u;
        var lost = vec4<f32>(0.0);
        for (var first = 0u; first < edit.old_count; first += LANES) {
            let item = first + lane;
            var link = Link();
            var stays = 0u;
            if item < edit.old_count {
                link = links[edit.old_first + item];
                // Where nobody leaves, bits are of those before, whose slots others may hold by now.
                if pass_of.is_leaving != 0u && is_leaving(link.slot) {
                    lost += link.share * sent[link.slot];
                } else {
                    stays = 1u;
                }
            }
            // All lanes have read before any writes: a row that stays where it is only ever moves down.
            let before = sums_before(vec4<u32>(stays, 0u, 0u, 0u), lane).x;
            let more = lane_counts[LANES - 1u].x;
            if stays == 1u {
                links[edit.first + kept + before] = link;
            }
            kept += more;
            workgroupBarrier();
        }
        take_back(edit.slot, lost, lane);
    }
    for (var at = lane; at < edit.new_count; at += LANES) {
        links[edit.first + kept + at] = newcomers[edit.first_new + at];
    }
    storageBarrier();
    workgroupBarrier();
    let count = kept + edit.new_count;
    let sum = sum_of(edit.first, count, lane);
    if lane == 0u {
        rows[edit.slot] = LiveRow(edit.first, count);
        outside_shares[edit.slot] = 1.0 - sum;
    }
}
