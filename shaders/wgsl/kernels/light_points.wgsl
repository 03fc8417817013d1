// What each light brings to each point, with shadows. One thread a point and light.
// CPU twins: `light::arrival`, `light::direct`.

// A point of a patch.
struct LightPoint {
    position: vec3<f32>,     //  0
    epsilon_m: f32,          // 12  how far off its surface its shadow rays begin
    normal: vec3<f32>,       // 16
    of_patch: u32,           // 28
}                            // 32

struct Lamp {
    position: vec3<f32>,     //  0  m
    kind: u32,               // 12  SUN, BARE or SPOT
    direction: vec3<f32>,    // 16  where its light goes
    range_m: f32,            // 28  0 for no limit
    intensity: vec3<f32>,    // 32  cd; of the sun what a surface receives that faces a place of its disc, lx
    cap_height: f32,         // 44  of the cap of directions that is the sun's disc, on the unit sphere
    inner_cosine: f32,       // 48
    outer_cosine: f32,       // 52
    spare: vec2<u32>,        // 56
}                            // 64

@group(0) @binding(4) var<storage, read> points: array<LightPoint>;
@group(0) @binding(5) var<storage, read> spans: array<PointSpan>;
@group(0) @binding(6) var<storage, read> lamps: array<Lamp>;
// Where each patch's walk over the disc of each lamp begins.
@group(0) @binding(7) var<storage, read> shifts: array<vec2<f32>>;
@group(0) @binding(8) var<storage, read_write> arriving: array<vec4<f32>>;

const SUN: u32 = 0u;
const SPOT: u32 = 2u;
// Smallest difference of a cone's cosines.
const CONE_COSINES_MIN: f32 = 1e-3;
// Below this share a ray counts as blocked.
const TRANSMITTANCE_MIN: f32 = 1e-3;
// The golden ratio's turn.
const GOLDEN_TURN: f32 = 0.618034;
const TURN: f32 = 6.2831855;
// As far as a ray goes.
const FAR_M: f32 = 3e38;

var<private> remaining: f32;

fn meet(at: u32, origin: vec3<f32>, direction: vec3<f32>) -> bool {
    if crossing_m(at, origin, direction, 0.0) > 0.0 {
        remaining *= triangles[at].transmittance;
        if remaining < TRANSMITTANCE_MIN {
            remaining = 0.0;
            return true;
        }
    }
    return false;
}

// A direction within the cap of `height` about unit `axis`.
fn direction_in_cap(axis: vec3<f32>, height_max: f32, disc: vec2<f32>) -> vec3<f32> {
    let height = height_max * disc.x;
    let radius = sqrt(max(height * (2.0 - height), 0.0));
    let side_of_z = select(-1.0, 1.0, axis.z >= 0.0);
    let a = -1.0 / (side_of_z + axis.z);
    let b = axis.x * axis.y * a;
    let side = vec3<f32>(1.0 + side_of_z * axis.x * axis.x * a, side_of_z * b, -side_of_z * axis.x);
    let up = vec3<f32>(b, side_of_z + axis.y * axis.y * a, -axis.y);
    let angle = TURN * disc.y;
    return normalize(axis * (1.0 - height) + (side * cos(angle) + up * sin(angle)) * radius);
}

// One on the axis, zero outside the outer cone, the square of a straight line in the cosine between.
fn cone_falloff(lamp: Lamp, cosine: f32) -> f32 {
    let width = max(lamp.inner_cosine - lamp.outer_cosine, CONE_COSINES_MIN);
    let linear = clamp((cosine - lamp.outer_cosine) / width, 0.0, 1.0);
    return linear * linear;
}

@compute @workgroup_size(64)
fn light_points(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = (group.x + group.y * GRID_WIDTH) * RAY_LANES + lane;
    if at >= pass_of.rows * pass_of.entry_count {
        return;
    }
    // All points of one lamp side by side: their rays go alike.
    let lamp_index = at / pass_of.rows;
    let point_index = at - lamp_index * pass_of.rows;
    let point = points[point_index];
    let lamp = lamps[lamp_index];
    let offset = lamp.position - point.position;
    var distance = length(offset);
    var towards = offset / max(distance, 1e-30);
    var strength = 1.0;
    if lamp.kind == SUN {
        towards = -lamp.direction;
        if lamp.cap_height > 0.0 {
            let span = spans[point.of_patch];
            let step = f32(point_index - span.first_point);
            let shift = shifts[point.of_patch * pass_of.entry_count + lamp_index];
            let disc = vec2<f32>((step + shift.x) / f32(span.point_count), fract(shift.y + step * GOLDEN_TURN));
            towards = direction_in_cap(towards, lamp.cap_height, disc);
        }
        distance = FAR_M;
    } else {
        if lamp.range_m > 0.0 {
            let share = distance / lamp.range_m;
            strength = clamp(1.0 - share * share * share * share, 0.0, 1.0);
        }
        strength = select(strength / (distance * distance), 0.0, distance == 0.0);
        if lamp.kind == SPOT {
            strength *= cone_falloff(lamp, dot(-towards, lamp.direction));
        }
    }
    let facing = max(dot(point.normal, towards), 0.0);
    let open = lamp.intensity * (strength * facing);
    remaining = 1.0;
    if max(open.x, max(open.y, open.z)) > 0.0 {
        // A lamp nearer than the epsilon has nothing in between that could be told apart from it.
        reach_m = max(distance - 2.0 * point.epsilon_m, 0.0);
        walk_trees(point.position + point.normal * point.epsilon_m, towards);
    }
    arriving[at] = vec4<f32>(open * remaining, 0.0);
}
