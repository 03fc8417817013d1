// Links of a slot that matters, by whether its class shoots as a whole or in part.

fn importance_of(slot: u32) -> f32 {
    let importance = largest_of(unshot[slot]) * residents[slot].area;
    return select(0.0, importance, importance > UNSHOT_TOLERANCE * bitcast<f32>(word_of(SHOT_SCALE)));
}

// Links of `slot` if it is of the last class that shoots.
fn links_of_last(slot: u32) -> u32 {
    let importance = importance_of(slot);
    let is_last = importance > 0.0 && class_of(importance) == word_of(SHOT_LAST_CLASS);
    return select(0u, max(rows[slot].count, 1u), is_last);
}
