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
/// Among the words of shots: mean power of patches, remembered for a while.
pub const SHOT_SCALE: u32 = 0;
/// Among the words of shots: unshot power as a share of all, after a frame.
pub const SHOT_UNSHOT_SHARE: u32 = 1;
/// Among the words of shots: mean square of what a bounce changes of each patch's light, as a share of it; of the worst channel.
pub const SHOT_CHANGE: u32 = 2;
/// Among the words of shots: patches that shot in a frame.
pub const SHOT_SHOOTERS: u32 = 3;
/// Among the words of shots: patches that shoot in a round.
pub const SHOT_LISTED: u32 = 4;
/// Among the words of shots: most that any of them shoots, the bits of a positive `f32`.
pub const SHOT_BRIGHTEST: u32 = 5;
/// Among the words of shots: least important class that shoots.
pub const SHOT_LAST_CLASS: u32 = 6;
/// Among the words of shots: links of that class that may be shot over.
pub const SHOT_LINKS_OF_LAST: u32 = 7;
/// Words of shots.
pub const SHOT_WORDS: u32 = 8;
/// Classes of importance: sign, exponent and three bits of a positive `f32`.
pub const SHOT_CLASSES: u32 = 1 << 11;
/// Threads of a workgroup that follows rays: few, so that long ways hold up few.
pub const RAY_LANES: u32 = 64;
/// Groups of nodes that a ray may leave waiting, of both levels of trees together.
pub const TREE_STACK: u32 = 40;
/// Of a ray that meets no triangle.
pub const NO_TRIANGLE: u32 = u32::MAX;
/// Of a column that no source stands for.
pub const NO_SOURCE: u32 = u32::MAX;
/// Of rows whose columns name their targets themselves.
pub const NO_TARGETS: u32 = u32::MAX;
/// Most columns of a row.
pub const ROW_COLUMNS_MAX: u32 = (1 << 24) - 1;
/// Parts of a row's sums: what comes from slots, from coarse parents, from the sky.
pub const SUM_PARTS: u32 = 3;
/// Parts of a ray that counts whole.
pub const RAY_PARTS: u32 = 1 << 20;
/// Most rays whose ends one workgroup adds up.
pub const RUN_RAYS: u32 = 512;
/// Slots of its table: three keys a ray, and some room.
pub const RUN_KEYS: u32 = 1792;
/// Key of an end that the host has to find: of the first ray of a run, the others follow.
pub const KEY_UNKNOWN: u32 = 0xFFFF_0000;
/// Key of the sky's first lobe; the others follow.
pub const KEY_SKY: u32 = 0xFFFF_FF00;
/// Key of sides without patches.
pub const KEY_ABSORBED: u32 = 0xFFFF_FF06;
/// No key, and no patch.
pub const NO_KEY: u32 = u32::MAX;
/// Of a side: only the host can tell what a ray finds that meets it.
pub const SIDE_FOR_HOST: u32 = 1;
/// Of a side: that is so in voxels that ask the host.
pub const SIDE_FOR_HOST_IN_PLACES: u32 = 2;
/// Of a side: it has no back.
pub const SIDE_TWO_SIDED: u32 = 4;
/// Of a side: its front lies inside of something.
pub const SIDE_FRONT_BURIED: u32 = 8;
/// Of a side: its back does.
pub const SIDE_BACK_BURIED: u32 = 16;
/// From [`SIDE_FRONT_BURIED`] and [`SIDE_BACK_BURIED`] to the flags of sides that are buried in some voxels: bits up.
pub const BURIED_IN_PLACES: u32 = 2;
/// From the bits by direction of a voxel's buried sides to those of its open ones: bits up.
pub const BURIED_OPEN: u32 = 8;
/// A run that adds up all of its rays; less than this names a direction whose way they have to go.
pub const SUM_WHOLE: u32 = 6;
/// A run that adds up what ends on sides without patches.
pub const SUM_ABSORBED: u32 = 7;

/// Every constant that a kernel may name, as WGSL has it. A test holds each kernel against this list.
pub const CONSTANTS: &[(&str, u32)] = &[
    ("TILE_EDGE", TILE_EDGE),
    ("BLOCK", BLOCK),
    ("LANES", LANES),
    ("SECTIONS", SECTIONS),
    ("RETURN_BANDS", RETURN_BANDS),
    ("GRID_WIDTH", GRID_WIDTH),
    ("SHOT_SCALE", SHOT_SCALE),
    ("SHOT_UNSHOT_SHARE", SHOT_UNSHOT_SHARE),
    ("SHOT_CHANGE", SHOT_CHANGE),
    ("SHOT_SHOOTERS", SHOT_SHOOTERS),
    ("SHOT_LISTED", SHOT_LISTED),
    ("SHOT_BRIGHTEST", SHOT_BRIGHTEST),
    ("SHOT_LAST_CLASS", SHOT_LAST_CLASS),
    ("SHOT_LINKS_OF_LAST", SHOT_LINKS_OF_LAST),
    ("SHOT_CLASSES", SHOT_CLASSES),
    ("RAY_LANES", RAY_LANES),
    ("TREE_STACK", TREE_STACK),
    ("NO_TRIANGLE", NO_TRIANGLE),
    ("NO_SOURCE", NO_SOURCE),
    ("NO_TARGETS", NO_TARGETS),
    ("ROW_COLUMNS_MAX", ROW_COLUMNS_MAX),
    ("SUM_PARTS", SUM_PARTS),
    ("RAY_PARTS", RAY_PARTS),
    ("RUN_RAYS", RUN_RAYS),
    ("RUN_KEYS", RUN_KEYS),
    ("KEY_UNKNOWN", KEY_UNKNOWN),
    ("KEY_SKY", KEY_SKY),
    ("KEY_ABSORBED", KEY_ABSORBED),
    ("NO_KEY", NO_KEY),
    ("SIDE_FOR_HOST", SIDE_FOR_HOST),
    ("SIDE_FOR_HOST_IN_PLACES", SIDE_FOR_HOST_IN_PLACES),
    ("SIDE_TWO_SIDED", SIDE_TWO_SIDED),
    ("SIDE_FRONT_BURIED", SIDE_FRONT_BURIED),
    ("SIDE_BACK_BURIED", SIDE_BACK_BURIED),
    ("BURIED_IN_PLACES", BURIED_IN_PLACES),
    ("BURIED_OPEN", BURIED_OPEN),
    ("SUM_WHOLE", SUM_WHOLE),
    ("SUM_ABSORBED", SUM_ABSORBED),
];
