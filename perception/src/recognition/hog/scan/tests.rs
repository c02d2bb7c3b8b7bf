use super::super::gradient::reflected;
use super::super::model::weight_count;
use super::*;

/// Smooth noise.
fn picture(width: usize, height: usize, seed: u64) -> Vec<u8> {
    let mut random = fastrand::Rng::with_seed(seed);
    let coarse: Vec<f64> = (0..(width / 4 + 2) * (height / 4 + 2)).map(|_| random.f64() * 255.0).collect();
    let stride = width / 4 + 2;
    (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let (a, b) = ((x % 4) as f64 / 4.0, (y % 4) as f64 / 4.0);
            let at = |dx: usize, dy: usize| coarse[(y / 4 + dy) * stride + x / 4 + dx];
            let (upper, lower) = (at(0, 0) * (1.0 - a) + at(1, 0) * a, at(0, 1) * (1.0 - a) + at(1, 1) * a);
            (upper * (1.0 - b) + lower * b) as u8
        })
        .collect()
}

fn model(seed: u64) -> HogModel {
    let mut random = fastrand::Rng::with_seed(seed);
    let weights: Vec<f32> = (0..weight_count(32, 48)).map(|_| random.f32() - 0.5).collect();
    HogModel::new(32, 48, 0.25, &weights).unwrap()
}

/// The descriptor of a window, pixel by pixel in double precision, as the method is described.
fn reference(image: GreyView<'_>) -> Vec<f64> {
    let (width, height) = (image.width(), image.height());
    let root = |x: isize, y: isize| f64::from(image.at(reflected(x, width), reflected(y, height))).sqrt();
    let mut out = Vec::new();
    for column in 0..width / CELL - 1 {
        for row in 0..height / CELL - 1 {
            let mut block = [0.0_f64; BLOCK];
            for i in 0..2 * CELL {
                for j in 0..2 * CELL {
                    let (x, y) = ((column * CELL + j) as isize, (row * CELL + i) as isize);
                    let (dx, dy) = (root(x + 1, y) - root(x - 1, y), root(x, y + 1) - root(x, y - 1));
                    let place =
                        dy.atan2(dx).rem_euclid(std::f64::consts::PI) / std::f64::consts::PI * 9.0 - 0.5;
                    let (di, dj) = (i as f64 - 8.0, j as f64 - 8.0);
                    let weight = dx.hypot(dy) * (-(di * di + dj * dj) / 32.0).exp();
                    for cell in 0..4 {
                        let near = |i: usize, cell: usize| {
                            (1.0 - ((i as f64 + 0.5) / 8.0 - 0.5 - cell as f64).abs()).max(0.0)
                        };
                        let share = weight * near(j, cell / 2) * near(i, cell % 2);
                        let (first, part) = (place.floor(), place - place.floor());
                        let bin = |b: f64| cell * BINS + b.rem_euclid(9.0) as usize;
                        block[bin(first)] += share * (1.0 - part);
                        block[bin(first + 1.0)] += share * part;
                    }
                }
            }
            let norm = |b: &[f64; BLOCK]| b.iter().map(|v| v * v).sum::<f64>().sqrt();
            let scale = 1.0 / (norm(&block) + 3.6);
            block.iter_mut().for_each(|v| *v = (*v * scale).min(0.2));
            let scale = 1.0 / (norm(&block) + 1e-3);
            out.extend(block.map(|v| v * scale));
        }
    }
    out
}

#[test]
fn descriptors_are_those_of_the_method_pixel_by_pixel() {
    for seed in 0..4 {
        let data = picture(32, 48, seed);
        let image = GreyView::new(&data, 32, 48, 32).unwrap();
        let found = HogScanner::new(model(1), 40, 50, 8, 10).descriptor(image);
        let expected = reference(image);
        assert_eq!(found.len(), expected.len());
        let worst = found.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
        // The polynomial of the arc tangent, which is OpenCV's, is a hundredth of a degree off.
        assert!(worst < 2e-3, "{worst}");
    }
}

#[test]
fn all_levels_give_the_same_bits() {
    let (width, height) = (117, 91);
    let data = picture(width, height, 3);
    let image = GreyView::new(&data, width, height, width).unwrap();
    let sizes = Sizes::Range { min_px: 0, max_px: 0, growth: 1.2 };
    let scan = |level| {
        let mut scanner = HogScanner::new(model(2), width, height, 8, usize::MAX).with_level(level);
        let hits = scanner.scan(image, sizes, f32::MIN).to_vec();
        (hits, scanner.blocks)
    };
    let plain = scan(Level::PLAIN);
    assert!(plain.0.len() > 100, "{}", plain.0.len());
    for level in Level::available() {
        assert!(scan(level) == plain, "{} differs from plain", level.name());
    }
}

#[test]
fn a_window_of_the_expected_size_is_found_also_in_a_crop_without_room_around_it() {
    let data = picture(32, 48, 9);
    let window = GreyView::new(&data, 32, 48, 32).unwrap();
    // The plane through this very picture.
    let weights = HogScanner::new(model(1), 40, 50, 0, 10).descriptor(window);
    let model = HogModel::new(32, 48, -1.0, &weights).unwrap();
    let mut scanner = HogScanner::new(model, 80, 90, 8, 50);
    let best = |hits: &[ScoredWindow]| *hits.iter().max_by(|a, b| a.score.total_cmp(&b.score)).unwrap();
    let found = best(scanner.scan(window, Sizes::Around { width_px: 32.0, growth: 1.0 }, f32::MIN));
    let Window { x, y, width, height } = found.window;
    assert!(x.abs() <= 1 && y.abs() <= 1 && width.abs_diff(32) < 2 && height.abs_diff(48) < 2, "{found:?}");
    // A crop smaller than the window is enlarged as far as the memory allows, and then not searched.
    let small = GreyView::new(&data[..64], 8, 8, 8).unwrap();
    scanner.scan(small, Sizes::Around { width_px: 400.0, growth: 1.3 }, f32::MIN);
    // No more hits than there is memory for.
    let many = scanner.scan(window, Sizes::Around { width_px: 20.0, growth: 1.3 }, f32::MIN).len();
    assert!((1..=50).contains(&many), "{many}");
}
