//! Benchmarks of the stereo kernels at every instruction-set level, and of whole frames.
//! `cargo bench -p lookout-perception` runs all, `-- frame` or `-- kernel` a part.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use lookout_perception::image::GreyImage;
use lookout_perception::simd::{Lanes, Level};
use lookout_perception::stereo::blocks::Block;
use lookout_perception::stereo::confidence::ConfidenceFilter;
use lookout_perception::stereo::cost::{CostParameters, CostStrip, STRIP};
use lookout_perception::stereo::energy::EnergyRow;
use lookout_perception::stereo::epipolar::field::RowField;
use lookout_perception::stereo::epipolar::pairing::PairingCheck;
use lookout_perception::stereo::epipolar::shift::shift_rows;
use lookout_perception::stereo::epipolar::{EpipolarCheck, EpipolarParameters, MatchedPair};
use lookout_perception::stereo::fill::{BridgeParameters, Fill};
use lookout_perception::stereo::median::Median;
use lookout_perception::stereo::pyramid;
use lookout_perception::stereo::speckle::{SpeckleFilter, SpeckleParameters};
use lookout_perception::stereo::viterbi::{Energies, Merge, PAD, Span, Sum, single, triple};
use lookout_perception::stereo::winner::{Winner, WinnerParameters};
use lookout_perception::stereo::{DisparityView, MatchOutput, Matcher, Mpv, MpvParameters, Search};
use std::hint::black_box;

/// A textured pair with slanted ground and three upright boxes.
fn pair(width: usize, height: usize, disparities: usize) -> (GreyImage, GreyImage) {
    let mut random = fastrand::Rng::with_seed(1);
    let wide = width + disparities;
    let coarse: Vec<u8> = (0..(wide / 2 + 2) * (height / 2 + 2)).map(|_| random.u8(..)).collect();
    let texture = |x: usize, y: usize| {
        let at = |dx: usize, dy: usize| u32::from(coarse[(y / 2 + dy) * (wide / 2 + 2) + x / 2 + dx]);
        let (a, b) = ((x % 2) as u32, (y % 2) as u32);
        ((at(0, 0) * (2 - a) * (2 - b) + at(1, 0) * a * (2 - b) + at(0, 1) * (2 - a) * b + at(1, 1) * a * b)
            / 4) as u8
    };
    let truth = |x: usize, y: usize| {
        let ground = disparities * (height + 3 * y) / (10 * height);
        let part = 8 * x / width;
        let upright = part % 2 == 1 && part < 7 && y > height * part / 12 && y < height * (part + 5) / 12;
        if upright { disparities * (5 + part / 2) / 10 } else { ground }
    };
    let (mut left, mut right) = (GreyImage::new(width, height), GreyImage::new(width, height));
    for y in 0..height {
        for x in 0..width {
            left.as_mut_slice()[y * width + x] = texture(x + disparities - truth(x, y), y);
            right.as_mut_slice()[y * width + x] = texture(x + disparities, y);
        }
    }
    (left, right)
}

fn lanes(count: usize, most: u8) -> Vec<Lanes> {
    let mut random = fastrand::Rng::with_seed(2);
    (0..count).map(|_| Lanes(std::array::from_fn(|_| random.u8(..=most)))).collect()
}

fn kernels(c: &mut Criterion) {
    let n = 64;
    let (left, right) = pair(640, 480, 64);
    for level in Level::available() {
        let mut group = c.benchmark_group(format!("kernel/{}", level.name()));
        group.throughput(Throughput::Elements((STRIP * n * 32) as u64));
        let mut strip = CostStrip::new(CostParameters::default(), level, 640, n);
        let mut costs = vec![Lanes::ZERO; STRIP * n];
        strip.start(left.view(), right.view(), 64);
        group.bench_function("cost of a tile, 32 x 32 x 64 nodes", |b| {
            b.iter(|| strip.tile(black_box(320), 0, n, n, &mut costs));
        });
        group.throughput(Throughput::Elements((640 * STRIP) as u64));
        group.bench_function("statistics of a strip, 640 x 32 pixels", |b| {
            b.iter(|| strip.start(left.view(), right.view(), black_box(64)));
        });

        group.throughput(Throughput::Elements((n * 32) as u64));
        let data = lanes(n, 100);
        let mut out = vec![Lanes::ZERO; n];
        let mut forward = vec![Lanes::ZERO; 3 * n];
        let mut states: [Vec<Lanes>; 3] = std::array::from_fn(|_| lanes(n + 2 * PAD, 150));
        let beside = lanes(n + 2 * PAD, 150);
        let sums = lanes(n, 150);
        let mut three = vec![[Lanes::ZERO; 3]; n];
        let span = Span::new((0, n), (0, n), 0);
        let weight = Lanes::splat(8);
        group.bench_function("one path, 32 x 64 nodes", |b| {
            b.iter(|| {
                let [old, new, _] = &mut states;
                let mut least = Lanes::ZERO;
                single(
                    level,
                    old,
                    &mut least,
                    new,
                    &data,
                    &mut out,
                    &weight,
                    12,
                    0,
                    span,
                    Merge::First,
                    &mut forward,
                );
                std::mem::swap(old, new);
            });
        });
        group.throughput(Throughput::Elements((3 * n * 32) as u64));
        group.bench_function("three paths, 32 x 64 nodes each", |b| {
            b.iter(|| {
                let [first, second, third] = &mut states;
                let mut energies = Energies {
                    straight: first,
                    right: second,
                    right_beside: &beside,
                    left: [&beside, &beside],
                    left_after: third,
                };
                let weights = [&weight; 3];
                triple(
                    level,
                    &mut energies,
                    weights,
                    [0; 3],
                    &data,
                    &mut Sum::Finish { other: &sums, total: &mut out },
                    50,
                    span,
                    &mut three,
                );
            });
        });

        group.throughput(Throughput::Elements((640 * n) as u64));
        let blocks: Vec<Block> =
            (0..20).map(|t| Block { low: 0, high: n, at: t * 32 * (n + 2), ..Block::default() }).collect();
        let energies = lanes(20 * (n + 2), 255);
        let volume = lanes(20 * 32 * (n + 2), 100);
        let mut winner = Winner::new(WinnerParameters::default(), level, 640, n);
        let (mut disparity, mut confidence) = (vec![0; 640], vec![0; 640]);
        group.bench_function("winners of a row, 640 x 64 nodes", |b| {
            b.iter(|| {
                winner.row(EnergyRow::new(3, &blocks, &energies, &volume), &mut disparity, &mut confidence)
            });
        });

        group.throughput(Throughput::Elements(640 * 480));
        let mut random = fastrand::Rng::with_seed(4);
        let map: Vec<u16> =
            (0..640 * 480).map(|i| if random.u8(..20) == 0 { 0 } else { 5000 + i as u16 % 640 }).collect();
        let confidences: Vec<u8> = map.iter().map(|&d| u8::from(d > 0) * 99).collect();
        let mut half = vec![0; 320 * 240];
        group.bench_function("halving, 640 x 480 pixels", |b| {
            b.iter(|| pyramid::halve(level, left.view(), &mut half));
        });
        let mut median = Median::new(level, 640, 1);
        let mut copy = map.clone();
        group.bench_function("median, 640 x 480 pixels", |b| b.iter(|| median.apply(&mut copy)));
        let mut mean = ConfidenceFilter::new(level, 640, 1);
        let mut filtered = confidences.clone();
        group.bench_function("confidence, 640 x 480 pixels", |b| b.iter(|| mean.apply(&mut filtered)));
        let mut speckle = SpeckleFilter::new(level, SpeckleParameters::default(), 640, 480, 1);
        let mut copy = map.clone();
        group.bench_function("speckles, 640 x 480 pixels", |b| b.iter(|| speckle.apply(&mut copy)));
        if level == Level::PLAIN {
            let fill = Fill::new(BridgeParameters::default(), 640, 1);
            let (mut copy, mut filtered) = (map.clone(), confidences.clone());
            group.bench_function("bridges, 640 x 480 pixels", |b| {
                b.iter(|| {
                    copy.copy_from_slice(&map);
                    filtered.copy_from_slice(&confidences);
                    fill.bridge(&mut copy, &mut filtered);
                });
            });
        }
        group.finish();
    }
}

fn frames(c: &mut Criterion) {
    for (width, height, disparities) in [(640, 480, 64), (640, 480, 128), (1242, 375, 128)] {
        let (left, right) = pair(width, height, disparities);
        let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
        let mut group = c.benchmark_group(format!("frame/{width}x{height}x{disparities}"));
        group.sample_size(20);
        for (name, search) in [("fast", Search::Windows), ("full", Search::Full)] {
            // The plain level takes seconds per frame and is not used on boards.
            for level in Level::available().into_iter().skip(1) {
                let parameters = MpvParameters::default();
                let Ok(mut matcher) = Mpv::at_level(level, parameters, search, width, height, disparities)
                else {
                    continue;
                };
                group.bench_function(BenchmarkId::new(name, level.name()), |b| {
                    b.iter(|| {
                        let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
                        matcher.compute(left.view(), right.view(), output)
                    });
                });
            }
        }
        // The monitor needs a map, even if the benchmarks above are filtered out.
        let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
        if let Ok(mut matcher) = Mpv::at_level(
            Level::best(),
            MpvParameters::default(),
            Search::Windows,
            width,
            height,
            disparities,
        ) {
            let _ = matcher.compute(left.view(), right.view(), output);
        }
        let mut check = EpipolarCheck::new(EpipolarParameters::default());
        group.bench_function("calibration check", |b| {
            b.iter(|| {
                let disparity = DisparityView::new(&disparity, width, height)?;
                let pair = MatchedPair {
                    left: left.view(),
                    right: right.view(),
                    disparity,
                    confidence: &confidence,
                };
                Some(check.update(pair, &RowField::ZERO, 0.1))
            });
        });
        let mut pairing = PairingCheck::new(width, height, 4.0);
        group.bench_function("pairing check", |b| b.iter(|| pairing.update(left.view(), right.view())));
        let field = RowField { offset_px: 0.6, across_px: -0.2, down_px: 0.1 };
        group.bench_function("row shift", |b| {
            b.iter(|| shift_rows(Level::best(), right.view(), &field, &mut confidence));
        });
        group.finish();
    }
}

criterion_group!(benches, kernels, frames);
criterion_main!(benches);
