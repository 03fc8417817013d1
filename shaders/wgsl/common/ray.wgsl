// A ray, and what it meets first.
// Crossings count with `distance_min_m < distance < distance_max_m`, in lengths of the direction.
struct RayQuery {
    origin: vec3<f32>,       //  0
    distance_min_m: f32,     // 12
    direction: vec3<f32>,    // 16
    distance_max_m: f32,     // 28
}                            // 32

// Rays begin this far behind their origin, m, and count from the origin on.
const RUN_UP_M: f32 = 2e-4;

struct RayHit {
    triangle: u32,           //  0  number of the triangle, or NO_TRIANGLE
    distance_m: f32,         //  4
}                            //  8
