//! Sizes that kernels and hosts share; their WGSL twins are in `wgsl/common/limits.wgsl`.

/// Rows and columns of a tile of a plane.
pub const TILE_EDGE: u32 = 64;
/// Most patches that enter, leave or are refined together: the width of a block's columns.
pub const BLOCK: u32 = 32;
/// Threads of a workgroup.
pub const LANES: u32 = 256;
/// Parts in which a gather sums the columns of a plane, each by workgroups of its own.
pub const SECTIONS: u32 = 4;
/// Bands of rows that `return_light` sums apart.
pub const RETURN_BANDS: u32 = 16;
/// Workgroups in a row of a grid that is too long for one dimension.
pub const GRID_WIDTH: u32 = 4096;

/// Every constant that a kernel may name, as WGSL has it. A test holds each kernel against this list.
pub const CONSTANTS: &[(&str, u32)] = &[
    ("TILE_EDGE", TILE_EDGE),
    ("BLOCK", BLOCK),
    ("LANES", LANES),
    ("SECTIONS", SECTIONS),
    ("RETURN_BANDS", RETURN_BANDS),
    ("GRID_WIDTH", GRID_WIDTH),
];
