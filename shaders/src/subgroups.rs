//! Kernels that add up and scan across a workgroup, by way of subgroups where a device has them.
//!
//! Some of what kernels are put together from exists twice: in `wgsl/common` over memory that a workgroup shares, in
//! `wgsl/subgroups` with fewer barriers. Both give the same bits: integers in any order, floats in one. The second counts on
//! subgroups of consecutive lanes, as many in each as it is told: a host makes sure by [`NUMBER_LANES`].

use crate::kernel::{Access, Binding, Kernel};

/// What exists twice: over shared memory, and over subgroups.
const PIECES: [(&str, &str); 3] = [
    (include_str!("../wgsl/common/lane_scan.wgsl"), include_str!("../wgsl/subgroups/lane_scan.wgsl")),
    (include_str!("../wgsl/common/span_sum.wgsl"), include_str!("../wgsl/subgroups/span_sum.wgsl")),
    (include_str!("../wgsl/common/pair_sum.wgsl"), include_str!("../wgsl/subgroups/pair_sum.wgsl")),
];

/// Fewest and most lanes of a subgroup that kernels count on.
pub const SUBGROUP_LANES_RANGE: std::ops::RangeInclusive<u32> = 4..=128;

/// Tells how subgroups lie in a workgroup. Not among [`KERNELS`](crate::kernel::KERNELS): only devices with subgroups have it.
pub const NUMBER_LANES: Kernel = Kernel {
    name: "number_lanes",
    source: concat!(
        include_str!("../wgsl/common/limits.wgsl"),
        include_str!("../wgsl/common/pass.wgsl"),
        include_str!("../wgsl/subgroups/number_lanes.wgsl"),
    ),
    bindings: &[
        Binding { name: "pass_of", access: Access::Uniform },
        Binding { name: "lanes", access: Access::ReadWrite },
    ],
    workgroup_size: [crate::limits::LANES, 1, 1],
};

/// What [`NUMBER_LANES`] finds of `lane` if subgroups are `lanes` consecutive lanes each; its last number is of meaning in
/// all lanes of a subgroup but the last.
#[must_use]
pub const fn numbered(lane: u32, lanes: u32) -> [u32; 4] {
    [lanes, lane / lanes * lanes, lane % lanes, lane + 1]
}

impl Kernel {
    /// Its source for subgroups of `lanes` consecutive lanes, a power of two in [`SUBGROUP_LANES_RANGE`]; none if it is the same.
    #[must_use]
    pub fn subgroup_source(&self, lanes: u32) -> Option<String> {
        debug_assert!(SUBGROUP_LANES_RANGE.contains(&lanes) && lanes.is_power_of_two(), "{lanes}");
        let mut source = self.source.to_owned();
        for (shared, by_subgroups) in PIECES {
            source = source.replace(shared, by_subgroups);
        }
        (source != self.source)
            .then(|| format!("// Of each subgroup.\nconst SUBGROUP_LANES: u32 = {lanes}u;\n{source}"))
    }
}
