// Random bits for draws: a hash of counters, the same bits as on the host.
// CPU twin: `radiosity::tables::draw`.

// What is neither resident nor the sky, and the sky, among the outcomes of a row.
const FAR: u32 = 0xFFFFFFFFu;
const SKY: u32 = 0xFFFFFFFEu;

fn mix_bits(bits: u32) -> u32 {
    let state = bits * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// What all draws of `row` start from.
fn row_key(row: u32) -> u32 {
    return mix_bits(row + mix_bits(pass_of.frame + mix_bits(pass_of.seed)));
}
