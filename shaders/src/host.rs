//! Host structs with the layout of their WGSL twins.
//!
//! `Pod` refuses hidden padding here, naga computes offsets there, and `tests/reflection.rs` compares every field by
//! name, offset and type. A struct of WGSL without a twin here fails that test, and the reverse.

use bytemuck::{Pod, Zeroable};

/// One field of a host struct: name, offset in bytes, WGSL type.
pub type Field = (&'static str, usize, &'static str);

/// A host struct's name, size in bytes and fields.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// As in WGSL.
    pub name: &'static str,
    /// Bytes, padding included.
    pub size: usize,
    /// In order.
    pub fields: &'static [Field],
}

/// What a host type is called in WGSL.
trait GpuField {
    const WGSL: &'static str;
}

impl GpuField for u32 {
    const WGSL: &'static str = "u32";
}

impl GpuField for f32 {
    const WGSL: &'static str = "f32";
}

impl GpuField for [u32; 2] {
    const WGSL: &'static str = "vec2<u32>";
}

impl GpuField for [f32; 2] {
    const WGSL: &'static str = "vec2<f32>";
}

impl GpuField for [u32; 3] {
    const WGSL: &'static str = "vec3<u32>";
}

impl GpuField for [i32; 3] {
    const WGSL: &'static str = "vec3<i32>";
}

impl GpuField for [f32; 4] {
    const WGSL: &'static str = "vec4<f32>";
}

impl GpuField for [f32; 3] {
    const WGSL: &'static str = "vec3<f32>";
}

macro_rules! gpu_structs {
    ($($(#[$struct_doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty,)* })*) => {
        $(
            $(#[$struct_doc])*
            #[repr(C)]
            #[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
            pub struct $name {
                $($(#[$field_doc])* pub $field: $type,)*
            }
        )*

        /// Every host struct.
        pub const LAYOUTS: &[Layout] = &[$(Layout {
            name: stringify!($name),
            size: size_of::<$name>(),
            fields: &[$((
                stringify!($field),
                std::mem::offset_of!($name, $field),
                <$type as GpuField>::WGSL,
            ),)*],
        },)*];
    };
}

gpu_structs! {
    /// What one dispatch is told. Not every kernel reads every field.
    Pass {
        /// Rows of every vector and of every block's columns: all stripes of the matrix.
        rows: u32,
        /// Stripes that can hold anything.
        stripe_count: u32,
        /// First stripe of the part of a plane that is bound.
        first_stripe: u32,
        /// One past its last stripe.
        end_stripe: u32,
        /// Which of three values of a patch the bound plane goes with.
        channel: u32,
        /// Entries, members or tiles in the bound list.
        entry_count: u32,
        /// Which part of a plane is bound; the first part of rows' sums that is compared.
        part: u32,
        /// Parts of a plane; parts of a row's sums that are compared.
        part_count: u32,
        /// Numbers from one channel of the operand to the next; 0 if all share it.
        channel_stride: u32,
        /// Weight of the first operand.
        first_weight: f32,
        /// Weight of the second operand.
        second_weight: f32,
        /// Weight of the irradiance from outside.
        outside_weight: f32,
        /// Of every draw.
        seed: u32,
        /// Of draws: which frame it is.
        frame: u32,
        /// Draws a row and frame, 1 at least where any are made.
        samples_per_row: u32,
        /// Links that a round of shots may take, 1 at least.
        budget_links: u32,
        /// Slots with a patch.
        taken_count: u32,
        /// 1 where light is shot.
        is_shot: u32,
        /// 1 where patches leave.
        is_leaving: u32,
        /// Root of the tree over placements of trees.
        top_node: u32,
        /// Of the grid in which ends of rays are counted.
        voxel_edge_m: f32,
        /// How far before a side the voxel of a ray's end is looked up.
        off_surface_m: f32,
        /// Of the table of voxels: a power of two.
        voxel_slots: u32,
        /// A patch whose pivot is below it does not enter.
        pivot_min: f32,
        /// What rays of fans meet nearer is near.
        near_m: f32,
        /// Fans whose rays are made.
        fan_count: u32,
    }

    /// A patch in its slot; all zero in a free one.
    Resident {
        /// 0..=0.98 a channel.
        reflectance: [f32; 3],
        /// m2.
        area: f32,
    }

    /// A patch of the block that enters, leaves or is refined.
    Member {
        /// Its row and column; all ones once it did not enter.
        slot: u32,
        /// Its column in the block.
        place: u32,
    }

    /// What a patch of a block exchanges with a resident.
    ExchangeEntry {
        /// `slot * BLOCK + place`.
        at: u32,
        /// m2.
        exchange_m2: f32,
    }

    /// One row, or one section of a long row, whose table is to be built.
    TableSpan {
        /// Where its weights begin.
        first_weight: u32,
        /// Where its bins begin.
        first_bin: u32,
        /// At most 4,096.
        item_count: u32,
    }

    /// The row of one slot: its links, then what is far and the sky.
    RowSpan {
        /// Where its weights and outcomes begin.
        first_item: u32,
        /// Two more than its links; 0 for a free slot.
        item_count: u32,
        /// Where its table begins.
        first_bin: u32,
        /// Where the guide of a cumulative table begins.
        first_guide: u32,
        /// Where the sum of its weights is.
        total_at: u32,
    }

    /// One form factor of a row.
    Link {
        /// Whom it leads to.
        slot: u32,
        /// 0..=1.
        share: f32,
    }

    /// Where the links of a slot's row are.
    LiveRow {
        /// Where they begin.
        first: u32,
        /// 0 for a free slot.
        count: u32,
    }

    /// A row that changes: who leaves is struck from it, who comes is appended, and it may move.
    RowEdit {
        /// Whose row.
        slot: u32,
        /// Where its links began.
        old_first: u32,
        /// How many there were.
        old_count: u32,
        /// Where they begin from now on.
        first: u32,
        /// Where those begin that are appended.
        first_new: u32,
        /// How many are appended.
        new_count: u32,
    }

    /// Of a stripe's 64 slots, which carry light and whose light is wanted.
    StripeMarks {
        /// A bit each.
        lit: [u32; 2],
        /// A bit each.
        wanted: [u32; 2],
    }

    /// Of 32 slots, a bit each.
    NewsMarks {
        /// Their light on the device is their patch's.
        known: u32,
        /// Nothing was told of the patch that is there.
        fresh: u32,
    }

    /// What is told of a slot. The first of a list says how many follow, in place of a slot.
    NewsEntry {
        /// Whose light.
        slot: u32,
        /// lx.
        red: f32,
        /// lx.
        green: f32,
        /// lx.
        blue: f32,
    }

    /// Where one tree stands among others: rows of the map from the world into its frame.
    TreePlacement {
        /// With the offset last.
        to_tree_x: [f32; 4],
        /// With the offset last.
        to_tree_y: [f32; 4],
        /// With the offset last.
        to_tree_z: [f32; 4],
        /// Its root.
        first_node: u32,
        /// Of its leaves.
        first_triangle: u32,
        /// Of no meaning.
        spare: [u32; 2],
    }

    /// A triangle in the world.
    TreeTriangle {
        /// Corner 0, m.
        corner: [f32; 3],
        /// Its number for the host.
        index: u32,
        /// Corner 0 minus corner 1, m.
        edge_1: [f32; 3],
        /// What a crossing lets through.
        transmittance: f32,
        /// Corner 2 minus corner 0, m.
        edge_2: [f32; 3],
        /// Of no meaning.
        spare: u32,
    }

    /// A ray; crossings count strictly between its distances, in lengths of its direction.
    RayQuery {
        /// m.
        origin: [f32; 3],
        /// From where crossings count.
        distance_min_m: f32,
        /// Of any length.
        direction: [f32; 3],
        /// To where; finite.
        distance_max_m: f32,
    }

    /// What a ray meets first.
    RayHit {
        /// Number of the triangle, or [`NO_TRIANGLE`](crate::limits::NO_TRIANGLE).
        triangle: u32,
        /// In lengths of the ray's direction.
        distance_m: f32,
    }

    /// Rays from one place over the hemisphere about a normal, by the cosine and consecutive pairs of a shifted R2 sequence.
    RayFan {
        /// m.
        origin: [f32; 3],
        /// Among those of all fans.
        first_ray: u32,
        /// Unit.
        normal: [f32; 3],
        /// Number of the first ray's pair.
        first_pair: u32,
        /// Of the sequence.
        shift: [f32; 2],
        /// Rays.
        ray_count: u32,
        /// Of no meaning.
        spare: u32,
    }

    /// A triangle as an end of rays.
    EndSide {
        /// Unit, of its front.
        normal: [f32; 3],
        /// Of the limits `SIDE_`.
        flags: u32,
        /// Of a ray, for the patch along each axis.
        parts: [u32; 3],
        /// Of no meaning.
        spare: u32,
    }

    /// A slot of the table of voxels with patches, places left out, or buried sides; an empty one ends a search.
    EndVoxel {
        /// Which.
        voxel: [i32; 3],
        /// 0 in an empty slot.
        is_taken: u32,
        /// Patches that face along each axis, or [`NO_KEY`](crate::limits::NO_KEY).
        along: [u32; 3],
        /// 1 where rays that meet sides with [`SIDE_FOR_HOST_IN_PLACES`](crate::limits::SIDE_FOR_HOST_IN_PLACES) are the host's.
        asks_host: u32,
        /// Patches that face the other way.
        against: [u32; 3],
        /// Of sides that are buried in places, by the direction that they face most: a bit for those that are here, and
        /// [`BURIED_OPEN`](crate::limits::BURIED_OPEN) bits up one for those that are not.
        buried: u32,
    }

    /// Rays side by side whose ends are added up.
    EndRun {
        /// Among those that were traced.
        first_ray: u32,
        /// At most [`RUN_RAYS`](crate::limits::RUN_RAYS).
        ray_count: u32,
        /// Number of the direction whose way rays have to go, or of the limits `SUM_`.
        sum: u32,
    }

    /// What one patch, lobe or the like takes of a run.
    EndPart {
        /// A patch, or of the limits `KEY_`.
        key: u32,
        /// Parts of a ray.
        parts: u32,
    }

    /// The parts of a run, in any order.
    EndSpan {
        /// Among those of all runs.
        first_part: u32,
        /// At most three a ray.
        part_count: u32,
    }

    /// A point of a patch that is lit.
    LightPoint {
        /// m.
        position: [f32; 3],
        /// How far off its surface its shadow rays begin.
        epsilon_m: f32,
        /// Unit.
        normal: [f32; 3],
        /// Among those that are lit together.
        of_patch: u32,
    }

    /// The points of a patch.
    PointSpan {
        /// Among all points.
        first_point: u32,
        /// Equal shares of the patch.
        point_count: u32,
    }

    /// A delta light.
    Lamp {
        /// m; not of the sun.
        position: [f32; 3],
        /// Sun, bare lamp, lamp with a cone: 0, 1, 2.
        kind: u32,
        /// Where its light goes, unit.
        direction: [f32; 3],
        /// 0 for no limit.
        range_m: f32,
        /// cd; of the sun what a surface receives that faces a place of its disc, lx.
        intensity: [f32; 3],
        /// Of the cap of directions that is the sun's disc, on the unit sphere.
        cap_height: f32,
        /// Of the cone's inner half angle.
        inner_cosine: f32,
        /// Of its outer half angle.
        outer_cosine: f32,
        /// Of no meaning.
        spare: [u32; 2],
    }

    /// The row of a receiver.
    ReceiverSpan {
        /// Of the lobes +X, -X, +Y.
        first_sky: [f32; 3],
        /// Word where its columns begin.
        first: u32,
        /// Of the lobes -Y, +Z, -Z.
        last_sky: [f32; 3],
        /// How many, at most [`ROW_COLUMNS_MAX`](crate::limits::ROW_COLUMNS_MAX); times 2^24, of narrow columns: shares are
        /// half floats over two to that.
        count: u32,
    }

    /// A receiver whose light is asked for.
    ReceiverAsked {
        /// Which.
        row: u32,
        /// Where the segments of its chunk begin.
        first_span: u32,
        /// Word where the targets of its chunk begin, or [`NO_TARGETS`](crate::limits::NO_TARGETS).
        first_target: u32,
    }

    /// Where the patches of a segment are in the list of sources.
    SegmentSpan {
        /// The first.
        first: u32,
        /// How many; a patch beyond has no source.
        count: u32,
    }

    /// What arrives at a receiver.
    ReceiverLight {
        /// From resident patches, lx.
        irradiance: [f32; 3],
        /// Of its row.
        resident_share: f32,
        /// From coarse parents, lx.
        far_irradiance: [f32; 3],
        /// Of the far share: what known parents stand for.
        fed_share: f32,
        /// From the sky, lx.
        sky_irradiance: [f32; 3],
        /// Of its row.
        far_share: f32,
    }

    /// What is told of a part of a row's sums. The first of a list says how many follow, in place of a row's part.
    SumsEntry {
        /// Row among all on the device, times [`SUM_PARTS`](crate::limits::SUM_PARTS), and part.
        at: u32,
        /// lx.
        red: f32,
        /// lx.
        green: f32,
        /// lx.
        blue: f32,
        /// That goes with it.
        share: f32,
    }

    /// What is told of a patch's direct light.
    LitPatch {
        /// Over its points, lx.
        mean: [f32; 3],
        /// Points of which light is told too: all, or none where it is the same on all.
        told_points: u32,
    }
}
