//! Times of the GPU matcher on a real GPU: `cargo bench -p lookout --features gpu --bench gpu [-- ADAPTER [PAIRS]]`.
//!
//! For each size and method: the median over so many pairs, after a tenth as many to warm up, of the time from a pair in
//! memory to its map in memory; pairs a second with two in flight; the device's own time by stage; and the volumes' traffic
//! that goes with it (docs/gpu.md).

use perception::image::{GreyImage, GreyView};
use perception::stereo::gpu::{GpuMpv, GpuOptions, adapters};
use perception::stereo::{MatchError, MatchOutput, Matcher, MpvParameters, Search};
use std::time::{Duration, Instant};

/// Bytes of the volumes that a node stands for, over all kernels.
const BYTES_PER_NODE: f64 = 25.0;

fn median(times: &mut [f64]) -> f64 {
    times.sort_unstable_by(f64::total_cmp);
    times[times.len() / 2]
}

/// A textured ground that comes nearer downwards.
fn pair(width: usize, height: usize) -> (GreyImage, GreyImage) {
    let mut random = fastrand::Rng::with_seed(1);
    let across = width / 3 + 60;
    let cells: Vec<u8> = (0..across * (height / 3 + 1)).map(|_| random.u8(..)).collect();
    let at = |x: usize, y: usize| cells[y / 3 * across + x / 3];
    let mut pair = (GreyImage::new(width, height), GreyImage::new(width, height));
    for y in 0..height {
        for x in 0..width {
            pair.0.as_mut_slice()[y * width + x] = at(x, y);
            pair.1.as_mut_slice()[y * width + x] = at(x + 2 + 50 * y / height, y);
        }
    }
    pair
}

fn collect(gpu: &mut GpuMpv, map: &mut (Vec<u16>, Vec<u8>)) -> Result<(), MatchError> {
    gpu.collect(MatchOutput { disparity: &mut map.0, confidence: &mut map.1 })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut given = std::env::args().skip(1).filter(|argument| !argument.starts_with('-'));
    let options = GpuOptions {
        adapter: given.next().unwrap_or_default(),
        software: true,
        patience: Duration::from_secs(60),
    };
    let pairs: usize = given.next().map_or(Ok(200), |count| count.parse())?;
    for adapter in adapters() {
        println!("adapter: {} ({}), {}", adapter.name, adapter.driver, adapter.kind);
    }
    for (width, height, disparities) in [(640, 480, 64), (640, 480, 128), (1242, 375, 128)] {
        let (left, right) = pair(width, height);
        let (left, right): (GreyView<'_>, GreyView<'_>) = (left.view(), right.view());
        for (method, search) in [("fast", Search::Windows), ("full", Search::Full)] {
            let mut gpu =
                GpuMpv::new(&options, MpvParameters::default(), search, width, height, disparities)?;
            let mut map = (vec![0; width * height], vec![0; width * height]);
            let stages = gpu.device().map_or(0, |device| device.stages.len());
            let mut stage_ms = vec![Vec::new(); stages];
            let (mut wall_ms, mut device_ms) = (Vec::new(), Vec::new());
            for n in 0..pairs + pairs / 10 {
                let start = Instant::now();
                gpu.submit(left, right)?;
                collect(&mut gpu, &mut map)?;
                if n < pairs / 10 {
                    continue;
                }
                wall_ms.push(start.elapsed().as_secs_f64() * 1e3);
                if let Some(device) = gpu.device().filter(|_| stages > 0) {
                    for (times, stage) in stage_ms.iter_mut().zip(device.stages) {
                        times.push(stage.ns as f64 * 1e-6);
                    }
                    device_ms.push(device.stages.iter().map(|stage| stage.ns as f64 * 1e-6).sum());
                }
            }
            let start = Instant::now();
            gpu.submit(left, right)?;
            for _ in 1..pairs {
                gpu.submit(left, right)?;
                collect(&mut gpu, &mut map)?;
            }
            collect(&mut gpu, &mut map)?;
            let flow_hz = pairs as f64 / start.elapsed().as_secs_f64();
            let nodes = gpu.nodes() as f64;
            println!(
                "{width}x{height}x{disparities} {method}: {:.3} ms a pair, {flow_hz:.1} pairs a second with two in flight, \
                 {:.1} M nodes",
                median(&mut wall_ms),
                nodes * 1e-6
            );
            if stages > 0 {
                let ms = median(&mut device_ms);
                println!("  device {ms:.3} ms, {:.1} GB/s", BYTES_PER_NODE * nodes / ms * 1e-6);
                for (times, stage) in stage_ms.iter_mut().zip(perception::stereo::device::STAGES) {
                    println!("  {stage:<10} {:.3} ms", median(times));
                }
            }
        }
    }
    Ok(())
}
