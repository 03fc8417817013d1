//! glTF to triangles, materials and lights (in the making).
pub mod scene;
pub mod texture;
pub use scene::{ImportReport, Material, Scene, Surface};
pub use texture::{Texture, Wrap};
