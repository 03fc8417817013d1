// A patch of the block that enters, leaves or is refined.
struct Member {
    slot: u32,     // 0
    place: u32,    // 4  its column in the block
}                  // 8
