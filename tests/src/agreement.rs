//! Served light beside solved light, patch by patch and point by point, within what the wire can say.

use crate::solved::{LayerPlace, PatchPlace, Solution, SolvedWorld, place_of};
use earthshine_client::Light;
use earthshine_volume::{Volume, lookup};
use earthshine_world::Rgb;
use std::collections::{BTreeMap, BTreeSet};

/// The wire's RGB9E5 keeps nine bits of the largest channel.
const WIRE_REL: f32 = 1.0 / 512.0;
/// Shares are stored in half precision, each row for itself; the engine takes both ways of an exchange from one of
/// the two rows.
const SHARES_REL: f32 = 1e-3;
/// Below this nothing is told apart from nothing, lx.
const DARK: f32 = 1e-4;

/// What a client was told of one patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServedPatch {
    /// lx.
    pub irradiance: Rgb,
    /// lx.
    pub sky_irradiance: Rgb,
    /// 0..=1.
    pub quality: f32,
}

/// Patches by place.
pub type PatchPlaces = BTreeMap<PatchPlace, ServedPatch>;

/// Everything a client was told of surfaces on level 0, by place.
#[must_use]
pub fn served_patches(light: &Light) -> PatchPlaces {
    // Detail comes before what it is detail of.
    let finest = light.volumes().iter().rfind(|volume| volume.layout().level == 0);
    patches_in(finest)
}

/// Everything a client was told of detail, by detail voxel and layer.
#[must_use]
pub fn served_detail(light: &Light) -> BTreeMap<LayerPlace, ServedPatch> {
    let finest = light.volumes().iter().rposition(|volume| volume.layout().level == 0).unwrap_or(0);
    let layers = (0..).zip(&light.volumes()[..finest]);
    layers
        .flat_map(|(layer, volume)| {
            patches_in(Some(volume)).into_iter().map(move |(place, told)| ((place, layer), told))
        })
        .collect()
}

fn patches_in(volume: Option<&Volume>) -> PatchPlaces {
    let mut patches = BTreeMap::new();
    for (voxel, told) in volume.into_iter().flat_map(Volume::iter) {
        for direction in (0..6).filter(|&direction| told.has(direction) && !told.is_air(direction)) {
            let patch = ServedPatch {
                irradiance: told.irradiance[direction],
                sky_irradiance: told.sky_irradiance[direction],
                quality: f32::from(told.quality[direction]) / 255.0,
            };
            patches.insert((voxel.to_array(), direction), patch);
        }
    }
    patches
}

/// Most that a served value may be off, for a value of `expected`, lx.
fn tolerance(expected: Rgb) -> f32 {
    (WIRE_REL + SHARES_REL) * expected.max_element() + DARK
}

/// Asserts that `light` is `solution` at every patch of the world, and at the middle of every sample point's surface.
///
/// # Panics
/// If it is not.
pub fn assert_is(world: &SolvedWorld, solution: &Solution, light: &Light) {
    let served = served_patches(light);
    assert_eq!(served.len(), world.told().count(), "every patch is served");
    for (index, patch) in world.told() {
        let told = served[&place_of(patch)];
        for (what, told, solved) in [
            ("irradiance", told.irradiance, solution.irradiance[index]),
            ("sky", told.sky_irradiance, solution.sky_irradiance[index]),
        ] {
            let gap = (told - solved).abs().max_element();
            assert!(gap <= tolerance(solved), "{what} of {patch:?}: {told} served, {solved} solved");
        }
        assert_eq!(told.quality, 1.0, "nothing is far from {patch:?}");
    }
    let volume = world.volume(solution);
    // The solve leaves the air out.
    let surfaces: Vec<_> = light.volumes().iter().map(Volume::without_air).collect();
    for chunk in world.chunks() {
        for point in chunk.points.iter().step_by(3) {
            let solved = lookup(&[&volume], point.position, point.normal).expect("a surface point is lit");
            let told = lookup(&surfaces, point.position, point.normal).expect("a surface point is lit");
            // Neighbours with other colours round by their own largest channel.
            let gap = (told.irradiance - solved.irradiance).abs().max_element();
            assert!(
                gap <= 4.0 * tolerance(solved.irradiance),
                "{told:?} served, {solved:?} solved at {point:?}"
            );
        }
    }
}

/// Asserts that every detail voxel of the world has in `light` what its row gathers of `solution`. Returns how many there are.
///
/// # Panics
/// If one has not.
pub fn assert_detail_is(world: &SolvedWorld, solution: &Solution, light: &Light) -> usize {
    let (served, solved) = (served_detail(light), world.details(solution));
    assert_eq!(served.len(), solved.len(), "every detail voxel is served");
    for (place, expected) in &solved {
        let told = served[place];
        let gap = (told.irradiance - *expected).abs().max_element();
        assert!(gap <= tolerance(*expected), "{told:?} served, {expected} solved at {place:?}");
    }
    served.len()
}

/// Asserts that what is served lies between the light of the `served` patches alone and that of the whole world, that
/// the sky is the patch's own, and that the quality is the share of the row that is known. Returns the least quality.
///
/// # Panics
/// If any of it is not so.
pub fn assert_between(
    world: &SolvedWorld,
    whole: &Solution,
    alone: &Solution,
    served: &BTreeMap<PatchPlace, ServedPatch>,
) -> f32 {
    let present: BTreeSet<PatchPlace> = served.keys().copied().collect();
    let known = world.known_shares(&present);
    let mut least = 1.0f32;
    for (index, patch) in world.told() {
        let Some(told) = served.get(&place_of(patch)) else { continue };
        let (most, fewest) = (whole.irradiance[index], alone.irradiance[index]);
        let slack = tolerance(most);
        assert!((told.irradiance - most).max_element() <= slack, "{told:?} exceeds {most} at {patch:?}");
        assert!((fewest - told.irradiance).max_element() <= slack, "{told:?} is below {fewest} at {patch:?}");
        let sky = whole.sky_irradiance[index];
        let gap = (told.sky_irradiance - sky).abs().max_element();
        assert!(gap <= tolerance(sky), "{told:?} has another sky than {sky} at {patch:?}");
        let ([fewest, most], step) = (known[index], 1.5 / 255.0);
        assert!((fewest - step..=most + step).contains(&told.quality), "{told:?}: {fewest} to {most} known");
        least = least.min(told.quality);
    }
    least
}
