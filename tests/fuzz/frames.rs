//! Content that no message check refuses: any disparity in any pixel, any image.

use super::harness::fuzz;
use perception::depth::DepthView;
use perception::image::GreyView;
use perception::rig::Rig;
use perception::scene::{SceneDetector, SceneParameters};
use perception::stereo::{DisparityView, MatchOutput, Matcher, Mpv, MpvParameters, Search};

const WIDTH: usize = 96;
const HEIGHT: usize = 64;

/// A rig whose pictures are so small.
const RIG: Rig = Rig { focal_px: 130.0, baseline_m: 0.12, cx_px: 48.0, cy_px: 28.0 };

/// A flat road 1.2 m below the camera, with a wall of 2 m at `wall_px`.
fn road(wall_px: f64) -> Vec<u8> {
    let mut out = Vec::new();
    for row in 0..HEIGHT {
        let ground = (row as f64 - RIG.cy_px) * RIG.baseline_m / 1.2;
        for column in 0..WIDTH {
            let is_wall = (40..60).contains(&column) && ground < wall_px && row > 10;
            let disparity = if is_wall { wall_px } else { ground.max(0.0) };
            out.extend(((disparity * 256.0) as u16).to_le_bytes());
        }
    }
    out
}

#[test]
fn disparity() {
    let seeds = vec![road(0.0), road(1.5), road(2.5), vec![0xff; 2 * WIDTH * HEIGHT], vec![0; 8]];
    fuzz("frames::disparity", seeds, 3 * WIDTH * HEIGHT, |input, _| {
        let (map, confidence) = input.split_at(input.len().min(2 * WIDTH * HEIGHT));
        let mut confidence = confidence.to_vec();
        confidence.resize(WIDTH * HEIGHT, u8::MAX);
        let mut map: Vec<u16> = map.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
        map.resize(WIDTH * HEIGHT, 0);
        let mut detector = SceneDetector::new(SceneParameters::default(), RIG, WIDTH, HEIGHT, 32);
        // Pictures that have nothing to do with each other, or with the map.
        let right: Vec<u8> = map.iter().map(|d| (d >> 4) as u8).collect();
        let mut said = String::new();
        // Small obstacles are confirmed in the third frame.
        for _ in 0..3 {
            let view = DisparityView::new(&map, WIDTH, HEIGHT).expect("the map fits");
            let pictures = [&confidence, &right]
                .map(|data| GreyView::new(data, WIDTH, HEIGHT, WIDTH).expect("the pictures fit"));
            let depth = DepthView::new(view, &confidence).expect("the confidences fit");
            let scene = detector.detect(depth.with_images(pictures).expect("they have one size"));
            for r in scene.regions {
                // What a reader of regions insists on.
                let b = r.bounds;
                assert!(
                    b.x as usize + b.width as usize <= WIDTH && b.y as usize + b.height as usize <= HEIGHT
                );
                let measures = [r.disparity_sigma_px, r.distance_m, r.lateral_m, r.width_m, r.height_m];
                assert!(r.disparity_px > 0.0 && measures.iter().all(|v| v.is_finite()), "{r:?}");
            }
            assert_eq!(scene.profile_px.len(), HEIGHT);
            let road = scene.road.map(|r| (r.confidence * 5.0) as u32);
            said = format!("{road:?} {}", "x".repeat(scene.regions.len().min(20)));
        }
        said
    });
}

/// A textured pair, shifted by 6 px.
fn pair() -> Vec<u8> {
    let mut random = fastrand::Rng::with_seed(9);
    let texture: Vec<u8> = std::iter::repeat_with(|| random.u8(..)).take((WIDTH + 6) * HEIGHT).collect();
    let rows =
        |from: usize| texture.chunks_exact(WIDTH + 6).flat_map(move |row| row[from..from + WIDTH].to_vec());
    rows(0).chain(rows(6)).collect()
}

#[test]
fn pictures() {
    let size = WIDTH * HEIGHT;
    let seeds = vec![pair(), vec![0; 2 * size], vec![255; 2 * size], [0, 255].repeat(size)];
    fuzz("frames::pictures", seeds, 2 * size, |input, _| {
        let mut both = input.to_vec();
        both.resize(2 * size, 128);
        let view = |data| GreyView::new(data, WIDTH, HEIGHT, WIDTH).expect("the picture fits");
        let (left, right) = both.split_at(size);
        let mut said = String::new();
        for search in [Search::Windows, Search::Full] {
            let mut matcher =
                Mpv::new(MpvParameters::default(), search, WIDTH, HEIGHT, 32).expect("a size that fits");
            let (mut disparity, mut confidence) = (vec![0; size], vec![0; size]);
            let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
            matcher.compute(view(left), view(right), output).expect("the sizes agree");
            assert!(disparity.iter().all(|&d| d < 32 * 256), "a disparity beyond those that are searched");
            assert!(disparity.iter().zip(&confidence).all(|(&d, &c)| d > 0 || c == 0));
            said += &"x".repeat(disparity.iter().filter(|&&d| d > 0).count() * 10 / size);
            said.push(' ');
        }
        said
    });
}
