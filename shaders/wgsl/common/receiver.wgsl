// A receiver's row: where its columns are, and its sky shares by lobe, those of +X -X +Y and of -Y +Z -Z. A column is one
// word, its target among its chunk's and above that a half float; or two, its target and an f32.
struct ReceiverSpan {
    first_sky: vec3<f32>,         //  0
    first: u32,                   // 12  word where its columns begin
    last_sky: vec3<f32>,          // 16
    count: u32,                   // 28  in the lowest 24 bits; above, shares are half floats over two to that
}                                 // 32

// A receiver whose light is asked for.
struct ReceiverAsked {
    row: u32,                     //  0
    first_span: u32,              //  4  where the segments of its chunk begin
    first_target: u32,            //  8  word where the targets of its chunk begin, or NO_TARGETS
}                                 // 12

// Where the patches of a segment are in the list of sources.
struct SegmentSpan {
    first: u32,                   //  0
    count: u32,                   //  4  a patch beyond has no source
}                                 //  8

struct ReceiverLight {
    irradiance: vec3<f32>,        //  0  from resident patches
    resident_share: f32,          // 12
    far_irradiance: vec3<f32>,    // 16  from coarse parents
    fed_share: f32,               // 28  of the far share: what known parents stand for
    sky_irradiance: vec3<f32>,    // 32
    far_share: f32,               // 44
}                                 // 48
