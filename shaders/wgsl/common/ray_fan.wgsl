// Rays from one place over the hemisphere about a normal, by the cosine and consecutive pairs of a shifted R2 sequence.
struct RayFan {
    origin: vec3<f32>,       //  0
    first_ray: u32,          // 12  among those of all fans
    normal: vec3<f32>,       // 16
    first_pair: u32,         // 28
    shift: vec2<f32>,        // 32
    ray_count: u32,          // 40
    spare: u32,              // 44
}                            // 48
