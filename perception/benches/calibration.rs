//! Benchmarks of rectification and calibration. `cargo bench -p lookout-perception --bench calibration`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lookout_perception::calibration::{
    Board, Camera, Crop, Distortion, Lens, Pair, Places, Pose, Rectification, calibrate, finder,
};
use lookout_perception::image::GreyImage;
use lookout_perception::rectify::Remap;
use lookout_perception::simd::Level;
use nalgebra::{Rotation3, Vector2, Vector3};

fn cameras() -> ([Camera; 2], Pose) {
    let left = Camera {
        distortion: Distortion::BrownConrady([0.115, -0.21, -0.0006, -0.0027, 0.0, 0.0, 0.0, 0.0]),
        ..Camera::pinhole(463.1, 462.8, 314.8, 237.3)
    };
    let between = Pose {
        rotation: Rotation3::new(Vector3::new(0.0074, 0.0222, 0.0096)),
        translation_m: Vector3::new(-0.094, -0.0009, 0.0025),
    };
    ([left, Camera { cx_px: 326.9, ..left }], between)
}

fn remap(c: &mut Criterion) {
    let (cameras, between) = cameras();
    let mut random = fastrand::Rng::with_seed(1);
    let pixels = (0..640 * 480).map(|_| random.u8(..)).collect();
    let Ok(image) = GreyImage::from_vec(pixels, 640, 480) else { return };
    let Ok(r) = Rectification::new(&cameras, &between, (640, 480), Crop::Valid) else { return };
    let mut out = vec![0; 640 * 480];
    let mut group = c.benchmark_group("remap/640x480");
    group.throughput(Throughput::Elements(640 * 480));
    for level in Level::available() {
        let table = Remap::new(level, 640, 480, |x, y| {
            r.source(&cameras, 0, Vector2::new(x as f64, y as f64)).map(|p| (p.x, p.y))
        });
        group.bench_function(level.name(), |b| b.iter(|| table.apply(image.view(), &mut out)));
    }
    group.finish();
}

fn solve(c: &mut Criterion) {
    let (cameras, between) = cameras();
    let Ok(board) = Board::new(9, 6, 0.025) else { return };
    let mut random = fastrand::Rng::with_seed(2);
    let mut noise = || 0.3 * (random.f64() + random.f64() + random.f64() - 1.5);
    let pairs: Vec<Pair> = (0..29)
        .filter_map(|i| {
            let way = f64::from(i) * 2.4;
            let pose = Pose {
                rotation: Rotation3::new(Vector3::new(0.5 * way.cos(), 0.5 * way.sin(), 0.1 * way.sin())),
                translation_m: Vector3::new(
                    0.05 + 0.1 * way.sin(),
                    0.06 * way.cos(),
                    0.5 + 0.01 * f64::from(i),
                ),
            };
            let mut side = |camera: &Camera, pose: &Pose| -> Option<Places> {
                let see = |p: &Vector2<f64>| camera.project(&pose.apply(&Vector3::new(p.x, p.y, 0.0)));
                board
                    .points_m()
                    .iter()
                    .map(|p| Some(Some(see(p)? + Vector2::new(noise(), noise()))))
                    .collect()
            };
            Some(Pair { left: side(&cameras[0], &pose)?, right: side(&cameras[1], &pose.then(&between))? })
        })
        .collect();
    c.bench_function("calibrate/29 pairs of 54 corners", |b| {
        b.iter(|| calibrate(&board, (640, 480), &pairs, Lens::Radial2, Crop::Valid));
    });
    let mut picture = GreyImage::new(640, 480);
    c.bench_function("find/no board, noise", |b| {
        picture.as_mut_slice().iter_mut().for_each(|v| *v = random.u8(..));
        b.iter(|| finder::find(picture.view(), &board));
    });
    // The worst case without a spatial index: thousands of saddle points that all fit beside each other.
    let mut field = GreyImage::new(900, 700);
    for (i, v) in field.as_mut_slice().iter_mut().enumerate() {
        let (x, y) = ((i % 900) as f64, (i / 900) as f64);
        let side = |a: f64| (4.0 * (std::f64::consts::PI * a / 9.0).sin()).clamp(-1.0, 1.0);
        *v = (120.0 + 90.0 * side(x + 0.07 * y) * side(y - 0.05 * x)) as u8;
    }
    c.bench_function("find/no board, field of small checks", |b| {
        b.iter(|| finder::find(field.view(), &board));
    });
}

criterion_group!(benches, remap, solve);
criterion_main!(benches);
