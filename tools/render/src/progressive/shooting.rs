//! The solver: first light on every leaf, then one shot after the other, with an account of all power.

use super::elements::{Elements, Leaf, Side};
use super::form_factor;
use super::id_buffer::IdBuffer;
use super::{ProgressiveError, ProgressiveOptions, Visibility};
use crate::path::{EmitterSampling, PathTracer};
use crate::sampling::{PathStream, cosine_direction};
use crate::tracer::{SceneTracer, Vertex, off_surface};
use earthshine_scene::Scene;
use earthshine_trace::hemisphere::spread_pair;
use earthshine_world::random::{Purpose, hash, unit_pair};
use earthshine_world::{LightRig, Rgb, Vec3};
use glam::DVec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Patches of the automatic size.
const PATCHES: f32 = 1000.0;
/// Rays of a leaf towards the sky.
const SKY_RAYS: u32 = 128;
/// Streams of the sky rays and lamps; the reference uses 0 and 1.
const STREAM: u64 = 4;
/// A shot may arrive as this much more than it was: errors of form factors go both ways, and cutting off those above
/// one would lose light. At the highest reflectance, 0.98, light still dies away.
const EXCESS_MAX: f64 = 0.02;
/// Shots with this share of all power or more look at four places a leaf and may split it.
const BRIGHT_SHARE: f64 = 1e-3;

/// Where all power went, lm, by channel. `given = unshot + absorbed + escaped`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Power {
    /// Emitted, and reflected of lamps and sky: what there was to shoot at first.
    pub given: DVec3,
    /// Not shot yet.
    pub unshot: DVec3,
    /// Taken in by receivers.
    pub absorbed: DVec3,
    /// Shot at no receiver: out of the scene, or lost to the form factors' error.
    pub escaped: DVec3,
    /// Most that any shot's form factors exceeded one by; from a bound on they were scaled down.
    pub excess_share_max: f64,
}

impl Power {
    /// Share of the given power that is not waiting to be shot any more, channels together; one if none was given.
    #[must_use]
    pub fn shot_share(&self) -> f64 {
        let given = self.given.element_sum();
        if given > 0.0 { 1.0 - self.unshot.element_sum() / given } else { 1.0 }
    }
}

/// One shot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Who shot.
    pub patch: u32,
    /// What it had, lm, channels together.
    pub power: f64,
    /// Leaves that split.
    pub splits: usize,
}

/// A scene being solved.
#[derive(Debug)]
pub struct Progressive<'a> {
    paths: PathTracer<'a>,
    options: ProgressiveOptions,
    elements: Elements,
    power: Power,
    shots: u64,
}

impl<'a> Progressive<'a> {
    /// Cuts the scene and puts first light on it. Nothing was shot yet.
    ///
    /// # Errors
    /// Options out of range, no triangles, or more elements than allowed.
    pub fn new(
        tracer: &'a SceneTracer<'a>,
        rig: &'a LightRig,
        options: &ProgressiveOptions,
    ) -> Result<Self, ProgressiveError> {
        options.validate()?;
        let scene = tracer.scene();
        let (triangles, elements_max) = (scene.triangles.len(), options.elements_max);
        if triangles == 0 {
            return Err(ProgressiveError::Empty);
        }
        if 2 * triangles > elements_max {
            return Err(ProgressiveError::TooManyTriangles { triangles, elements_max });
        }
        let sides: Vec<Side> = (0..triangles).flat_map(|triangle| both_sides(scene, triangle)).collect();
        let total: f32 = sides.iter().map(|side| form_factor::area(&side.corners)).sum();
        let patch_area = options.patch_area_max_m2.unwrap_or(total / PATCHES);
        let mut elements = Elements::cut(&sides, patch_area, elements_max)?;
        let paths = PathTracer { tracer, rig, emitter_sampling: EmitterSampling::Balanced };
        let seed = options.seed;
        elements.leaves.par_iter_mut().enumerate().for_each(|(index, leaf)| {
            first_light(&paths, leaf, hash(seed, Purpose::ReferencePath, index as u64, STREAM));
        });
        let given = elements.leaves.iter().map(Leaf::unshot_power).sum();
        let power = Power { given, unshot: given, ..Power::default() };
        Ok(Self { paths, options: *options, elements, power, shots: 0 })
    }

    /// Patches and leaves as they are.
    #[must_use]
    pub fn elements(&self) -> &Elements {
        &self.elements
    }

    /// The account.
    #[must_use]
    pub fn power(&self) -> &Power {
        &self.power
    }

    /// How many shots there were.
    #[must_use]
    pub fn shots(&self) -> u64 {
        self.shots
    }

    /// The patch with the most unshot power shoots. `None` if there is none left.
    pub fn shoot(&mut self) -> Option<Shot> {
        let unshot = |patch: u32| {
            let exitance = self.elements.unshot_exitance(patch);
            f64::from(exitance.element_sum()) * f64::from(self.elements.patches[patch as usize].area)
        };
        let strongest = |best: (u32, f64), patch: u32| {
            let power = unshot(patch);
            if power > best.1 { (patch, power) } else { best }
        };
        let (patch, power) = (0..self.elements.patches.len() as u32).fold((0, 0.0), strongest);
        if power <= 0.0 {
            return None;
        }
        let splits = self.shoot_from(patch, power);
        self.shots += 1;
        Some(Shot { patch, power, splits })
    }

    fn shoot_from(&mut self, patch: u32, power: f64) -> usize {
        let exitance = self.elements.unshot_exitance(patch);
        let shot = exitance.as_dvec3() * f64::from(self.elements.patches[patch as usize].area);
        for leaf in self.elements.patches[patch as usize].leaves.clone() {
            self.elements.leaves[leaf as usize].unshot = Rgb::ZERO;
        }
        let is_bright = power >= BRIGHT_SHARE * self.power.given.element_sum();
        let (shares, splits) = self.shares(patch, is_bright);
        let arriving = |leaf: u32, share: f32| exitance * share * self.elements.leaves[leaf as usize].area;
        let arrived: DVec3 = shares.iter().map(|&(leaf, share)| arriving(leaf, share).as_dvec3()).sum();
        let excess = arrived.element_sum() / shot.element_sum();
        let scale = ((1.0 + EXCESS_MAX) / excess.max(1.0 + EXCESS_MAX)) as f32;
        let mut reflected = DVec3::ZERO;
        for &(leaf, share) in &shares {
            let leaf = &mut self.elements.leaves[leaf as usize];
            let irradiance = exitance * (share * scale);
            let new = leaf.reflectance * irradiance;
            leaf.irradiance += irradiance;
            leaf.unshot += new;
            reflected += new.as_dvec3() * f64::from(leaf.area);
        }
        let arrived = arrived * f64::from(scale);
        self.power.excess_share_max = self.power.excess_share_max.max(excess - 1.0);
        self.power.unshot = self.power.unshot - shot + reflected;
        self.power.absorbed += arrived - reflected;
        self.power.escaped += shot - arrived;
        splits
    }

    /// Form factor from each leaf that sees `patch` to it; leaves whose own parts differ too much are split first.
    fn shares(&mut self, patch: u32, is_bright: bool) -> (Vec<(u32, f32)>, usize) {
        let buffer = match self.options.visibility {
            Visibility::Rays => None,
            Visibility::IdBuffer { edge_texels } => {
                let shooter = &self.elements.patches[patch as usize];
                Some(IdBuffer::look(self.paths.tracer, &self.elements, shooter, edge_texels))
            }
        };
        let mut pending: Vec<u32> = (0..self.elements.leaves.len() as u32).collect();
        let (mut shares, mut splits, mut difference_max) = (Vec::new(), 0, None);
        while !pending.is_empty() {
            let found: Vec<[f32; 4]> = pending
                .par_iter()
                .map(|&leaf| self.leaf_shares(leaf, patch, buffer.as_ref(), is_bright))
                .collect();
            let difference_max = *difference_max.get_or_insert_with(|| self.difference_max(&pending, &found));
            let mut next = Vec::new();
            for (&leaf, parts) in pending.iter().zip(&found) {
                let (low, high) = parts
                    .iter()
                    .fold((f32::MAX, 0.0f32), |(low, high), &part| (low.min(part), high.max(part)));
                if high <= 0.0 {
                    continue;
                }
                let element = &self.elements.leaves[leaf as usize];
                let difference = element.reflectance.max_element() * (high - low);
                let may_split =
                    is_bright && element.depth < self.options.splits_max && self.elements.has_room();
                if may_split && difference > difference_max {
                    next.extend(self.elements.split(leaf));
                    splits += 1;
                } else {
                    shares.push((leaf, parts.iter().sum::<f32>() * 0.25));
                }
            }
            pending = next;
        }
        (shares, splits)
    }

    /// The largest difference across a leaf that does not split it: a share of the mean over all leaves that are lit.
    fn difference_max(&self, leaves: &[u32], shares: &[[f32; 4]]) -> f32 {
        let mut sum = (0.0f64, 0.0f64);
        for (&leaf, parts) in leaves.iter().zip(shares) {
            let leaf = &self.elements.leaves[leaf as usize];
            let share = parts.iter().sum::<f32>() * 0.25;
            if share > 0.0 {
                sum.0 += f64::from(share * leaf.reflectance.max_element() * leaf.area);
                sum.1 += f64::from(leaf.area);
            }
        }
        self.options.gradient_max * (sum.0 / sum.1.max(f64::MIN_POSITIVE)) as f32
    }

    /// Form factors to `patch` from four places of `leaf`; the one of its centre four times for a faint shot.
    fn leaf_shares(&self, leaf: u32, patch: u32, buffer: Option<&IdBuffer>, is_bright: bool) -> [f32; 4] {
        let leaf = &self.elements.leaves[leaf as usize];
        let shooter = &self.elements.patches[patch as usize];
        let share = |place: Vec3| {
            if buffer.is_some_and(|buffer| !buffer.sees(place, leaf.patch)) {
                return 0.0;
            }
            let origin = off_surface(place, leaf.normal);
            let is_visible =
                |part: Vec3| buffer.is_some() || self.paths.sees(origin, off_surface(part, shooter.normal));
            form_factor::triangle((place, leaf.normal), &shooter.corners, shooter.normal, &is_visible)
        };
        if is_bright { leaf.places().map(share) } else { [share(form_factor::centre(&leaf.corners)); 4] }
    }

    /// Mean reflected share of what is still unshot, for the ambient estimate: area-weighted over sides with light.
    ///
    /// Unshot power spread evenly over everything that is lit, with all its later bounces:
    /// `sum(unshot A) / sum(A) / (1 - mean reflectance)`, lx (Cohen et al. 1988). For showing only.
    #[must_use]
    pub fn ambient_irradiance(&self) -> Rgb {
        let (mut area, mut reflected) = (0.0f64, DVec3::ZERO);
        for leaf in &self.elements.leaves {
            if leaf.irradiance != Rgb::ZERO || leaf.unshot != Rgb::ZERO {
                area += f64::from(leaf.area);
                reflected += leaf.reflectance.as_dvec3() * f64::from(leaf.area);
            }
        }
        if area <= 0.0 {
            return Rgb::ZERO;
        }
        (self.power.unshot.max(DVec3::ZERO) / area / (DVec3::ONE - reflected / area)).as_vec3()
    }
}

fn both_sides(scene: &Scene, triangle: usize) -> [Side; 2] {
    let (normal, [a, b, c]) = (scene.normal(triangle), scene.triangles[triangle]);
    [Side { corners: [a, b, c], normal }, Side { corners: [a, c, b], normal: -normal }]
}

/// Reflectance, light of lamps and sky, and own emission, each the mean over the leaf's four places.
fn first_light(paths: &PathTracer<'_>, leaf: &mut Leaf, seed: u64) {
    let mut emitted = Rgb::ZERO;
    let mut lamps = Rgb::ZERO;
    let mut stream = PathStream::new(seed, 0);
    for place in leaf.places() {
        let Some(vertex) = vertex_at(paths.tracer, place, leaf.normal) else { continue };
        leaf.reflectance += vertex.reflectance * 0.25;
        emitted += vertex.emitted_radiance * (0.25 * PI * paths.rig.emission_scale);
        lamps += paths.lamp_irradiance(&vertex, &mut stream, &mut 0) * 0.25;
    }
    let sky = sky_irradiance(paths, leaf, seed);
    leaf.irradiance = sky;
    leaf.unshot = emitted + leaf.reflectance * (lamps + sky);
}

/// The surface at a place: material lookups need a hit.
fn vertex_at(tracer: &SceneTracer<'_>, place: Vec3, normal: Vec3) -> Option<Vertex> {
    let off = off_surface(place, normal);
    let reach = 4.0 * crate::tracer::offset_at(place);
    tracer.closest(off, -normal, 0.0, reach).map(|hit| tracer.vertex(&hit))
}

fn sky_irradiance(paths: &PathTracer<'_>, leaf: &Leaf, seed: u64) -> Rgb {
    let is_dark = paths.rig.sky.lobes.iter().all(|&lobe| lobe == Rgb::ZERO);
    if is_dark && paths.tracer.environment().is_none() {
        return Rgb::ZERO;
    }
    let (shift_u, shift_v) = unit_pair(seed);
    let places = leaf.places();
    let ray = |ray: u32| {
        let direction = cosine_direction(leaf.normal, spread_pair(ray, shift_u, shift_v));
        let origin = off_surface(places[ray as usize % places.len()], leaf.normal);
        let is_free = paths.tracer.closest(origin, direction, 0.0, f32::INFINITY).is_none();
        if is_free { paths.sky_radiance(direction) } else { Rgb::ZERO }
    };
    (0..SKY_RAYS).map(ray).sum::<Rgb>() * (PI / SKY_RAYS as f32)
}
