// What a frame of shots keeps between its passes, as words: `limits.rs` says which is which.
// CPU twin: `radiosity::solver::shooting`.

// Which word is which.
const SHOT_SCALE: u32 = 0u;
const SHOT_UNSHOT_SHARE: u32 = 1u;
const SHOT_CHANGE: u32 = 2u;
const SHOT_SHOOTERS: u32 = 3u;
const SHOT_LISTED: u32 = 4u;
const SHOT_BRIGHTEST: u32 = 5u;
const SHOT_LAST_CLASS: u32 = 6u;
const SHOT_LINKS_OF_LAST: u32 = 7u;
// Classes of importance.
const SHOT_CLASSES: u32 = 2048u;

// A patch shoots if its unshot power exceeds this share of the mean power.
const UNSHOT_TOLERANCE: f32 = 1e-5;
// Flux arrives in whole units: the most that any patch shoots has so many. Sums of integers are the same in any order.
const UNITS_OF_BRIGHTEST: f32 = 536870912.0;
// A round whose brightest shot is below this counts in units of it.
const BRIGHTEST_MIN: f32 = 1e-28;

// Largest channel of what is unshot.
fn largest_of(unshot: vec4<f32>) -> f32 {
    let size = abs(unshot.xyz);
    return max(max(size.x, size.y), size.z);
}

// The histogram's class of a positive importance: exponent and three bits.
fn class_of(importance: f32) -> u32 {
    return bitcast<u32>(importance) >> 20u;
}
