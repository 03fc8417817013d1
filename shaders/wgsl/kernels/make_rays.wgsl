// The rays of fans, one after the other. One thread a ray.
// CPU twin: `trace::RayFan::query`.

@group(0) @binding(1) var<storage, read> fans: array<RayFan>;
@group(0) @binding(2) var<storage, read_write> queries: array<RayQuery>;

const TAU: f32 = 6.2831855;
// Steps of the R2 sequence, as 32-bit fractions.
const STEP_U: u32 = 3242174889u;
const STEP_V: u32 = 2447445414u;
const BELOW_ONE: f32 = 0.99999988;
const FARTHEST_M: f32 = 3.4028235e38;

// The last fan that begins at or before ray `at`.
fn fan_of(at: u32) -> u32 {
    var first = 0u;
    var end = pass_of.fan_count;
    while end - first > 1u {
        let middle = (first + end) / 2u;
        if fans[middle].first_ray <= at {
            first = middle;
        } else {
            end = middle;
        }
    }
    return first;
}

fn fraction(index: u32, step: u32, shift: f32) -> f32 {
    let value = f32((index * step) >> 8u) * (1.0 / 16777216.0) + shift;
    return min(value - floor(value), BELOW_ONE);
}

// Sine and cosine of whole turns from 0 to 1, within 2e-7: what a device has of its own may be off by 2^-11.
// Polynomials of S. Moshier's Cephes (sinf, cosf) within an eighth of a turn.
fn sine_and_cosine(turns: f32) -> vec2<f32> {
    let quarter = floor(turns * 4.0 + 0.5);
    let angle = (turns - quarter * 0.25) * TAU;
    let square = angle * angle;
    let sine = angle
        + angle * square * (-1.6666654611e-1 + square * (8.3321608736e-3 - square * 1.9515295891e-4));
    let high = 4.166664568298827e-2 + square * (-1.388731625493765e-3 + square * 2.443315711809948e-5);
    let cosine = 1.0 - 0.5 * square + square * square * high;
    let swapped = select(vec2<f32>(sine, cosine), vec2<f32>(cosine, sine), (u32(quarter) & 1u) == 1u);
    let negated = vec2<bool>((u32(quarter) & 2u) == 2u, ((u32(quarter) + 1u) & 2u) == 2u);
    return select(swapped, -swapped, negated);
}

// Unit direction about unit `normal` with density `cos / pi`.
fn cosine_direction(normal: vec3<f32>, u: f32, v: f32) -> vec3<f32> {
    // Two directions across (T. Duff and others, Building an Orthonormal Basis, Revisited, 2017).
    let side = select(1.0, -1.0, (bitcast<u32>(normal.z) >> 31u) == 1u);
    let a = -1.0 / (side + normal.z);
    let b = normal.x * normal.y * a;
    let tangent = vec3<f32>(1.0 + side * normal.x * normal.x * a, side * b, -side * normal.x);
    let bitangent = vec3<f32>(b, side + normal.y * normal.y * a, -normal.y);
    let turned = sqrt(u) * sine_and_cosine(v);
    let up = sqrt(max(1.0 - u, 0.0));
    return normalize(tangent * turned.y + bitangent * turned.x + normal * up);
}

@compute @workgroup_size(256)
fn make_rays(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.x + group.y * GRID_WIDTH) * LANES + lane;
    if at >= pass_of.entry_count {
        return;
    }
    let fan = fans[fan_of(at)];
    let pair = fan.first_pair + at - fan.first_ray;
    let made = cosine_direction(fan.normal, fraction(pair, STEP_U, fan.shift.x), fraction(pair, STEP_V, fan.shift.y));
    // Trees are not asked with minus zeros.
    let direction = select(made, vec3<f32>(0.0), made == vec3<f32>(0.0));
    queries[at] = RayQuery(fan.origin - direction * RUN_UP_M, RUN_UP_M, direction, FARTHEST_M);
}
