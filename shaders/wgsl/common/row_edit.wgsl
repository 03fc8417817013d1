// A row that changes: who leaves is struck from it, who comes is appended, and it may move.
struct RowEdit {
    slot: u32,         //  0  whose row
    old_first: u32,    //  4  where its links began
    old_count: u32,    //  8
    first: u32,        // 12  where they begin from now on
    first_new: u32,    // 16  of those that are appended
    new_count: u32,    // 20
}                      // 24

@group(0) @binding(1) var<storage, read> edits: array<RowEdit>;
// A bit a slot.
@group(0) @binding(2) var<storage, read> leaving: array<u32>;

fn is_leaving(slot: u32) -> bool {
    return (leaving[slot / 32u] >> (slot % 32u) & 1u) != 0u;
}
