//! What a host must know of a kernel to run it: bindings, workgroup size, source.
//!
//! A layout is built from this, so a new kernel is one WGSL file and one constant; `tests/reflection.rs` compares
//! each with what naga reads from the source.

/// What a kernel does with a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// A uniform, bound at an offset that each dispatch chooses.
    Uniform,
    /// Storage that is read.
    Read,
    /// Storage that is read and written.
    ReadWrite,
}

/// One buffer of group 0; its place in [`Kernel::bindings`] is its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Binding {
    /// The variable's name.
    pub name: &'static str,
    /// What the kernel does with it.
    pub access: Access,
}

/// A compute shader with one entry point.
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    /// Of the file, the entry point, and this.
    pub name: &'static str,
    /// Whole and valid WGSL.
    pub source: &'static str,
    /// Buffers, by number.
    pub bindings: &'static [Binding],
    /// Threads of a workgroup.
    pub workgroup_size: [u32; 3],
}

const fn uniform(name: &'static str) -> Binding {
    Binding { name, access: Access::Uniform }
}

const fn read(name: &'static str) -> Binding {
    Binding { name, access: Access::Read }
}

const fn written(name: &'static str) -> Binding {
    Binding { name, access: Access::ReadWrite }
}

/// Names a kernel, the common files it is put together from, its buffers after the pass's uniform, and the threads of its
/// workgroups where they are not the usual.
macro_rules! kernel {
    ($(#[$doc:meta])* $constant:ident = $name:literal, $common:tt, $bindings:tt) => {
        kernel!($(#[$doc])* $constant = $name, $common, $bindings, crate::limits::LANES);
    };
    (
        $(#[$doc:meta])* $constant:ident = $name:literal, [$($common:literal),*], [$($binding:expr),* $(,)?], $lanes:expr
    ) => {
        $(#[$doc])*
        pub const $constant: Kernel = Kernel {
            name: $name,
            source: concat!(
                include_str!("../wgsl/common/limits.wgsl"),
                include_str!("../wgsl/common/pass.wgsl"),
                $(include_str!(concat!("../wgsl/common/", $common, ".wgsl")),)*
                include_str!(concat!("../wgsl/kernels/", $name, ".wgsl")),
            ),
            bindings: &[uniform("pass_of"), $($binding),*],
            workgroup_size: [$lanes, 1, 1],
        };
    };
}

kernel!(
    /// What a block's patches exchange with residents, into its columns.
    SCATTER_EXCHANGE = "scatter_exchange",
    ["resident"],
    [read("entries"), read("residents"), written("columns")]
);
kernel!(
    /// A plane times a block's columns.
    GATHER_COLUMNS = "gather_columns",
    ["exchange", "resident"],
    [read("plane"), read("right"), read("residents"), read("is_named"), written("sums")]
);
kernel!(
    /// Two blocks of columns and the sums of a gather, weighted.
    COMBINE_COLUMNS = "combine_columns",
    [],
    [read("first"), read("second"), read("sums"), written("result")]
);
kernel!(
    /// What comes back to a block's patches.
    RETURN_LIGHT = "return_light",
    ["resident"],
    [read("exchange"), read("columns"), read("residents"), written("returned")]
);
kernel!(
    /// Who of a block enters, and its small matrices.
    SOLVE_BLOCK = "solve_block",
    ["resident", "member"],
    [
        read("returned"),
        written("among"),
        read("offered"),
        written("residents"),
        written("members"),
        written("exchange"),
        written("small"),
        written("refused"),
    ]
);
kernel!(
    /// A block's columns times two small matrices.
    TIMES_SMALL = "times_small",
    ["member"],
    [read("columns"), read("small"), read("members"), written("finals"), written("update")]
);
kernel!(
    /// A plane plus a product of rank 32.
    RANK_UPDATE = "rank_update", ["exchange"], [written("plane"), read("columns"), read("update")]
);
kernel!(
    /// Sets rows and columns of a block's members.
    WRITE_COLUMNS = "write_columns",
    ["exchange", "member"],
    [written("plane"), read("finals"), read("members")]
);
kernel!(
    /// Copies columns of a block's members out of a plane.
    COPY_COLUMNS = "copy_columns",
    ["exchange", "resident", "member"],
    [read("plane"), read("residents"), read("members"), written("columns")]
);
kernel!(
    /// Copies what a block's members exchange among themselves out of a plane.
    READ_MEMBERS = "read_members",
    ["exchange", "member"],
    [read("plane"), read("members"), written("among")]
);
kernel!(
    /// What leaves patches: their own light and what they reflect.
    EMIT_EXITANCE = "emit_exitance",
    ["resident"],
    [read("own"), read("arriving"), read("residents"), written("sent")]
);
kernel!(
    /// What each tile adds to a product.
    MULTIPLY_TILES = "multiply_tiles",
    ["exchange", "stripe_marks"],
    [read("plane"), read("tiles"), read("marks"), read("sent"), written("tile_sums")]
);
kernel!(
    /// The product's sums, as irradiance.
    SUM_TILES = "sum_tiles",
    ["resident", "stripe_marks"],
    [read("tile_sums"), read("marks"), read("residents"), read("outside"), written("irradiance")]
);

kernel!(
    /// Alias tables, one workgroup a row or section.
    BUILD_ALIAS = "build_alias",
    ["table_span", "span_sum", "lane_scan"],
    [
        read("spans"),
        read("weights"),
        written("masses"),
        written("parts"),
        written("bins"),
        written("totals")
    ]
);

kernel!(
    /// Cumulative tables, one workgroup a row.
    BUILD_CDF = "build_cdf",
    ["row_span", "cdf_guide", "span_sum", "lane_scan"],
    [read("spans"), read("weights"), written("ends"), written("guide"), written("totals")]
);
kernel!(
    /// What draws of the outside bring.
    SHARE_OUTSIDE = "share_outside",
    [],
    [read("outside_shares"), read("sky_shares"), read("outside"), read("sky"), written("outside_draws")]
);
kernel!(
    /// What each patch has sent.
    SEND_LIGHT = "send_light",
    ["resident"],
    [read("residents"), read("own_light"), read("irradiance"), read("unshot"), written("sent")]
);
kernel!(
    /// Strikes who leaves from rows and appends who comes.
    EDIT_ROWS = "edit_rows",
    ["row_edit", "link", "lane_scan"],
    [read("edits"), read("leaving"), read("newcomers"), written("links"), written("rows"), written("outside_shares"), read("sent"), written("arriving")]
);
kernel!(
    /// In tables, who leaves looks far.
    FORGET_LEAVING = "forget_leaving",
    ["row_edit", "row_span", "draw"],
    [read("edits"), read("leaving"), written("spans"), written("outcomes")]
);
kernel!(
    /// No light in slots that somebody leaves.
    CLEAR_SLOTS = "clear_slots",
    [],
    [read("slots"), written("own_light"), written("outside"), written("irradiance"), written("unshot"), written("arriving"), written("rest")]
);
kernel!(
    /// Takes new sources of all slots.
    TAKE_SOURCES = "take_sources",
    ["resident"],
    [read("residents"), read("new_own_light"), read("new_outside"), written("own_light"), written("outside"), written("irradiance"), written("unshot")]
);
kernel!(
    /// What arrives at each of some slots.
    GATHER_ROWS = "gather_rows",
    ["link"],
    [read("slots"), read("rows"), read("links"), read("sent"), read("outside"), written("gathered")]
);
kernel!(
    /// Takes what was gathered for light.
    TAKE_GATHERED = "take_gathered",
    ["resident"],
    [read("slots"), read("residents"), read("gathered"), written("irradiance"), written("unshot")]
);
kernel!(
    /// Sums over slots, a pair a workgroup.
    MEASURE_LIGHT = "measure_light",
    ["resident", "shots", "pair_sum"],
    [read("residents"), read("own_light"), read("irradiance"), read("unshot"), read("gathered"), written("light_sums")]
);
kernel!(
    /// Sums of [`MEASURE_LIGHT`], and what they say.
    SUM_LIGHT = "sum_light",
    ["shots", "pair_sum"],
    [read("light_sums"), written("shot_words")]
);
kernel!(
    /// Weights and outcomes of rows whose tables are built next.
    FILL_TABLES = "fill_tables",
    ["row_span", "link", "draw", "span_sum"],
    [read("builds"), read("rows"), read("links"), read("sky_shares"), written("weights"), written("outcomes"), written("spans"), written("totals")]
);
kernel!(
    /// Brings flux that has arrived into light, and counts who matters.
    FOLD_FLUX = "fold_flux",
    ["resident", "link", "shots"],
    [read("residents"), read("rows"), read("shot_words"), written("arrived"), written("arriving"), written("irradiance"), written("unshot"), written("classes")]
);
kernel!(
    /// The least important class that shoots in a round.
    CHOOSE_CLASS = "choose_class",
    ["shots", "lane_scan"],
    [written("classes"), written("shot_words")]
);
kernel!(
    /// Links of the last class that shoots, of each workgroup of slots.
    COUNT_LAST = "count_last",
    ["resident", "link", "shots", "importance", "lane_scan"],
    [read("residents"), read("rows"), read("unshot"), read("shot_words"), written("group_counts")]
);
kernel!(
    /// Counts of workgroups to counts of those before.
    SCAN_GROUPS = "scan_groups",
    ["lane_scan"],
    [written("group_counts")]
);
kernel!(
    /// Lists who shoots in a round.
    TAKE_SHOOTERS = "take_shooters",
    ["resident", "link", "shots", "importance", "lane_scan"],
    [read("residents"), read("rows"), written("unshot"), written("shot_words"), read("group_counts"), written("shooters"), written("shot")]
);
kernel!(
    /// Shooters send along their rows.
    SHOOT_LINKS = "shoot_links",
    ["resident", "link", "shots"],
    [read("residents"), read("rows"), read("links"), read("shooters"), read("shot"), read("shot_words"), written("arrived")]
);
kernel!(
    /// What leaves patches of what is not shot yet.
    SEND_REST = "send_rest",
    ["resident"],
    [read("residents"), read("unshot"), read("rest"), written("sent")]
);
kernel!(
    /// Light and what is estimated beside it.
    PUBLISH_LIGHT = "publish_light",
    ["shots"],
    [read("irradiance"), read("shot_words"), written("rest"), written("published")]
);
kernel!(
    /// How many slots of each workgroup are news.
    COUNT_NEWS = "count_news",
    ["light_code", "news", "lane_scan"],
    [read("light"), read("marks"), read("told"), written("group_counts")]
);
kernel!(
    /// Lists what is news, and takes it for told.
    LIST_NEWS = "list_news",
    ["light_code", "news", "lane_scan"],
    [read("light"), read("marks"), written("told"), read("group_counts"), written("news")]
);
kernel!(
    /// Draws from alias tables, blended with the past.
    DRAW_ALIAS = "draw_alias",
    ["row_span", "draw", "temporal"],
    [
        read("spans"),
        read("outcomes"),
        read("totals"),
        read("sent"),
        read("outside_draws"),
        written("irradiance"),
        read("bins"),
    ]
);
kernel!(
    /// Draws from cumulative tables, blended with the past.
    DRAW_CDF = "draw_cdf",
    ["row_span", "cdf_guide", "draw", "temporal"],
    [
        read("spans"),
        read("outcomes"),
        read("totals"),
        read("sent"),
        read("outside_draws"),
        written("irradiance"),
        read("ends"),
        read("guide"),
    ]
);
kernel!(
    /// The closest triangle along rays.
    TRACE_CLOSEST = "trace_closest",
    ["ray", "wide_tree"],
    [read("nodes"), read("placements"), read("triangles"), read("queries"), written("hits")],
    crate::limits::RAY_LANES
);
kernel!(
    /// The rays of fans.
    MAKE_RAYS = "make_rays", ["ray", "ray_fan"], [read("fans"), written("queries")]
);
kernel!(
    /// What the rays of fans face.
    FACE_FANS = "face_fans",
    ["ray", "ray_fan", "end_side"],
    [read("fans"), read("queries"), read("hits"), read("sides"), written("faced")]
);
kernel!(
    /// Where the rays of runs end.
    COUNT_ENDS = "count_ends",
    ["draw", "ray", "end_side"],
    [
        read("queries"),
        read("hits"),
        read("sides"),
        read("voxels"),
        read("runs"),
        written("parts"),
        written("part_spans"),
        written("parts_taken"),
    ]
);
kernel!(
    /// What lights bring to points, with shadows.
    LIGHT_POINTS = "light_points",
    ["wide_tree", "point_span"],
    [
        read("nodes"),
        read("placements"),
        read("triangles"),
        read("points"),
        read("spans"),
        read("lamps"),
        read("shifts"),
        written("arriving"),
    ],
    crate::limits::RAY_LANES
);
kernel!(
    /// What arrives at points of all lamps.
    SUM_LAMPS = "sum_lamps", [], [read("arriving"), written("on_points")], crate::limits::RAY_LANES
);
kernel!(
    /// Light of patches over their points, and whose points have to be told of.
    SUM_POINTS = "sum_points",
    ["point_span", "lit_patch", "lane_scan"],
    [read("spans"), read("on_points"), written("lit"), written("group_counts")]
);
kernel!(
    /// Lists light on points that have to be told of.
    LIST_POINTS = "list_points",
    ["point_span", "lit_patch", "lane_scan"],
    [read("spans"), read("on_points"), read("lit"), read("group_counts"), written("listed")]
);
kernel!(
    /// What arrives at receivers.
    GATHER_RECEIVERS = "gather_receivers",
    ["receiver"],
    [
        read("asked"),
        read("rows"),
        read("columns"),
        read("spans"),
        read("source_of"),
        read("sources"),
        read("sky"),
        written("gathered"),
    ]
);
kernel!(
    /// Counts parts of rows' sums that are news.
    COUNT_SUMS = "count_sums",
    ["receiver", "sums", "lane_scan"],
    [read("asked"), read("gathered"), read("told"), written("group_counts")]
);
kernel!(
    /// Lists parts of rows' sums that are news, and takes them for told.
    LIST_SUMS = "list_sums",
    ["receiver", "sums", "lane_scan"],
    [read("asked"), read("gathered"), written("told"), read("group_counts"), written("news")]
);

/// Every kernel.
pub const KERNELS: &[Kernel] = &[
    SCATTER_EXCHANGE,
    GATHER_COLUMNS,
    COMBINE_COLUMNS,
    RETURN_LIGHT,
    SOLVE_BLOCK,
    TIMES_SMALL,
    RANK_UPDATE,
    WRITE_COLUMNS,
    COPY_COLUMNS,
    READ_MEMBERS,
    EMIT_EXITANCE,
    MULTIPLY_TILES,
    SUM_TILES,
    BUILD_ALIAS,
    BUILD_CDF,
    SHARE_OUTSIDE,
    SEND_LIGHT,
    EDIT_ROWS,
    FORGET_LEAVING,
    CLEAR_SLOTS,
    TAKE_SOURCES,
    GATHER_ROWS,
    TAKE_GATHERED,
    MEASURE_LIGHT,
    SUM_LIGHT,
    FILL_TABLES,
    FOLD_FLUX,
    CHOOSE_CLASS,
    COUNT_LAST,
    SCAN_GROUPS,
    TAKE_SHOOTERS,
    SHOOT_LINKS,
    SEND_REST,
    PUBLISH_LIGHT,
    COUNT_NEWS,
    LIST_NEWS,
    DRAW_ALIAS,
    DRAW_CDF,
    TRACE_CLOSEST,
    MAKE_RAYS,
    FACE_FANS,
    COUNT_ENDS,
    LIGHT_POINTS,
    SUM_LAMPS,
    SUM_POINTS,
    LIST_POINTS,
    GATHER_RECEIVERS,
    COUNT_SUMS,
    LIST_SUMS,
];
