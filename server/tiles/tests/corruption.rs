//! Bytes that are not a tile, or not that tile: always an error, never a panic, always named.

mod chunks;

use chunks::{Dice, options, random_chunk};
use earthshine_tiles::{Frame, MappedTile, RowCodec, TileError, decode_bytes, encode, format};
use std::path::Path;

fn small_tile(codec: RowCodec) -> Vec<u8> {
    encode(&random_chunk(3, 34, 6), &options(codec)).expect("a sound chunk")
}

#[test]
fn every_flipped_bit_is_an_error() {
    for codec in [RowCodec::Half, RowCodec::Full] {
        let mut tile = small_tile(codec);
        for at in 0..tile.len() {
            for mask in [0xFF, 1, 2, 4, 8, 16, 32, 64, 128] {
                tile[at] ^= mask;
                let error = decode_bytes(&tile, Path::new("flip.tile")).expect_err("a flipped byte");
                let words = error.to_string();
                assert!(words.contains("flip.tile") && words.contains("bake it again"), "{words}");
                tile[at] ^= mask;
            }
        }
        decode_bytes(&tile, Path::new("flip.tile")).unwrap();
    }
}

#[test]
fn every_truncation_and_every_surplus_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.tile");
    let mut tile = small_tile(RowCodec::Half);
    for length in 0..tile.len() {
        let error = decode_bytes(&tile[..length], Path::new("cut.tile")).expect_err("a cut tile");
        assert!(matches!(error, TileError::Truncated { .. }), "{length}: {error}");
        if length % 37 == 0 {
            std::fs::write(&path, &tile[..length]).unwrap();
            let error = MappedTile::open(&path).expect_err("a cut file");
            assert!(matches!(error, TileError::Truncated { .. }), "{length}: {error}");
        }
    }
    tile.push(0);
    let error = decode_bytes(&tile, Path::new("long.tile")).expect_err("one byte more").to_string();
    assert!(error.contains("1 bytes follow"), "{error}");
}

#[test]
fn the_damaged_frame_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("named.tile");
    let tile = small_tile(RowCodec::Half);
    std::fs::write(&path, &tile).unwrap();
    let sections: Vec<_> =
        MappedTile::open(&path).unwrap().sections().map(|(frame, entry)| (frame, *entry)).collect();
    assert_eq!(sections.len(), 10);
    for (damaged, entry) in sections {
        let mut tile = tile.clone();
        tile[entry.offset as usize + entry.stored_bytes as usize / 2] ^= 0x10;
        let error = decode_bytes(&tile, &path).expect_err("a damaged frame");
        assert!(matches!(error, TileError::Checksum { frame, .. } if frame == damaged), "{error}");
        let cut = &tile[..entry.offset as usize + 1];
        let error = decode_bytes(cut, &path).expect_err("a cut frame");
        assert!(
            matches!(error, TileError::Truncated { frame, .. } if frame == damaged),
            "{damaged}: {error}"
        );
    }
    let error = decode_bytes(&tile[..120], &path).expect_err("a cut table");
    assert!(matches!(error, TileError::Truncated { frame: Frame::Table, .. }), "{error}");
}

#[test]
fn other_files_and_versions_are_told_apart() {
    let mut tile = small_tile(RowCodec::Half);
    tile[8] += 1;
    let error = decode_bytes(&tile, Path::new("new.tile")).expect_err("another version");
    assert!(matches!(error, TileError::Version { found, .. } if found == format::VERSION + 1), "{error}");
    assert!(
        error.to_string().contains(&format!(
            "this program reads {} to {}",
            format::VERSION_OLDEST,
            format::VERSION
        )),
        "{error}"
    );
    for foreign in [&b"glTF\x02\0\0\0"[..], &[0; 4096], b"PNG", b"EARTHS\n"] {
        let error = decode_bytes(foreign, Path::new("other.glb")).expect_err("a foreign file");
        assert!(matches!(error, TileError::Magic { .. }), "{error}");
    }
    let error = MappedTile::open(Path::new("no/such.tile")).expect_err("no file");
    assert!(matches!(error, TileError::Io { .. }) && error.to_string().contains("no/such.tile"), "{error}");
}

#[test]
fn noise_is_never_a_tile() {
    let mut dice = Dice::new(11);
    let tile = small_tile(RowCodec::Full);
    for _ in 0..3000 {
        let mut bytes = tile.clone();
        for _ in 0..1 + dice.below(20) {
            let (from, to) = (dice.below(bytes.len()), dice.below(bytes.len()));
            let length = dice.below(64).min(bytes.len() - from.max(to));
            match dice.below(3) {
                0 => bytes.copy_within(from..from + length, to),
                1 => bytes[to..to + length].fill(dice.bits() as u8),
                _ => bytes.truncate(to.max(1)),
            }
        }
        if bytes != tile {
            assert!(decode_bytes(&bytes, Path::new("noise.tile")).is_err());
        }
    }
}
