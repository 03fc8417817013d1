// One row, or one section of a long row, whose table is to be built.
struct TableSpan {
    first_weight: u32,    // 0  where its weights begin
    first_bin: u32,       // 4  where its bins begin
    item_count: u32,      // 8  at most 4,096
}                         // 12
