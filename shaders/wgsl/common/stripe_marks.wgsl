// Of a stripe's 64 slots, which carry light and whose light is wanted.
struct StripeMarks {
    lit: vec2<u32>,       // 0
    wanted: vec2<u32>,    // 8
}                         // 16

fn is_marked(marks: vec2<u32>, slot: u32) -> bool {
    return ((marks[slot / 32u] >> (slot % 32u)) & 1u) == 1u;
}

fn is_any(marks: vec2<u32>) -> bool {
    return (marks.x | marks.y) != 0u;
}
