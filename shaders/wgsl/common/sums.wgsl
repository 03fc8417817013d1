// What is news of the sums of rows: four numbers that differ, in any bit, from those that were told of that row last. An
// entry is such a part of a row that was asked for; which of a row's parts are compared, the host says.

// The first of a list says how many follow, in place of a row's part.
struct SumsEntry {
    at: u32,       //  0  row among all on the device, times SUM_PARTS, and part
    red: f32,      //  4  lx
    green: f32,    //  8
    blue: f32,     // 12
    share: f32,    // 16  that goes with it
}                  // 20

// Where the row's sums were gathered.
fn gathered_at(entry: u32) -> u32 {
    return entry / pass_of.part_count * SUM_PARTS + pass_of.part + entry % pass_of.part_count;
}

// Where what was told of it is.
fn told_at(entry: u32) -> u32 {
    return asked[entry / pass_of.part_count].row * SUM_PARTS + pass_of.part + entry % pass_of.part_count;
}

fn is_news(entry: u32) -> bool {
    return any(bitcast<vec4<u32>>(gathered[gathered_at(entry)]) != bitcast<vec4<u32>>(told[told_at(entry)]));
}
