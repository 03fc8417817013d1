//! glTF 2.0 and lights JSON to triangles, materials and lights in world space.
//!
//! Not here: rays, voxels, light. Start at [`load`]; [`Scene`] is what every tool works on from there. Skies come with
//! the lights: a colour, a gradient, or an [`EnvironmentMap`] and its projection on the six lobes of the service.
//!
//! | glTF | what becomes of it |
//! |---|---|
//! | .glb, .gltf, external and data-URI buffers and images | read; absolute paths and other schemes are refused |
//! | nodes | composed in f64; mirrored ones keep their front faces; the default scene, or all roots without one |
//! | triangles, strips, fans, indexed or not, sparse accessors | read; points and lines are skipped with a warning |
//! | `EXT_mesh_gpu_instancing`, `KHR_mesh_quantization`, `KHR_node_visibility` | read |
//! | base colour factor and texture, vertex colours | reflectance, clamped to 0.98; for metals too (`metals_black`) |
//! | texture sets, wrap modes, nearest or linear, `KHR_texture_transform` | honoured when sampled; no mipmaps |
//! | emission, `KHR_materials_emissive_strength`, double-sided | radiance of the front face, or both |
//! | alpha mask | holes; blending is masked at 0.5 and counted |
//! | `KHR_materials_unlit`, `KHR_materials_pbrSpecularGlossiness` | base or diffuse colour as reflectance |
//! | `KHR_lights_punctual` | lights in world space |
//! | normals, gloss, transmission, other `KHR_materials_*` | ignored: surfaces are flat, diffuse and opaque |
//! | skins, morph targets, animations | ignored: rest pose |
//! | Draco, meshopt, splats, unknown required extensions | refused by name, with the command that converts |

mod accessor;
mod container;
mod document;
pub mod environment;
mod environment_file;
mod error;
mod extensions;
mod geometry;
mod images;
mod import;
pub mod lights;
mod lights_json;
mod materials;
mod nodes;
mod primitive;
mod punctual;
mod resource;
pub mod scene;
pub mod shared_scenes;
pub mod sky_projection;
pub mod texture;

pub use environment::{EnvironmentError, EnvironmentMap};
pub use error::SceneError;
pub use import::{ImportOptions, load, load_bytes};
pub use lights::{LightsFile, light_rig, load_lights, parse_lights};
pub use scene::{ImportReport, Material, PlacedMesh, Scene, Surface};
pub use shared_scenes::scenes_dir;
pub use sky_projection::SkyProjection;
pub use texture::{Texture, Wrap};
