// A patch in its slot; all zero in a free one.
struct Resident {
    reflectance: vec3<f32>,    //  0  0..=0.98 a channel
    area: f32,                 // 12  m2
}                              // 16
