// The code that light is published as: RGB9E5 of light in units. CPU twin: `rgb9e5::encode` of `earthshine-volume`, to the
// bit: every step is exact or rounded once.

// What a code of one stands for, lx.
const LIGHT_UNIT_LX: f32 = 16.0;
// Largest value of a channel.
const CODE_MAX: f32 = 65408.0;
// Of what is no light. No light has it: its exponent does not fit its mantissas.
const CODE_NOT_A_NUMBER: u32 = 0xF8000001u;

fn power_of_two(exponent: i32) -> f32 {
    return bitcast<f32>(u32(exponent + 127) << 23u);
}

fn code_of(light: vec3<f32>) -> u32 {
    // By its bits: comparisons need not know what is no number.
    let exponents = bitcast<vec3<u32>>(light) & vec3<u32>(0x7F800000u);
    if any(exponents == vec3<u32>(0x7F800000u)) {
        return CODE_NOT_A_NUMBER;
    }
    let units = min(light * (1.0 / LIGHT_UNIT_LX), vec3<f32>(CODE_MAX));
    // A negative zero would have the exponent of something large.
    let channels = select(vec3<f32>(0.0), units, units > vec3<f32>(0.0));
    let largest = max(max(channels.x, channels.y), channels.z);
    // -127 of zero; below the smallest exponent the mantissas alone say how little it is.
    let floor_log2 = i32(bitcast<u32>(largest) >> 23u) - 127;
    var exponent = max(floor_log2, -16) + 16;
    // Rounding may carry the largest channel over the top of its exponent.
    if largest * power_of_two(24 - exponent) >= 511.5 {
        exponent += 1;
    }
    let mantissas = vec3<u32>(floor(channels * power_of_two(24 - exponent) + 0.5));
    return mantissas.x | (mantissas.y << 9u) | (mantissas.z << 18u) | (u32(exponent) << 27u);
}
