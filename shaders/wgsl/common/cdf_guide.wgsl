// The guide of a cumulative table: the first item that may lie in each part of its line.
// CPU twin: `radiosity::tables::CdfTable`.

// Length of the line.
const LINE: u32 = 0x80000000u;
// Most parts of a guide, as a power of two.
const GUIDE_BITS_MAX: u32 = 12u;

// Parts of the guide of a row, as a power of two.
fn guide_bits(item_count: u32) -> u32 {
    return min(32u - countLeadingZeros(max(item_count, 1u) - 1u), GUIDE_BITS_MAX);
}
