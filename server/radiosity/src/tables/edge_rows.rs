//! Rows on which tables go wrong first: every implementation is held against each, here and in shaders.

use earthshine_world::random::{Purpose, hash, unit_f32};

/// A row with a name for messages.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeRow {
    /// What is special about it.
    pub name: &'static str,
    /// One an item.
    pub weights: Vec<f32>,
}

/// All of them; the longest has 1,000 items but for the last, which needs sections.
#[must_use]
pub fn edge_rows() -> Vec<EdgeRow> {
    const N: usize = 1000;
    let row = |name, weights: Vec<f32>| EdgeRow { name, weights };
    let of = |name, weight: &dyn Fn(usize) -> f32| row(name, (0..N).map(weight).collect());
    let random = |i: usize| unit_f32(hash(11, Purpose::Simulation, i as u64, 0));
    vec![
        row("no items", Vec::new()),
        row("one item", vec![0.25]),
        row("zero and one", vec![0.0, 1.0]),
        of("all equal", &|_| 0.125),
        of("all zero", &|_| 0.0),
        of("one of a thousand", &|i| if i == 617 { 0.5 } else { 0.0 }),
        of("uniform random", &random),
        of("1/x", &|i| 1.0 / (i + 1) as f32),
        of("1/x^2", &|i| 1.0 / ((i + 1) * (i + 1)) as f32),
        of("every seventh zero", &|i| if i.is_multiple_of(7) { 0.0 } else { random(i) }),
        of("eight decades", &|i| 10f32.powf(-8.0 * random(i))),
        row("a light and a heavy", vec![0.1, 0.9]),
        row("sections", (0..10_001).map(|i| random(i) / (1 + i % 97) as f32).collect()),
    ]
}
