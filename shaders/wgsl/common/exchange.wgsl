// Where the numbers of a symmetric plane lie: the lower triangle in tiles, stripe after stripe, each tile row-major.
// The CPU twin is `radiosity::exchange`. Places are relative to the part of the plane that is bound.

// Number of tiles in the stripes before `stripe`.
fn tiles_before(stripe: u32) -> u32 {
    return stripe * (stripe + 1u) / 2u;
}

// Where the tile begins whose rows are those of stripe `row` and whose columns are those of stripe `column <= row`.
fn tile_at(row: u32, column: u32) -> u32 {
    return (tiles_before(row) - tiles_before(pass_of.first_stripe) + column) * (TILE_EDGE * TILE_EDGE);
}

// Whether the stripe `row` lies in the bound part.
fn is_bound(row: u32) -> bool {
    return row >= pass_of.first_stripe && row < pass_of.end_stripe;
}

// Where entry (a, b), or its mirror image, is: a's stripe is not before b's.
fn entry_at(a: u32, b: u32) -> u32 {
    return tile_at(a / TILE_EDGE, b / TILE_EDGE) + (a % TILE_EDGE) * TILE_EDGE + b % TILE_EDGE;
}
