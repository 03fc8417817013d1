//! Where light is looked up to see whether it is there.

use earthshine_client::{Light, LookedUp};
use glam::Vec3;

/// A place on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Probe {
    /// m.
    pub position: Vec3,
    /// Of the surface.
    pub normal: Vec3,
}

/// Where a flight looks for light in every frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Probes {
    /// Straight down from the camera and from points around it, for whoever knows nothing of the world. A column
    /// is dark where nothing that faces up is lit. The frame is a miss where *all* columns are dark: at the rim of
    /// a world some always are.
    Ground {
        /// Columns besides the camera's own.
        count: u32,
        /// Of those around the camera, m.
        radius_m: f32,
        /// How far down, m.
        depth_m: f32,
    },
    /// Surface points of the world, of which the nearest ones are asked. The frame is a miss where *any* is dark.
    Surface {
        /// All of them.
        probes: Vec<Probe>,
        /// Those farther from the camera are not asked, m.
        radius_m: f32,
        /// Most probes a frame.
        count_max: usize,
    },
}

impl Default for Probes {
    /// Nine columns within 2 m, 20 m deep.
    fn default() -> Self {
        Self::Ground { count: 8, radius_m: 2.0, depth_m: 20.0 }
    }
}

/// What one frame's probes found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Found {
    pub(crate) asked: u64,
    pub(crate) dark: u64,
    pub(crate) is_miss: bool,
    /// Sums over the probes with light: see [`LookedUp`].
    pub(crate) quality: f64,
    pub(crate) far_share: f64,
    pub(crate) stale_share: f64,
}

impl Found {
    /// What one probe read.
    fn note(&mut self, read: Option<LookedUp>) {
        let Some(LookedUp { quality, far_share, stale_share, .. }) = read else {
            self.dark += 1;
            return;
        };
        self.quality += f64::from(quality);
        self.far_share += f64::from(far_share);
        self.stale_share += f64::from(stale_share);
    }
}

impl Probes {
    /// Steps down a column, in voxels: as far as the lookup rule reaches.
    const COLUMN_STEP_VOXELS: f32 = 1.0;
    /// Most steps down a column.
    const COLUMN_STEPS_MAX: usize = 256;

    pub(crate) fn ask(&self, light: &Light, position: Vec3, voxel_edge_m: f32) -> Found {
        match self {
            Self::Ground { count, radius_m, depth_m } => {
                let around = (0..*count).map(|index| {
                    let angle = std::f32::consts::TAU * index as f32 / *count as f32;
                    position + Vec3::new(angle.cos(), 0.0, angle.sin()) * *radius_m
                });
                let columns = std::iter::once(position).chain(around);
                let mut found = Found { asked: u64::from(*count) + 1, ..Found::default() };
                for top in columns {
                    found.note(below(light, top, *depth_m, voxel_edge_m));
                }
                Found { is_miss: found.dark == found.asked, ..found }
            }
            Self::Surface { probes, radius_m, count_max } => {
                let mut near: Vec<(f32, &Probe)> = probes
                    .iter()
                    .map(|probe| (probe.position.distance_squared(position), probe))
                    .filter(|(distance, _)| *distance <= radius_m * radius_m)
                    .collect();
                near.sort_by(|(a, _), (b, _)| a.total_cmp(b));
                near.truncate(*count_max);
                let mut found = Found { asked: near.len() as u64, ..Found::default() };
                for (_, probe) in near {
                    found.note(light.lookup(probe.position, probe.normal));
                }
                Found { is_miss: found.dark > 0, ..found }
            }
        }
    }
}

/// The first light that faces up below `top`.
fn below(light: &Light, top: Vec3, depth_m: f32, voxel_edge_m: f32) -> Option<LookedUp> {
    let step_m = voxel_edge_m * Probes::COLUMN_STEP_VOXELS;
    let steps = (depth_m / step_m).clamp(0.0, Probes::COLUMN_STEPS_MAX as f32) as usize;
    (0..=steps).find_map(|step| light.lookup(top - Vec3::Y * (step as f32 * step_m), Vec3::Y))
}
