//! A scene becomes a world in a scratch folder that goes when the test ends.

use earthshine_bake::{BakeOptions, BakeSummary, Levels, Silent, bake};
use earthshine_scene::{ImportOptions, Scene, light_rig, load_bytes};
use earthshine_tiles::BakeParameters;
use earthshine_world::{Grid, LightRig};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A world on disk.
#[derive(Debug)]
pub struct BakedWorld {
    path: PathBuf,
    /// What the bake said.
    pub summary: BakeSummary,
    options: BakeOptions,
    _folder: TempDir,
}

/// Few rays and few points: enough for light that is compared with itself.
#[must_use]
pub fn coarse(voxel_edge_m: f32, chunk_edge_voxels: u32) -> BakeParameters {
    BakeParameters {
        rays_per_patch: 64,
        points_per_patch: 4,
        samples_per_voxel_face: 4,
        buried_rays: 8,
        grid: Grid { voxel_edge_m, chunk_edge_voxels },
        ..BakeParameters::default()
    }
}

/// The lights that came with `scene`, and emission.
#[must_use]
pub fn own_lights(scene: &Scene) -> LightRig {
    light_rig(scene, None)
}

/// Imports a generated scene.
///
/// # Panics
/// If it cannot be imported.
#[must_use]
pub fn imported(glb: &[u8]) -> Scene {
    load_bytes(glb, "generated", &ImportOptions::default()).expect("generated scenes can be imported")
}

impl BakedWorld {
    /// Bakes level 0 of `scene` lit by `lights` into a folder called `name`.
    ///
    /// # Panics
    /// If there is no scratch folder, or the bake fails.
    #[must_use]
    pub fn new(name: &str, scene: &Scene, lights: LightRig, parameters: BakeParameters) -> Self {
        Self::with_levels(name, scene, lights, parameters, Levels::Exactly(1))
    }

    /// As [`Self::new`], with coarse levels.
    ///
    /// # Panics
    /// If there is no scratch folder, or the bake fails.
    #[must_use]
    pub fn with_levels(
        name: &str,
        scene: &Scene,
        lights: LightRig,
        parameters: BakeParameters,
        levels: Levels,
    ) -> Self {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join(name);
        let options = BakeOptions { levels, ..BakeOptions::new(name, parameters, lights) };
        let summary = baked(scene, &path, &options);
        Self { path, summary, options, _folder: folder }
    }

    /// Bakes another scene, or other parameters, into the same folder.
    ///
    /// # Panics
    /// If the bake fails.
    pub fn bake_again(&mut self, scene: &Scene, parameters: BakeParameters) {
        let overwrite = parameters != self.options.parameters;
        self.options = BakeOptions { parameters, overwrite, ..self.options.clone() };
        self.summary = baked(scene, &self.path, &self.options);
    }

    /// Its folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Patches of the whole world.
    ///
    /// # Panics
    /// If there are more than a matrix could ever hold.
    #[must_use]
    pub fn patch_count(&self) -> u32 {
        u32::try_from(self.summary.patches).expect("a small world")
    }
}

fn baked(scene: &Scene, path: &Path, options: &BakeOptions) -> BakeSummary {
    let name = &options.scene_name;
    bake(scene, path, options, &Silent).unwrap_or_else(|error| panic!("{name} does not bake: {error}"))
}
