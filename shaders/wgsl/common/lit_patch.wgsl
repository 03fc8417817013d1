// What is told of a patch's direct light.
struct LitPatch {
    mean: vec3<f32>,         //  0  over its points, lx
    told_points: u32,        // 12  points of which light is told too: all, or none where it is the same on all
}                            // 16
