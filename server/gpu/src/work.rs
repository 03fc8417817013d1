//! What a pass moves and computes, reckoned from what it is told: the least that its kernel needs, to hold its time against.
//!
//! Bytes: each number of a list that is gone over counts once, whatever caches and repeated reads do; each read at a place
//! that data decides (light of a link's slot, a draw's bin) counts by itself. Operations: additions, multiplications,
//! divisions and comparisons of floats; a fused one is two. Integers are not counted.

use earthshine_shaders::host::Pass;
use earthshine_shaders::kernel::Kernel;
use earthshine_shaders::limits::{BLOCK, RETURN_BANDS, SECTIONS, SHOT_CLASSES, TILE_EDGE};

/// What a pass does at least.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Work {
    /// Read and written.
    pub bytes: f64,
    /// Of floats.
    pub flops: f64,
}

/// Why nobody says what passes of kernel `name` do; none where [`Work`] is known.
#[must_use]
pub fn unknown(name: &str) -> Option<&'static str> {
    match name {
        "trace_closest" | "light_points" => Some("which nodes of the trees rays visit is not counted"),
        "face_fans" => Some("how many rays fans have is theirs to say"),
        "count_ends" => Some("how many keys the ends of rays have is found on the device"),
        "take_shooters" | "shoot_links" => Some("who shoots is decided on the device"),
        _ => None,
    }
}

/// Bytes of a number.
const NUMBER: f64 = 4.0;
/// Bytes of light, or of a patch: four numbers.
const LIGHT: f64 = 16.0;
/// Numbers of a tile.
const TILE: f64 = (TILE_EDGE * TILE_EDGE) as f64;
/// Columns of a block.
const WIDTH: f64 = BLOCK as f64;

/// What a pass of `kernel` does. `items` are what its entries have together: links of rows, items of tables; of
/// `gather_columns` the stripes that are named.
pub(crate) fn work(kernel: &Kernel, pass: &Pass, items: u64) -> Option<Work> {
    let (entries, items) = (f64::from(pass.entry_count), items as f64);
    let known = |bytes: f64, flops: f64| Some(Work { bytes, flops });
    let each = |bytes: f64, flops: f64| known(entries * bytes, entries * flops);
    let both = |(bytes, flops): (f64, f64), (item_bytes, item_flops): (f64, f64)| {
        known(entries * bytes + items * item_bytes, entries * flops + items * item_flops)
    };
    let is_shot = pass.is_shot != 0;
    match kernel.name {
        // Its fan; what is known of it.
        "make_rays" => each(20.0 * NUMBER, 80.0),
        // Patch, own light, irradiance, unshot; what leaves.
        "send_light" => each(5.0 * LIGHT, 12.0),
        "send_rest" => each(4.0 * LIGHT, 8.0),
        "share_outside" => each(2.0 * NUMBER + 4.0 * LIGHT, 16.0),
        "take_sources" if is_shot => each(11.0 * LIGHT, 24.0),
        "take_sources" => each(4.0 * LIGHT, 0.0),
        "clear_slots" => each(NUMBER + 6.0 * LIGHT, 0.0),
        // A row's place, its slot, what comes from outside, what arrives; a link and what its slot sends.
        "gather_rows" => both((3.0 * NUMBER + 2.0 * LIGHT, 4.0), (2.0 * NUMBER + LIGHT, 8.0)),
        // Who is asked for, a row, the light of three kinds; a column, its
        // target, the span and place in the list of that, a source.
        "gather_receivers" => both((23.0 * NUMBER, 24.0), (5.0 * NUMBER + LIGHT, 10.0)),
        // Who is asked for, four numbers gathered and told. What is news comes on top of it, as for light of slots.
        "count_sums" | "list_sums" => {
            each(2.0 * LIGHT + 2.0 * NUMBER / f64::from(pass.part_count.max(1)), 0.0)
        }
        "take_gathered" => each(NUMBER + if is_shot { 6.0 } else { 4.0 } * LIGHT, 16.0),
        "measure_light" => each(if is_shot { 4.0 } else { 2.0 } * LIGHT, 20.0),
        "sum_light" => each(2.0 * LIGHT, 8.0),
        "publish_light" => each(3.0 * LIGHT + 3.0 * NUMBER, 3.0),
        // Light, the code told, two bits. What is news comes on top of it, and the device decides how much that is.
        "count_news" | "list_news" => each(4.25 * NUMBER, 12.0),
        // A build, a row's place, a span, a sky share, a sum; of an item a link, an outcome, a weight that is summed.
        "fill_tables" => both((13.0 * NUMBER, 4.0), (4.0 * NUMBER, 2.0)),
        // Of an item its weight, its mass, its place and sum among the light or heavy, its bin.
        "build_alias" => both((4.0 * NUMBER, 1.0), (5.0 * NUMBER, 4.0)),
        // Of an item its weight, its end, and a part of the guide at least.
        "build_cdf" => both((6.0 * NUMBER, 1.0), (3.0 * NUMBER, 4.0)),
        "draw_alias" | "draw_cdf" => {
            let draws = f64::from(pass.samples_per_row);
            let looked = if kernel.name == "draw_alias" { 2.0 } else { 3.0 } * NUMBER + LIGHT;
            each(6.0 * NUMBER + 2.0 * LIGHT + draws * looked, 14.0 + 4.0 * draws)
        }
        // An edit, a row's place, its sum, what arrives; links are read and written.
        "edit_rows" => both((9.0 * NUMBER + LIGHT, 1.0), (4.0 * NUMBER, 1.0)),
        "forget_leaving" => both((11.0 * NUMBER, 0.0), (NUMBER, 0.0)),
        // Patch, row, flux; what arrives, light and what is unshot are read and written.
        "fold_flux" => each(LIGHT + 8.0 * NUMBER + 6.0 * LIGHT, 28.0),
        "choose_class" => known(2.0 * NUMBER * f64::from(SHOT_CLASSES), 0.0),
        "count_last" => each(2.0 * LIGHT + 2.0 * NUMBER, 6.0),
        "scan_groups" => each(2.0 * NUMBER, 0.0),
        "sum_lamps" => {
            let points = f64::from(pass.rows);
            known(points * (entries + 1.0) * LIGHT, 4.0 * points * entries)
        }
        // Of all points; of a patch where they are, and what is told of it. What points have to be told comes on top.
        "sum_points" => {
            let points = f64::from(pass.rows);
            known(points * LIGHT + entries * (2.0 * NUMBER + LIGHT), 6.0 * points)
        }
        "list_points" => each(2.0 * NUMBER + LIGHT, 0.0),
        "scatter_exchange" => each(3.0 * NUMBER, 0.0),
        _ => matrix_work(kernel, pass, items),
    }
}

/// Tiles in stripes before `stripe`.
fn tiles_before(stripe: u32) -> f64 {
    f64::from(stripe) * f64::from(stripe + 1) / 2.0
}

/// Of kernels that go over planes and over a block's columns.
fn matrix_work(kernel: &Kernel, pass: &Pass, items: f64) -> Option<Work> {
    let (entries, stripes) = (f64::from(pass.entry_count), f64::from(pass.stripe_count));
    let slots = stripes * f64::from(TILE_EDGE);
    // Of a channel.
    let columns = slots * WIDTH;
    let tiles = tiles_before(pass.end_stripe) - tiles_before(pass.first_stripe);
    // Of all tiles, those of the part that is bound.
    let part = tiles / tiles_before(pass.stripe_count).max(1.0);
    let known = |bytes: f64, flops: f64| Some(Work { bytes, flops });
    match kernel.name {
        // A tile beside the diagonal is read for its rows, and again for its columns.
        "gather_columns" => {
            let read = stripes * items * part;
            let sums = f64::from(SECTIONS) * columns;
            known(NUMBER * (read * TILE + slots * WIDTH + sums), 2.0 * WIDTH * TILE * read)
        }
        "combine_columns" => {
            let sections = f64::from(SECTIONS * pass.part_count);
            let second = if pass.second_weight == 0.0 { 0.0 } else { 1.0 };
            let numbers = 3.0 * columns;
            known(NUMBER * numbers * (2.0 + sections + second), numbers * (2.0 + sections + 2.0 * second))
        }
        "return_light" => {
            let returned = 3.0 * f64::from(RETURN_BANDS) * WIDTH * WIDTH;
            known(NUMBER * (4.0 * columns + returned) + slots * LIGHT, 3.0 * columns * 2.0 * WIDTH)
        }
        "solve_block" => {
            let numbers = f64::from(RETURN_BANDS) + 2.0 + 3.0;
            known(3.0 * NUMBER * numbers * WIDTH * WIDTH, 3.0 * 6.0 * WIDTH * WIDTH * WIDTH)
        }
        "times_small" => known(3.0 * columns * 3.0 * NUMBER, 3.0 * columns * 4.0 * WIDTH),
        "rank_update" => known(NUMBER * (2.0 * tiles * TILE + 2.0 * columns), 2.0 * WIDTH * TILE * tiles),
        "write_columns" | "copy_columns" => known(2.0 * NUMBER * entries * slots * part, 0.0),
        "read_members" => known(2.0 * NUMBER * entries * entries * part, 0.0),
        "emit_exitance" => {
            let rows = f64::from(pass.rows);
            known(rows * (9.0 * NUMBER + LIGHT), 6.0 * rows)
        }
        // Each number serves for its row and its column.
        "multiply_tiles" => known(NUMBER * entries * part * TILE, 4.0 * entries * part * TILE),
        "sum_tiles" => {
            let sums = 3.0 * stripes * slots;
            known(NUMBER * (sums + 6.0 * slots) + slots * LIGHT, sums + 9.0 * slots)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::plane_bytes;
    use earthshine_shaders::kernel::{KERNELS, MULTIPLY_TILES, RANK_UPDATE};

    /// Goal: what a kernel does is known, or it is said why not.
    #[test]
    fn every_kernel_s_work_is_known_or_it_is_said_why_not() {
        let pass = Pass { rows: 128, stripe_count: 2, end_stripe: 2, entry_count: 3, ..Pass::default() };
        for kernel in KERNELS {
            let work = work(kernel, &pass, 70);
            assert_eq!(work.is_none(), unknown(kernel.name).is_some(), "{}", kernel.name);
            assert!(work.is_none_or(|work| work.bytes > 0.0 && work.flops >= 0.0), "{}", kernel.name);
        }
    }

    /// Goal: the bytes of a plane are those that it has, in one part and in several.
    #[test]
    fn planes_are_counted_whole_and_in_parts() {
        let slots = 640;
        let (stripes, plane) = (slots / TILE_EDGE, plane_bytes(slots) as f64);
        let entry_count = tiles_before(stripes) as u32;
        let whole =
            Pass { rows: slots, stripe_count: stripes, end_stripe: stripes, entry_count, ..Pass::default() };
        let of = |kernel, pass: &Pass| work(kernel, pass, 0).expect("known").bytes;
        assert_eq!(of(&MULTIPLY_TILES, &whole), plane);
        let columns = 2.0 * NUMBER * f64::from(slots) * WIDTH;
        assert_eq!(of(&RANK_UPDATE, &whole), 2.0 * plane + columns);
        let parts = [(0, 4), (4, 9), (9, stripes)];
        let of_parts: f64 = parts
            .iter()
            .map(|&(first_stripe, end_stripe)| {
                of(&MULTIPLY_TILES, &Pass { first_stripe, end_stripe, ..whole })
            })
            .sum();
        assert!((of_parts / plane - 1.0).abs() < 1e-9, "{of_parts}");
    }
}
