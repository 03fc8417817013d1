//! Which world, and how large: every option has a default and a range.

use crate::GenError;
use serde::{Deserialize, Serialize};

/// The worlds there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WorldKind {
    /// The Cornell box, 2 m, open at the front (+Z), one area lamp. The seed changes nothing.
    Cornell,
    /// A closed box of one reflectance and one emission: exitance is `pi L / (1 - rho)` everywhere. The seed changes nothing.
    Furnace,
    /// Two closed rooms joined by a doorway, a lamp in one. The seed chooses paints and furniture.
    TwoRooms,
    /// One closed room of legs, boards, books and a kerb under a large lamp: contacts finer than any voxel. The seed chooses
    /// paints and books.
    Study,
    /// A long closed corridor with doglegs, pillars, lamps and changing paint: many chunks.
    Corridor,
    /// Streets, houses with rooms and windows, squares, trees, street lamps and a sun.
    Town,
}

impl WorldKind {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Cornell, Self::Furnace, Self::TwoRooms, Self::Study, Self::Corridor, Self::Town];

    /// As on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Cornell => "cornell",
            Self::Furnace => "furnace",
            Self::TwoRooms => "two-rooms",
            Self::Study => "study",
            Self::Corridor => "corridor",
            Self::Town => "town",
        }
    }
}

impl std::fmt::Display for WorldKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for WorldKind {
    type Err = GenError;

    fn from_str(given: &str) -> Result<Self, GenError> {
        let found = Self::ALL.into_iter().find(|kind| kind.name() == given);
        found.ok_or_else(|| GenError::UnknownKind { given: given.to_owned() })
    }
}

/// What can be chosen about a world; each kind reads the fields that begin with its name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GenOptions {
    /// Every random number is a hash of it.
    pub seed: u64,
    /// Reflectance of all walls, 0 to 0.98.
    pub furnace_reflectance: f32,
    /// Radiance that all walls emit, cd/m2.
    pub furnace_radiance: f32,
    /// Length of the corridor along X, m.
    pub corridor_length_m: f32,
    /// Edge of the town, m; rounded to whole cells of [`Self::TOWN_CELL_M`].
    pub town_size_m: f32,
    /// Triangles as rendered, met within 10 %; `None` for [`Self::TOWN_CELL_TRIANGLES`] a cell.
    pub town_triangles: Option<u64>,
    /// Repeated props become triangles of their cell rather than instances of one mesh.
    pub flatten: bool,
}

impl Default for GenOptions {
    fn default() -> Self {
        Self {
            seed: 1,
            furnace_reflectance: 0.5,
            furnace_radiance: 1.0,
            corridor_length_m: 160.0,
            town_size_m: 160.0,
            town_triangles: None,
            flatten: false,
        }
    }
}

impl GenOptions {
    /// Edge of one town cell: a block and half of the streets around it, m.
    pub const TOWN_CELL_M: f32 = 40.0;
    /// Triangles of a town cell unless a total is asked for.
    pub const TOWN_CELL_TRIANGLES: u64 = 11_000;
    /// Largest edge of a town, m.
    pub const TOWN_SIZE_MAX_M: f32 = 8_000.0;
    /// Longest corridor, m.
    pub const CORRIDOR_LENGTH_MAX_M: f32 = 10_000.0;
    /// Most triangles of a town, instances counted.
    pub const TOWN_TRIANGLES_MAX: u64 = 400_000_000;

    /// Cells along the town's edge, at least 1.
    #[must_use]
    pub fn town_cells_on_edge(&self) -> i32 {
        (self.town_size_m / Self::TOWN_CELL_M).round().max(1.0) as i32
    }

    /// Coordinates of the cells along one axis; the town lies around the origin.
    #[must_use]
    pub fn town_cell_range(&self) -> std::ops::Range<i32> {
        let edge = self.town_cells_on_edge();
        -(edge / 2)..edge - edge / 2
    }

    /// Triangles each cell of the town aims at.
    #[must_use]
    pub fn town_cell_triangles(&self) -> u64 {
        let cells = u64::from(self.town_cells_on_edge().unsigned_abs()).pow(2);
        self.town_triangles.map_or(Self::TOWN_CELL_TRIANGLES, |total| total / cells)
    }

    /// Checks the options that `kind` reads.
    ///
    /// # Errors
    /// The first one out of its range.
    pub fn validate(&self, kind: WorldKind) -> Result<(), GenError> {
        let check = |name, value: f64, least: f64, most: f64| {
            let inside = (least..=most).contains(&value);
            if inside { Ok(()) } else { Err(GenError::OutOfRange { name, value, least, most }) }
        };
        match kind {
            WorldKind::Cornell | WorldKind::TwoRooms | WorldKind::Study => Ok(()),
            WorldKind::Furnace => {
                check("furnace_reflectance", self.furnace_reflectance.into(), 0.0, 0.98)?;
                check("furnace_radiance", self.furnace_radiance.into(), 0.0, 1e9)
            }
            WorldKind::Corridor => check(
                "corridor_length_m",
                self.corridor_length_m.into(),
                8.0,
                Self::CORRIDOR_LENGTH_MAX_M.into(),
            ),
            WorldKind::Town => {
                let (least, most) = (Self::TOWN_CELL_M.into(), Self::TOWN_SIZE_MAX_M.into());
                check("town_size_m", self.town_size_m.into(), least, most)?;
                let triangles = self.town_triangles.unwrap_or(1);
                check("town_triangles", triangles as f64, 1.0, Self::TOWN_TRIANGLES_MAX as f64)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back_and_others_are_refused() {
        for kind in WorldKind::ALL {
            assert_eq!(kind.name().parse::<WorldKind>().unwrap(), kind);
            assert_eq!(serde_json::to_string(&kind).unwrap(), format!("\"{kind}\""));
        }
        assert!(
            matches!("village".parse::<WorldKind>(), Err(GenError::UnknownKind { given }) if given == "village")
        );
    }

    #[test]
    fn numbers_out_of_range_are_named() {
        let options = GenOptions { town_size_m: f32::NAN, furnace_reflectance: 1.0, ..GenOptions::default() };
        for (kind, option) in [(WorldKind::Town, "town_size_m"), (WorldKind::Furnace, "furnace_reflectance")]
        {
            let error = options.validate(kind).unwrap_err();
            assert!(matches!(error, GenError::OutOfRange { name, .. } if name == option), "{error}");
        }
        assert!(options.validate(WorldKind::Cornell).is_ok());
    }

    #[test]
    fn cells_lie_around_the_origin() {
        let sized = |town_size_m| GenOptions { town_size_m, ..GenOptions::default() };
        assert_eq!(sized(160.0).town_cell_range(), -2..2);
        assert_eq!(sized(40.0).town_cell_range(), 0..1);
        assert_eq!(sized(130.0).town_cell_range(), -1..2);
    }
}
