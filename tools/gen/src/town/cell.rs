//! One cell of a town: a block, its pavement and half of the streets around it, 40 m by 40 m.
//!
//! A cell knows the options, its own coordinates and nothing of its neighbours. Its structure is always made; what
//! adorns it is offered in order of importance and taken while the cell's share of the triangles lasts.

use super::prop::{Detail, Prop, PropLibrary};
use super::{house, square, street};
use crate::GenOptions;
use crate::draw::{Draw, Use};
use crate::mesh::{Mesh, Placement};
use earthshine_world::{Light, Vec3};
use std::collections::BTreeMap;

/// The block inside its pavement: `[BLOCK_LOW_M, BLOCK_HIGH_M]` on both axes of the cell, m.
pub(crate) const BLOCK_LOW_M: f32 = 7.0;
pub(crate) const BLOCK_HIGH_M: f32 = 33.0;

/// A cell, ready to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct CellMesh {
    /// Coordinates, in cells.
    pub cell: (i32, i32),
    /// Its lower corner in the world, m; everything below is relative to it.
    pub origin: Vec3,
    /// Streets and houses, and in flattened towns the props too.
    pub mesh: Mesh,
    /// Where props stand; empty in flattened towns.
    pub props: BTreeMap<Prop, Vec<Placement>>,
    /// Street lamps that cast light of their own, by name.
    pub lamps: Vec<(String, Light)>,
    /// As rendered: props counted each time.
    pub triangles: u64,
}

/// What comes first when triangles are short.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Rank {
    Tree,
    Fitting,
    Furniture,
    Street,
    Roof,
    Paving,
    Road,
}

/// A cell in the making.
pub(crate) struct CellBuilder<'a> {
    pub(crate) draw: Draw,
    pub(crate) mesh: Mesh,
    pub(crate) lamps: Vec<(String, Light)>,
    /// Whether its lamps are lights, too: see [`has_lamp_lights`].
    pub(crate) lamps_light: bool,
    /// Triangles up to which it may be adorned.
    budget: u64,
    cell: (i32, i32),
    library: &'a PropLibrary,
    placed: Vec<(Prop, Placement)>,
    offered: Vec<(Rank, Prop, Placement)>,
}

impl CellBuilder<'_> {
    /// Stands a prop that belongs to the structure.
    pub(crate) fn place(&mut self, prop: Prop, placement: Placement) {
        self.placed.push((prop, placement));
    }

    /// Stands a prop if there are triangles left for it.
    pub(crate) fn offer(&mut self, rank: Rank, prop: Prop, placement: Placement) {
        self.offered.push((rank, prop, placement));
    }

    /// Adds a light named after the cell.
    pub(crate) fn lamp(&mut self, side: u32, light: Light) {
        let (x, z) = self.cell;
        self.lamps.push((format!("street lamp {x},{z} {side}"), light));
    }

    fn finish(mut self, options: &GenOptions) -> CellMesh {
        let cost = |prop: Prop| self.library.mesh(prop).triangles();
        let mut triangles = self.mesh.triangles() + self.placed.iter().map(|p| cost(p.0)).sum::<u64>();
        self.offered.sort_by_key(|&(rank, ..)| rank);
        for (_, prop, placement) in self.offered {
            if triangles + cost(prop) <= self.budget {
                triangles += cost(prop);
                self.placed.push((prop, placement));
            }
        }
        let mut props: BTreeMap<Prop, Vec<Placement>> = BTreeMap::new();
        for (prop, placement) in self.placed {
            props.entry(prop).or_default().push(placement);
        }
        if options.flatten {
            for (prop, placements) in std::mem::take(&mut props) {
                for placement in placements {
                    self.mesh.append(self.library.mesh(prop), &placement);
                }
            }
        }
        let (x, z) = self.cell;
        let origin = Vec3::new(x as f32, 0.0, z as f32) * GenOptions::TOWN_CELL_M;
        CellMesh { cell: self.cell, origin, mesh: self.mesh, props, lamps: self.lamps, triangles }
    }
}

/// Makes one cell of the town that `options` describe, without the rest of it.
#[must_use]
pub fn generate_town_cell(options: &GenOptions, cell: (i32, i32)) -> CellMesh {
    make_cell(options, cell, &library(options))
}

/// The props of the town that `options` describe.
pub(crate) fn library(options: &GenOptions) -> PropLibrary {
    PropLibrary::new(options.seed, &Detail::for_cell(options.town_cell_triangles()))
}

pub(crate) fn make_cell(options: &GenOptions, cell: (i32, i32), library: &PropLibrary) -> CellMesh {
    let draw = Draw::of_cell(options.seed, cell);
    let sparse = Sparse::of(options);
    let block = Block::of(draw, cell, sparse);
    let budget = match (sparse, block) {
        (Some(sparse), Block::Park) => sparse.park_triangles,
        _ => options.town_cell_triangles(),
    };
    let mut builder = CellBuilder {
        draw,
        mesh: Mesh::default(),
        lamps: Vec::new(),
        lamps_light: has_lamp_lights(options, cell),
        budget,
        cell,
        library,
        placed: Vec::new(),
        offered: Vec::new(),
    };
    street::lay(&mut builder, block, neighbours(options, cell));
    match block {
        Block::Houses => house::build_all(&mut builder),
        Block::Market => square::market(&mut builder),
        Block::Park => square::park(&mut builder),
    }
    builder.finish(options)
}

/// What a block is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Block {
    Houses,
    Market,
    Park,
}

impl Block {
    /// One cell in every sixteen is a market for sure, so that every town of 160 m has one.
    fn of(draw: Draw, (x, z): (i32, i32), sparse: Option<Sparse>) -> Self {
        if let Some(Sparse { houses, .. }) = sparse
            && !draw.chance(Use::BlockKind, 2, houses)
        {
            return Self::Park;
        }
        if (x.rem_euclid(4), z.rem_euclid(4)) == (3, 3) {
            Self::Market
        } else if (x, z) == (0, 0) || !draw.chance(Use::BlockKind, 0, 0.15) {
            Self::Houses
        } else {
            draw.pick(Use::BlockKind, 1, &[Self::Market, Self::Park])
        }
    }
}

/// A town with fewer triangles than blocks of houses take: the others are parks.
#[derive(Debug, Clone, Copy)]
struct Sparse {
    /// Share of blocks that are not parks for want of triangles.
    houses: f32,
    park_triangles: u64,
}

/// What streets and four bare houses take, on the average.
const BUILT_TRIANGLES: u64 = 2_740;

impl Sparse {
    /// `None` where there are triangles for houses everywhere.
    fn of(options: &GenOptions) -> Option<Self> {
        let share = options.town_cell_triangles();
        (share < BUILT_TRIANGLES).then(|| {
            // Half of what there is adorns parks, where it does; the rest is for houses.
            let park_triangles = share / 2;
            let houses = (share - park_triangles) as f32 / (BUILT_TRIANGLES - park_triangles) as f32;
            Self { houses, park_triangles }
        })
    }
}

/// Whether the town goes on at -X, -Z, +X, +Z of `cell`.
fn neighbours(options: &GenOptions, (x, z): (i32, i32)) -> [bool; 4] {
    let range = options.town_cell_range();
    [range.contains(&(x - 1)), range.contains(&(z - 1)), range.contains(&(x + 1)), range.contains(&(z + 1))]
}

/// Cells along the edge of the middle of a town, where two lamps a cell are lights: at most 50 in all.
const LIT_CELLS_ON_EDGE: i32 = 5;

fn has_lamp_lights(options: &GenOptions, (x, z): (i32, i32)) -> bool {
    let edge = options.town_cells_on_edge();
    let lit = edge.min(LIT_CELLS_ON_EDGE);
    let middle = options.town_cell_range().start + (edge - lit) / 2;
    let range = middle..middle + lit;
    range.contains(&x) && range.contains(&z)
}
