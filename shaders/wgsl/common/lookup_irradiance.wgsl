// The lookup rule: what light a point with a normal reads from the voxels around it.
//
// Paste into a shader that is given volumes as the client library lays them out (`earthshine_volume::ShaderVolumes`): layouts,
// finest first; one place a voxel (0 for dark, else one more than the index of its block), of layers of detail the places of
// one after those of the other; one block a lit voxel. The Rust twin is `earthshine_volume::lookup`.

// How far a point reads in front of its surface, in voxels.
const NORMAL_OFFSET_VOXELS: f32 = 0.25;
// Patches of this weight among the eight voxels leave nothing to receivers.
const SURFACE_WEIGHT: f32 = 0.25;
// Light is at least this share of what the three directions that a point faces add up to.
const AIR_FLOOR: f32 = 0.75;
// Weights below it are nothing.
const WEIGHT_MIN: f32 = 1e-6;
// At this distance from its plane, in voxels, a value counts half.
const PLANE_REACH_VOXELS: f32 = 0.1;
// A point as near to a plane, in voxels, lies on its surface; from the second distance on it is in the air, where the
// surface counts so much nevertheless.
const SURFACE_TO_VOXELS: f32 = 0.1;
const AIR_FROM_VOXELS: f32 = 0.3;
const FAR_SURFACE: f32 = 0.01;
// At this distance from its tilted plane, in voxels, a value counts a quarter.
const TILT_REACH_VOXELS: f32 = 0.1;
// A value whose normal differs by this, as the sine of half the angle, counts a quarter.
const TURN_REACH: f32 = 0.05;
// How far from the middle of its voxel a barrier may be, in voxels; codes of its angle and steps of its distance.
const BARRIER_REACH_VOXELS: f32 = 1.5;
const BARRIER_ANGLES: f32 = 252.0;
const BARRIER_STEPS: f32 = 250.0;
// So far beyond a barrier, in voxels, a value counts a sixteenth; what is farther beyond than the second counts no less.
const BEYOND_REACH_VOXELS: f32 = 0.05;
const BEYOND_MAX_VOXELS: f32 = 0.5;
// Steps between the two sides of a voxel; codes of planes are one more than the step, 0 for unknown.
const PLANE_STEPS: f32 = 254.0;

struct VolumeLayout {
    origin: vec3<i32>,      //  0  lowest voxel, in voxels
    voxel_edge_m: f32,      // 12  m
    dims: vec3<u32>,        // 16  voxels along the axes
    level: u32,             // 28  0 is the finest
    layers: u32,            // 32  of detail: volumes in one place; 1 where there is no detail
    first_place: u32,       // 36  of the voxels of the first layer
}                           // 48

struct VoxelBlock {
    present: u32,                 //  0  bit a: direction a has light; bit 8 + a: it is the air's (a receiver's)
    irradiance: array<u32, 6>,    //  4  RGB9E5, lx, in the order +X -X +Y -Y +Z -Z
    planes: array<u32, 6>,        // 28  bytes, lowest first: where its surface lies, and its tilted plane's three
    barriers: array<u32, 6>,      // 52  bytes, lowest first: angle and distance of one, and of another; zeros for none
}                                 // 76

@group(0) @binding(0) var<storage, read> volume_layouts: array<VolumeLayout>;
@group(0) @binding(1) var<storage, read> volume_places: array<u32>;
@group(0) @binding(2) var<storage, read> volume_blocks: array<VoxelBlock>;

// Shared-exponent colour, 9 bits a channel and 5 of exponent.
fn decode_rgb9e5(packed: u32) -> vec3<f32> {
    let scale = exp2(f32(packed >> 27u) - 24.0);
    return vec3<f32>(f32(packed & 511u), f32((packed >> 9u) & 511u), f32((packed >> 18u) & 511u)) * scale;
}

// Place of `voxel`'s block in layer `layer` of `volume` plus one; 0 where it has no light or lies outside.
fn place_of(volume: u32, voxel: vec3<i32>, layer: u32) -> u32 {
    let local = voxel - volume_layouts[volume].origin;
    let dims = vec3<i32>(volume_layouts[volume].dims);
    if any(local < vec3<i32>(0)) || any(local >= dims) {
        return 0u;
    }
    let index = u32(local.x + dims.x * (local.y + dims.y * (local.z + dims.z * i32(layer))));
    return volume_places[volume_layouts[volume].first_place + index];
}

// Which directions of `voxel` have light, and which of them the air's, as in a block: of the first layer.
fn present_of(volume: u32, voxel: vec3<i32>) -> u32 {
    let place = place_of(volume, voxel, 0u);
    return select(0u, volume_blocks[max(place, 1u) - 1u].present, place != 0u);
}

// How much of a point `distance` voxels from a plane lies on its surface, not in the air.
fn on_surface(distance: f32) -> f32 {
    return clamp((AIR_FROM_VOXELS - abs(distance)) / (AIR_FROM_VOXELS - SURFACE_TO_VOXELS), FAR_SURFACE, 1.0);
}

// Of a value with plane codes `planes` on an axis, for a point `from_middle` voxels from the middle of its voxel, on a surface
// with unit `normal`. x: how much it counts; y: how much of the point lies on its surface.
fn nearness(planes: u32, axis: u32, from_middle: vec3<f32>, normal: vec3<f32>) -> vec2<f32> {
    let tilt = (vec3<u32>(planes) >> vec3<u32>(8u, 16u, 24u)) & vec3<u32>(255u);
    if any(tilt == vec3<u32>(0u)) {
        let code = planes & 255u;
        let distance = select(0.0, from_middle[axis] + 0.5 - (f32(code) - 1.0) / PLANE_STEPS, code != 0u);
        // How far a surface with this normal may lie from the middle of its patch.
        let along = abs(normal[axis]);
        let slant = 0.5 * (dot(abs(normal), vec3<f32>(1.0)) - along) / max(along, 1e-30);
        let off = distance / PLANE_REACH_VOXELS;
        return vec2<f32>(1.0 / (1.0 + off * off), on_surface(max(abs(distance) - slant, 0.0)));
    }
    let flat = (vec2<f32>(tilt.xy) - 128.0) / 127.0;
    let z = 1.0 - abs(flat.x) - abs(flat.y);
    let fold = max(-z, 0.0);
    let own = normalize(vec3<f32>(flat - select(vec2<f32>(-fold), vec2<f32>(fold), flat >= vec2<f32>(0.0)), z));
    let distance = dot(from_middle, own) - ((f32(tilt.z) - 1.0) / PLANE_STEPS - 0.5) * sqrt(3.0);
    let off = distance / TILT_REACH_VOXELS;
    let turned = 0.5 * length(normal - own) / TURN_REACH;
    let difference = 1.0 + off * off + turned * turned;
    return vec2<f32>(1.0 / (difference * difference), on_surface(distance));
}

// Cosine and sine of a barrier's angle, by the series around the nearest quarter of a turn: to 4e-7, where WGSL's own need not be
// nearer than 5e-4, which would be seen.
fn turned(angle: u32) -> vec2<f32> {
    let steps = f32(angle) - 1.0;
    let quarter = round(steps * 4.0 / BARRIER_ANGLES);
    let turn = (steps - quarter * (BARRIER_ANGLES / 4.0)) * (6.283185307 / BARRIER_ANGLES);
    let square = turn * turn;
    let sine = turn * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)));
    let cosine = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0)));
    let quarters = u32(quarter);
    let way = select(vec2<f32>(cosine, sine), vec2<f32>(-sine, cosine), (quarters & 1u) == 1u);
    return select(way, -way, (quarters & 2u) == 2u);
}

// How much a value on `axis` counts for a point `from_middle` voxels from the middle of its voxel, by the walls that end it.
fn same_side(barriers: u32, axis: u32, from_middle: vec3<f32>) -> f32 {
    let across = vec2<f32>(from_middle[(axis + 1u) % 3u], from_middle[(axis + 2u) % 3u]);
    var trust = 1.0;
    for (var left = barriers; left != 0u; left >>= 16u) {
        if (left & 0xffffu) != 0u {
            let share = f32((left >> 8u) & 255u) / BARRIER_STEPS;
            let wall = (share - 0.5) * 2.0 * BARRIER_REACH_VOXELS;
            let off = clamp(dot(across, turned(left & 255u)) - wall, 0.0, BEYOND_MAX_VOXELS) / BEYOND_REACH_VOXELS;
            let twice = (1.0 + off * off) * (1.0 + off * off);
            trust /= twice * twice;
        }
    }
    return trust;
}

// What one volume answers.
struct Found {
    light: vec4<f32>,     // rgb: irradiance, lx; a: 1 where there is light, else 0
    surface_share: f32,   // how much of it is surfaces', 1 on a flat one
}

// Light of `volume` alone, at the point at `fraction` (0..1) between the centres of voxel `low` and its upper neighbours.
fn lookup_in(volume: u32, low: vec3<i32>, fraction: vec3<f32>, normal: vec3<f32>) -> Found {
    // Of the surface itself, in voxels from the middle of voxel `low`.
    let surface = fraction - NORMAL_OFFSET_VOXELS * normal;
    // Light times weight, and weight, by direction.
    var surfaces = array<vec4<f32>, 6>();
    var airs = array<vec4<f32>, 6>();
    // Directions whose surfaces' light is read.
    let faced = vec3<u32>(0u, 2u, 4u) + select(vec3<u32>(0u), vec3<u32>(1u), normal < vec3<f32>(0.0));
    // Of voxels with surfaces, as far as the point lies on one.
    var surface_weights = array<f32, 6>();
    for (var corner = 0u; corner < 8u; corner++) {
        let step = vec3<u32>(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
        let along = select(1.0 - fraction, fraction, step == vec3<u32>(1u));
        let weight = along.x * along.y * along.z;
        let from_middle = surface - vec3<f32>(step);
        // By direction, of the layer that the point lies in.
        var on_surfaces = array<f32, 6>();
        for (var layer = 0u; layer < volume_layouts[volume].layers; layer++) {
            let place = place_of(volume, low + vec3<i32>(step), layer);
            if place == 0u {
                continue;
            }
            let present = volume_blocks[place - 1u].present;
            for (var direction = 0u; direction < 6u; direction++) {
                if ((present >> direction) & 1u) == 1u {
                    let light = vec4<f32>(decode_rgb9e5(volume_blocks[place - 1u].irradiance[direction]), 1.0) * weight;
                    if ((present >> (direction + 8u)) & 1u) == 1u {
                        airs[direction] += light;
                    } else if faced[direction / 2u] == direction {
                        let planes = volume_blocks[place - 1u].planes[direction];
                        let near = nearness(planes, direction / 2u, from_middle, normal);
                        let barriers = volume_blocks[place - 1u].barriers[direction];
                        surfaces[direction] += light * (near.x * same_side(barriers, direction / 2u, from_middle));
                        on_surfaces[direction] = max(on_surfaces[direction], near.y);
                    }
                }
            }
        }
        for (var direction = 0u; direction < 6u; direction++) {
            surface_weights[direction] += weight * on_surfaces[direction];
        }
    }
    var total = vec4<f32>(0.0);
    var slope = vec3<f32>(0.0);
    var surface_weight = 0.0;
    for (var axis = 0u; axis < 3u; axis++) {
        let facing = axis * 2u + select(0u, 1u, normal[axis] < 0.0);
        let air = airs[facing];
        let behind = airs[facing ^ 1u];
        // What surfaces leave to the air.
        let room = max(0.0, 1.0 - surface_weights[facing] / SURFACE_WEIGHT);
        var both = room * air;
        if surfaces[facing].w > 0.0 {
            both += surfaces[facing] * (surface_weights[facing] / surfaces[facing].w);
        }
        if both.w <= WEIGHT_MIN {
            continue;
        }
        let along = abs(normal[axis]);
        total += vec4<f32>(both.xyz / both.w, 1.0) * (along * along);
        surface_weight += along * along * surface_weights[facing];
        if air.w > WEIGHT_MIN && behind.w > WEIGHT_MIN {
            let share = room * air.w / both.w * behind.w;
            slope += along * (1.0 - along) * 0.5 * share * (air.xyz / air.w - behind.xyz / behind.w);
        }
    }
    if total.w <= WEIGHT_MIN {
        return Found(vec4<f32>(0.0), 0.0);
    }
    let light = total.xyz / total.w;
    let sloped = vec4<f32>(max(light + slope / total.w, AIR_FLOOR * light), 1.0);
    return Found(sloped, min(surface_weight / SURFACE_WEIGHT, 1.0));
}

// Directions of `wanted` (bits) that have no light in the block of `2^halvings` voxels along an edge that holds `voxel`.
fn dark_in_block(volume: u32, voxel: vec3<i32>, halvings: u32, wanted: u32) -> u32 {
    let first = (voxel >> vec3<u32>(halvings)) << vec3<u32>(halvings);
    let mask = (1u << halvings) - 1u;
    var dark = wanted;
    for (var at = 0u; at < (1u << (3u * halvings)) && dark != 0u; at++) {
        let step = (vec3<u32>(at) >> vec3<u32>(0u, halvings, 2u * halvings)) & vec3<u32>(mask);
        dark &= ~present_of(volume, first + vec3<i32>(step));
    }
    return dark;
}

// Share of a point's light that volume `fine` gives up to the next coarser one: the trilinear weight of voxels beyond its end
// over that and the weight of those that are lit, each direction by the square of the normal. A voxel is beyond the
// end where the coarser one has light in a direction and none of the voxels that share a coarse voxel with it has.
fn share_of_coarser(fine: u32, low: vec3<i32>, fraction: vec3<f32>, normal: vec3<f32>) -> f32 {
    let coarse = fine + 1u;
    let ratio = volume_layouts[coarse].voxel_edge_m / volume_layouts[fine].voxel_edge_m;
    let halvings = u32(clamp(round(log2(ratio)), 0.0, 16.0));
    let is_detail = volume_layouts[fine].level == volume_layouts[coarse].level;
    let facing = vec3<u32>(0u, 2u, 4u) + select(vec3<u32>(0u), vec3<u32>(1u), normal < vec3<f32>(0.0));
    let facing_bits = vec3<u32>(1u) << facing;
    let wanted = facing_bits.x | facing_bits.y | facing_bits.z;
    var lit_weight = 0.0;
    var beyond_weight = 0.0;
    for (var corner = 0u; corner < 8u; corner++) {
        let step = vec3<u32>(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
        let along = select(1.0 - fraction, fraction, step == vec3<u32>(1u));
        let weights = along.x * along.y * along.z * normal * normal;
        let voxel = low + vec3<i32>(step);
        let lit = present_of(fine, voxel);
        let covering = present_of(coarse, voxel >> vec3<u32>(halvings));
        // Detail ends where surfaces end, not where the air begins.
        let known = select(covering, covering & ~(covering >> 8u), is_detail);
        let beyond = dark_in_block(fine, voxel, select(1u, halvings, is_detail), wanted & known & ~lit);
        lit_weight += dot(weights, select(vec3<f32>(0.0), vec3<f32>(1.0), (facing_bits & vec3<u32>(lit)) != vec3<u32>(0u)));
        beyond_weight +=
            dot(weights, select(vec3<f32>(0.0), vec3<f32>(1.0), (facing_bits & vec3<u32>(beyond)) != vec3<u32>(0u)));
    }
    return select(0.0, beyond_weight / (lit_weight + beyond_weight), beyond_weight > 0.0);
}

// Light at `position` (m) on a surface with unit `normal`, from the finest volume that has any, shared with the next where
// that one ends. rgb: irradiance, lx; a: 1 where there is light, else 0.
fn lookup_irradiance(position: vec3<f32>, normal: vec3<f32>) -> vec4<f32> {
    var total = vec4<f32>(0.0);
    let count = arrayLength(&volume_layouts);
    for (var volume = 0u; volume < count; volume++) {
        // In voxels from the centre of the lowest one.
        let edge = volume_layouts[volume].voxel_edge_m;
        let origin = volume_layouts[volume].origin;
        let local = position / edge + NORMAL_OFFSET_VOXELS * normal - 0.5 - vec3<f32>(origin);
        if any(local < vec3<f32>(-1.0)) || any(local > vec3<f32>(volume_layouts[volume].dims)) {
            continue;
        }
        let low = origin + vec3<i32>(floor(local));
        let fraction = local - floor(local);
        let found = lookup_in(volume, low, fraction, normal);
        if found.light.a == 0.0 {
            continue;
        }
        var kept = 1.0;
        if volume + 1u < count {
            // Detail knows surfaces alone: it fades where they end, and what stands for the air takes over.
            let is_detail = volume_layouts[volume].level == volume_layouts[volume + 1u].level;
            let fade = select(1.0, found.surface_share, is_detail);
            kept = fade * (1.0 - share_of_coarser(volume, low, fraction, normal));
        }
        total += (1.0 - total.a) * kept * found.light;
        if kept >= 1.0 {
            break;
        }
    }
    if total.a <= WEIGHT_MIN {
        return vec4<f32>(0.0);
    }
    return vec4<f32>(total.xyz / total.a, 1.0);
}
