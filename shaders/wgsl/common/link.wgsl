// One form factor of a row: whom it leads to, and the share. The row itself: where its links are.
struct Link {
    slot: u32,     // 0
    share: f32,    // 4  0..=1
}                  // 8

struct LiveRow {
    first: u32,    // 0  where its links begin
    count: u32,    // 4  0 for a free slot
}                  // 8
