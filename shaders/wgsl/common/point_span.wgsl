// The points of a patch.
struct PointSpan {
    first_point: u32,        //  0
    point_count: u32,        //  4
}                            //  8
