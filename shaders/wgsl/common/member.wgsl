// A patch of the block that enters, leaves or is refined; one that did not enter has NO_SLOT.
struct Member {
    slot: u32,     // 0
    place: u32,    // 4  its column in the block
}                  // 8

// No slot at all.
const NO_SLOT: u32 = 0xFFFFFFFFu;
