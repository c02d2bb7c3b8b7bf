//! Running time of the road stage compared with that of the stereo stage, on the same synthetic street.
//! `cargo bench -p lookout-perception --bench road`.

use criterion::{Criterion, criterion_group, criterion_main};
use lookout_perception::depth::DepthView;
use lookout_perception::image::{GreyImage, GreyView};
use lookout_perception::rig::Rig;
use lookout_perception::scene::{SceneDetector, SceneParameters};
use lookout_perception::stereo::{DisparityView, MatchOutput, Matcher, Mpv, MpvParameters, Search};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
/// Rig of the paper, 1.2 m above the road.
const RIG: Rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 220.0 };
const CAMERA_HEIGHT_M: f64 = 1.2;

/// Obstacles in the street: left and right side, height and distance, in metres.
const OBSTACLES: [(f64, f64, f64, f64); 12] = [
    (-0.9, 0.9, 1.5, 18.0),
    (-4.2, -2.4, 1.5, 9.0),
    (-4.2, -2.4, 1.5, 15.0),
    (-4.2, -2.4, 1.5, 22.0),
    (2.6, 4.4, 1.6, 12.0),
    (2.6, 4.4, 1.6, 19.0),
    (1.9, 2.3, 1.8, 8.0),
    (3.4, 3.7, 2.9, 10.0),
    (-2.0, -1.6, 0.7, 7.0),
    (-9.0, -6.0, 3.0, 25.0),
    (6.0, 9.0, 3.0, 26.0),
    (0.9, 2.5, 1.5, 34.0),
];

/// Disparity of a pixel: the road, an obstacle, or houses 45 m away.
fn truth(x: usize, y: usize) -> f64 {
    let road = RIG.baseline_m / CAMERA_HEIGHT_M * (y as f64 - RIG.cy_px);
    OBSTACLES.iter().fold(road.max(RIG.disparity_px(45.0)), |nearest, &(left, right, tall, distance)| {
        let across = RIG.lateral_m(x as f64, distance);
        let up = CAMERA_HEIGHT_M - (y as f64 - RIG.cy_px) * distance / RIG.focal_px;
        let there = (left..=right).contains(&across) && (0.0..=tall).contains(&up);
        if there { nearest.max(RIG.disparity_px(distance)) } else { nearest }
    })
}

/// A textured image pair of the street with two grey levels of noise in each image.
fn pair(disparities: usize) -> (GreyImage, GreyImage) {
    let mut random = fastrand::Rng::with_seed(1);
    let wide = WIDTH + disparities + 2;
    let texture: Vec<f64> = (0..wide * HEIGHT).map(|_| f64::from(random.u8(40..200))).collect();
    let mut noisy = |at: f64, y: usize| {
        let (column, share) = (at as usize, at.fract());
        let row = &texture[y * wide..][..wide];
        (row[column] * (1.0 - share) + row[column + 1] * share + 4.0 * (random.f64() - 0.5)).round() as u8
    };
    let (mut left, mut right) = (GreyImage::new(WIDTH, HEIGHT), GreyImage::new(WIDTH, HEIGHT));
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let right_at = (x + disparities) as f64;
            left.as_mut_slice()[y * WIDTH + x] = noisy(right_at - truth(x, y), y);
            right.as_mut_slice()[y * WIDTH + x] = noisy(right_at, y);
        }
    }
    (left, right)
}

/// Computes the disparity map of one pair.
fn match_pair(matcher: &mut Mpv, (left, right): (GreyView<'_>, GreyView<'_>), map: &mut (Vec<u16>, Vec<u8>)) {
    let output = MatchOutput { disparity: &mut map.0, confidence: &mut map.1 };
    assert!(matcher.compute(left, right, output).is_ok(), "the sizes fit");
}

fn stages(c: &mut Criterion) {
    for disparities in [64, 128] {
        let mut group = c.benchmark_group(format!("stage/{WIDTH}x{HEIGHT}x{disparities}"));
        group.sample_size(40);
        let (left, right) = pair(disparities);
        let views = (left.view(), right.view());
        let parameters = MpvParameters::default();
        let Ok(mut matcher) = Mpv::new(parameters, Search::Windows, WIDTH, HEIGHT, disparities) else {
            continue;
        };
        let mut map = (vec![0; WIDTH * HEIGHT], vec![0; WIDTH * HEIGHT]);
        group.bench_function("stereo, fast", |b| b.iter(|| match_pair(&mut matcher, views, &mut map)));
        // The map is needed even if the stereo benchmark is filtered out.
        match_pair(&mut matcher, views, &mut map);
        let depth = DisparityView::new(&map.0, WIDTH, HEIGHT).and_then(|view| DepthView::new(view, &map.1));
        let Some(depth) = depth else { continue };
        let mut detector = SceneDetector::new(SceneParameters::default(), RIG, WIDTH, HEIGHT, disparities);
        for _ in 0..5 {
            detector.detect(depth);
        }
        let scene = detector.detect(depth);
        assert!(
            scene.road.is_some() && scene.regions.len() >= 6,
            "a street: {} regions",
            scene.regions.len()
        );
        group.bench_function("road without small obstacles", |b| {
            b.iter(|| detector.detect(depth).regions.len())
        });
        if let Some(depth) = depth.with_images([views.0, views.1]) {
            group.bench_function("road", |b| b.iter(|| detector.detect(depth).regions.len()));
        }
        group.finish();
    }
}

criterion_group!(benches, stages);
criterion_main!(benches);
