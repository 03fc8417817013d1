//! Which graphics adapters there are, which one is taken, and what it can hold.

use crate::memory;
use wgpu::{Adapter, Backends, DeviceType, DownlevelFlags, Features, Instance, InstanceDescriptor, Limits};

/// Which adapter to take, and what of it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct AdapterChoice {
    /// Part of its name, upper or lower case alike; any if empty. A software adapter that is named is taken.
    pub name: String,
    /// Whether an adapter that computes on the CPU will do: for tests of shaders, never for use.
    pub allow_software: bool,
    /// Kernels do without subgroups, even where the adapter has some that they could use: to find out what these save, or
    /// where a driver's are at fault.
    pub without_subgroups: bool,
}

/// Why there is no device.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// No driver, or none that wgpu can use.
    #[error(
        "no graphics adapter was found; install a Vulkan, Metal or Direct3D 12 driver, or use backend = \"cpu\""
    )]
    NoAdapter,
    /// Adapters there are, but not the one asked for.
    #[error("no graphics adapter is named like {wanted:?}; there are {found}; `earthshine gpu` lists them")]
    NotFound {
        /// Part of a name.
        wanted: String,
        /// The names there are.
        found: String,
    },
    /// Only adapters that compute on the CPU.
    #[error("{name} computes on the CPU, where backend = \"cpu\" is faster; name it to use it all the same")]
    Software {
        /// Of the first.
        name: String,
    },
    /// A driver without compute shaders, or with too little room in a workgroup.
    #[error("{name} cannot run the kernels: {cause}; update its driver or use backend = \"cpu\"")]
    Incapable {
        /// Of the adapter.
        name: String,
        /// What it lacks.
        cause: String,
    },
    /// The driver refused.
    #[error("{name} gave no device: {cause}")]
    Refused {
        /// Of the adapter.
        name: String,
        /// What the driver said.
        cause: String,
    },
}

/// One adapter, as `earthshine gpu` lists it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterReport {
    /// As the driver names it.
    pub name: String,
    /// Its driver and version.
    pub driver: String,
    /// The API it is reached through.
    pub api: String,
    /// Discrete, integrated, virtual, software or other.
    pub kind: &'static str,
    /// Whether it computes on the CPU.
    pub is_software: bool,
    /// Largest buffer that a kernel can bind, bytes.
    pub binding_bytes_max: u64,
    /// Largest buffer, bytes.
    pub buffer_bytes_max: u64,
    /// Room that the threads of a workgroup share, bytes.
    pub workgroup_bytes_max: u32,
    /// Threads of a subgroup: least and most.
    pub subgroup_sizes: (u32, u32),
    /// Whether kernels may use subgroups.
    pub has_subgroups: bool,
    /// Whether kernels may use 16-bit floats.
    pub has_f16: bool,
    /// Whether the time of each pass can be measured.
    pub has_timestamps: bool,
    /// Most patches whose planes bind whole; above it they are split.
    pub slots_unsplit_max: u32,
    /// Most patches that its limits allow. What its memory holds is known when it is asked for.
    pub slots_max: u32,
    /// Why it cannot be used, if it cannot.
    pub unusable: Option<String>,
}

/// Every adapter there is, in the order of the drivers.
#[must_use]
pub fn list() -> Vec<AdapterReport> {
    pollster::block_on(instance().enumerate_adapters(Backends::all())).iter().map(report).collect()
}

pub(crate) fn instance() -> Instance {
    Instance::new(InstanceDescriptor::new_without_display_handle_from_env())
}

/// The adapter that `choice` means: discrete before integrated before others, the first of a kind.
pub(crate) fn choose(instance: &Instance, choice: &AdapterChoice) -> Result<Adapter, GpuError> {
    let mut adapters = pollster::block_on(instance.enumerate_adapters(Backends::all()));
    if adapters.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    let names: Vec<String> = adapters.iter().map(|adapter| adapter.get_info().name).collect();
    let wanted = choice.name.to_lowercase();
    adapters.retain(|adapter| adapter.get_info().name.to_lowercase().contains(&wanted));
    if adapters.is_empty() {
        return Err(GpuError::NotFound { wanted: choice.name.clone(), found: names.join(", ") });
    }
    adapters.sort_by_key(|adapter| rank(adapter.get_info().device_type));
    let adapter = adapters.swap_remove(0);
    let info = adapter.get_info();
    if info.device_type == DeviceType::Cpu && !choice.allow_software && choice.name.is_empty() {
        return Err(GpuError::Software { name: info.name });
    }
    match lacks_of(&adapter) {
        Some(cause) => Err(GpuError::Incapable { name: info.name, cause }),
        None => Ok(adapter),
    }
}

fn rank(kind: DeviceType) -> u8 {
    match kind {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}

/// What the kernels need of a device; the rest is as low as a device may be.
pub(crate) fn required_limits(of: &Limits) -> Limits {
    Limits {
        max_compute_workgroup_storage_size: WORKGROUP_BYTES,
        max_storage_buffers_per_shader_stage: 8,
        max_storage_buffer_binding_size: of.max_storage_buffer_binding_size,
        max_buffer_size: of.max_buffer_size,
        ..Limits::downlevel_defaults()
    }
}

/// Most that the threads of a workgroup share: two blocks of 64 x 32 numbers.
const WORKGROUP_BYTES: u32 = 16 << 10;

fn lacks_of(adapter: &Adapter) -> Option<String> {
    lacks(adapter.get_downlevel_capabilities().flags, &adapter.limits())
}

/// What a driver with these flags and limits is short of.
fn lacks(flags: DownlevelFlags, limits: &Limits) -> Option<String> {
    if !flags.contains(DownlevelFlags::COMPUTE_SHADERS) {
        return Some("it has no compute shaders".to_owned());
    }
    let mut cause = None;
    required_limits(limits).check_limits_with_fail_fn(limits, true, |name, wanted, allowed| {
        cause = Some(format!("{name} is {allowed}, {wanted} is needed"));
    });
    let binding = binding_bytes(limits);
    let is_short = cause.is_none() && memory::slots_max(binding) == 0;
    cause.or_else(|| is_short.then(|| format!("a binding holds {binding} bytes, too few for any patch")))
}

/// Largest buffer that a kernel can be given, bytes.
fn binding_bytes(limits: &Limits) -> u64 {
    limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
}

fn report(adapter: &Adapter) -> AdapterReport {
    let (info, limits, features) = (adapter.get_info(), adapter.limits(), adapter.features());
    let binding = binding_bytes(&limits);
    AdapterReport {
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        api: info.backend.to_string(),
        kind: match info.device_type {
            DeviceType::DiscreteGpu => "discrete",
            DeviceType::IntegratedGpu => "integrated",
            DeviceType::VirtualGpu => "virtual",
            DeviceType::Cpu => "software",
            DeviceType::Other => "other",
        },
        is_software: info.device_type == DeviceType::Cpu,
        binding_bytes_max: limits.max_storage_buffer_binding_size,
        buffer_bytes_max: limits.max_buffer_size,
        workgroup_bytes_max: limits.max_compute_workgroup_storage_size,
        subgroup_sizes: (info.subgroup_min_size, info.subgroup_max_size),
        has_subgroups: features.contains(Features::SUBGROUP),
        has_f16: features.contains(Features::SHADER_F16),
        has_timestamps: features.contains(Features::TIMESTAMP_QUERY),
        slots_unsplit_max: memory::slots_unsplit_max(binding),
        slots_max: memory::slots_max(binding),
        unusable: lacks_of(adapter),
        name: info.name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GpuDevice;
    use std::io::Write as _;

    /// Goal: a driver that cannot run the kernels is refused, and what it lacks is named. Method: what is needed, then
    /// without compute shaders, and each limit that a kernel is up against lowered by one.
    #[test]
    fn drivers_that_lack_anything_are_refused_by_its_name() {
        let all = DownlevelFlags::all();
        let enough = required_limits(&Limits::default());
        assert_eq!(lacks(all, &enough), None);
        let without = lacks(all - DownlevelFlags::COMPUTE_SHADERS, &enough).expect("no compute");
        assert!(without.contains("compute shaders"), "{without}");
        type Lowered = (&'static str, fn(&mut Limits));
        let lowered: [Lowered; 9] = [
            ("max_compute_workgroup_storage_size", |of| of.max_compute_workgroup_storage_size -= 1),
            ("max_compute_invocations_per_workgroup", |of| of.max_compute_invocations_per_workgroup -= 1),
            ("max_compute_workgroup_size_x", |of| of.max_compute_workgroup_size_x -= 1),
            ("max_compute_workgroups_per_dimension", |of| of.max_compute_workgroups_per_dimension -= 1),
            ("max_storage_buffers_per_shader_stage", |of| of.max_storage_buffers_per_shader_stage -= 1),
            ("max_bindings_per_bind_group", |of| of.max_bindings_per_bind_group -= 1),
            ("max_uniform_buffer_binding_size", |of| of.max_uniform_buffer_binding_size -= 1),
            ("max_dynamic_uniform_buffers_per_pipeline_layout", |of| {
                of.max_dynamic_uniform_buffers_per_pipeline_layout -= 1;
            }),
            ("a binding holds 1024 bytes", |of| of.max_storage_buffer_binding_size = 1024),
        ];
        for (name, lower) in lowered {
            let mut limits = enough.clone();
            lower(&mut limits);
            let cause = lacks(all, &limits).unwrap_or_else(|| panic!("{name} is needed"));
            assert!(cause.contains(name), "{cause} for {name}");
            let refusal = GpuError::Incapable { name: "it".to_owned(), cause }.to_string();
            assert!(refusal.contains(name) && refusal.contains("cpu"), "{refusal}");
        }
    }

    /// Goal: what computes on the CPU is used only by who asks for it, by name or by leave; a name that nobody has is said
    /// with those there are. Method: whatever adapters there are.
    #[test]
    fn a_software_adapter_is_used_only_when_asked() {
        let wanted = AdapterChoice {
            name: "an adapter that nobody has".to_owned(),
            allow_software: true,
            ..AdapterChoice::default()
        };
        let refused = GpuDevice::open(&wanted).map(drop);
        let Some(software) = list().into_iter().find(|adapter| adapter.is_software) else {
            assert!(matches!(refused, Err(GpuError::NoAdapter | GpuError::NotFound { .. })), "{refused:?}");
            assert!(!list().is_empty() || std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none());
            writeln!(std::io::stderr(), "SKIPPED a test of software adapters: there is none")
                .expect("standard error");
            return;
        };
        let Err(GpuError::NotFound { found, .. }) = refused else { panic!("{refused:?}") };
        assert!(found.contains(&software.name), "{found}");
        let open = |name: &str, allow_software| {
            GpuDevice::open(&AdapterChoice {
                name: name.to_owned(),
                allow_software,
                ..AdapterChoice::default()
            })
        };
        if list().iter().all(|adapter| adapter.is_software) {
            let refused = open("", false).map(drop);
            assert!(
                matches!(&refused, Err(GpuError::Software { name }) if *name == software.name),
                "{refused:?}"
            );
            assert!(open("", true).is_ok(), "with leave");
        }
        let named = open(&software.name.to_uppercase(), false).expect("it is named");
        assert_eq!(named.name(), software.name);
    }
}
