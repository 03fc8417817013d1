// What is news of a slot: its code is another than what was told. The host compares nothing; it says who is there.

// Of 32 slots, a bit each.
struct NewsMarks {
    known: u32,    // 0  their light on the device is their patch's
    fresh: u32,    // 4  nothing was told of the patch that is there
}                  // 8

// What is told of a slot. The first of a list says how many follow, in place of a slot.
struct NewsEntry {
    slot: u32,     //  0
    red: f32,      //  4  lx
    green: f32,    //  8
    blue: f32,     // 12
}                  // 16

// A channel after the other.
fn light_of(slot: u32) -> vec3<f32> {
    let stride = pass_of.channel_stride;
    return vec3<f32>(light[slot], light[stride + slot], light[2u * stride + slot]);
}

fn is_news(slot: u32) -> bool {
    let of_slot = marks[slot / 32u];
    let bit = 1u << (slot % 32u);
    if (of_slot.known & bit) == 0u {
        return false;
    }
    return (of_slot.fresh & bit) != 0u || code_of(light_of(slot)) != told[slot];
}
