//! Who looks, from where, how fast.

use crate::ClientError;
use earthshine_protocol::v1;
use glam::Vec3;

/// Where light is wanted, and where it will be wanted soon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// m.
    pub position: Vec3,
    /// Unit.
    pub forward: Vec3,
    /// m/s.
    pub velocity: Vec3,
}

impl Camera {
    pub(crate) fn to_wire(self, sequence: u64) -> Result<v1::CameraUpdate, ClientError> {
        if !(self.position.is_finite() && self.forward.is_finite() && self.velocity.is_finite()) {
            return Err(ClientError::Invalid {
                cause: format!("a camera with numbers that are not finite: {self:?}"),
            });
        }
        Ok(v1::CameraUpdate {
            sequence,
            position: Some(vector_to_wire(self.position)),
            forward: Some(vector_to_wire(self.forward)),
            velocity: Some(vector_to_wire(self.velocity)),
        })
    }
}

pub(crate) fn vector_to_wire(vector: Vec3) -> v1::Vector3 {
    v1::Vector3 { x: vector.x, y: vector.y, z: vector.z }
}

/// An absent vector is zero, as everywhere in protobuf.
pub(crate) fn vector_from_wire(vector: Option<v1::Vector3>, what: &str) -> Result<Vec3, ClientError> {
    let vector = vector.map_or(Vec3::ZERO, |v| Vec3::new(v.x, v.y, v.z));
    if vector.is_finite() {
        Ok(vector)
    } else {
        Err(ClientError::protocol(format!("{what} is not finite: {vector}")))
    }
}
