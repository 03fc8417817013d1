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

/// Names a kernel, the common files it is put together from, and its buffers after the pass's uniform.
macro_rules! kernel {
    ($(#[$doc:meta])* $constant:ident = $name:literal, [$($common:literal),*], [$($binding:expr),* $(,)?]) => {
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
            workgroup_size: [crate::limits::LANES, 1, 1],
        };
    };
}

kernel!(
    /// What a block's patches exchange with residents, into its columns.
    SCATTER_EXCHANGE = "scatter_exchange", [], [read("entries"), written("columns")]
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
    /// What of each row is far and the sky's: its last two weights.
    SPLIT_OUTSIDE = "split_outside",
    ["row_span", "span_sum"],
    [read("spans"), read("sky_shares"), written("weights")]
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
    ["row_span"],
    [read("spans"), read("weights"), read("outside"), read("sky"), written("outside_draws")]
);
kernel!(
    /// What leaves patches, all channels at once.
    SEND_LIGHT = "send_light",
    ["resident"],
    [read("residents"), read("own_light"), read("irradiance"), written("sent")]
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

/// Every kernel.
pub const KERNELS: &[Kernel] = &[
    SCATTER_EXCHANGE,
    GATHER_COLUMNS,
    COMBINE_COLUMNS,
    RETURN_LIGHT,
    TIMES_SMALL,
    RANK_UPDATE,
    WRITE_COLUMNS,
    COPY_COLUMNS,
    READ_MEMBERS,
    EMIT_EXITANCE,
    MULTIPLY_TILES,
    SUM_TILES,
    BUILD_ALIAS,
    SPLIT_OUTSIDE,
    BUILD_CDF,
    SHARE_OUTSIDE,
    SEND_LIGHT,
    DRAW_ALIAS,
    DRAW_CDF,
];
