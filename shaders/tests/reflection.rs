//! Goal: a shader that does not compile, or disagrees with Rust, fails here and not in a user's engine.
//! Method: naga parses and validates each source; its constants and struct sizes are compared with Rust's.

use earthshine_shaders::LOOKUP_IRRADIANCE;
use earthshine_volume::lookup::{AIR_FLOOR, NORMAL_OFFSET_VOXELS, SURFACE_WEIGHT, WEIGHT_MIN};
use earthshine_volume::plane::{PLANE_REACH_VOXELS, PLANE_STEPS};
use naga::valid::{Capabilities, ValidationFlags, Validator};

fn parsed(source: &str) -> naga::Module {
    let module =
        naga::front::wgsl::parse_str(source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(source)));
    Validator::new(ValidationFlags::all(), Capabilities::default())
        .validate(&module)
        .expect("a valid module");
    module
}

fn constant(module: &naga::Module, name: &str) -> f32 {
    let found = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name));
    let (_, constant) = found.unwrap_or_else(|| panic!("no constant {name}"));
    match module.global_expressions[constant.init] {
        naga::Expression::Literal(naga::Literal::F32(value)) => value,
        ref other => panic!("{name} is {other:?}"),
    }
}

fn span(module: &naga::Module, name: &str) -> u32 {
    let found = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name));
    match found.unwrap_or_else(|| panic!("no struct {name}")).1.inner {
        naga::TypeInner::Struct { span, .. } => span,
        ref other => panic!("{name} is {other:?}"),
    }
}

#[test]
fn the_lookup_shader_is_valid_and_has_the_rust_rule_s_constants() {
    let module = parsed(LOOKUP_IRRADIANCE);
    assert_eq!(constant(&module, "NORMAL_OFFSET_VOXELS"), NORMAL_OFFSET_VOXELS);
    assert_eq!(constant(&module, "SURFACE_WEIGHT"), SURFACE_WEIGHT);
    assert_eq!(constant(&module, "AIR_FLOOR"), AIR_FLOOR);
    assert_eq!(constant(&module, "WEIGHT_MIN"), WEIGHT_MIN);
    assert_eq!(constant(&module, "PLANE_REACH_VOXELS"), PLANE_REACH_VOXELS);
    assert_eq!(constant(&module, "PLANE_STEPS"), PLANE_STEPS);
    assert_eq!((span(&module, "VolumeLayout"), span(&module, "VoxelBlock")), (32, 36));
}
