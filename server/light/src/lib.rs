//! Lamps, sun and sky to direct exitance (in the making).
use earthshine_world::OccluderMesh;
/// One chunk's shadow casters, ready for rays.
#[derive(Debug)]
pub struct Occluders;
impl Occluders {
    /// Builds the tree over `mesh`.
    #[must_use]
    pub fn build(_mesh: &OccluderMesh) -> Self {
        Self
    }
}
