//! What the bytes of a bake depend on, as flags; shared by `bake` and `bench`.

use crate::defaults::{Chosen, Wish, receiver_rays};
use crate::method::MethodArguments;
use crate::scene_source::SceneSource;
use clap::{Args, ValueEnum};
use earthshine_bake::BakeError;
use earthshine_bake::MemoryLimit;
use earthshine_gen::WorldKind;
use earthshine_tiles::BakeParameters;
use earthshine_world::AxisWeights;
use std::str::FromStr;

/// What the bytes of a bake depend on.
#[derive(Args, Clone)]
pub(crate) struct QualityArguments {
    /// Edge of a voxel, m. Smaller: more detail, about four times the patches a halving. Default: what makes about 13,000
    /// patches of a file, to three digits, from 0.016 to 4; where 4 m makes more, what makes 75,000 of a city with --detail auto and nothing that emits, or 400,000 at most of a landscape; generated scenes have their own, worlds that are there keep theirs.
    #[arg(long)]
    voxel: Option<f32>,
    /// Voxels along a chunk's edge, 1 to 22.
    #[arg(long, default_value_t = 16)]
    chunk_voxels: u32,
    /// Rays a patch. The error of a row falls with its square root; time grows in step. Default: 1024; 512 where --detail auto
    /// gives a city detail; worlds that are there keep theirs.
    #[arg(long)]
    rays: Option<u32>,
    /// Sample points a patch keeps for direct light. Default: 64 where there is detail, else 16, and in cities.
    #[arg(long)]
    points_per_patch: Option<u32>,
    /// Points that cover a voxel face of surface. Default: 64 where there is detail, else 16.
    #[arg(long)]
    samples_per_face: Option<u32>,
    /// How normals spread over directions; `absolute` is the sources' way and makes energy.
    #[arg(long, default_value = "squared")]
    weights: Weights,
    /// Whether back faces of single-sided materials reflect. Default: two; one for the generated Cornell box, whose
    /// outside nobody sees.
    #[arg(long)]
    sides: Option<Sides>,
    /// Rays that find buried points; 0 keeps them all.
    #[arg(long, default_value_t = 32)]
    buried_rays: u32,
    /// Voxels from a surface within which empty air gets receivers, light for moving objects; 0 for none.
    #[arg(long, default_value_t = 4)]
    receivers: u32,
    /// Rays that the six receivers of a voxel share. Default: 2048 where something emits, which few rays find; else 512.
    #[arg(long)]
    receiver_rays: Option<u32>,
    /// Most columns of a receiver's row.
    #[arg(long, default_value_t = 24)]
    receiver_columns: u32,
    /// Detail voxels along a voxel's edge in which light on surfaces is served: 1 for that of patches alone, 2, 4 or 8. Patches, and
    /// what they exchange, stay those of voxels. `auto`: the most that a world of so many patches can afford, none for
    /// kilometres; the summary says which.
    #[arg(long, default_value = "auto")]
    detail: Detail,
    /// Rays of a part of a patch in a detail voxel. Default: chosen with --detail auto, 512 to 2048, 64 to 96 in cities; else 512.
    #[arg(long)]
    detail_rays: Option<u32>,
    /// Most columns of such a part's row. Default: 192, fewer with --detail auto where a server would not hold them.
    #[arg(long)]
    detail_columns: Option<u32>,
    /// Every random number hangs on it.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Whether metals reflect their base colour diffusely or nothing.
    #[arg(long, default_value = "diffuse")]
    metals: Metals,
    #[command(flatten)]
    method: MethodArguments,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Weights {
    Squared,
    Absolute,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Sides {
    One,
    Two,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Metals {
    Diffuse,
    Black,
}

/// How many detail voxels, or who says so.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Detail {
    Auto,
    Exactly(u32),
}

impl FromStr for Detail {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "1" => Ok(Self::Exactly(1)),
            "2" => Ok(Self::Exactly(2)),
            "4" => Ok(Self::Exactly(4)),
            "8" => Ok(Self::Exactly(8)),
            _ => Err("detail voxels along a voxel's edge are 1, 2, 4, 8 or auto".to_owned()),
        }
    }
}

impl QualityArguments {
    /// The parameters for `source`, chosen for its size where nothing was asked for.
    pub(crate) fn parameters(&self, source: &SceneSource) -> BakeParameters {
        self.chosen(source).parameters
    }

    /// The parameters for who looks at patches alone: no detail, and no points for it, where nothing was asked for.
    pub(crate) fn parameters_of_patches(&self, source: &SceneSource) -> BakeParameters {
        let detail = if self.detail == Detail::Auto { Detail::Exactly(1) } else { self.detail };
        Self { detail, ..self.clone() }.parameters(source)
    }

    /// [`Self::parameters`] that can be baked: for who has minutes of other work to do first.
    ///
    /// # Errors
    /// The first that cannot be.
    pub(crate) fn checked(&self, source: &SceneSource) -> Result<BakeParameters, BakeError> {
        let parameters = self.parameters(source);
        earthshine_bake::check_parameters(&parameters).map(|()| parameters)
    }

    /// [`Self::parameters_of_patches`] that can be baked.
    ///
    /// # Errors
    /// The first that cannot be.
    pub(crate) fn checked_of_patches(&self, source: &SceneSource) -> Result<BakeParameters, BakeError> {
        let parameters = self.parameters_of_patches(source);
        earthshine_bake::check_parameters(&parameters).map(|()| parameters)
    }

    /// The parameters for `source`, and which of them were chosen.
    pub(crate) fn chosen(&self, source: &SceneSource) -> Chosen {
        self.chosen_within(source, MemoryLimit::default())
    }

    /// The same by counting that takes no more than `memory`.
    pub(crate) fn chosen_within(&self, source: &SceneSource, memory: MemoryLimit) -> Chosen {
        let detail = match self.detail {
            Detail::Auto => None,
            Detail::Exactly(detail) => Some(detail),
        };
        let Self {
            voxel: voxel_edge_m,
            rays,
            detail_rays,
            detail_columns,
            points_per_patch,
            samples_per_face,
            ..
        } = *self;
        let wish = Wish {
            voxel_edge_m,
            rays,
            detail,
            detail_rays,
            detail_columns,
            points_per_patch,
            samples_per_face,
            memory,
        };
        wish.granted(source, self.base(source))
    }

    /// The same, with what the world was baked with where nothing is said: after an edit it stays the same world.
    pub(crate) fn as_before(&self, before: &BakeParameters) -> Self {
        let detail = if self.detail == Detail::Auto { Detail::Exactly(before.detail) } else { self.detail };
        Self {
            voxel: self.voxel.or(Some(before.grid.voxel_edge_m)),
            rays: self.rays.or(Some(before.rays_per_patch)),
            detail,
            detail_rays: self.detail_rays.or(Some(before.detail_rays)),
            detail_columns: self.detail_columns.or(Some(before.detail_columns)),
            points_per_patch: self.points_per_patch.or(Some(before.points_per_patch)),
            samples_per_face: self.samples_per_face.or(Some(before.samples_per_voxel_face)),
            receiver_rays: self.receiver_rays.or(Some(before.receiver_rays)),
            ..self.clone()
        }
    }

    /// All that does not hang on the world's size.
    fn base(&self, source: &SceneSource) -> BakeParameters {
        let default_sides = if source.kind == Some(WorldKind::Cornell) { Sides::One } else { Sides::Two };
        let mut parameters = BakeParameters {
            seed: self.seed,
            buried_rays: self.buried_rays,
            weights: match self.weights {
                Weights::Squared => AxisWeights::Squared,
                Weights::Absolute => AxisWeights::Absolute,
            },
            two_sided: self.sides.unwrap_or(default_sides) == Sides::Two,
            metals_black: self.metals_black(),
            receiver_reach_voxels: self.receivers,
            receiver_rays: self.receiver_rays.unwrap_or(receiver_rays(source.scene.emits())),
            receiver_columns: self.receiver_columns,
            method: self.method.method(),
            ..BakeParameters::default()
        };
        parameters.grid.chunk_edge_voxels = self.chunk_voxels;
        parameters
    }

    /// The same with another voxel edge, m.
    pub(crate) fn with_voxel(self, voxel_edge_m: f32) -> Self {
        Self { voxel: Some(voxel_edge_m), ..self }
    }

    /// The same with another seed.
    pub(crate) fn with_seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// The same with another number of rays a patch.
    pub(crate) fn with_rays(self, rays: u32) -> Self {
        Self { rays: Some(rays), ..self }
    }

    /// The same with another number of points a voxel face.
    pub(crate) fn with_samples_per_face(self, samples_per_face: u32) -> Self {
        Self { samples_per_face: Some(samples_per_face), ..self }
    }

    pub(crate) fn metals_black(&self) -> bool {
        self.metals == Metals::Black
    }
}
