//! What the bytes of a bake depend on, as flags; shared by `bake` and `bench`.

use crate::method::MethodArguments;
use crate::scene_source::SceneSource;
use clap::{Args, ValueEnum};
use earthshine_gen::WorldKind;
use earthshine_tiles::BakeParameters;
use earthshine_world::{AxisWeights, Grid};

/// What the bytes of a bake depend on.
#[derive(Args, Clone)]
pub(crate) struct QualityArguments {
    /// Edge of a voxel, m. Smaller: more detail, about four times the patches a halving. Default: the power of two
    /// that gives a file about 20,000 patches or fewer, from 1/64 to 4; generated scenes have their own.
    #[arg(long)]
    voxel: Option<f32>,
    /// Voxels along a chunk's edge, 1 to 22.
    #[arg(long, default_value_t = 16)]
    chunk_voxels: u32,
    /// Rays a patch. The error of a row falls with its square root; time grows in step.
    #[arg(long, default_value_t = 1024)]
    rays: u32,
    /// Sample points a patch keeps for direct light.
    #[arg(long, default_value_t = 16)]
    points_per_patch: u32,
    /// Points that cover a voxel face of surface.
    #[arg(long, default_value_t = 16)]
    samples_per_face: u32,
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
    /// Rays that the six receivers of a voxel share.
    #[arg(long, default_value_t = 512)]
    receiver_rays: u32,
    /// Most columns of a receiver's row.
    #[arg(long, default_value_t = 24)]
    receiver_columns: u32,
    /// Detail voxels along a voxel's edge in which light on surfaces is served: 1 for that of patches alone, 2, 4 or 8. Patches, and
    /// what they exchange, stay those of voxels.
    #[arg(long, default_value_t = 1, value_parser = detail)]
    detail: u32,
    /// Rays of a detail voxel.
    #[arg(long, default_value_t = 512)]
    detail_rays: u32,
    /// Most columns of a detail voxel's row.
    #[arg(long, default_value_t = 192)]
    detail_columns: u32,
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

impl QualityArguments {
    /// The parameters for `source`, with its defaults where nothing was asked for.
    pub(crate) fn parameters(&self, source: &SceneSource) -> BakeParameters {
        let voxel_edge_m = self.voxel.unwrap_or_else(|| default_voxel_edge_m(source));
        let default_sides = if source.kind == Some(WorldKind::Cornell) { Sides::One } else { Sides::Two };
        BakeParameters {
            seed: self.seed,
            grid: Grid { voxel_edge_m, chunk_edge_voxels: self.chunk_voxels },
            rays_per_patch: self.rays,
            points_per_patch: self.points_per_patch,
            samples_per_voxel_face: self.samples_per_face,
            buried_rays: self.buried_rays,
            weights: match self.weights {
                Weights::Squared => AxisWeights::Squared,
                Weights::Absolute => AxisWeights::Absolute,
            },
            two_sided: self.sides.unwrap_or(default_sides) == Sides::Two,
            metals_black: self.metals_black(),
            receiver_reach_voxels: self.receivers,
            receiver_rays: self.receiver_rays,
            receiver_columns: self.receiver_columns,
            detail: self.detail,
            detail_rays: self.detail_rays,
            detail_columns: self.detail_columns,
            method: self.method.method(),
        }
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
        Self { rays, ..self }
    }

    /// The same with another number of points a voxel face.
    pub(crate) fn with_samples_per_face(self, samples_per_face: u32) -> Self {
        Self { samples_per_face, ..self }
    }

    pub(crate) fn metals_black(&self) -> bool {
        self.metals == Metals::Black
    }
}

fn detail(text: &str) -> Result<u32, String> {
    match text {
        "1" => Ok(1),
        "2" => Ok(2),
        "4" => Ok(4),
        "8" => Ok(8),
        _ => Err("detail voxels along a voxel's edge are 1, 2, 4 or 8".to_owned()),
    }
}

/// Patches that the default voxel edge aims at, at most.
const PATCHES_AIM: f64 = 20_000.0;

fn default_voxel_edge_m(source: &SceneSource) -> f32 {
    match source.kind {
        Some(WorldKind::Cornell) => return 0.14,
        Some(WorldKind::Furnace) => return 0.25,
        Some(WorldKind::TwoRooms) => return 0.5,
        Some(WorldKind::Corridor) => return 1.0,
        Some(WorldKind::Town) => return 2.0,
        None => {}
    }
    // Both sides of every triangle.
    let edge = (2.0 * source.scene.surface_area() / PATCHES_AIM).sqrt();
    edge.log2().ceil().clamp(-6.0, 2.0).exp2() as f32
}
