//! Compiled compute shaders.

use super::engine::Engine;
use super::uniforms::ScalePlan;

const COMMON: &str = include_str!("shaders/common.wgsl");

macro_rules! shader {
    ($name:literal) => {
        include_str!(concat!("shaders/", $name, ".wgsl"))
    };
}

/// Kernels that all scales share.
pub(super) struct Kernels {
    pub(super) halve: wgpu::ComputePipeline,
    pub(super) prepare: wgpu::ComputePipeline,
    pub(super) score: wgpu::ComputePipeline,
    pub(super) check: wgpu::ComputePipeline,
    pub(super) seed: wgpu::ComputePipeline,
    pub(super) slopes: wgpu::ComputePipeline,
    pub(super) windows: wgpu::ComputePipeline,
    pub(super) windows_again: wgpu::ComputePipeline,
    pub(super) limit: wgpu::ComputePipeline,
    pub(super) lay_out: wgpu::ComputePipeline,
    pub(super) runs: wgpu::ComputePipeline,
    pub(super) join: wgpu::ComputePipeline,
    pub(super) count: wgpu::ComputePipeline,
    pub(super) remove: wgpu::ComputePipeline,
    pub(super) filter_confidence: wgpu::ComputePipeline,
    pub(super) median: wgpu::ComputePipeline,
    pub(super) bridge_rows: wgpu::ComputePipeline,
    pub(super) bridge_columns: wgpu::ComputePipeline,
    pub(super) pack: wgpu::ComputePipeline,
}

impl Kernels {
    pub(super) fn new(engine: &Engine) -> Self {
        let module = |source: &str| compile(engine, &format!("{COMMON}\n{source}"));
        let (plan, speckle, finish) =
            (module(shader!("plan")), module(shader!("speckle")), module(shader!("finish")));
        let planning = |entry| pipeline(engine, &plan, entry);
        let island = |entry| pipeline(engine, &speckle, entry);
        let last = |entry| pipeline(engine, &finish, entry);
        let one = |source, entry| pipeline(engine, &module(source), entry);
        Self {
            halve: one(shader!("halve"), "halve"),
            prepare: one(shader!("prepare"), "prepare"),
            score: one(shader!("cost"), "score"),
            check: one(shader!("check"), "check"),
            seed: planning("seed"),
            slopes: planning("slopes"),
            windows: planning("windows"),
            windows_again: planning("windows_again"),
            limit: planning("limit"),
            lay_out: planning("lay_out"),
            runs: island("runs"),
            join: island("join"),
            count: island("count"),
            remove: island("remove"),
            filter_confidence: last("filter_confidence"),
            median: last("median"),
            bridge_rows: last("bridge_rows"),
            bridge_columns: last("bridge_columns"),
            pack: last("pack"),
        }
    }
}

/// Kernels of one scale, whose workgroup memory depends on its size.
pub(super) struct ScaleKernels {
    pub(super) advance: wgpu::ComputePipeline,
    pub(super) pick: wgpu::ComputePipeline,
}

impl ScaleKernels {
    pub(super) fn new(engine: &Engine, scale: &ScalePlan) -> Self {
        let sizes = format!("const LANES = {}u;\nconst WORDS = {}u;\n{COMMON}", scale.lanes, scale.words);
        // If the lanes of a path share a subgroup, their minimum needs no workgroup memory.
        let least =
            if scale.lanes <= engine.subgroup { shader!("min_subgroup") } else { shader!("min_memory") };
        let path = compile(engine, &format!("{sizes}\n{}\n{least}", shader!("path")));
        let winner = compile(engine, &format!("{sizes}\n{}", shader!("winner")));
        Self { advance: pipeline(engine, &path, "advance"), pick: pipeline(engine, &winner, "pick") }
    }
}

fn compile(engine: &Engine, source: &str) -> wgpu::ShaderModule {
    engine.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    })
}

fn pipeline(engine: &Engine, module: &wgpu::ShaderModule, entry: &str) -> wgpu::ComputePipeline {
    engine.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: None,
        module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions {
            // Each kernel writes its workgroup memory before it reads it.
            zero_initialize_workgroup_memory: false,
            ..wgpu::PipelineCompilationOptions::default()
        },
        cache: None,
    })
}
