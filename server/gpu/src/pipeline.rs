//! From the description of a kernel to what a device runs: one function for all kernels.

use earthshine_shaders::host::Pass;
use earthshine_shaders::kernel::{Access, KERNELS, Kernel};
use std::borrow::Cow;
use std::collections::BTreeMap;
use wgpu::{
    BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType, BufferBindingType,
    BufferSize, ComputePipeline, ComputePipelineDescriptor, Device, PipelineCache,
    PipelineCompilationOptions, PipelineLayoutDescriptor, ShaderModuleDescriptor, ShaderRuntimeChecks,
    ShaderSource, ShaderStages,
};

/// A kernel, compiled.
#[derive(Debug)]
pub(crate) struct Pipeline {
    pub(crate) layout: BindGroupLayout,
    pub(crate) compute: ComputePipeline,
}

/// Compiles every kernel, or takes it from `cache`; for subgroups of so many lanes, if any.
pub(crate) fn compile_all(
    device: &Device,
    subgroup_lanes: Option<u32>,
    cache: Option<&PipelineCache>,
) -> BTreeMap<&'static str, Pipeline> {
    let source = |kernel: &Kernel| match subgroup_lanes.and_then(|lanes| kernel.subgroup_source(lanes)) {
        Some(source) => Cow::Owned(source),
        None => Cow::Borrowed(kernel.source),
    };
    KERNELS.iter().map(|kernel| (kernel.name, compile(device, kernel, source(kernel), cache))).collect()
}

/// Compiles one kernel from its source, or a variant of it.
pub(crate) fn compile(
    device: &Device,
    kernel: &Kernel,
    source: Cow<'static, str>,
    cache: Option<&PipelineCache>,
) -> Pipeline {
    let entries = (0..).zip(kernel.bindings).map(|(number, binding)| BindGroupLayoutEntry {
        binding: number,
        visibility: ShaderStages::COMPUTE,
        ty: match binding.access {
            Access::Uniform => BindingType::Buffer {
                ty: BufferBindingType::Uniform,
                has_dynamic_offset: true,
                min_binding_size: BufferSize::new(size_of::<Pass>() as u64),
            },
            Access::Read | Access::ReadWrite => BindingType::Buffer {
                ty: BufferBindingType::Storage { read_only: binding.access == Access::Read },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
        },
        count: None,
    });
    let entries: Vec<BindGroupLayoutEntry> = entries.collect();
    let label = Some(kernel.name);
    let layout = device.create_bind_group_layout(&BindGroupLayoutDescriptor { label, entries: &entries });
    let pipeline_layout = device.create_pipeline_layout(&PipelineLayoutDescriptor {
        label,
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    let source = ShaderModuleDescriptor { label, source: ShaderSource::Wgsl(source) };
    let checks = ShaderRuntimeChecks { int_div_checks: true, ..ShaderRuntimeChecks::unchecked() };
    // SAFETY: the kernels are ours, validated by naga in a test, loop over counts that the host gives, and index what the
    // host sizes from the same counts; callers' updates are checked by `UpdateCheck` before any of them is uploaded.
    let module = unsafe { device.create_shader_module_trusted(source, checks) };
    let compute = device.create_compute_pipeline(&ComputePipelineDescriptor {
        label,
        layout: Some(&pipeline_layout),
        module: &module,
        entry_point: Some(kernel.name),
        // Every kernel writes what its workgroup shares before it reads it.
        compilation_options: PipelineCompilationOptions {
            constants: &[],
            zero_initialize_workgroup_memory: false,
        },
        cache,
    });
    Pipeline { layout, compute }
}
