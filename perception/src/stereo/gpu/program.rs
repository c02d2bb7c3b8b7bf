//! All buffers and dispatches of a pair, created once; each frame only encodes them.

use super::super::blocks::BLOCK;
use super::super::device::STAGES;
use super::engine::Engine;
use super::kernels::{Kernels, ScaleKernels};
use super::uniforms::{BlockUniform, Plan, ScalePlan};
use wgpu::BufferUsages as Usage;

// Indices into `STAGES`.
const PREPARE: usize = 0;
const PLAN: usize = 1;
const COST: usize = 2;
const HORIZONTAL: usize = 3;
const VERTICAL: usize = 4;
const DIAGONAL: usize = 5;
const WINNER: usize = 6;
const FINISH: usize = 7;

/// Bytes that `plan.wgsl` writes for each scale.
const PLAN_BYTES: u64 = 16;

/// One dispatch.
struct Run {
    kernel: wgpu::ComputePipeline,
    bind: wgpu::BindGroup,
    groups: [u32; 3],
}

/// Dispatches of one stage, which are timed together.
struct Pass {
    stage: usize,
    scale: usize,
    /// Buffer that is cleared before the pass.
    clear: Option<wgpu::Buffer>,
    runs: Vec<Run>,
}

/// The buffers of one scale.
pub(super) struct ScaleBuffers {
    uniform: wgpu::Buffer,
    pictures: wgpu::Buffer,
    pub(super) blocks: wgpu::Buffer,
    pub(super) map: wgpu::Buffer,
    plan: wgpu::Buffer,
}

/// Buffers that all scales share.
pub(super) struct Scratch {
    features: wgpu::Buffer,
    /// H.
    pub(super) merged: wgpu::Buffer,
    /// The matching costs, then the jump costs of the six other paths.
    pub(super) jumps: wgpu::Buffer,
    /// Winners, then region labels, then the download.
    pixels: wgpu::Buffer,
    /// The right view, then region sizes.
    right_view: wgpu::Buffer,
    seeds: wgpu::Buffer,
    other_map: wgpu::Buffer,
}

/// All passes of a pair with their buffers.
pub(super) struct Program {
    pub(super) scales: Vec<ScaleBuffers>,
    pub(super) scratch: Scratch,
    passes: Vec<Pass>,
    queries: Option<(wgpu::QuerySet, wgpu::Buffer)>,
    /// Number of nodes of each scale with fixed windows; `None` where windows are planned.
    nodes: Vec<Option<usize>>,
    pub(super) pixels: usize,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Bytes of both images at the finest scale, and of one row.
    pub(super) picture_bytes: u64,
    pub(super) row_bytes: usize,
    /// Bytes of all buffers on the device.
    pub(super) bytes: usize,
}

impl Program {
    pub(super) fn new(engine: &Engine, plan: &Plan) -> Self {
        let kernels = Kernels::new(engine);
        let mut bytes = 0;
        let mut storage = |label: &str, size: u64| {
            bytes += size;
            engine.buffer(label, size, Usage::STORAGE | Usage::COPY_DST | Usage::COPY_SRC)
        };
        let most = |of: &dyn Fn(&ScalePlan) -> u64| plan.scales.iter().map(of).max().unwrap_or(0);
        let volume = most(&|scale| scale.volume_bytes);
        let pixels = most(&|scale| scale.pixels());
        let scratch = Scratch {
            features: storage("features", most(&ScalePlan::feature_bytes)),
            merged: storage("merged", volume),
            jumps: storage("jumps", volume),
            pixels: storage("pixels", 4 * pixels + 64),
            right_view: storage("right view", 4 * pixels),
            seeds: storage("seeds", most(&|scale| 4 * scale.coarse_pixels())),
            other_map: storage("other map", 4 * pixels),
        };
        let scales: Vec<ScaleBuffers> = plan
            .scales
            .iter()
            .map(|scale| ScaleBuffers {
                uniform: engine.filled("scale", bytemuck::bytes_of(&scale.uniform), Usage::UNIFORM),
                pictures: storage("pictures", scale.picture_bytes()),
                blocks: engine.filled(
                    "blocks",
                    bytemuck::cast_slice(&scale.blocks),
                    Usage::STORAGE | Usage::COPY_SRC,
                ),
                map: storage("map", 4 * scale.pixels()),
                plan: storage("plan", PLAN_BYTES),
            })
            .collect();
        let mut passes = Vec::new();
        halving(engine, &kernels, plan, &scales, &mut passes);
        for i in 0..plan.scales.len() {
            scale_passes(engine, &kernels, plan, &scales, &scratch, i, &mut passes);
        }
        let queries = engine.timestamp_ns.map(|_| {
            let count = 2 * passes.len() as u32;
            let set = engine.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("stages"),
                ty: wgpu::QueryType::Timestamp,
                count,
            });
            let usage = Usage::QUERY_RESOLVE | Usage::COPY_SRC;
            (set, engine.buffer("timestamps", 8 * u64::from(count), usage))
        });
        let finest = &plan.scales[plan.scales.len() - 1];
        Self {
            nodes: plan.scales.iter().map(|scale| (!scale.windows).then_some(scale.nodes)).collect(),
            pixels: finest.pixels() as usize,
            width: finest.uniform.width as usize,
            height: finest.uniform.height as usize,
            picture_bytes: finest.picture_bytes(),
            row_bytes: 4 * finest.uniform.stride as usize,
            bytes: bytes as usize,
            scales,
            scratch,
            passes,
            queries,
        }
    }

    /// Bytes of the disparities in the download; confidences follow.
    pub(super) fn disparity_bytes(&self) -> u64 {
        (self.pixels as u64).div_ceil(4) * 8
    }

    fn map_bytes(&self) -> u64 {
        (self.disparity_bytes() / 2 * 3).next_multiple_of(8)
    }

    fn timestamps_at(&self) -> u64 {
        self.map_bytes() + PLAN_BYTES * self.scales.len() as u64
    }

    /// Bytes of the download.
    pub(super) fn download_bytes(&self) -> u64 {
        self.timestamps_at() + 16 * self.passes.len() as u64
    }

    /// Encodes all commands of a pair, from `upload` to `download`.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        upload: &wgpu::Buffer,
        download: &wgpu::Buffer,
    ) {
        self.encode_some(encoder, upload, download, |_, _| true);
    }

    /// The same, but only the passes that `wanted` selects by scale and stage.
    pub(super) fn encode_some(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        upload: &wgpu::Buffer,
        download: &wgpu::Buffer,
        wanted: impl FnMut(usize, &'static str) -> bool,
    ) {
        let finest = &self.scales[self.scales.len() - 1];
        encoder.copy_buffer_to_buffer(upload, 0, &finest.pictures, 0, self.picture_bytes);
        self.encode_passes(encoder, wanted);
        encoder.copy_buffer_to_buffer(&self.scratch.pixels, 0, download, 0, self.disparity_bytes() / 2 * 3);
        for (i, scale) in self.scales.iter().enumerate() {
            let at = self.map_bytes() + PLAN_BYTES * i as u64;
            encoder.copy_buffer_to_buffer(&scale.plan, 0, download, at, PLAN_BYTES);
        }
        if let Some((set, resolved)) = &self.queries {
            let count = 2 * self.passes.len() as u32;
            encoder.resolve_query_set(set, 0..count, resolved, 0);
            encoder.copy_buffer_to_buffer(resolved, 0, download, self.timestamps_at(), 8 * u64::from(count));
        }
    }

    pub(super) fn encode_passes(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        mut wanted: impl FnMut(usize, &'static str) -> bool,
    ) {
        for (i, pass) in self.passes.iter().enumerate() {
            if !wanted(pass.scale, STAGES[pass.stage]) {
                continue;
            }
            if let Some(buffer) = &pass.clear {
                encoder.clear_buffer(buffer, 0, None);
            }
            let timestamp_writes =
                self.queries.as_ref().map(|(query_set, _)| wgpu::ComputePassTimestampWrites {
                    query_set,
                    beginning_of_pass_write_index: Some(2 * i as u32),
                    end_of_pass_write_index: Some(2 * i as u32 + 1),
                });
            let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(STAGES[pass.stage]),
                timestamp_writes,
            });
            for run in &pass.runs {
                let [x, y, z] = run.groups;
                compute.set_pipeline(&run.kernel);
                compute.set_bind_group(0, &run.bind, &[]);
                compute.dispatch_workgroups(x, y, z);
            }
        }
    }

    /// Number of nodes of the downloaded pair.
    pub(super) fn nodes_of(&self, download: &[u8]) -> usize {
        let planned = |scale: usize| {
            let at = (self.map_bytes() + PLAN_BYTES * scale as u64) as usize + 4;
            download.get(at..at + 4).and_then(|bytes| bytes.try_into().ok()).map_or(0, u32::from_le_bytes)
        };
        self.nodes.iter().enumerate().map(|(i, nodes)| nodes.unwrap_or_else(|| planned(i) as usize)).sum()
    }

    /// Reports the times of the passes in nanoseconds; `unit_ns` is the length of a timestamp tick.
    pub(super) fn times_of(&self, download: &[u8], unit_ns: f32, mut add: impl FnMut(usize, u64)) {
        let at = self.timestamps_at() as usize;
        let stamps = download.get(at..).unwrap_or_default().chunks_exact(16);
        for (pass, both) in self.passes.iter().zip(stamps) {
            let stamp = |bytes: &[u8]| bytes.try_into().map_or(0, u64::from_le_bytes);
            let ticks = stamp(&both[8..]).saturating_sub(stamp(&both[..8]));
            add(pass.stage, (ticks as f64 * f64::from(unit_ns)) as u64);
        }
    }
}

/// A dispatch with buffers bound by their binding numbers.
fn run(
    engine: &Engine,
    kernel: &wgpu::ComputePipeline,
    buffers: &[(u32, &wgpu::Buffer)],
    groups: [u32; 3],
) -> Run {
    let entries: Vec<_> = buffers
        .iter()
        .map(|&(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
        .collect();
    let bind = engine.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &kernel.get_bind_group_layout(0),
        entries: &entries,
    });
    Run { kernel: kernel.clone(), bind, groups }
}

/// The pass that downsamples the pair to all coarser scales.
fn halving(engine: &Engine, kernels: &Kernels, plan: &Plan, scales: &[ScaleBuffers], passes: &mut Vec<Pass>) {
    let mut runs = Vec::new();
    for i in (0..scales.len() - 1).rev() {
        let (coarse, fine) = (&plan.scales[i].uniform, &plan.scales[i + 1].uniform);
        let sizes = [fine.width, fine.height, fine.stride, 0];
        let sizes = engine.filled("fine", bytemuck::bytes_of(&sizes), Usage::UNIFORM);
        let buffers =
            [(0, &scales[i].uniform), (1, &scales[i + 1].pictures), (2, &scales[i].pictures), (3, &sizes)];
        let groups = [coarse.stride.div_ceil(64), coarse.height, 2];
        runs.push(run(engine, &kernels.halve, &buffers, groups));
    }
    passes.push(Pass { stage: PREPARE, scale: 0, clear: None, runs });
}

/// The passes of one scale.
fn scale_passes(
    engine: &Engine,
    kernels: &Kernels,
    plan: &Plan,
    scales: &[ScaleBuffers],
    scratch: &Scratch,
    i: usize,
    passes: &mut Vec<Pass>,
) {
    let scale = &plan.scales[i];
    let own = ScaleKernels::new(engine, scale);
    let (uniform, buffers) = (&scale.uniform, &scales[i]);
    let (width, height) = (uniform.width, uniform.height);
    let blocks = uniform.tiles * uniform.strips;
    let columns = width.div_ceil(64);
    let mut pass = |stage, clear: Option<&wgpu::Buffer>, runs| {
        passes.push(Pass { stage, scale: i, clear: clear.cloned(), runs });
    };

    let prepare = [(0, &buffers.uniform), (1, &buffers.pictures), (2, &scratch.features)];
    pass(PREPARE, None, vec![run(engine, &kernels.prepare, &prepare, [(width + 4).div_ceil(64), height, 2])]);

    if i > 0 && (scale.windows || scale.slopes) {
        let coarse = &scales[i - 1].map;
        let planning = |kernel: &wgpu::ComputePipeline, bindings: &[u32], groups| {
            let all = [
                (0, &buffers.uniform),
                (1, coarse),
                (2, &scratch.seeds),
                (3, &buffers.blocks),
                (4, &buffers.plan),
            ];
            let some: Vec<_> = all.into_iter().filter(|(binding, _)| bindings.contains(binding)).collect();
            run(engine, kernel, &some, groups)
        };
        let mut runs = Vec::new();
        if scale.slopes {
            runs.push(planning(&kernels.slopes, &[0, 1, 3], [uniform.tiles, uniform.strips, 1]));
        }
        if scale.windows {
            let coarse_groups = [uniform.coarse_width.div_ceil(64), uniform.coarse_height, 1];
            runs.push(planning(&kernels.seed, &[0, 1, 2], coarse_groups));
            runs.push(planning(&kernels.windows, &[0, 2, 3], [blocks, 1, 1]));
            runs.push(planning(&kernels.limit, &[0, 3, 4], [1, 1, 1]));
            runs.push(planning(&kernels.windows_again, &[0, 2, 3, 4], [blocks, 1, 1]));
            runs.push(planning(&kernels.lay_out, &[0, 3, 4], [1, 1, 1]));
        }
        pass(PLAN, None, runs);
    }

    let score = [(0, &buffers.uniform), (1, &scratch.features), (2, &buffers.blocks), (3, &scratch.jumps)];
    let items = BLOCK as u32 * max_words(scale);
    pass(COST, None, vec![run(engine, &kernels.score, &score, [items.div_ceil(64), blocks, 1])]);

    let paths = 32 / scale.lanes;
    let orientation = |n: usize| {
        let direction = engine.filled("direction", bytemuck::bytes_of(&scale.directions[n]), Usage::UNIFORM);
        let (lines, data, results) = if n == 0 {
            (height, &scratch.jumps, &scratch.merged)
        } else {
            (width, &scratch.merged, &scratch.jumps)
        };
        let bound = [
            (0, &buffers.uniform),
            (1, &direction),
            (2, &buffers.pictures),
            (3, &buffers.blocks),
            (4, data),
            (5, results),
        ];
        run(engine, &own.advance, &bound, [lines.div_ceil(paths), 1, 1])
    };
    pass(HORIZONTAL, None, vec![orientation(0)]);
    pass(VERTICAL, None, vec![orientation(1)]);
    pass(DIAGONAL, None, vec![orientation(2), orientation(3)]);

    let pick = [
        (0, &buffers.uniform),
        (1, &buffers.blocks),
        (2, &scratch.merged),
        (3, &scratch.jumps),
        (4, &scratch.pixels),
        (5, &scratch.right_view),
    ];
    let check = [(0, &buffers.uniform), (1, &scratch.pixels), (2, &scratch.right_view), (3, &buffers.map)];
    pass(
        WINNER,
        Some(&scratch.right_view),
        vec![
            run(engine, &own.pick, &pick, [uniform.tiles, height, 1]),
            run(engine, &kernels.check, &check, [columns, height, 1]),
        ],
    );

    let whole = [columns, height, 1];
    let change = |kernel: &wgpu::ComputePipeline, from: &wgpu::Buffer, to: &wgpu::Buffer| {
        run(engine, kernel, &[(0, &buffers.uniform), (1, from), (2, to)], whole)
    };
    let bound = [(0, &buffers.uniform), (1, &buffers.map), (2, &scratch.pixels), (3, &scratch.right_view)];
    let island = |kernel: &wgpu::ComputePipeline, bindings: usize, groups| {
        run(engine, kernel, &bound[..bindings], groups)
    };
    let finest = i + 1 == plan.scales.len();
    let mut runs = Vec::new();
    if finest {
        runs.push(change(&kernels.filter_confidence, &buffers.map, &scratch.other_map));
        runs.push(change(&kernels.median, &scratch.other_map, &buffers.map));
    }
    runs.push(island(&kernels.runs, 4, [height, 1, 1]));
    runs.push(island(&kernels.join, 3, [columns, height - 1, 1]));
    runs.push(island(&kernels.count, 4, whole));
    runs.push(island(&kernels.remove, 4, whole));
    if finest {
        if plan.bridge {
            runs.push(change(&kernels.bridge_rows, &buffers.map, &scratch.other_map));
            runs.push(change(&kernels.bridge_columns, &scratch.other_map, &buffers.map));
        }
        let bound = [(0, &buffers.uniform), (1, &buffers.map), (2, &scratch.pixels)];
        let groups = [(width * height).div_ceil(256), 1, 1];
        runs.push(run(engine, &kernels.pack, &bound, groups));
    }
    pass(FINISH, None, runs);
}

/// Maximum number of words per pixel of a block of the scale.
fn max_words(scale: &ScalePlan) -> u32 {
    if !scale.windows {
        return scale.blocks.iter().map(BlockUniform::words).max().unwrap_or(0);
    }
    // A window may start and end within a word.
    ((scale.uniform.widest + 6) / 4).min(scale.words)
}
