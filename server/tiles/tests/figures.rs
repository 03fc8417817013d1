//! Sizes of a town's rows, and that the measurement measures.

mod chunks;

use chunks::{options, town::town, write_world};
use earthshine_tiles::{RowCodec, measure};

/// Rates depend on the machine and are printed, not asserted. `FIGURES_SECONDS` makes them steadier,
/// `FIGURES_CHUNKS` makes the town larger.
#[test]
fn a_town_takes_at_most_2_2_bytes_a_nonzero() {
    let seconds = std::env::var("FIGURES_SECONDS").map_or(0.3, |text| text.parse().unwrap());
    let chunks = town(std::env::var("FIGURES_CHUNKS").map_or(3, |text| text.parse().unwrap()), 1);
    for (codec, most) in [(RowCodec::Half, 2.2), (RowCodec::Full, 4.5)] {
        let folder = tempfile::tempdir().unwrap();
        write_world(folder.path(), &chunks, &options(codec));
        let figures = measure(folder.path(), seconds).unwrap();
        let rows: usize = chunks.iter().map(|chunk| chunk.patches.len()).sum();
        println!("{codec:?}: {} non-zeros a row, {figures:?}", figures.nonzeros / rows as u64);
        assert!(figures.bytes_per_nonzero < most, "{figures:?}");
        assert!(figures.nonzeros > 300_000 && figures.ratio > 1.9, "{figures:?}");
        assert!(figures.decode_mnz_s_core > 0.0 && figures.encode_mnz_s_core > 0.0, "{figures:?}");
    }
}

#[test]
fn a_world_without_rows_has_figures_too() {
    let folder = tempfile::tempdir().unwrap();
    write_world(folder.path(), &[], &options(RowCodec::Half));
    assert_eq!(measure(folder.path(), 0.1).unwrap().nonzeros, 0);
}
