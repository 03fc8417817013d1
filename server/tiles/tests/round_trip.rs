//! What goes in comes out: exactly with the lossless codec, within the invariants with the other.

mod chunks;

use chunks::{options, random_chunk};
use earthshine_tiles::{
    MappedTile, RowCodec, TileError, check_receivers, check_rows, decode_bytes, encode, write_atomic,
};
use earthshine_world::{Chunk, Column, DetailVoxel, ReceiverPlace, SurfacePlane, Vec3, VoxelCoord};
use std::path::Path;

const SIZES: [(usize, usize); 8] =
    [(0, 0), (1, 0), (1, 1), (31, 9), (32, 40), (33, 200), (70, 1500), (130, 30)];

fn round_trip(chunk: &Chunk, codec: RowCodec) -> Chunk {
    let tile = encode(chunk, &options(codec)).expect("a sound chunk");
    decode_bytes(&tile, Path::new("test.tile")).expect("the tile just made")
}

#[test]
fn the_lossless_codec_is_lossless() {
    for (seed, (patches, row_max)) in (0..).zip(SIZES) {
        let chunk = random_chunk(seed, patches, row_max);
        let back = round_trip(&chunk, RowCodec::Full);
        assert_eq!(back.id, chunk.id);
        assert_eq!(back.patches, chunk.patches);
        assert_eq!(back.rows, chunk.rows);
        assert_eq!(back.receivers, chunk.receivers);
        assert_eq!(back.occluders, chunk.occluders);
        assert_eq!((check_rows(&back), check_receivers(&back)), (vec![], vec![]));
    }
}

#[test]
fn the_half_codec_keeps_columns_shares_and_sums() {
    for (seed, (patches, row_max)) in (0..).zip(SIZES) {
        let chunk = random_chunk(seed, patches, row_max);
        let back = round_trip(&chunk, RowCodec::Half);
        assert_eq!(
            (&back.rows.segments, &back.rows.row_starts),
            (&chunk.rows.segments, &chunk.rows.row_starts)
        );
        assert_eq!(back.rows.columns, chunk.rows.columns);
        // Below 2^-29 of the group's largest share the error is absolute: 2^-38, nothing beside any sum.
        for (share, was) in back.rows.shares.iter().zip(&chunk.rows.shares) {
            assert!((share - was).abs() <= was / 1024.0 + 4e-12, "{was} came back as {share}");
        }
        for row in 0..back.rows.row_count() {
            let (sum, was) = (back.rows.row_sum(row), chunk.rows.row_sum(row));
            assert!((sum - was).abs() < 4e-4, "{was} came back as {sum}");
        }
        assert_eq!(back.receivers.places, chunk.receivers.places);
        assert_eq!(back.receivers.rows.columns, chunk.receivers.rows.columns);
        assert_eq!((check_rows(&back), check_receivers(&back)), (vec![], vec![]));
        let again = round_trip(&back, RowCodec::Half);
        assert_eq!(again, back, "a second round changes nothing");
    }
}

#[test]
fn points_stay_where_they_are() {
    let chunk = random_chunk(9, 300, 5);
    let back = round_trip(&chunk, RowCodec::Half);
    for (point, was) in back.points.iter().zip(&chunk.points) {
        assert!((point.position - was.position).abs().max_element() < 3e-4);
        assert!(point.normal.dot(was.normal) > 1.0 - 1e-6);
    }
}

#[test]
fn the_same_chunk_gives_the_same_bytes() {
    for codec in [RowCodec::Half, RowCodec::Full] {
        let bytes: Vec<Vec<u8>> = std::thread::scope(|scope| {
            let encode = || encode(&random_chunk(4, 100, 300), &options(codec)).unwrap();
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(encode)).collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        assert!(bytes.windows(2).all(|pair| pair[0] == pair[1]));
    }
}

#[test]
fn a_mapped_tile_gives_its_parts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("part.tile");
    let chunk = random_chunk(6, 100, 200);
    write_atomic(&path, &encode(&chunk, &options(RowCodec::Full)).unwrap()).unwrap();
    let tile = MappedTile::open(&path).unwrap();
    assert_eq!((tile.header().chunk_id(), tile.header().patch_count), (chunk.id, 100));
    let whole = tile.decode().unwrap();
    assert_eq!(tile.decode_patches().unwrap(), chunk.patches);
    assert_eq!(tile.decode_points().unwrap(), whole.points);
    assert_eq!(tile.decode_occluders().unwrap(), chunk.occluders);
    assert_eq!(tile.decode_receivers().unwrap(), chunk.receivers);
    assert_eq!(tile.decode_rows(0..4).unwrap(), chunk.rows);
    let part = tile.decode_rows(2..9).unwrap();
    assert_eq!(part.row_count(), 36);
    for row in 0..36 {
        assert!(part.row(row).eq(chunk.rows.row(64 + row)), "row {row}");
        assert_eq!(part.sky_shares[row], chunk.rows.sky_shares[64 + row]);
    }
    assert_eq!(tile.decode_rows(7..9).unwrap().row_count(), 0);
    let stored: u64 = tile.sections().map(|(_, section)| u64::from(section.stored_bytes)).sum();
    let table = tile.sections().len() as u64 * 32;
    assert_eq!(stored + 112 + table, tile.header().file_bytes);
}

#[test]
fn a_file_cut_under_the_map_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.tile");
    write_atomic(&path, &encode(&random_chunk(6, 200, 200), &options(RowCodec::Full)).unwrap()).unwrap();
    let tile = MappedTile::open(&path).unwrap();
    std::fs::File::options().write(true).open(&path).unwrap().set_len(4096).unwrap();
    assert!(matches!(tile.decode(), Err(TileError::Truncated { .. })));
    assert!(matches!(tile.decode_rows(0..1), Err(TileError::Truncated { .. })));
}

#[cfg(unix)]
#[test]
fn a_file_deleted_or_replaced_under_the_map_is_read_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deleted.tile");
    let encoded = |seed| encode(&random_chunk(seed, 200, 200), &options(RowCodec::Full)).unwrap();
    write_atomic(&path, &encoded(6)).unwrap();
    let tile = MappedTile::open(&path).unwrap();
    let before = tile.decode().unwrap();
    std::fs::remove_file(&path).unwrap();
    assert_eq!(tile.decode().unwrap(), before);
    write_atomic(&path, &encoded(7)).unwrap();
    assert_eq!(tile.decode().unwrap(), before);
    assert_ne!(MappedTile::open(&path).unwrap().decode().unwrap(), before);
}

#[test]
fn impossible_chunks_are_refused_by_name() {
    type Change = fn(&mut Chunk);
    let cases: [(&str, Change); 21] = [
        ("patch 3 has sample points", |c| c.patches[3].point_count = 0),
        ("patch 3 has sample points", |c| c.patches[3].point_first = u32::MAX),
        ("patch 4 has no positive area", |c| c.patches[4].area = f32::NAN),
        ("patch 4 has a reflectance", |c| c.patches[4].reflectance = Vec3::splat(1.5)),
        ("patch 4 has an emission", |c| c.patches[4].emission.x = -1.0),
        ("sample point 0 has no usable", |c| c.points[0].normal = Vec3::ZERO),
        ("rows for 40 places", |c| c.rows.absorbed_shares.truncate(39)),
        ("row starts", |c| c.rows.row_starts[3] = u32::MAX),
        ("segments do not ascend", |c| c.rows.segments.push(c.id)),
        ("do not ascend", |c| c.rows.columns.fill(Column { segment: 0, local: 0 })),
        ("has the share -1", |c| c.rows.shares[0] = -1.0),
        ("has the share NaN", |c| c.rows.shares[0] = f32::NAN),
        ("sky shares", |c| c.rows.sky_shares[5][0] = f32::INFINITY),
        ("receivers: the receivers do not ascend", |c| c.receivers.places[1] = c.receivers.places[0]),
        ("facing", |c| {
            let patch = c.patches[0];
            c.receivers.places[0] = ReceiverPlace::in_air(patch.voxel, patch.direction);
            c.receivers.places.sort_by_key(ReceiverPlace::order);
        }),
        ("has no patch", |c| {
            let air = c.receivers.places.iter_mut().rfind(|place| place.detail.is_none());
            let plane = SurfacePlane::new(Vec3::Y, 0.0);
            air.expect("air").detail = Some(DetailVoxel::new(VoxelCoord::ZERO, 0, plane));
        }),
        ("is missing a layer below", |c| {
            let layers = c.receivers.places.iter_mut().filter_map(|place| place.detail.as_mut());
            layers.last().expect("detail").layer = DetailVoxel::LAYERS_MAX;
        }),
        ("receivers: ", |c| c.receivers.rows.shares[0] = 3.0),
        ("receivers: ", |c| c.receivers.places.truncate(2)),
        ("triangles with", |c| c.occluders.surfaces.push([0; 4])),
        ("a vertex that does not exist", |c| {
            c.occluders.triangles.push([999; 3]);
            c.occluders.surfaces.push([0; 4]);
        }),
    ];
    for (words, change) in cases {
        let mut chunk = random_chunk(5, 40, 100);
        change(&mut chunk);
        let error = encode(&chunk, &options(RowCodec::Half)).expect_err(words).to_string();
        assert!(error.contains(words), "{words:?} not in {error:?}");
    }
}

#[test]
fn a_chunk_too_large_is_a_limit() {
    let mut chunk = random_chunk(1, 1, 0);
    chunk.points.resize(earthshine_tiles::limits::POINTS_MAX as usize + 1, chunk.points[0]);
    let error = encode(&chunk, &options(RowCodec::Half)).expect_err("too many points");
    assert!(matches!(error, TileError::Limit { what: "sample points", .. }), "{error}");
}

#[test]
fn negative_zeros_are_zeros() {
    for codec in [RowCodec::Half, RowCodec::Full] {
        let mut chunk = random_chunk(2, 10, 10);
        chunk.rows.shares[0] = -0.0;
        chunk.rows.absorbed_shares.fill(-0.0);
        let back = round_trip(&chunk, codec);
        assert!(back.rows.shares[0].is_sign_positive() && back.rows.absorbed_shares[9].is_sign_positive());
    }
}
