// A triangle as an end of rays.
struct EndSide {
    normal: vec3<f32>,       //  0  of its front
    flags: u32,              // 12  of the constants SIDE_
    parts: vec3<u32>,        // 16  of a ray, for the patch along each axis
    spare: u32,              // 28
}                            // 32

fn has_flag(side: EndSide, flag: u32) -> bool {
    return (side.flags & flag) != 0u;
}

fn is_front(side: EndSide, direction: vec3<f32>) -> bool {
    return dot(side.normal, direction) < 0.0;
}
