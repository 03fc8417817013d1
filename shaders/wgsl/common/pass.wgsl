// What one dispatch is told. Not every kernel reads every field.
struct Pass {
    rows: u32,              //  0  rows of every vector and of every block's columns: all stripes of the matrix
    stripe_count: u32,      //  4  stripes that can hold anything
    first_stripe: u32,      //  8  of the part of a plane that is bound
    end_stripe: u32,        // 12  one past its last stripe
    channel: u32,           // 16  which of three values of a patch the bound plane goes with
    entry_count: u32,       // 20  entries, members or tiles in the bound list
    part: u32,              // 24  which part of a plane is bound; the first part of rows' sums that is compared
    part_count: u32,        // 28  parts of a plane; parts of a row's sums that are compared
    channel_stride: u32,    // 32  numbers from one channel of the operand to the next; 0 if all share it
    first_weight: f32,      // 36
    second_weight: f32,     // 40
    outside_weight: f32,    // 44
    seed: u32,              // 48  of every draw
    frame: u32,             // 52  of draws: which frame it is
    samples_per_row: u32,   // 56  draws a row and frame
    budget_links: u32,      // 60  links that a round of shots may take
    taken_count: u32,       // 64  slots with a patch
    is_shot: u32,           // 68  1 where light is shot
    is_leaving: u32,        // 72  1 where patches leave
    top_node: u32,          // 76  root of the tree over placements of trees
    voxel_edge_m: f32,      // 80
    off_surface_m: f32,     // 84  how far before a side the voxel of a ray's end is looked up
    voxel_slots: u32,       // 88  of the table of voxels: a power of two
    pivot_min: f32,         // 92  a patch whose pivot is below it does not enter
    near_m: f32,            // 96  what rays of fans meet nearer is near
    fan_count: u32,         // 100 fans whose rays are made
}                           // 104

@group(0) @binding(0) var<uniform> pass_of: Pass;
