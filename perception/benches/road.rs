//! Times of the road stage beside the stereo stage, whole frames of 640 × 480.
//! `cargo bench -p lookout-perception --bench road`.

use criterion::{Criterion, criterion_group, criterion_main};
use lookout_perception::image::GreyImage;
use lookout_perception::rig::Rig;
use lookout_perception::road::{DepthView, RoadDetector, RoadParameters};
use lookout_perception::stereo::{DisparityView, MatchOutput, Mpv, MpvParameters, Search};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const DISPARITIES: usize = 64;
const RIG: Rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 220.0 };

/// A textured road below the horizon with three things on it, and a wall at its end.
fn pair() -> (GreyImage, GreyImage) {
    let mut random = fastrand::Rng::with_seed(1);
    let wide = WIDTH + DISPARITIES;
    let noise: Vec<u8> = (0..wide * HEIGHT).map(|_| random.u8(60..160)).collect();
    let disparity = |x: usize, y: usize| {
        let road = (0.096 * (y as f64 - RIG.cy_px)).max(2.0);
        let things = [(100..180, 200..330, 11.0), (300..380, 220..290, 7.0), (450..480, 230..400, 18.0)];
        let thing = things.iter().find(|(columns, rows, _)| columns.contains(&x) && rows.contains(&y));
        thing.map_or(road, |t| t.2)
    };
    let (mut left, mut right) = (GreyImage::new(WIDTH, HEIGHT), GreyImage::new(WIDTH, HEIGHT));
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            // Between two pixels, so that disparities are finer than one.
            let at = (x + DISPARITIES) as f64 - disparity(x, y);
            let (i, share) = (at as usize, at.fract());
            let [a, b] = [i, i + 1].map(|i| f64::from(noise[y * wide + i.min(wide - 1)]));
            left.as_mut_slice()[y * WIDTH + x] = (a + share * (b - a)) as u8;
            right.as_mut_slice()[y * WIDTH + x] = noise[y * wide + x + DISPARITIES];
        }
    }
    (left, right)
}

fn frame(c: &mut Criterion) {
    let (left, right) = pair();
    let (mut disparity, mut confidence) = (vec![0; WIDTH * HEIGHT], vec![0; WIDTH * HEIGHT]);
    let mut group = c.benchmark_group("frame/640x480");
    let matcher = Mpv::new(MpvParameters::default(), Search::Windows, WIDTH, HEIGHT, DISPARITIES);
    let Ok(mut matcher) = matcher else { return };
    group.bench_function("stereo, fast, 64 disparities", |b| {
        b.iter(|| {
            let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
            matcher.compute(left.view(), right.view(), output).is_ok()
        });
    });
    let view = DisparityView::new(&disparity, WIDTH, HEIGHT);
    let Some(map) = view.and_then(|view| DepthView::new(view, &confidence)) else { return };
    let Some(with_pictures) = map.with_pictures([left.view(), right.view()]) else { return };
    for (name, depth) in [("road", with_pictures), ("road without small things", map)] {
        let mut detector = RoadDetector::new(RoadParameters::default(), RIG, WIDTH, HEIGHT, DISPARITIES);
        group.bench_function(name, |b| b.iter(|| detector.detect(depth).regions.len()));
    }
    group.finish();
}

criterion_group!(benches, frame);
criterion_main!(benches);
