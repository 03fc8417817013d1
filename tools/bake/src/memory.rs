//! How much memory a bake takes, said before it is taken.
//!
//! What stays in memory is the scene with its tree, a little for every patch of the world, and the cells. What the
//! chunks at work take comes on top, one a thread. The constants below were measured, not derived
//! (`bench bake` prints the peak beside the estimate).

use crate::BakeError;
use crate::cells::Cells;
use crate::inquiry::QUESTION_RAYS;
use earthshine_scene::Scene;
use earthshine_tiles::BakeParameters;

/// A triangle in one tree over all, in lists of chunks, and while the tree is built.
const TREE_BYTES: u64 = 200;
/// A triangle in lists of chunks alone.
const LISTED_BYTES: u64 = 8;
/// A triangle in the tree of its mesh, and its share of what building the largest of them takes.
const MESH_TREE_BYTES: u64 = 100;
/// A mesh in its place.
const PLACEMENT_BYTES: u64 = 400;
/// A patch, its voxel's place in the map, and what balancing keeps of it.
const PATCH_BYTES: u64 = 176;
/// A sample at work: itself, its share in up to three patches, and their sorting.
const SAMPLE_BYTES: u64 = 200;
/// Entries that a ray of an emitter makes: up to three, one a direction that the surface leans to, but none where it ends in
/// the sky or beside another. In a town, 0.6 at most.
const ENTRIES_A_RAY: u64 = 1;
/// An entry in the map of an emitter at work: a key of 20 bytes and a share of 4, in nodes that are half empty at worst.
const SHARE_BYTES: u64 = 48;
/// An entry of a chunk whose emitters are at work: 16 bytes in a list, and 16 in the payload that lists are written to.
const EMITTED_BYTES: u64 = 32;
/// A ray of a question on its way: itself, and what it meets first.
const QUERY_BYTES: u64 = 40;
/// The program, and what its allocator holds back.
const BASE_BYTES: u64 = 64 << 20;

/// One part of so many of a limit is spared for what is not known when trees are chosen.
const SPARE: u64 = 4;

/// What a bake may take; `None` for whatever there is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MemoryLimit(pub Option<u64>);

impl std::str::FromStr for MemoryLimit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || format!("{text:?} is no size: write a number with MiB or GiB, as in 8GiB");
        let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let unit: u64 = match text[number.len()..].to_ascii_lowercase().as_str() {
            "k" | "kib" => 1 << 10,
            "m" | "mib" => 1 << 20,
            "g" | "gib" => 1 << 30,
            _ => return Err(refused()),
        };
        let bytes = number.parse::<f64>().map_err(|_not_a_number| refused())? * unit as f64;
        if bytes >= 1.0 && bytes.is_finite() { Ok(Self(Some(bytes as u64))) } else { Err(refused()) }
    }
}

/// Which trees rays go through; both find the same hits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trees {
    /// One over all triangles.
    One,
    /// One a mesh, however often it is placed.
    OfMeshes,
}

/// Bytes that a scene, its trees and its cells take.
#[must_use]
pub fn of_scene(scene: &Scene, cells: &Cells, trees: Trees) -> u64 {
    of_trees(scene, trees) + 2 * cells.bytes()
}

/// Bytes that a scene and its trees take.
pub(crate) fn of_trees(scene: &Scene, trees: Trees) -> u64 {
    let triangles = scene.triangles.len() as u64;
    let trees = match trees {
        Trees::One => triangles * TREE_BYTES,
        Trees::OfMeshes => {
            let different = triangles.saturating_sub(scene.repeated_triangles());
            let placements = scene.placements.len() as u64 * PLACEMENT_BYTES;
            triangles * LISTED_BYTES + different * MESH_TREE_BYTES + placements
        }
    };
    let corners = 64 + 24 * u64::from(scene.emissive_coordinates.is_some());
    let colours = 24 * u64::from(scene.corner_colours.is_some());
    let texels: u64 = scene.textures.iter().map(|texture| size_of_val(&texture.texels[..]) as u64).sum();
    BASE_BYTES + triangles * (corners + colours) + trees + texels
}

/// Bytes that all of `patches` and one chunk a thread take.
#[must_use]
pub fn of_patches(patches: u64, chunk_samples_max: u64) -> u64 {
    let threads = rayon::current_num_threads() as u64;
    patches * PATCH_BYTES + threads * chunk_samples_max * SAMPLE_BYTES
}

/// Bytes that it takes to find out what emitters see of detail voxels by `rays` each, if chunks have so many `emitters`: a map
/// a thread, and the entries of the chunks at work, one a thread, taken for those with most emitters.
pub(crate) fn of_emitters(
    scene: &Scene,
    parameters: &BakeParameters,
    rays: u32,
    mut emitters: Vec<u64>,
) -> u64 {
    let threads = rayon::current_num_threads();
    emitters.sort_unstable_by(|a, b| b.cmp(a));
    let (all, at_work): (u64, u64) = (emitters.iter().sum(), emitters.iter().take(threads).sum());
    // Rays that end in one place share an entry. Nobody sees all sides of all surfaces, which makes up for detail voxels that
    // surfaces only graze.
    let places = faces(scene, parameters) * f64::from(parameters.detail).powi(2);
    let sides = 2 * scene.triangles.len() as u64;
    let entries = ENTRIES_A_RAY * u64::from(rays).min(places as u64 + sides);
    let of_questions = u64::from(rays).min(QUESTION_RAYS as u64) * QUERY_BYTES;
    (threads as u64).min(all) * (entries * SHARE_BYTES + of_questions) + at_work * entries * EMITTED_BYTES
}

/// Most samples of a bake that keeps them all: about 20 GiB.
const SAMPLES_MAX_WHOLE: f64 = 1e8;
/// Most samples of any bake: days.
const SAMPLES_MAX: f64 = 2e10;

/// Faces of voxels that both sides of all surfaces would fill.
fn faces(scene: &Scene, parameters: &BakeParameters) -> f64 {
    2.0 * scene.surface_area() / f64::from(parameters.grid.voxel_edge_m).powi(2)
}

/// Refuses a voxel edge that no time, or no memory, would suffice for.
///
/// # Errors
/// [`BakeError::TooFine`], with an edge that would do.
pub fn check_fineness(scene: &Scene, parameters: &BakeParameters, streamed: bool) -> Result<(), BakeError> {
    let samples = faces(scene, parameters) * f64::from(parameters.samples_per_voxel_face);
    let max = if streamed { SAMPLES_MAX } else { SAMPLES_MAX_WHOLE };
    if samples <= max {
        return Ok(());
    }
    let voxel_edge_m = parameters.grid.voxel_edge_m;
    let suggested_m = (f64::from(voxel_edge_m) * (samples / max).sqrt() * 1.1) as f32;
    Err(BakeError::TooFine { voxel_edge_m, samples: samples as u64, suggested_m })
}

/// Bytes that the patches of `scene` will take, guessed from its area before any is made; where the method is not
/// `streamed`, all their samples as well.
#[must_use]
pub fn estimated_patches(scene: &Scene, parameters: &BakeParameters, streamed: bool) -> u64 {
    // Small triangles share voxels, large ones fill them: half of the faces is a low guess.
    let faces = faces(scene, parameters);
    let samples = faces * f64::from(parameters.samples_per_voxel_face);
    let whole = if streamed { 0.0 } else { samples * (SAMPLE_BYTES as f64) };
    (0.5 * faces * PATCH_BYTES as f64 + whole) as u64
}

impl MemoryLimit {
    /// One tree where it fits beside `others` bytes with room to spare, else one a mesh; and what [`of_scene`] says of it.
    /// Chunks at work come on top, and how large they are is known only after the first rays.
    #[must_use]
    pub fn trees(self, scene: &Scene, cells: &Cells, others: u64) -> (Trees, u64) {
        let one = of_scene(scene, cells, Trees::One);
        match self.0 {
            Some(limit) if one + others > limit - limit / SPARE => {
                (Trees::OfMeshes, of_scene(scene, cells, Trees::OfMeshes))
            }
            _ => (Trees::One, one),
        }
    }

    /// The trees that fit beside the scene alone, before it is known what else there will be; `None` where none do: such a
    /// scene is not baked either.
    pub(crate) fn trees_alone(self, scene: &Scene) -> Option<Trees> {
        let fits = |&trees: &Trees| self.0.is_none_or(|limit| of_trees(scene, trees) <= limit);
        [Trees::One, Trees::OfMeshes].into_iter().find(fits)
    }

    /// Refuses `needed` bytes for `what` above the limit.
    ///
    /// # Errors
    /// [`BakeError::Memory`], with a voxel edge that might do.
    pub fn check(self, needed: u64, what: &'static str, voxel_edge_m: f32) -> Result<(), BakeError> {
        match self.0 {
            Some(limit) if needed > limit => {
                let factor = (needed as f64 / limit as f64).sqrt() as f32;
                Err(BakeError::Memory {
                    what,
                    needed_mib: needed >> 20,
                    limit_mib: limit >> 20,
                    suggested_m: (voxel_edge_m * factor * 10.0).ceil() / 10.0,
                })
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_trees_that_fit_are_chosen() {
        let scene = crate::test_shapes::ball(1.0, 40, 40);
        let [one, of_meshes] = [Trees::One, Trees::OfMeshes].map(|trees| of_trees(&scene, trees));
        assert!(of_meshes < one);
        let chosen = |bytes| MemoryLimit(bytes).trees_alone(&scene);
        assert_eq!((chosen(None), chosen(Some(one))), (Some(Trees::One), Some(Trees::One)));
        assert_eq!((chosen(Some(of_meshes)), chosen(Some(of_meshes - 1))), (Some(Trees::OfMeshes), None));
    }

    #[test]
    fn emitters_count_by_what_their_rays_may_find() {
        let scene = crate::test_shapes::ball(10.0, 40, 40);
        let parameters = BakeParameters { detail: 4, ..BakeParameters::default() };
        let of = |rays, emitters: &[u64]| of_emitters(&scene, &parameters, rays, emitters.to_vec());
        assert_eq!(of(1 << 18, &[0, 0]), 0);
        let one = 1000 * (ENTRIES_A_RAY * (SHARE_BYTES + EMITTED_BYTES) + QUERY_BYTES);
        assert_eq!(of(1000, &[0, 1]), one);
        let threads = rayon::current_num_threads() as u64;
        let listed = 1000 * ENTRIES_A_RAY * EMITTED_BYTES;
        let fifty = threads.min(50) * (one - listed) + 50 * listed;
        assert_eq!(of(1000, &[50]), fifty);
        // About 40,000 places: more rays than that are rays that meet again.
        assert!(of(1 << 20, &[1]) < of(100_000, &[1]) + QUESTION_RAYS as u64 * QUERY_BYTES);
    }

    #[test]
    fn sizes_are_read_and_limits_kept() {
        assert_eq!("1.5GiB".parse(), Ok(MemoryLimit(Some(3 << 29))));
        assert_eq!("200m".parse(), Ok(MemoryLimit(Some(200 << 20))));
        for wrong in ["", "12", "0MiB", "-1GiB", "manyGiB", "1TB"] {
            assert!(wrong.parse::<MemoryLimit>().unwrap_err().contains("8GiB"), "{wrong}");
        }
        let limit = MemoryLimit(Some(100 << 20));
        assert!(limit.check(100 << 20, "patches", 1.0).is_ok());
        let refused = limit.check(400 << 20, "patches", 1.0).unwrap_err().to_string();
        assert!(refused.contains("400 MiB") && refused.contains("--voxel 2"), "{refused}");
    }
}
