// Two levels of eight-wide compressed trees (Ylitie, Karras, Laine 2017) as `obvhs` lays them out, and where a ray crosses
// triangles: the order of nodes, the boxes and the crossings are those of the CPU.
// CPU twins: `obvhs::traverse!`, `light::ray_triangle`. A kernel that includes this has the function `meet`.

// Where one tree stands among others: rows of the map from the world into its frame.
struct TreePlacement {
    to_tree_x: vec4<f32>,    //  0
    to_tree_y: vec4<f32>,    // 16
    to_tree_z: vec4<f32>,    // 32
    first_node: u32,         // 48  its root
    first_triangle: u32,     // 52  of its leaves
    spare: vec2<u32>,        // 56
}                            // 64

// A triangle in the world.
struct TreeTriangle {
    corner: vec3<f32>,       //  0
    index: u32,              // 12  its number for the host
    edge_1: vec3<f32>,       // 16  corner 0 minus corner 1
    transmittance: f32,      // 28  what a crossing lets through
    edge_2: vec3<f32>,       // 32  corner 2 minus corner 0
    spare: u32,              // 44
}                            // 48

// A node is five of these.
@group(0) @binding(1) var<storage, read> nodes: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> placements: array<TreePlacement>;
@group(0) @binding(3) var<storage, read> triangles: array<TreeTriangle>;

// How far outside an edge still counts, in barycentric units.
const EDGE_TOLERANCE: f32 = 1e-6;
// Boxes that end nearer are not looked into, m.
const BOX_NEAR_M: f32 = 1e-4;
// Below this a part of a direction counts as none.
const DIRECTION_MIN: f32 = 1.1920929e-7;

// Crossings as far as this or farther are of no more interest; `meet` may shorten it.
var<private> reach_m: f32;
// Groups of nodes that wait, nearest last: a node's children in the upper byte of `y`, or leaves in the lower three.
var<private> waiting: array<vec2<u32>, TREE_STACK>;

fn inverse_of(direction: vec3<f32>) -> vec3<f32> {
    let limit = select(vec3<f32>(-1.0), vec3<f32>(1.0), direction >= vec3<f32>(0.0)) / DIRECTION_MIN;
    let is_none = abs(direction) <= vec3<f32>(DIRECTION_MIN);
    return select(1.0 / select(direction, vec3<f32>(1.0), is_none), limit, is_none);
}

// The octant that `direction` comes from, in each byte.
fn octant_of(direction: vec3<f32>) -> u32 {
    let bits = select(vec3<u32>(0x04040404u, 0x02020202u, 0x01010101u), vec3<u32>(0u), direction < vec3<f32>(0.0));
    return bits.x | bits.y | bits.z;
}

// Where planes of four children along one axis are crossed.
fn plane_distances(planes: u32, scale: f32, offset: f32) -> vec4<f32> {
    return vec4<f32>(unpack4xU8(planes)) * scale + offset;
}

// Which children of the node at `at` are met: a bit for each that is a node in the upper byte, one for each triangle below.
fn children_met(head: vec4<u32>, links: vec4<u32>, at: u32, origin: vec3<f32>, inverse: vec3<f32>, octant: u32) -> u32 {
    let exponents = unpack4xU8(head.w);
    let scale = bitcast<vec3<f32>>(exponents.xyz << vec3<u32>(23u)) * inverse;
    let offset = (bitcast<vec3<f32>>(head.xyz) - origin) * inverse;
    let from_above = inverse < vec3<f32>(0.0);
    let x = nodes[at + 2u];
    let y = nodes[at + 3u];
    let z = nodes[at + 4u];
    let near_x = select(x.xy, x.zw, from_above.x);
    let far_x = select(x.zw, x.xy, from_above.x);
    let near_y = select(y.xy, y.zw, from_above.y);
    let far_y = select(y.zw, y.xy, from_above.y);
    let near_z = select(z.xy, z.zw, from_above.z);
    let far_z = select(z.zw, z.xy, from_above.z);
    var met = 0u;
    for (var half = 0u; half < 2u; half++) {
        let enter = max(
            max(plane_distances(near_x[half], scale.x, offset.x), plane_distances(near_y[half], scale.y, offset.y)),
            max(plane_distances(near_z[half], scale.z, offset.z), vec4<f32>(BOX_NEAR_M)),
        );
        let leave = min(
            min(plane_distances(far_x[half], scale.x, offset.x), plane_distances(far_y[half], scale.y, offset.y)),
            min(plane_distances(far_z[half], scale.z, offset.z), vec4<f32>(reach_m)),
        );
        // The slots of inner children turn with the octant; leaves keep their triangles' places.
        let meta_bytes = links[2u + half];
        let is_inner = ((meta_bytes & (meta_bytes << 1u)) & 0x10101010u) >> 4u;
        let places = unpack4xU8((meta_bytes ^ (octant & (is_inner * 0xFFu))) & 0x1F1F1F1Fu);
        let marks = unpack4xU8((meta_bytes >> 5u) & 0x07070707u) << places;
        let hit = select(vec4<u32>(0u), marks, enter <= leave);
        met |= hit.x | hit.y | hit.z | hit.w;
    }
    return met;
}

// Has `meet` asked about every triangle whose box the ray meets, until it has enough.
fn walk_trees(origin: vec3<f32>, direction: vec3<f32>) {
    var own_origin = origin;
    var inverse = inverse_of(direction);
    var octant = octant_of(direction);
    var root = pass_of.top_node;
    var first_triangle = 0u;
    var is_top = true;
    var height = 0u;
    var group = vec2<u32>(0u, 0x80000000u);
    var leaves = vec2<u32>(0u);
    loop {
        while leaves.y != 0u {
            let bit = firstLeadingBit(leaves.y);
            leaves.y &= ~(1u << bit);
            let leaf = leaves.x + bit;
            if !is_top {
                if meet(first_triangle + leaf, origin, direction) {
                    return;
                }
                continue;
            }
            // Down into the tree that stands there; what is left above waits beneath it.
            waiting[height] = group;
            waiting[height + 1u] = leaves;
            height += 2u;
            let placement = placements[leaf];
            let at = vec4<f32>(origin, 1.0);
            own_origin = vec3<f32>(
                dot(placement.to_tree_x, at), dot(placement.to_tree_y, at), dot(placement.to_tree_z, at),
            );
            // As long as in the world: distances are the same.
            let own_direction = vec3<f32>(
                dot(placement.to_tree_x.xyz, direction),
                dot(placement.to_tree_y.xyz, direction),
                dot(placement.to_tree_z.xyz, direction),
            );
            inverse = inverse_of(own_direction);
            octant = octant_of(own_direction);
            root = placement.first_node;
            first_triangle = placement.first_triangle;
            is_top = false;
            // No tree begins at node 0 of a group that has no nodes: the mark of the floor.
            waiting[height] = vec2<u32>(0u);
            height += 1u;
            group = vec2<u32>(0u, 0x80000000u);
            leaves = vec2<u32>(0u);
        }
        if (group.y & 0xFF000000u) == 0u {
            if height == 0u {
                return;
            }
            height -= 1u;
            group = waiting[height];
            if (group.y & 0xFF000000u) == 0u {
                // The floor of a tree: up again.
                leaves = waiting[height - 1u];
                group = waiting[height - 2u];
                height -= 2u;
                is_top = true;
                own_origin = origin;
                inverse = inverse_of(direction);
                octant = octant_of(direction);
                root = pass_of.top_node;
                continue;
            }
        }
        let bit = firstLeadingBit(group.y);
        let inner = group.y;
        group.y &= ~(1u << bit);
        if (group.y & 0xFF000000u) != 0u {
            waiting[height] = group;
            height += 1u;
        }
        let slot = (bit - 24u) ^ (octant & 0xFFu);
        let before = countOneBits(inner & ~(0xFFFFFFFFu << slot) & 0xFFu);
        let at = 5u * (root + group.x + before);
        let head = nodes[at];
        let links = nodes[at + 1u];
        let met = children_met(head, links, at, own_origin, inverse, octant);
        group = vec2<u32>(links.x, (met & 0xFF000000u) | (head.w >> 24u));
        leaves = vec2<u32>(links.y, met & 0x00FFFFFFu);
    }
}

// The distance at which the ray crosses triangle `at`, beyond `distance_min_m` and within reach; negative if it does not.
fn crossing_m(at: u32, origin: vec3<f32>, direction: vec3<f32>, distance_min_m: f32) -> f32 {
    let edge_1 = triangles[at].edge_1;
    let edge_2 = triangles[at].edge_2;
    let to_corner = triangles[at].corner - origin;
    let across = cross(direction, to_corner);
    // Points to the back: see `edge_1`.
    let normal = cross(edge_1, edge_2);
    let facing = dot(normal, direction);
    if facing == 0.0 {
        return -1.0;
    }
    let inverse = 1.0 / facing;
    let u = dot(across, edge_2) * inverse;
    let v = dot(across, edge_1) * inverse;
    let distance = dot(normal, to_corner) * inverse;
    let is_inside = u >= -EDGE_TOLERANCE && v >= -EDGE_TOLERANCE && u + v <= 1.0 + EDGE_TOLERANCE;
    return select(-1.0, distance, is_inside && distance > distance_min_m && distance < reach_m);
}
