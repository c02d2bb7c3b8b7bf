//! The GPU against the CPU, on any available adapter; Mesa's lavapipe is enough.

use super::super::blocks::Block;
use super::super::cost::{CostStrip, STRIP};
use super::super::energy::{EnergyRow, Volumes};
use super::super::fallback::{Fallback, Replacement};
use super::super::matcher::MatcherError;
use super::super::solver::Solver;
use super::super::viterbi::Merge;
use super::super::winner::SubPixel;
use super::uniforms::{BlockUniform, Plan};
use super::*;
use crate::image::GreyImage;
use crate::simd::{LANES, Lanes, Level};

/// Options of the tests: any adapter, however slow.
fn any_adapter() -> GpuOptions {
    GpuOptions { software: true, patience: Duration::from_secs(300), ..GpuOptions::default() }
}

/// Whether there is an adapter at all. Without one these tests are skipped.
#[track_caller]
fn adapter_is_there() -> bool {
    let there = !adapters().is_empty();
    if !there {
        let why = "no Vulkan adapter (Debian: apt-get install mesa-vulkan-drivers installs one in software)";
        skipped_tests::skip(skipped_tests::Need::Gpu, why);
    }
    there
}

fn image(width: usize, height: usize, mut value: impl FnMut(usize, usize) -> u8) -> GreyImage {
    let mut image = GreyImage::new(width, height);
    for (i, v) in image.as_mut_slice().iter_mut().enumerate() {
        *v = value(i % width, i / width);
    }
    image
}

/// A pair whose kind depends on the seed: noise, low contrast, or a smooth surface with parallax.
fn pair(width: usize, height: usize, seed: u64) -> (GreyImage, GreyImage) {
    let mut random = fastrand::Rng::with_seed(seed);
    match seed % 4 {
        0 => (image(width, height, |_, _| random.u8(..)), {
            let mut random = fastrand::Rng::with_seed(seed + 1000);
            image(width, height, |_, _| random.u8(..))
        }),
        1 => (image(width, height, |_, _| random.u8(80..130)), {
            let mut random = fastrand::Rng::with_seed(seed + 1000);
            image(width, height, |_, _| random.u8(80..130))
        }),
        kind => {
            let (across, down) = (width / 4 + 40, height / 4 + 4);
            let coarse: Vec<u8> = (0..across * down).map(|_| random.u8(..)).collect();
            let at = |x: usize, y: usize| {
                let v = |dx, dy| u32::from(coarse[(y / 4 + dy) * across + x / 4 + dx]);
                let (a, b) = (x as u32 % 4, y as u32 % 4);
                let row = |dy| v(0, dy) * (4 - a) + v(1, dy) * a;
                ((row(0) * (4 - b) + row(1) * b) / 16) as u8
            };
            // Ground that comes nearer downwards and to the right, with a wall in front of it.
            let moved = |x: usize, y: usize| {
                if kind == 3 && (width / 3..width / 2).contains(&x) { 30 } else { 4 + y / 6 + x / 16 }
            };
            (image(width, height, at), image(width, height, |x, y| at(x + moved(x, y), y)))
        }
    }
}

fn compute(matcher: &mut dyn Matcher, pair: &(GreyImage, GreyImage)) -> (Vec<u16>, Vec<u8>) {
    let n = pair.0.width() * pair.0.height();
    let (mut disparity, mut confidence) = (vec![9; n], vec![9; n]);
    let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
    matcher.compute(pair.0.view(), pair.1.view(), output).unwrap();
    (disparity, confidence)
}

/// Description of the first difference between two maps.
fn difference(width: usize, got: &(Vec<u16>, Vec<u8>), expected: &(Vec<u16>, Vec<u8>)) -> Option<String> {
    let count = got.0.iter().zip(&expected.0).filter(|(a, b)| a != b).count();
    (0..got.0.len()).find(|&i| (got.0[i], got.1[i]) != (expected.0[i], expected.1[i])).map(|i| {
        format!(
            "({}, {}): {:?} instead of {:?}; {count} disparities differ",
            i % width,
            i / width,
            (got.0[i], got.1[i]),
            (expected.0[i], expected.1[i])
        )
    })
}

/// Downloads a buffer of the device.
fn read(engine: &mut Engine, buffer: &wgpu::Buffer) -> Vec<u8> {
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
    let copy = engine.buffer("read back", buffer.size(), usage);
    let mut encoder = engine.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, buffer.size());
    let index = engine.submit(encoder.finish()).unwrap();
    copy.slice(..).map_async(wgpu::MapMode::Read, |_| ());
    engine.wait(index, Duration::from_secs(300)).unwrap();
    copy.get_mapped_range(..).unwrap().to_vec()
}

/// One scale on the GPU and the CPU, with given windows and slopes.
struct Bench {
    engine: Engine,
    program: Program,
    plan: Plan,
    solver: Solver,
}

impl Bench {
    fn new(
        parameters: MpvParameters,
        (width, height, disparities): (usize, usize, usize),
        lanes: Option<u32>,
        subgroups: bool,
        mut set: impl FnMut(&mut Block),
    ) -> Self {
        let parameters = MpvParameters { scales: 1, ..parameters };
        let mut solver =
            Solver::new(parameters.cost, parameters.paths, Level::PLAIN, width, height, disparities, 1);
        solver.scale.blocks.set_all(&mut set);
        let mut plan = uniforms::plan(&parameters, Search::Full, width, height, disparities);
        let mut at = 0;
        let blocks =
            (0..solver.scale.blocks.strips()).flat_map(|strip| solver.scale.blocks.strip(strip).to_vec());
        plan.scales[0].blocks = blocks
            .map(|block| {
                let block = BlockUniform {
                    low: block.low as u32,
                    high: block.high as u32,
                    at,
                    slope_x: block.slope_x,
                    slope_y: block.slope_y,
                    ..BlockUniform::default()
                };
                at += block.words() * 1024;
                block
            })
            .collect();
        plan.scales[0].lanes = lanes.unwrap_or(plan.scales[0].lanes);
        let mut engine = Engine::open(&any_adapter(), &plan).unwrap();
        if !subgroups {
            engine.subgroup = 1;
        }
        let program = engine.guarded(|| Program::new(&engine, &plan)).unwrap();
        Self { engine, program, plan, solver }
    }

    /// Runs the stages up to `last`.
    fn run(&mut self, pair: &(GreyImage, GreyImage), last: &str) {
        let usage = wgpu::BufferUsages::COPY_SRC;
        let row_bytes = self.program.row_bytes;
        let mut bytes = vec![0; self.program.picture_bytes as usize];
        for (y, row) in bytes.chunks_exact_mut(row_bytes).enumerate() {
            let height = self.program.height;
            let image = if y < height { &pair.0 } else { &pair.1 };
            row[..self.program.width].copy_from_slice(image.view().row(y % height));
        }
        let upload = self.engine.filled("upload", &bytes, usage);
        let download = self.engine.buffer(
            "download",
            self.program.download_bytes(),
            wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        );
        let mut encoder =
            self.engine.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut on = true;
        self.program.encode_some(&mut encoder, &upload, &download, |_, stage| {
            let wanted = on;
            on &= stage != last;
            wanted
        });
        let index = self.engine.submit(encoder.finish()).unwrap();
        self.engine.wait(index, Duration::from_secs(300)).unwrap();
    }

    /// A node of a downloaded volume.
    fn node(&self, volume: &[u8], x: usize, y: usize, d: usize) -> u8 {
        let tiles = self.plan.scales[0].uniform.tiles as usize;
        let block = &self.plan.scales[0].blocks[y / 32 * tiles + x / 32];
        let pixel = (y % 32 * 32 + x % 32) * block.words() as usize;
        let word = block.at as usize + pixel + d / 4 - block.low as usize / 4;
        volume[4 * word + d % 4]
    }

    /// Calls `check` for each node of all windows.
    fn for_nodes(&self, mut check: impl FnMut(usize, usize, usize)) {
        for y in 0..self.program.height {
            for x in 0..self.program.width {
                let block = self.solver.scale.blocks.strip(y / STRIP)[x / LANES];
                (block.low..block.high).for_each(|d| check(x, y, d));
            }
        }
    }
}

#[test]
fn costs_equal_the_reference_bit_for_bit() {
    if !adapter_is_there() {
        return;
    }
    for (size, k2, limit, seed) in [
        ((70, 40, 9), 0.02, 8, 0),
        ((33, 9, 70), 0.01, 24, 1),
        ((97, 35, 12), 0.5, 0, 2),
        ((65, 33, 130), 0.06, 8, 3),
    ] {
        let parameters = MpvParameters::default();
        let cost = crate::stereo::cost::CostParameters { k2, gradient_limit: limit };
        let parameters = MpvParameters { cost, ..parameters };
        let (width, height, disparities) = size;
        let mut random = fastrand::Rng::with_seed(seed);
        let mut bench = Bench::new(parameters, size, None, true, |block| {
            block.low = random.usize(0..disparities);
            block.high = random.usize(block.low + 1..=disparities);
        });
        let mut pair = pair(width, height, seed);
        // A saturated flat patch: there the terms of the cost are largest and nearly cancel.
        for image in [&mut pair.0, &mut pair.1] {
            image.as_mut_slice()[..width * height / 3].fill(255);
            image.as_mut_slice()[..width * height / 3].iter_mut().step_by(7).for_each(|v| *v = 254);
        }
        bench.run(&pair, "cost");
        let jumps = bench.program.scratch.jumps.clone();
        let got = read(&mut bench.engine, &jumps);
        let mut strip = CostStrip::new(parameters.cost, Level::PLAIN, width, disparities);
        let mut expected = vec![Lanes::ZERO; STRIP * disparities];
        let mut at = (usize::MAX, usize::MAX);
        bench.for_nodes(|x, y, d| {
            // Compute all disparities of a tile at its first pixel.
            if at != (x / LANES, y) {
                at = (x / LANES, y);
                strip.start(pair.0.view(), pair.1.view(), y);
                strip.tile(x / LANES * LANES, 0, disparities, disparities, &mut expected);
            }
            assert_eq!(
                bench.node(&got, x, y, d),
                expected[d].0[x % LANES],
                "({x}, {y}) d {d} of {size:?}, K₂ {k2}"
            );
        });
    }
}

#[test]
fn both_layers_equal_the_reference_bit_for_bit() {
    if !adapter_is_there() {
        return;
    }
    let sizes = [(70, 40, 9), (31, 33, 20), (8, 70, 5), (41, 8, 40), (97, 65, 12), (33, 37, 140)];
    for (round, size) in sizes.into_iter().enumerate() {
        let (width, height, disparities) = size;
        let pair = pair(width, height, 1 + 2 * (round as u64 % 2));
        let mut parameters = MpvParameters::default();
        parameters.paths.edge_percent = if round % 2 == 0 { 60 } else { 85 };
        parameters.paths.lambda_vertical = [8, 1, 100][round % 3];
        parameters.paths.truncation_other = [40, 65, 75][round % 3];
        parameters.paths.merging = [Merge::Min, Merge::Mean, Merge::First][round % 3];
        for (lanes, subgroups) in [(None, true), (Some(8), false), (Some(32), false)] {
            let mut random = fastrand::Rng::with_seed(round as u64);
            let mut bench = Bench::new(parameters, size, lanes, subgroups, |block| {
                if round > 0 {
                    block.low = random.usize(0..disparities);
                    block.high = random.usize(block.low + 1..=disparities);
                    block.slope_x = random.i32(-128..=128);
                    block.slope_y = random.i32(-128..=128);
                }
            });
            bench.run(&pair, "diagonal");
            let (merged, jumps) = (bench.program.scratch.merged.clone(), bench.program.scratch.jumps.clone());
            let (merged, jumps) = (read(&mut bench.engine, &merged), read(&mut bench.engine, &jumps));
            let mut volumes = Volumes::new(bench.solver.scale.blocks.vectors());
            let mut expected = vec![(0, 0); width * height * disparities];
            let rows = std::sync::Mutex::new(&mut expected);
            let take = |row: EnergyRow<'_>| {
                let mut expected = rows.lock().unwrap();
                for x in 0..width {
                    let low = row.blocks[x / LANES].low;
                    let both = row.data(x / LANES).iter().zip(row.nodes(x / LANES));
                    for (d, (h, e)) in both.enumerate() {
                        expected[(row.y * width + x) * disparities + low + d] =
                            (h.0[x % LANES], e.0[x % LANES]);
                    }
                }
            };
            let (left, right) = (pair.0.view(), pair.1.view());
            assert!(bench.solver.solve(left, right, &mut volumes, &mut || true, |_| (take, take)));
            bench.for_nodes(|x, y, d| {
                let (h, e) = expected[(y * width + x) * disparities + d];
                let got = bench.node(&merged, x, y, d);
                let words = format!("({x}, {y}) d {d} of {size:?}, {lanes:?} lanes, {subgroups}");
                assert_eq!(got, h, "H at {words}");
                let total = got.saturating_add(bench.node(&jumps, x, y, d));
                assert_eq!(total, e, "E at {words}");
            });
        }
    }
}

#[test]
fn plans_equal_those_of_the_cpu() {
    if !adapter_is_there() {
        return;
    }
    let mut random = fastrand::Rng::with_seed(3);
    for (round, (width, height, disparities)) in
        [(161, 97, 64), (150, 90, 128), (70, 33, 20), (40, 200, 255)].into_iter().enumerate()
    {
        let parameters = MpvParameters { scales: 2, ..MpvParameters::default() };
        let plan = uniforms::plan(&parameters, Search::Windows, width, height, disparities);
        let mut engine = Engine::open(&any_adapter(), &plan).unwrap();
        let program = engine.guarded(|| Program::new(&engine, &plan)).unwrap();
        let (w, h) = (width.div_ceil(2), height.div_ceil(2));
        for slant in [0, 60, 150] {
            // A slope with steps, holes and outliers.
            let map: Vec<u16> = (0..w * h)
                .map(|i| match random.u8(..) {
                    0..60 => 0,
                    60..70 => random.u16(1..=128 * disparities as u16),
                    _ => {
                        let wall = if i % w > w / 2 { 30 * round } else { 0 };
                        (256 + 100 * wall + (i % w) * slant + (i / w) * 64).min(128 * disparities) as u16
                    }
                })
                .collect();
            let words: Vec<u32> = map.iter().map(|&d| u32::from(d) | 0x70_0000).collect();
            let mut blocks = super::super::blocks::Blocks::new(width, height, disparities);
            blocks.reserve(w, h);
            let budget = crate::stereo::mpv::budget(&blocks, disparities);
            let coarse = crate::stereo::DisparityView::new(&map, w, h).unwrap();
            blocks.plan(Level::PLAIN, coarse, true, Some((96, budget)), false);

            engine.queue.write_buffer(&program.scales[0].map, 0, bytemuck::cast_slice(&words));
            let mut encoder =
                engine.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            program.encode_passes(&mut encoder, |scale, stage| scale == 1 && stage == "plan");
            let index = engine.submit(encoder.finish()).unwrap();
            engine.wait(index, Duration::from_secs(300)).unwrap();
            let got = read(&mut engine, &program.scales[1].blocks);
            let got: Vec<BlockUniform> =
                got.chunks_exact(size_of::<BlockUniform>()).map(bytemuck::pod_read_unaligned).collect();
            for strip in 0..blocks.strips() {
                for (tile, expected) in blocks.strip(strip).iter().enumerate() {
                    let got = got[strip * blocks.tiles() + tile];
                    let got = (got.low as usize, got.high as usize, got.slope_x, got.slope_y);
                    let expected = (expected.low, expected.high, expected.slope_x, expected.slope_y);
                    assert_eq!(got, expected, "block {tile}, {strip} of {width}x{height}, slant {slant}");
                }
            }
        }
    }
}

#[test]
fn whole_maps_equal_the_reference_bit_for_bit() {
    if !adapter_is_there() {
        return;
    }
    let mut random = fastrand::Rng::with_seed(21);
    let mut sizes = vec![(8, 8, 255), (9, 100, 2), (200, 8, 255), (33, 65, 33), (64, 64, 16), (161, 97, 64)];
    for _ in 0..10 {
        sizes.push((random.usize(8..180), random.usize(8..120), random.usize(2..=160)));
    }
    for (i, (width, height, disparities)) in sizes.into_iter().enumerate() {
        let mut parameters = MpvParameters { complete: i % 3 == 0, ..MpvParameters::default() };
        match i % 5 {
            1 => parameters.winner.sub_pixel = SubPixel::Energy,
            2 => parameters.slopes = false,
            3 => {
                parameters.min_confidence = 20;
                parameters.speckle.min_pixels = 0;
                parameters.bridge.widest_px = 0;
            }
            4 => {
                parameters.scales = 2;
                parameters.winner.sub_pixel = SubPixel::None;
                parameters.winner.left_right_px = 255;
                parameters.min_confidence = 0;
            }
            _ => {}
        }
        for search in [Search::Full, Search::Windows] {
            let mut cpu =
                Mpv::at_level(Level::PLAIN, parameters, search, width, height, disparities).unwrap();
            let mut gpu =
                GpuMpv::new(&any_adapter(), parameters, search, width, height, disparities).unwrap();
            // Twice: the first pair must leave no state behind.
            for seed in [i as u64, i as u64 + 2] {
                let pair = pair(width, height, seed);
                let (expected, got) = (compute(&mut cpu, &pair), compute(&mut gpu, &pair));
                let difference = difference(width, &got, &expected);
                assert_eq!(difference, None, "{width}x{height}, {disparities}, {search:?}, seed {seed}");
                assert_eq!(gpu.nodes(), cpu.nodes(), "{width}x{height}, {disparities}, {search:?}");
            }
        }
    }
}

#[test]
fn two_pairs_in_flight_keep_their_order() {
    if !adapter_is_there() {
        return;
    }
    let (width, height, disparities) = (90, 50, 32);
    let parameters = MpvParameters::default();
    let mut cpu = Mpv::new(parameters, Search::Windows, width, height, disparities).unwrap();
    let mut gpu =
        GpuMpv::new(&any_adapter(), parameters, Search::Windows, width, height, disparities).unwrap();
    let pairs: Vec<_> = (0..5).map(|i| pair(width, height, 2 + i)).collect();
    gpu.submit(pairs[0].0.view(), pairs[0].1.view()).unwrap();
    for i in 0..pairs.len() {
        if let Some(next) = pairs.get(i + 1) {
            gpu.submit(next.0.view(), next.1.view()).unwrap();
            assert_eq!(gpu.in_flight(), gpu.max_in_flight());
        }
        let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
        gpu.collect(MatchOutput { disparity: &mut disparity, confidence: &mut confidence }).unwrap();
        let expected = compute(&mut cpu, &pairs[i]);
        assert_eq!(difference(width, &(disparity, confidence), &expected), None, "pair {i}");
    }
    assert_eq!(gpu.in_flight(), 0);
    let device = gpu.device().unwrap();
    assert!(!device.adapter.is_empty() && device.loss.is_none());
    if !device.stages.is_empty() {
        assert!(device.stages.iter().map(|stage| stage.ns).sum::<u64>() > 0, "{:?}", device.stages);
    }
}

#[test]
fn a_device_is_verified_against_the_cpu() {
    if !adapter_is_there() {
        return;
    }
    let (width, height, disparities) = (130, 60, 32);
    let make = |parameters| Mpv::new(parameters, Search::Windows, width, height, disparities).unwrap();
    let parameters = MpvParameters::default();
    let mut gpu =
        GpuMpv::new(&any_adapter(), parameters, Search::Windows, width, height, disparities).unwrap();
    gpu.verify(&mut make(parameters)).unwrap();
    // A device with other results is rejected.
    let mut other = parameters;
    other.paths.lambda_vertical += 3;
    let error = gpu.verify(&mut make(other)).unwrap_err();
    assert!(matches!(error, GpuError::Wrong { pixels: 1.., .. }), "{error}");
}

/// Passes some submissions, then injects its fault.
struct Faulty {
    submissions: usize,
    fault: Fault,
}

#[derive(Clone, Copy, Debug)]
enum Fault {
    /// Destroys the device: a real loss.
    Destroyed,
    Refused(Loss),
    /// The wait returns this error.
    Waiting(Loss),
    /// The wait has a time limit of zero: a real time-out of the driver's fence.
    NoTime,
}

impl Gate for Faulty {
    fn submit(&mut self) -> Result<(), Loss> {
        match (self.submissions.checked_sub(1), self.fault) {
            (Some(left), _) => self.submissions = left,
            (None, Fault::Refused(loss)) => return Err(loss),
            (None, _) => {}
        }
        Ok(())
    }

    fn wait(&mut self, patience: Duration) -> Result<Duration, Loss> {
        match self.fault {
            Fault::Waiting(loss) if self.submissions == 0 => Err(loss),
            Fault::NoTime if self.submissions == 0 => Ok(Duration::ZERO),
            _ => Ok(patience),
        }
    }
}

#[test]
fn a_lost_device_is_reported_and_replaced_without_losing_a_pair() {
    if !adapter_is_there() {
        return;
    }
    let (width, height, disparities) = (150, 100, 64);
    let parameters = MpvParameters::default();
    let cpu = move || Mpv::new(parameters, Search::Full, width, height, disparities);
    let pair = pair(width, height, 3);
    let expected = compute(&mut cpu().unwrap(), &pair);
    for (fault, loss) in [
        (Fault::Destroyed, Loss::Device),
        (Fault::Refused(Loss::OutOfMemory), Loss::OutOfMemory),
        (Fault::Refused(Loss::Device), Loss::Device),
        (Fault::Waiting(Loss::Device), Loss::Device),
        (Fault::Waiting(Loss::Hung), Loss::Hung),
        (Fault::NoTime, Loss::Hung),
    ] {
        let mut gpu =
            GpuMpv::new(&any_adapter(), parameters, Search::Full, width, height, disparities).unwrap();
        compute(&mut gpu, &pair);
        match fault {
            Fault::Destroyed => gpu.destroy_device(),
            // Refusals start at once; faults of the wait have a submission before them.
            Fault::Refused(_) => gpu.set_gate(Box::new(Faulty { submissions: 0, fault })),
            _ => gpu.set_gate(Box::new(Faulty { submissions: 1, fault })),
        }
        let replacement: Replacement = Box::new(move || Ok(Box::new(cpu()?)));
        let mut matcher = Fallback::new(Box::new(gpu), replacement);
        for _ in 0..2 {
            assert!(compute(&mut matcher, &pair) == expected, "{fault:?}");
            assert_eq!(matcher.device().unwrap().loss, Some(loss), "{fault:?}");
        }
    }
    // Without a fallback every call reports the loss.
    let mut gpu = GpuMpv::new(&any_adapter(), parameters, Search::Full, width, height, disparities).unwrap();
    gpu.set_gate(Box::new(Faulty { submissions: 0, fault: Fault::Refused(Loss::Device) }));
    let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
    for _ in 0..2 {
        let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
        let error = gpu.compute(pair.0.view(), pair.1.view(), output).unwrap_err();
        assert_eq!(error, MatchError::Lost(Loss::Device));
    }
    assert_eq!(gpu.workspace_bytes(), 0);
}

#[test]
fn invalid_options_are_refused_with_a_remedy() {
    let no_such = GpuOptions { adapter: "no such card".into(), ..any_adapter() };
    let make = |options: &GpuOptions, width, height, disparities| {
        GpuMpv::new(options, MpvParameters::default(), Search::Full, width, height, disparities).map(|_| ())
    };
    let error = make(&no_such, 64, 64, 16).unwrap_err();
    assert!(matches!(&error, GpuError::UnknownAdapter { wanted, .. } if wanted == "no such card"));
    if !adapter_is_there() {
        return;
    }
    let name = adapters()[0].name.clone();
    assert!(error.to_string().contains(&name), "{error}");
    let named = GpuOptions { adapter: name[..4].to_uppercase(), software: false, ..any_adapter() };
    make(&named, 64, 64, 16).unwrap();
    assert!(matches!(make(&any_adapter(), 4, 4, 16), Err(GpuError::Matcher(MatcherError::TooSmall { .. }))));
    // A volume of a gigabyte fits no adapter's binding that has the usual limit of 128 MiB.
    if let Err(error) = make(&any_adapter(), 4096, 2048, 127) {
        assert!(
            error.to_string().contains("scale the images down") || matches!(error, GpuError::Lost { .. })
        );
    }
    assert_eq!(make(&any_adapter(), 64, 64, 1), Err(GpuError::Matcher(MatcherError::Disparities(1))));
}
