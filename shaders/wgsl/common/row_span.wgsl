// The row of one slot: its links, then what is far and the sky.
struct RowSpan {
    first_item: u32,     //  0  where its weights and outcomes begin
    item_count: u32,     //  4  two more than its links; 0 for a free slot
    first_bin: u32,      //  8  where its table begins
    first_guide: u32,    // 12  where the guide of a cumulative table begins
    total_at: u32,       // 16  where the sum of its weights is
}                        // 20
