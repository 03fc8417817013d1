// Decides who of a block enters, and solves its 32 x 32 systems: `Id - D T` is swept in the order of the block and without
// exchanging rows, D reflectance over area and T the light that comes back. A pivot met at a patch is then the one that it
// would have alone, after those before it; below `pivot_min` in any channel, the patch is left out as if it had not come.
// Who leaves is the same system for T = -G: nobody is refused. One workgroup, all channels: a patch is refused in all.
// In f32: what comes back is known no better. CPU twin: `radiosity::local_matrix::capacitance`, in f64.

// Of one channel. `small` has N, K, T N for each.
const MATRIX_LEN: u32 = 1024u;

// By bands of rows, as `return_light` leaves it.
@group(0) @binding(1) var<storage, read> returned: array<f32>;
// Of who enters, what the block exchanges directly, one for all channels; of who leaves, G. T afterwards.
@group(0) @binding(2) var<storage, read_write> among: array<f32>;
// By place: who wants to enter. Without area it is nobody.
@group(0) @binding(3) var<storage, read> offered: array<Resident>;
@group(0) @binding(4) var<storage, read_write> residents: array<Resident>;
// Who does not enter is struck.
@group(0) @binding(5) var<storage, read_write> members: array<Member>;
// Of who enters, the members' own rows are set to what they exchange directly.
@group(0) @binding(6) var<storage, read_write> exchange: array<f32>;
@group(0) @binding(7) var<storage, read_write> small: array<f32>;
// A bit a slot: its patch was refused.
@group(0) @binding(8) var<storage, read_write> refused: array<atomic<u32>>;

var<workgroup> system: array<f32, 3072>;

fn scale_of(place: u32, channel: u32) -> f32 {
    if place >= pass_of.entry_count {
        return 0.0;
    }
    var patch_there = offered[place];
    if pass_of.is_leaving == 1u {
        patch_there = residents[members[place].slot];
    }
    return select(0.0, patch_there.reflectance[channel] / patch_there.area, patch_there.area > 0.0);
}

// What comes back by way of residents, and its mirror image: equal but for rounding.
fn returned_light(receiver: u32, sender: u32, channel: u32) -> f32 {
    var sum = vec2<f32>(0.0);
    for (var band = 0u; band < RETURN_BANDS; band++) {
        let base = (band * 3u + channel) * MATRIX_LEN;
        sum += vec2<f32>(returned[base + receiver * BLOCK + sender], returned[base + sender * BLOCK + receiver]);
    }
    return 0.5 * (sum.x + sum.y);
}

fn set_up(lane: u32) {
    for (var at = lane; at < MATRIX_LEN; at += LANES) {
        let receiver = at / BLOCK;
        let sender = at % BLOCK;
        let is_there = max(receiver, sender) < pass_of.entry_count;
        // Not a number beyond the members, perhaps.
        let direct = select(0.0, among[at], is_there);
        for (var channel = 0u; channel < 3u; channel++) {
            let own = channel * MATRIX_LEN + at;
            var light = 0.0;
            if is_there && pass_of.is_leaving == 1u {
                light = -among[own];
            } else if is_there {
                light = returned_light(receiver, sender, channel) + direct;
            }
            among[own] = light;
            system[own] = select(0.0, 1.0, receiver == sender) - scale_of(receiver, channel) * light;
        }
        if is_there && pass_of.is_leaving == 0u {
            exchange[members[receiver].slot * BLOCK + sender] = direct;
        }
    }
}

// One step of the in-place Gauss-Jordan inverse of all channels, unless a pivot is weak. Returns whether it is not.
fn sweep(place: u32, lane: u32) -> bool {
    var usable = pass_of.is_leaving == 1u || offered[place].area > 0.0;
    var swept = array<f32, 12>();
    for (var k = 0u; k < 12u; k++) {
        let channel = k / 4u;
        let at = k % 4u * LANES + lane;
        let base = channel * MATRIX_LEN;
        let pivot = system[base + place * BLOCK + place];
        let reciprocal = 1.0 / pivot;
        let above = system[base + place * BLOCK + at % BLOCK] * reciprocal;
        let beside = system[base + at / BLOCK * BLOCK + place];
        let is_row = at / BLOCK == place;
        let is_column = at % BLOCK == place;
        let elsewhere = select(system[base + at] - beside * above, -beside * reciprocal, is_column);
        swept[k] = select(elsewhere, select(above, reciprocal, is_column), is_row);
        usable = usable && pivot >= pass_of.pivot_min;
    }
    workgroupBarrier();
    for (var k = 0u; k < 12u; k++) {
        let own = k / 4u * MATRIX_LEN + k % 4u * LANES + lane;
        if usable {
            system[own] = swept[k];
        }
    }
    workgroupBarrier();
    return usable;
}

// N of who is in, zero elsewhere.
fn inverse_of(receiver: u32, sender: u32, channel: u32, kept: u32) -> f32 {
    let is_in = (kept >> receiver & kept >> sender & 1u) == 1u;
    return select(0.0, system[channel * MATRIX_LEN + receiver * BLOCK + sender], is_in);
}

// What `receiver` receives of `sender` once the loop is closed: an entry of T N.
fn closed(receiver: u32, sender: u32, channel: u32, kept: u32) -> f32 {
    var sum = 0.0;
    for (var k = 0u; k < BLOCK; k++) {
        sum += among[channel * MATRIX_LEN + receiver * BLOCK + k] * inverse_of(k, sender, channel, kept);
    }
    return sum;
}

fn hand_over(kept: u32, lane: u32) {
    let is_leaving = pass_of.is_leaving == 1u;
    for (var at = lane; at < 3u * MATRIX_LEN; at += LANES) {
        let channel = at / MATRIX_LEN;
        let receiver = at % MATRIX_LEN / BLOCK;
        let sender = at % BLOCK;
        let forth = inverse_of(receiver, sender, channel, kept);
        let back = inverse_of(sender, receiver, channel, kept);
        let factor = 0.5 * (forth * scale_of(sender, channel) + back * scale_of(receiver, channel));
        let is_in = (kept >> receiver & kept >> sender & 1u) == 1u;
        var light = 0.0;
        if is_in && !is_leaving {
            light = 0.5 * (closed(receiver, sender, channel, kept) + closed(sender, receiver, channel, kept));
        }
        let out = 3u * channel * MATRIX_LEN + at % MATRIX_LEN;
        small[out] = select(forth, 0.0, is_leaving);
        small[out + MATRIX_LEN] = select(factor, -factor, is_leaving);
        small[out + 2u * MATRIX_LEN] = light;
        // Nobody sees who does not enter.
        if channel == 0u && !is_leaving && receiver < pass_of.entry_count && (kept >> receiver & 1u) == 0u {
            exchange[members[receiver].slot * BLOCK + sender] = 0.0;
        }
    }
}

fn note(place: u32, is_kept: bool) {
    let slot = members[place].slot;
    let is_leaving = pass_of.is_leaving == 1u;
    var here = Resident();
    if is_kept && !is_leaving {
        here = offered[place];
    }
    residents[slot] = here;
    if is_kept || is_leaving {
        atomicAnd(&refused[slot / 32u], ~(1u << slot % 32u));
    } else {
        atomicOr(&refused[slot / 32u], 1u << slot % 32u);
        members[place].slot = NO_SLOT;
    }
}

@compute @workgroup_size(256)
fn solve_block(@builtin(local_invocation_index) lane: u32) {
    set_up(lane);
    storageBarrier();
    workgroupBarrier();
    var kept = 0u;
    for (var place = 0u; place < pass_of.entry_count; place++) {
        if sweep(place, lane) {
            kept |= 1u << place;
        }
    }
    hand_over(kept, lane);
    storageBarrier();
    if lane < pass_of.entry_count {
        note(lane, (kept >> lane & 1u) == 1u);
    }
}
