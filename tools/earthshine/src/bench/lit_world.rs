//! A level of a real world with its light, as benches of sampling and of solvers need it: rows in Morton order.

use crate::bench::scratch;
use crate::quality::QualityArguments;
use crate::scene_source;
use crate::whole_world::{WholeLight, WholeWorld};
use anyhow::Context as _;
use clap::Args;
use earthshine_bake::Levels;
use earthshine_radiosity::gather::SparseRows;
use earthshine_radiosity::tables::order::morton;
use earthshine_world::{LightRig, Rgb, Vec3};
use std::path::PathBuf;

/// Which world.
#[derive(Args)]
pub(super) struct WorldArguments {
    /// A generated world or a .glb file, baked into a scratch folder.
    #[arg(long, default_value = "cornell")]
    pub(super) scene: String,
    /// A world that is baked already, instead of a scene.
    #[arg(long, conflicts_with_all = ["scene", "lights", "voxel", "rays", "samples_per_face", "chunk_voxels"])]
    pub(super) world: Option<PathBuf>,
    /// Lights JSON; a baked world has its own.
    #[arg(long)]
    pub(super) lights: Option<PathBuf>,
    #[command(flatten)]
    pub(super) quality: QualityArguments,
}

/// Level 0, lit and solved. Everything is by patch.
pub(super) struct LitWorld {
    pub(super) name: String,
    pub(super) rig: LightRig,
    pub(super) world: WholeWorld,
    /// Columns of each row along the Z-curve of their patches, then by direction.
    pub(super) rows: SparseRows,
    pub(super) areas: Vec<f32>,
    pub(super) reflectance: Vec<Rgb>,
    pub(super) centroids: Vec<Vec3>,
    /// Share of each row that leaves the world.
    pub(super) sky_shares: Vec<f32>,
    pub(super) light: WholeLight,
}

impl WorldArguments {
    /// Bakes it, if it is not, and solves its light.
    pub(super) fn load(&self, quiet: bool) -> anyhow::Result<LitWorld> {
        if let Some(folder) = &self.world {
            let world = WholeWorld::load(folder)?;
            let name =
                folder.file_name().map_or_else(|| "world".into(), |name| name.to_string_lossy().into());
            let rig = world.manifest.lights.clone();
            return LitWorld::new(name, &rig, world);
        }
        let source = scene_source::load(&self.scene, self.lights.as_deref(), self.quality.metals_black())?;
        let folder = tempfile::tempdir().context("a scratch folder for the world")?;
        let parameters = self.quality.parameters_of_patches(&source);
        scratch::bake(&source, parameters, Levels::Exactly(1), folder.path(), quiet)?;
        LitWorld::new(source.name.clone(), &source.lights, WholeWorld::load(folder.path())?)
    }
}

impl LitWorld {
    fn new(name: String, rig: &LightRig, world: WholeWorld) -> anyhow::Result<Self> {
        let light = world.solve(rig);
        let keys: Vec<(u64, usize)> =
            world.patches().map(|patch| (morton(patch.voxel.to_array()), patch.direction.index())).collect();
        let sky = world.chunks().iter().flat_map(|chunk| &chunk.rows.sky_shares);
        Ok(Self {
            rows: ordered(&world.rows, &keys)?,
            areas: world.patches().map(|patch| patch.area).collect(),
            reflectance: world.patches().map(|patch| patch.reflectance).collect(),
            centroids: world.patches().map(|patch| patch.centroid).collect(),
            sky_shares: sky.map(|lobes| lobes.iter().sum()).collect(),
            light,
            name,
            rig: rig.clone(),
            world,
        })
    }

    /// What leaves each patch, lm/m2.
    pub(super) fn exitance(&self) -> Vec<Rgb> {
        self.world.exitance(&self.light)
    }

    /// Every patch, the nearest to the middle of the world first.
    pub(super) fn nearest_first(&self) -> Vec<u32> {
        let middle = self.world.manifest.bounds.centre();
        let mut order: Vec<u32> = (0..self.areas.len() as u32).collect();
        let distance = |patch: u32| self.centroids[patch as usize].distance_squared(middle);
        order.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
        order
    }
}

/// `rows` with the columns of each sorted by `keys` of their patches.
fn ordered(rows: &SparseRows, keys: &[(u64, usize)]) -> anyhow::Result<SparseRows> {
    let mut starts = vec![0];
    let (mut columns, mut shares) =
        (Vec::with_capacity(rows.nonzero_count()), Vec::with_capacity(rows.nonzero_count()));
    for row in 0..rows.row_count() {
        let (of_row, shares_of_row) = rows.row(row);
        let mut entries: Vec<(u32, f32)> =
            of_row.iter().copied().zip(shares_of_row.iter().copied()).collect();
        entries.sort_by_key(|&(column, _)| keys[column as usize]);
        for (column, share) in entries {
            columns.push(column);
            shares.push(share);
        }
        starts.push(columns.len());
    }
    Ok(SparseRows::new(starts, columns, shares)?)
}
