//! The six directions of a voxel, and the share of a surface that each of them stands for.

use glam::Vec3;

/// One of the six axis directions. A patch faces one; the order is that of every array of six.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Direction {
    /// +X
    PosX = 0,
    /// -X
    NegX = 1,
    /// +Y, up
    PosY = 2,
    /// -Y
    NegY = 3,
    /// +Z
    PosZ = 4,
    /// -Z
    NegZ = 5,
}

impl Direction {
    /// All six, in storage order.
    pub const ALL: [Self; 6] = [Self::PosX, Self::NegX, Self::PosY, Self::NegY, Self::PosZ, Self::NegZ];

    /// The direction at `index` in [`Self::ALL`]; `None` from 6 on.
    #[must_use]
    pub fn from_index(index: u8) -> Option<Self> {
        Self::ALL.get(usize::from(index)).copied()
    }

    /// Position in [`Self::ALL`].
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }

    /// 0 for X, 1 for Y, 2 for Z.
    #[must_use]
    pub fn axis(self) -> usize {
        self as usize / 2
    }

    /// Unit vector.
    #[must_use]
    pub fn vector(self) -> Vec3 {
        [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z][self as usize]
    }

    /// The side of axis `axis` (0..3) that a vector with component `component` points to.
    #[must_use]
    pub fn of_component(axis: usize, component: f32) -> Self {
        Self::ALL[axis * 2 + usize::from(component < 0.0)]
    }
}

/// How a point with unit normal `n` spreads over the three directions that it faces.
///
/// [`Squared`](Self::Squared) sums to one for every normal, so areas and row sums are kept. The
/// sources' [`Absolute`](Self::Absolute) sums to up to 1.73 and makes energy; it is here to be compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AxisWeights {
    /// `n_a^2`
    #[default]
    Squared,
    /// `|n_a|`
    Absolute,
}

impl AxisWeights {
    /// Weight and direction along each of the three axes; a weight may be zero.
    #[must_use]
    pub fn of(self, normal: Vec3) -> [(Direction, f32); 3] {
        [0, 1, 2].map(|axis| {
            let component = normal[axis];
            let weight = match self {
                Self::Squared => component * component,
                Self::Absolute => component.abs(),
            };
            (Direction::of_component(axis, component), weight)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squared_weights_are_a_partition_of_unity_and_absolute_ones_are_not() {
        let normal = Vec3::new(1.0, -1.0, 1.0).normalize_or_zero();
        let sum = |weights: AxisWeights| weights.of(normal).iter().map(|(_, w)| w).sum::<f32>();
        assert!((sum(AxisWeights::Squared) - 1.0).abs() < 1e-6);
        assert!(sum(AxisWeights::Absolute) > 1.7);
        assert_eq!(AxisWeights::Squared.of(normal)[1].0, Direction::NegY);
    }
}
