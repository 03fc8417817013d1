//! What lies inside of something swallows light: hits there find no patch.
//!
//! The back of a wall, of moulding, of a block on the floor lies in voxels where lit surfaces face the same way. A ray that
//! comes to it went through a crack or began inside of something itself, and what stands in its voxel's patch is the light of
//! those others: counted there, it leaks through walls. So a *piece* (what one voxel cuts from one side of a triangle) whose
//! points are all buried ([`crate::exposure`]) absorbs.
//!
//! Whether a point is buried is told by a few paths that look for light: the sky, lamps, emitters. Small emitters they seldom
//! meet, and a room that is modelled with its walls facing out and lit by one would swallow its light. So in scenes
//! in which anything emits nothing is absorbed; nor is it where it is in doubt: in a voxel and direction in which more than
//! `DOUBT_SHARE` of what looked buried found light after all. And a piece of which one point found light
//! is no wall's inside: detail, which is read where it lies, takes its other points for hidden (`reached`). Nor do a few points
//! speak for a piece whose side is open in the voxel beside it: a pane that ends behind a lintel is cut by the grid below it.

use crate::exposure::Exposure;
use crate::sample::{SurfaceSample, side_weights};
use crate::voxel_map::VoxelMap;
use earthshine_world::{AxisWeights, Direction, Grid, VoxelCoord};

/// Of the area that looks buried in a voxel and direction, the share above which light that some of it finds is no crack's.
/// Paths within a wall find the crack that they began beside; in a room they find its windows and lamps.
const DOUBT_SHARE: f32 = 0.125;

/// Of a piece with fewer points the part that is open may have none.
const FEW_POINTS: u32 = 4;

/// A piece of one side of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct BuriedPiece {
    /// See [`crate::sample::side_of`].
    pub side: u32,
    /// As an array, so that it can be sorted.
    pub voxel: [i32; 3],
}

/// The pieces whose hits are absorbed.
#[derive(Debug, Default, Clone)]
pub struct BuriedPieces {
    /// Ascending.
    pieces: Vec<BuriedPiece>,
    /// A bit a side: whether it has any. Most hits ask no more.
    sides: Vec<u64>,
}

impl BuriedPieces {
    /// Any number of `pieces`, in any order.
    #[must_use]
    pub fn new(mut pieces: Vec<BuriedPiece>) -> Self {
        pieces.sort_unstable();
        pieces.dedup();
        let words = pieces.last().map_or(0, |last| last.side as usize / 64 + 1);
        let mut sides = vec![0; words];
        pieces.iter().for_each(|piece| sides[piece.side as usize / 64] |= 1 << (piece.side % 64));
        Self { pieces, sides }
    }

    /// All of them, ascending.
    #[must_use]
    pub fn pieces(&self) -> &[BuriedPiece] {
        &self.pieces
    }

    /// Whether the piece that `voxel` cuts from side `side` is one.
    #[must_use]
    pub fn contains(&self, side: u32, voxel: VoxelCoord) -> bool {
        self.has_side(side)
            && self.pieces.binary_search(&BuriedPiece { side, voxel: voxel.to_array() }).is_ok()
    }

    /// Whether any is of side `side`.
    #[must_use]
    pub fn has_side(&self, side: u32) -> bool {
        self.sides.get(side as usize / 64).is_some_and(|word| word >> (side % 64) & 1 == 1)
    }

    /// Bytes that they take.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.pieces[..]) + size_of_val(&self.sides[..])) as u64
    }
}

/// Area of points that look buried, m2.
#[derive(Debug, Clone, Copy, Default)]
struct Suspects {
    all: f32,
    /// Of those that found light.
    lit: f32,
}

impl Suspects {
    fn are_in_doubt(self) -> bool {
        self.lit > DOUBT_SHARE * self.all
    }
}

/// What the points of a piece come to.
#[derive(Debug, Clone, Copy)]
struct Points {
    are_buried: bool,
    count: u32,
}

/// The pieces of `samples` whose hits are absorbed, ascending. What lies in other chunks is not asked: chunks are baked one
/// by one.
#[must_use]
pub fn buried_pieces(samples: &[SurfaceSample], weights: AxisWeights, grid: Grid) -> Vec<BuriedPiece> {
    let mut suspects: VoxelMap<VoxelCoord, [Suspects; 6]> = VoxelMap::default();
    for sample in samples.iter().filter(|sample| sample.is_suspect) {
        let suspects = suspects.entry(sample.voxel).or_default();
        for direction in facing(sample, weights) {
            let of = &mut suspects[direction.index()];
            of.all += sample.area;
            of.lit += if sample.exposure == Exposure::Buried { 0.0 } else { sample.area };
        }
    }
    let is_buried = |sample: &SurfaceSample| {
        let is_in_doubt = || {
            let of = suspects.get(&sample.voxel).copied().unwrap_or_default();
            facing(sample, weights).map(|direction| of[direction.index()]).any(Suspects::are_in_doubt)
        };
        sample.exposure == Exposure::Buried && !is_in_doubt()
    };
    let mut whole: VoxelMap<(u32, VoxelCoord), Points> = VoxelMap::default();
    for sample in samples {
        let none = Points { are_buried: true, count: 0 };
        let points = whole.entry((sample.side, sample.voxel)).or_insert(none);
        points.are_buried &= is_buried(sample);
        points.count += 1;
    }
    let is_open_beside = |side: u32, voxel: VoxelCoord| {
        let beside = Direction::ALL.map(|direction| voxel + direction.vector().as_ivec3());
        let own = beside.into_iter().filter(|&beside| grid.chunk_of(beside) == grid.chunk_of(voxel));
        own.filter_map(|beside| whole.get(&(side, beside))).any(|points| !points.are_buried)
    };
    let is_whole = |&(&(side, voxel), points): &(&(u32, VoxelCoord), &Points)| {
        points.are_buried && (points.count >= FEW_POINTS || !is_open_beside(side, voxel))
    };
    let mut pieces: Vec<BuriedPiece> = whole
        .iter()
        .filter(is_whole)
        .map(|(&(side, voxel), _)| BuriedPiece { side, voxel: voxel.to_array() })
        .collect();
    pieces.sort_unstable();
    pieces
}

/// The pieces of which at least one of `samples` looked buried, and found light. What lies open says nothing of the rest:
/// an awning goes on into the house.
pub(crate) fn reached<'s>(
    samples: impl Iterator<Item = &'s SurfaceSample>,
) -> VoxelMap<(u32, VoxelCoord), ()> {
    let reached = samples.filter(|sample| sample.is_suspect && sample.exposure != Exposure::Buried);
    reached.map(|sample| ((sample.side, sample.voxel), ())).collect()
}

/// The directions that `sample` counts for.
fn facing(sample: &SurfaceSample, weights: AxisWeights) -> impl Iterator<Item = Direction> {
    side_weights(weights, sample.normal).into_iter().filter(|(_, weight)| *weight > 0.0).map(|of| of.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builder::{Builder, Surfaces};
    use crate::progress::Silent;
    use crate::rows::RowCaster;
    use crate::test_shapes::{boxed, point, quad};
    use earthshine_scene::{Material, Scene};
    use earthshine_tiles::BakeParameters;
    use earthshine_trace::SceneTracer;
    use earthshine_world::{Grid, Rgb, Vec3};

    const GRID: Grid = Grid { voxel_edge_m: 1.0, chunk_edge_voxels: 4 };

    fn parameters(voxel_edge_m: f32) -> BakeParameters {
        let grid = Grid { voxel_edge_m, chunk_edge_voxels: 4 };
        BakeParameters { grid, ..BakeParameters::default() }
    }

    fn surfaces(tracer: &SceneTracer<'_>, parameters: &BakeParameters) -> Surfaces {
        Builder { tracer, parameters }.surfaces(&Silent)
    }

    /// Goal: what is within a wall sees no light of the surfaces that share its voxels. Method: a wall of a tenth of a voxel,
    /// closed, under the open sky; rays from within it, and from without.
    #[test]
    fn the_inside_of_a_thin_wall_absorbs() {
        let wall = boxed(Vec3::new(0.4, 0.0, 0.0), Vec3::new(0.5, 3.0, 3.0));
        let (tracer, parameters) = (SceneTracer::new(&wall), parameters(1.0));
        let surfaces = surfaces(&tracer, &parameters);
        let pieces = surfaces.set.buried();
        let backs = surfaces.samples.iter().filter(|sample| sample.side % 2 == 1);
        assert!(backs.clone().count() > 100);
        backs.for_each(|back| assert!(pieces.contains(back.side, back.voxel), "{back:?}"));
        assert!(pieces.pieces().iter().all(|piece| piece.side % 2 == 1 && pieces.has_side(piece.side)));
        assert!(!pieces.contains(0, VoxelCoord::ZERO) && !pieces.has_side(0) && pieces.bytes() > 0);
        let caster = RowCaster::of_world(&tracer, &surfaces, &parameters);
        // Both meet what faces +x in one voxel: the back of the wall's far side, and the front of its near one.
        let [within, without] = [0.45, 0.9].map(|x| caster.end(Vec3::new(x, 1.3, 1.3), Vec3::NEG_X));
        assert_eq!((within.absorbed_share(), without.absorbed_share()), (1.0, 0.0));
    }

    /// Goal: where anything emits, what paths take for buried absorbs nothing: they seldom meet a small lamp. Method: a closed
    /// room whose walls face out, with a lamp of a hundredth of its ceiling, on and off.
    #[test]
    fn nothing_absorbs_where_anything_emits() {
        let mut room = boxed(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0));
        let lamp = Material { emitted_radiance: Rgb::ONE, double_sided: true, ..room.materials[0].clone() };
        room.materials.push(lamp);
        let corners = quad(Vec3::new(1.8, 2.9, 1.8), Vec3::X * 0.4, Vec3::Z * 0.4);
        room.triangles.extend(corners);
        room.texture_coordinates.extend([[[0.0; 2]; 3]; 2]);
        room.material_of.extend([1; 2]);
        let found = |room: &Scene| {
            let (tracer, parameters) = (SceneTracer::new(room), parameters(0.5));
            let Surfaces { samples, set } = surfaces(&tracer, &parameters);
            let buried = samples.iter().filter(|sample| sample.exposure == Exposure::Buried).count();
            (buried, set.buried().pieces().len())
        };
        let (buried, pieces) = found(&room);
        assert!(buried > 100 && pieces == 0, "{buried} points, {pieces} pieces");
        room.materials[1].emitted_radiance = Rgb::ZERO;
        let (buried, pieces) = found(&room);
        assert!(buried > 1000 && pieces > 100, "{buried} points, {pieces} pieces");
    }

    /// Goal: few points do not speak for a piece that goes on in the open. Method: buried points of a pane in one voxel, and an
    /// open one of the same pane in the voxel below it, beside it in another chunk, or nowhere.
    #[test]
    fn few_buried_points_beside_the_open_absorb_nothing() {
        let pane = |voxel: VoxelCoord, exposure: Exposure| SurfaceSample {
            exposure,
            is_suspect: exposure == Exposure::Buried,
            ..point(voxel.as_vec3() + 0.5, Vec3::X, voxel)
        };
        let above = VoxelCoord::new(0, 3, 0);
        let found = |count: usize, open: Option<VoxelCoord>| {
            let buried = (0..count).map(|_| pane(above, Exposure::Buried));
            let open = open.map(|voxel| pane(voxel, Exposure::Open(0.5)));
            let samples: Vec<SurfaceSample> = buried.chain(open).collect();
            buried_pieces(&samples, AxisWeights::Squared, GRID).len()
        };
        let few = FEW_POINTS as usize - 1;
        assert_eq!(found(few, Some(above - VoxelCoord::Y)), 0);
        assert_eq!(found(few + 1, Some(above - VoxelCoord::Y)), 1, "as many as can tell");
        assert_eq!(found(few, None), 1, "buried all over");
        assert_eq!(found(few, Some(above + VoxelCoord::Y)), 1, "open in another chunk");
        assert_eq!(found(few, Some(above + VoxelCoord::new(1, 1, 0))), 1, "not beside it");
    }

    /// Goal: a few points of a wall's inside that find light through a crack do not undo the others; many do. Method: points of
    /// pieces of their own in one voxel.
    #[test]
    fn doubt_is_a_matter_of_how_much_found_light() {
        let piece = |side: u32, exposure: Exposure| SurfaceSample {
            side,
            exposure,
            is_suspect: true,
            ..point(Vec3::splat(0.5), Vec3::X, VoxelCoord::ZERO)
        };
        let with_lit = |lit: u32| {
            let exposure = |side: u32| if side < lit { Exposure::Open(1.0) } else { Exposure::Buried };
            let samples: Vec<SurfaceSample> = (0..16).map(|side| piece(side, exposure(side))).collect();
            buried_pieces(&samples, AxisWeights::Squared, GRID).len()
        };
        assert_eq!([0, 1, 2, 3].map(with_lit), [16, 15, 14, 0]);
        // One point of two is enough for its piece, whatever faces elsewhere.
        let halves = [piece(4, Exposure::Buried), piece(4, Exposure::Hidden(0.25))];
        assert_eq!(buried_pieces(&halves, AxisWeights::Squared, GRID), []);
        assert!(
            reached(halves.iter()).contains_key(&(4, VoxelCoord::ZERO))
                && reached(halves[..1].iter()).is_empty()
        );
    }
}
