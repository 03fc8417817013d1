//! Where a volume is: origin, dims, voxel edge; and which number a voxel has in it.

use glam::{IVec3, UVec3, Vec3};

/// A box of voxels of one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// Level of the pyramid: 0 is the finest. Detail has that of the voxels it is detail of.
    pub level: u8,
    /// Lowest voxel, in voxels of this level.
    pub origin: IVec3,
    /// Voxels along the axes.
    pub dims: UVec3,
    /// Edge of a voxel, m; of detail: of a detail voxel, a half or a quarter of the level's.
    pub voxel_edge_m: f32,
}

/// A box of voxels that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LayoutError {
    /// No voxels, or too many.
    #[error("{dims} voxels: each axis needs 1 to {dim_max}, all together at most {voxels_max}", dim_max = Layout::DIM_MAX, voxels_max = Layout::VOXELS_MAX)]
    Dims {
        /// As asked.
        dims: UVec3,
    },
    /// Too far out for `f32` to name single voxels.
    #[error("origin {origin}: each axis must be within +-{max}", max = Layout::ORIGIN_MAX)]
    Origin {
        /// As asked.
        origin: IVec3,
    },
    /// Not a length.
    #[error("a voxel edge of {voxel_edge_m} m: it must be finite and between 1e-6 and 1e6")]
    VoxelEdge {
        /// As asked, m.
        voxel_edge_m: f32,
    },
    /// A bounding box of nothing was asked for.
    #[error("no voxels to put a box around")]
    Nothing,
}

impl Layout {
    /// Most voxels of a volume: its index takes 4 MiB where nothing is lit, 260 MiB where everything is.
    pub const VOXELS_MAX: u32 = 1 << 26;
    /// Most voxels along one axis.
    pub const DIM_MAX: u32 = 1 << 16;
    /// Farthest origin along one axis, in voxels: beyond it `f32` skips integers.
    pub const ORIGIN_MAX: i32 = 1 << 24;

    /// Checks all bounds.
    ///
    /// # Errors
    /// The first number that is out of its bounds.
    pub fn validate(&self) -> Result<(), LayoutError> {
        let Self { origin, dims, voxel_edge_m, .. } = *self;
        let in_range = dims.min_element() > 0 && dims.max_element() <= Self::DIM_MAX;
        // The range comes first: three axes of 2^16 fit in a `u64`, three of 2^32 do not.
        let count = || dims.to_array().into_iter().map(u64::from).product::<u64>();
        if !in_range || count() > u64::from(Self::VOXELS_MAX) {
            return Err(LayoutError::Dims { dims });
        }
        if origin.to_array().iter().any(|&c| c.unsigned_abs() > Self::ORIGIN_MAX.unsigned_abs()) {
            return Err(LayoutError::Origin { origin });
        }
        if !(1e-6..=1e6).contains(&voxel_edge_m) {
            return Err(LayoutError::VoxelEdge { voxel_edge_m });
        }
        Ok(())
    }

    /// The smallest box around `voxels`.
    ///
    /// # Errors
    /// If there are none, or the box is out of bounds.
    pub fn bounding(
        level: u8,
        voxel_edge_m: f32,
        voxels: impl IntoIterator<Item = IVec3>,
    ) -> Result<Self, LayoutError> {
        let box_of = |(low, high): (IVec3, IVec3), voxel: IVec3| (low.min(voxel), high.max(voxel));
        let mut voxels = voxels.into_iter();
        let first = voxels.next().ok_or(LayoutError::Nothing)?;
        let (origin, high) = voxels.fold((first, first), box_of);
        if origin.to_array().iter().any(|&c| c.unsigned_abs() > Self::ORIGIN_MAX.unsigned_abs()) {
            return Err(LayoutError::Origin { origin });
        }
        let dims =
            UVec3::from_array([0, 1, 2].map(|axis| high[axis].abs_diff(origin[axis]).saturating_add(1)));
        let layout = Self { level, origin, dims, voxel_edge_m };
        layout.validate().map(|()| layout)
    }

    /// Number of voxels. The layout must be valid.
    #[must_use]
    pub fn voxel_count(&self) -> u32 {
        self.dims.x * self.dims.y * self.dims.z
    }

    /// Linear index `x + dims.x * (y + dims.y * z)` of `voxel`; `None` outside.
    #[must_use]
    pub fn index_of(&self, voxel: IVec3) -> Option<u32> {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let local = i64::from(voxel[axis]) - i64::from(self.origin[axis]);
            u32::try_from(local).ok().filter(|&local| local < self.dims[axis])
        });
        Some(x? + self.dims.x * (y? + self.dims.y * z?))
    }

    /// The voxel of linear `index`, which must be below [`Self::voxel_count`].
    #[must_use]
    pub fn voxel_of(&self, index: u32) -> IVec3 {
        let UVec3 { x, y, .. } = self.dims;
        self.origin + UVec3::new(index % x, index / x % y, index / x / y).as_ivec3()
    }

    /// The same box, so that its middle voxel is the one that holds `position` (m).
    #[must_use]
    pub fn centred_on(&self, position: Vec3) -> Self {
        let origin = (position / self.voxel_edge_m).floor().as_ivec3();
        Self { origin: origin.saturating_sub((self.dims / 2).as_ivec3()), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout() -> Layout {
        Layout { level: 0, origin: IVec3::new(-3, 5, 7), dims: UVec3::new(4, 3, 5), voxel_edge_m: 0.5 }
    }

    #[test]
    fn indices_and_voxels_are_inverse() {
        let layout = layout();
        for index in 0..layout.voxel_count() {
            assert_eq!(layout.index_of(layout.voxel_of(index)), Some(index));
        }
        for outside in [IVec3::new(-4, 5, 7), IVec3::new(1, 5, 7), IVec3::MIN, IVec3::MAX] {
            assert_eq!(layout.index_of(outside), None);
        }
    }

    #[test]
    fn impossible_boxes_are_refused() {
        let fault = |change: fn(&mut Layout)| {
            let mut layout = layout();
            change(&mut layout);
            layout.validate().unwrap_err().to_string()
        };
        assert!(fault(|l| l.dims.y = 0).contains("voxels"));
        assert!(fault(|l| l.dims = UVec3::splat(u32::MAX)).contains("voxels"));
        assert!(fault(|l| l.dims = UVec3::splat(1 << 10)).contains("voxels"));
        assert!(fault(|l| l.origin.z = i32::MIN).contains("origin"));
        assert!(fault(|l| l.voxel_edge_m = f32::NAN).contains("edge"));
        assert_eq!(Layout::bounding(0, 1.0, []), Err(LayoutError::Nothing));
        assert!(Layout::bounding(0, 1.0, [IVec3::MIN, IVec3::MAX]).is_err());
    }

    #[test]
    fn a_bounding_box_fits() {
        let layout = Layout::bounding(1, 0.5, [IVec3::new(1, -2, 3), IVec3::new(-1, 2, 3)]).unwrap();
        assert_eq!((layout.origin, layout.dims), (IVec3::new(-1, -2, 3), UVec3::new(3, 5, 1)));
        let moved = layout.centred_on(Vec3::new(10.2, 0.0, 0.0));
        assert_eq!(moved.origin, IVec3::new(19, -2, 0));
    }
}
