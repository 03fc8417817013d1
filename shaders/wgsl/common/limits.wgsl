// Sizes that kernels and hosts share. The Rust twins are in `src/limits.rs`.

// Rows and columns of a tile of a plane.
const TILE_EDGE: u32 = 64u;
// Most patches that enter, leave or are refined together: the width of a block's columns.
const BLOCK: u32 = 32u;
// Threads of a workgroup.
const LANES: u32 = 256u;
// Parts in which a gather sums the columns of a plane, each by workgroups of its own.
const SECTIONS: u32 = 4u;
// Bands of rows that `return_light` sums apart.
const RETURN_BANDS: u32 = 16u;
// Workgroups in a row of a grid that is too long for one dimension.
const GRID_WIDTH: u32 = 4096u;
// Threads of a workgroup that follows rays: few, so that long ways hold up few.
const RAY_LANES: u32 = 64u;
// Groups of nodes that a ray may leave waiting, of both levels of trees together.
const TREE_STACK: u32 = 40u;
// Of a ray that meets no triangle.
const NO_TRIANGLE: u32 = 0xFFFFFFFFu;
// Of a column that no source stands for.
const NO_SOURCE: u32 = 0xFFFFFFFFu;
// Of rows whose columns name their targets themselves.
const NO_TARGETS: u32 = 0xFFFFFFFFu;
// Most columns of a row.
const ROW_COLUMNS_MAX: u32 = 0xFFFFFFu;
// Parts of a row's sums: what comes from slots, from coarse parents, from the sky.
const SUM_PARTS: u32 = 3u;
// Parts of a ray that counts whole.
const RAY_PARTS: u32 = 1048576u;
// Most rays whose ends one workgroup adds up.
const RUN_RAYS: u32 = 512u;
// Slots of its table: three keys a ray, and some room.
const RUN_KEYS: u32 = 1792u;
// Keys of ends that are no patches; those from KEY_UNKNOWN on name rays of the run.
const KEY_UNKNOWN: u32 = 0xFFFF0000u;
const KEY_SKY: u32 = 0xFFFFFF00u;
const KEY_ABSORBED: u32 = 0xFFFFFF06u;
const NO_KEY: u32 = 0xFFFFFFFFu;
// Of a side: only the host can tell what a ray finds that meets it; that is so in voxels that ask it; it has no back.
const SIDE_FOR_HOST: u32 = 1u;
const SIDE_FOR_HOST_IN_PLACES: u32 = 2u;
const SIDE_TWO_SIDED: u32 = 4u;
// Of a side: its front, or its back, lies inside of something. BURIED_IN_PLACES bits up: that is so in some voxels.
const SIDE_FRONT_BURIED: u32 = 8u;
const SIDE_BACK_BURIED: u32 = 16u;
const BURIED_IN_PLACES: u32 = 2u;
// From the bits by direction of a voxel's buried sides to those of its open ones: bits up.
const BURIED_OPEN: u32 = 8u;
// What a run adds up, other than the rays that go one direction's way.
const SUM_WHOLE: u32 = 6u;
const SUM_ABSORBED: u32 = 7u;
