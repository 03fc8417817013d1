//! Goal: a shader that does not compile, or disagrees with Rust, fails here and not in a user's engine or on a device.
//! Method: naga parses and validates each source; names, offsets, types, bindings, access, workgroup sizes and
//! constants are compared with the Rust side. Each comparison is shown to notice.

use earthshine_shaders::LOOKUP_IRRADIANCE;
use earthshine_shaders::host::LAYOUTS;
use earthshine_shaders::kernel::{
    Access, Binding, KERNELS, Kernel, LIGHT_POINTS, MEASURE_LIGHT, TRACE_CLOSEST,
};
use earthshine_shaders::limits::CONSTANTS;
use earthshine_shaders::subgroups::{NUMBER_LANES, SUBGROUP_LANES_RANGE};
use earthshine_volume::barrier;
use earthshine_volume::lookup::{AIR_FLOOR, NORMAL_OFFSET_VOXELS, SURFACE_WEIGHT, WEIGHT_MIN};
use earthshine_volume::plane::{
    AIR_FROM_VOXELS, FAR_SURFACE, PLANE_REACH_VOXELS, PLANE_STEPS, SURFACE_TO_VOXELS,
};
use earthshine_volume::tilt::{TILT_REACH_VOXELS, TURN_REACH};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{AddressSpace, Literal, StorageAccess, TypeInner};
use std::collections::BTreeSet;

fn parsed(source: &str) -> naga::Module {
    parsed_for(source, Capabilities::default())
}

/// For devices of these capabilities.
fn parsed_for(source: &str, capabilities: Capabilities) -> naga::Module {
    let module =
        naga::front::wgsl::parse_str(source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(source)));
    if let Err(error) = Validator::new(ValidationFlags::all(), capabilities).validate(&module) {
        panic!("{}", error.emit_to_string(source));
    }
    module
}

fn constant(module: &naga::Module, name: &str) -> Option<Literal> {
    let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name))?;
    match module.global_expressions[constant.init] {
        naga::Expression::Literal(value) => Some(value),
        ref other => panic!("{name} is {other:?}"),
    }
}

fn type_name(module: &naga::Module, handle: naga::Handle<naga::Type>) -> String {
    let scalar = |scalar: naga::Scalar| match scalar.kind {
        naga::ScalarKind::Float => format!("f{}", scalar.width * 8),
        naga::ScalarKind::Uint => format!("u{}", scalar.width * 8),
        naga::ScalarKind::Sint => format!("i{}", scalar.width * 8),
        other => panic!("{other:?}"),
    };
    match &module.types[handle].inner {
        TypeInner::Scalar(of) => scalar(*of),
        TypeInner::Vector { size, scalar: of } => format!("vec{}<{}>", *size as u32, scalar(*of)),
        other => panic!("no host type for {other:?}"),
    }
}

/// What in `module` disagrees with the Rust side, in words.
fn disagreements(kernel: &Kernel, module: &naga::Module) -> Vec<String> {
    let mut found = Vec::new();
    found.extend(entry_point_disagreement(kernel, module));
    found.extend(binding_disagreement(kernel, module));
    for (name, value) in CONSTANTS {
        if let Some(wgsl) = constant(module, name).filter(|wgsl| *wgsl != Literal::U32(*value)) {
            found.push(format!("{name} is {value} in Rust, {wgsl:?} in WGSL"));
        }
    }
    for (_, of) in module.types.iter() {
        let (Some(name), TypeInner::Struct { members, span }) = (&of.name, &of.inner) else { continue };
        // What a compare and exchange returns: naga's own.
        if name.starts_with("__") {
            continue;
        }
        let wgsl: Vec<(String, usize, String)> = members
            .iter()
            .map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize, type_name(module, m.ty)))
            .collect();
        match LAYOUTS.iter().find(|layout| layout.name == name) {
            None => found.push(format!("struct {name} has no host struct")),
            Some(layout) => {
                let host: Vec<(String, usize, String)> = layout
                    .fields
                    .iter()
                    .map(|&(name, at, of)| (name.to_owned(), at, of.to_owned()))
                    .collect();
                if host != wgsl || layout.size != *span as usize {
                    let size = layout.size;
                    found.push(format!(
                        "struct {name}: {host:?} of {size} in Rust, {wgsl:?} of {span} in WGSL"
                    ));
                }
            }
        }
    }
    found
}

fn entry_point_disagreement(kernel: &Kernel, module: &naga::Module) -> Option<String> {
    let points: Vec<_> = module.entry_points.iter().map(|p| (p.name.as_str(), p.workgroup_size)).collect();
    (points != [(kernel.name, kernel.workgroup_size)])
        .then(|| format!("entry points are {points:?}, not {:?} alone", (kernel.name, kernel.workgroup_size)))
}

fn binding_disagreement(kernel: &Kernel, module: &naga::Module) -> Option<String> {
    let mut wgsl: Vec<(u32, u32, String, Access)> = module
        .global_variables
        .iter()
        .filter_map(|(_, variable)| {
            let binding = variable.binding.as_ref()?;
            let access = match variable.space {
                AddressSpace::Uniform => Access::Uniform,
                AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => {
                    Access::ReadWrite
                }
                AddressSpace::Storage { .. } => Access::Read,
                ref other => panic!("{other:?}"),
            };
            Some((binding.group, binding.binding, variable.name.clone().unwrap_or_default(), access))
        })
        .collect();
    wgsl.sort_by_key(|&(group, binding, ..)| (group, binding));
    let host: Vec<(u32, u32, String, Access)> = (0..)
        .zip(kernel.bindings)
        .map(|(number, &Binding { name, access })| (0, number, name.to_owned(), access))
        .collect();
    (wgsl != host).then(|| format!("bindings are {host:?} in Rust, {wgsl:?} in WGSL"))
}

#[test]
fn every_kernel_is_valid_and_agrees_with_rust() {
    for kernel in KERNELS {
        let found = disagreements(kernel, &parsed(kernel.source));
        assert!(found.is_empty(), "{}: {found:#?}", kernel.name);
    }
}

/// Goal: kernels by way of subgroups are valid where there are any, and only there; they are what the others are but for how
/// lanes add up. Method: every size of subgroups; the kernels that scan or add across a workgroup, by name.
#[test]
fn kernels_by_way_of_subgroups_agree_with_rust() {
    let lanes = (2..=7).map(|bits| 1u32 << bits);
    for (kernel, lanes) in KERNELS.iter().flat_map(|kernel| lanes.clone().map(move |lanes| (kernel, lanes))) {
        assert!(SUBGROUP_LANES_RANGE.contains(&lanes));
        let source = kernel.subgroup_source(lanes);
        let is_shared =
            ["lane_counts", "lane_sums", "firsts"].iter().any(|name| kernel.source.contains(name));
        assert_eq!(source.is_some(), is_shared, "{}", kernel.name);
        let Some(source) = source else { continue };
        assert!(source.contains("subgroup") && !kernel.source.contains("subgroup"), "{}", kernel.name);
        let module = parsed_for(&source, Capabilities::SUBGROUP);
        assert_eq!(disagreements(kernel, &module), Vec::<String>::new(), "{}", kernel.name);
        assert_eq!(constant(&module, "SUBGROUP_LANES"), Some(Literal::U32(lanes)));
        let refused = Validator::new(ValidationFlags::all(), Capabilities::default()).validate(&module);
        assert!(refused.is_err(), "{}", kernel.name);
    }
    let module = parsed_for(NUMBER_LANES.source, Capabilities::SUBGROUP);
    assert_eq!(disagreements(&NUMBER_LANES, &module), Vec::<String>::new());
}

/// Goal: no kernel without a description, none described twice, no host struct that nothing uses.
#[test]
fn the_list_of_kernels_is_the_folder() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("wgsl/kernels");
    let files: BTreeSet<String> = std::fs::read_dir(folder)
        .expect("the kernels")
        .map(|entry| {
            entry.expect("a file").path().file_stem().expect("a name").to_string_lossy().into_owned()
        })
        .collect();
    let names: BTreeSet<String> = KERNELS.iter().map(|kernel| kernel.name.to_owned()).collect();
    assert_eq!(files, names);
    assert_eq!(names.len(), KERNELS.len(), "each once");
    for layout in LAYOUTS {
        let declares = |kernel: &&Kernel| kernel.source.contains(&format!("struct {} {{", layout.name));
        assert!(KERNELS.iter().any(|kernel| declares(&kernel)), "{} has no twin in WGSL", layout.name);
    }
}

/// Goal: the comparison can fail. Method: one small change at a time in valid sources.
#[test]
fn every_kind_of_drift_is_noticed() {
    let drifts = [
        ("multiply_tiles", "fn multiply_tiles(", "fn multiply_all("),
        ("multiply_tiles", "@workgroup_size(256)", "@workgroup_size(128)"),
        ("multiply_tiles", "var<storage, read> sent", "var<storage, read_write> sent"),
        ("multiply_tiles", "@binding(3) var<storage, read> marks", "@binding(9) var<storage, read> marks"),
        ("multiply_tiles", "const TILE_EDGE: u32 = 64u", "const TILE_EDGE: u32 = 32u"),
        ("sum_tiles", "reflectance: vec3<f32>", "reflectance: vec4<f32>"),
        ("sum_tiles", "    area: f32,", "    area: f32, extra: f32,"),
        ("scatter_exchange", "    at: u32, ", "    at: i32, "),
        ("rank_update", "    entry_count: u32, ", "    count_of_entries: u32, "),
        ("copy_columns", "    slot: u32,     // 0\n    place: u32,", "    place: u32,\n    slot: u32,"),
        (
            "write_columns",
            "struct Member {",
            "struct Unknown { x: u32 }\nvar<private> y: Unknown;\nstruct Member {",
        ),
    ];
    for (name, from, to) in drifts {
        let kernel = KERNELS.iter().find(|kernel| kernel.name == name).expect("a kernel");
        assert!(kernel.source.contains(from), "{name} has {from:?}");
        let source = kernel.source.replace(from, to);
        let module = naga::front::wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{from:?}: {e}"));
        let found = disagreements(kernel, &module);
        assert!(!found.is_empty(), "{name}: {from:?} for {to:?} went unnoticed");
    }
}

fn f32_constant(module: &naga::Module, name: &str) -> f32 {
    match constant(module, name) {
        Some(Literal::F32(value)) => value,
        other => panic!("{name} is {other:?}"),
    }
}

#[test]
fn a_device_knows_what_is_dark_as_the_cpu_does() {
    use earthshine_radiosity::solver::step_gather::DARKEST;
    assert_eq!(f32_constant(&parsed(MEASURE_LIGHT.source), "DARKEST"), DARKEST);
}

/// Goal: a device follows rays by the rules of the CPU.
#[test]
fn the_tracing_kernels_have_the_constants_of_the_cpu() {
    use earthshine_light::arrival::CONE_COSINES_MIN;
    use earthshine_light::direct::GOLDEN_TURN;
    use earthshine_light::occluders::TRANSMITTANCE_MIN;
    use earthshine_light::ray_triangle::EDGE_TOLERANCE;
    use earthshine_trace::{RUN_UP_M, TIE_ROOM};
    let module = parsed(TRACE_CLOSEST.source);
    assert_eq!(f32_constant(&module, "EDGE_TOLERANCE"), EDGE_TOLERANCE);
    assert_eq!(f32_constant(&module, "DIRECTION_MIN"), f32::EPSILON);
    assert_eq!(f32_constant(&module, "TIE_ROOM"), TIE_ROOM);
    assert_eq!(f32_constant(&module, "RUN_UP_M"), RUN_UP_M);
    let module = parsed(LIGHT_POINTS.source);
    assert_eq!(f32_constant(&module, "CONE_COSINES_MIN"), CONE_COSINES_MIN);
    assert_eq!(f32_constant(&module, "GOLDEN_TURN"), GOLDEN_TURN);
    assert_eq!(f32_constant(&module, "TRANSMITTANCE_MIN"), TRANSMITTANCE_MIN);
}

fn span(module: &naga::Module, name: &str) -> u32 {
    let found = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name));
    match found.unwrap_or_else(|| panic!("no struct {name}")).1.inner {
        TypeInner::Struct { span, .. } => span,
        ref other => panic!("{name} is {other:?}"),
    }
}

#[test]
fn the_lookup_shader_is_valid_and_has_the_rust_rule_s_constants() {
    let module = parsed(LOOKUP_IRRADIANCE);
    assert_eq!(f32_constant(&module, "NORMAL_OFFSET_VOXELS"), NORMAL_OFFSET_VOXELS);
    assert_eq!(f32_constant(&module, "SURFACE_WEIGHT"), SURFACE_WEIGHT);
    assert_eq!(f32_constant(&module, "AIR_FLOOR"), AIR_FLOOR);
    assert_eq!(f32_constant(&module, "WEIGHT_MIN"), WEIGHT_MIN);
    assert_eq!(f32_constant(&module, "PLANE_REACH_VOXELS"), PLANE_REACH_VOXELS);
    assert_eq!(f32_constant(&module, "SURFACE_TO_VOXELS"), SURFACE_TO_VOXELS);
    assert_eq!(f32_constant(&module, "AIR_FROM_VOXELS"), AIR_FROM_VOXELS);
    assert_eq!(f32_constant(&module, "FAR_SURFACE"), FAR_SURFACE);
    assert_eq!(f32_constant(&module, "PLANE_STEPS"), PLANE_STEPS);
    assert_eq!(f32_constant(&module, "TILT_REACH_VOXELS"), TILT_REACH_VOXELS);
    assert_eq!(f32_constant(&module, "TURN_REACH"), TURN_REACH);
    assert_eq!(f32_constant(&module, "BARRIER_REACH_VOXELS"), barrier::BARRIER_REACH_VOXELS);
    assert_eq!(f32_constant(&module, "BARRIER_ANGLES"), f32::from(barrier::BARRIER_ANGLES));
    assert_eq!(f32_constant(&module, "BARRIER_STEPS"), f32::from(barrier::BARRIER_STEPS));
    assert_eq!(f32_constant(&module, "BEYOND_REACH_VOXELS"), barrier::BEYOND_REACH_VOXELS);
    assert_eq!(f32_constant(&module, "BEYOND_MAX_VOXELS"), barrier::BEYOND_MAX_VOXELS);
    assert_eq!((span(&module, "VolumeLayout"), span(&module, "VoxelBlock")), (48, 76));
}
