use super::super::cascade::{Branch, Features, HaarFeature, LbpFeature, Node, Split, Stage, WeightedRect};
use super::super::integral::Integral;
use super::*;
use crate::image::GreyImage;

/// Accepts windows whose upper left block is darker than the centre.
fn dark_corner() -> Cascade {
    let mut subset = [0; 8];
    for code in (0..=255_u8).filter(|code| code & 128 == 0) {
        subset[usize::from(code >> 5)] |= 1_u32 << (code & 31);
    }
    let split = Split::Subset(subset);
    let node = Node { feature: 0, split, left: Branch::Leaf(1.0), right: Branch::Leaf(-1.0) };
    Cascade {
        width: 24,
        height: 24,
        features: Features::Lbp(vec![LbpFeature { x: 0, y: 0, width: 8, height: 8 }]),
        stages: vec![Stage { threshold: 0.0, trees: vec![vec![node]] }],
    }
}

fn scanner(width: usize, height: usize) -> Scanner {
    Scanner::new(&dark_corner(), width, height, usize::MAX)
}

#[test]
fn the_papers_range_gives_five_sizes_of_a_24_pixel_window() {
    let mut scanner = scanner(640, 480);
    scanner.choose_scales(Sizes::default(), 640, 480);
    let sizes: Vec<i32> = scanner.scales.iter().map(|&s| round(24.0 * f64::from(s))).collect();
    assert_eq!(sizes, [31, 41, 53, 69, 89]);
    // A crop too small for the minimum size gets the closest size, a tiny one none.
    scanner.choose_scales(Sizes::default(), 28, 28);
    assert_eq!(scanner.scales, [1.0]);
    scanner.choose_scales(Sizes::default(), 23, 50);
    assert!(scanner.scales.is_empty());
}

#[test]
fn an_expected_size_gives_two() {
    let mut scanner = scanner(640, 480);
    scanner.choose_scales(Sizes::Around { width_px: 48.0, growth: 1.44 }, 200, 200);
    assert_eq!(scanner.scales, [(2.0_f64 / 1.2) as f32, (2.0_f64 * 1.2) as f32]);
    // As large as the crop allows, and no smaller than the image can be enlarged.
    scanner.choose_scales(Sizes::Around { width_px: 100.0, growth: 1.3 }, 48, 60);
    assert_eq!(scanner.scales, [2.0]);
    scanner.choose_scales(Sizes::Around { width_px: 2.0, growth: 1.3 }, 48, 60);
    assert_eq!(scanner.scales, [MIN_SCALE as f32]);
    scanner.choose_scales(Sizes::Around { width_px: 2.0, growth: 1.3 }, 8, 8);
    assert!(scanner.scales.is_empty());
    scanner.choose_scales(Sizes::Around { width_px: f64::NAN, growth: 1.3 }, 8, 8);
    assert!(scanner.scales.iter().all(|s| s.is_finite()));
    // An image of the maximum size is not enlarged.
    let full = GreyImage::new(640, 480);
    scanner.scan(full.view(), Sizes::Around { width_px: 10.0, growth: 1.3 });
    assert!(scanner.scales[0] > 0.99);
}

#[test]
fn hits_are_where_the_pattern_is() {
    let (width, height) = (60, 50);
    let mut image = GreyImage::new(width, height);
    // One bright 10×10 patch on black.
    for y in 20..30 {
        for x in 30..40 {
            image.as_mut_slice()[y * width + x] = 200;
        }
    }
    let mut scanner = scanner(width, height);
    let hits = scanner.scan(image.view(), Sizes::default()).to_vec();
    assert!(!hits.is_empty());
    for hit in &hits {
        // The patch touches the centre block of each hit.
        let (third_x, third_y) = (hit.width / 3 + 2, hit.height / 3 + 2);
        assert!(hit.x + third_x - 2 < 42 && hit.x + 2 * third_x > 28, "{hit:?}");
        assert!(hit.y + third_y - 2 < 32 && hit.y + 2 * third_y > 18, "{hit:?}");
    }
    // A black image: no centre is brighter than its corner.
    assert!(scanner.scan(GreyImage::new(width, height).view(), Sizes::default()).is_empty());
    // Too small for any window.
    assert!(scanner.scan(GreyImage::new(5, 5).view(), Sizes::default()).is_empty());
}

/// A cascade of random trees with `nodes` decisions each, over a window of `side` pixels.
fn random_cascade(seed: u64, haar: bool, side: u16, nodes: u16) -> Cascade {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut place = |span: u16| {
        let x = random.u16(0..=side - span);
        (x, random.u16(1..=(side - x) / span))
    };
    let mut features = Vec::new();
    let mut haars = Vec::new();
    for i in 0..40_u16 {
        let ((x, w), (y, h)) = (place(3), place(3));
        features.push(LbpFeature { x, y, width: w, height: h });
        let tilted = i % 3 == 0;
        let rect = |x, y, width, height, weight| WeightedRect { x, y, width, height, weight };
        let third = if i % 2 == 0 { rect(x, y, w, h, 1.0) } else { WeightedRect::default() };
        haars.push(if tilted {
            let arm = side / 6 + i % 3;
            let top = i % 4;
            HaarFeature {
                rects: [
                    rect(side / 2, top, arm, arm, -1.0),
                    rect(side / 2, top, arm, arm / 2, 2.0),
                    WeightedRect::default(),
                ],
                tilted,
            }
        } else {
            HaarFeature { rects: [rect(x, y, 2 * w, 3 * h, -1.0), rect(x, y, w, 3 * h, 2.0), third], tilted }
        });
    }
    let mut tree = || -> Vec<Node> {
        let mut free: Vec<(u16, bool)> = Vec::new();
        let mut tree: Vec<Node> = Vec::new();
        for i in 0..nodes {
            let mut leaf = || Branch::Leaf(random.f32() * 2.0 - 1.0);
            let (left, right) = (leaf(), leaf());
            let split = if haar {
                Split::Threshold(random.f32() * 0.4 - 0.2)
            } else {
                Split::Subset(std::array::from_fn(|_| random.u32(..)))
            };
            tree.push(Node { feature: random.u32(0..40), split, left, right });
            if i > 0 {
                let (parent, is_left) = free.swap_remove(random.usize(0..free.len()));
                let parent = &mut tree[usize::from(parent)];
                if is_left { parent.left = Branch::Node(i) } else { parent.right = Branch::Node(i) }
            }
            free.extend([(i, true), (i, false)]);
        }
        tree
    };
    let stages = (0..4).map(|_| Stage {
        threshold: if haar { -2.5 } else { -0.6 },
        trees: (0..5).map(|_| tree()).collect(),
    });
    let stages = stages.collect();
    let features = if haar { Features::Haar(haars) } else { Features::Lbp(features) };
    Cascade { width: side, height: side, features, stages }
}

/// Reference implementation of the scan: one window after the other.
fn plain_scan(cascade: &Cascade, image: GreyView<'_>, scales: &[f32]) -> Vec<Window> {
    let mut hits = Vec::new();
    let side = i32::from(cascade.width);
    for &scale in scales {
        let width = round((image.width() as f32 / scale).into());
        let height = round((image.height() as f32 / scale).into());
        let mut resizer = Resizer::new(width as usize, height as usize);
        let pixels = resizer.scale(image, width as usize, height as usize);
        let integral = Integral::of(pixels, width as usize);
        let step = if scale >= 2.0 { 1 } else { 2 };
        let first = round((image.width() as f32 / scales[0]).into()) - side + 1;
        let stripes = (first as usize).div_ceil(32);
        let stripe = ((height - side + 1) as usize / step).div_ceil(stripes).max(1) * step;
        for y in (0..=height - side).take(stripe * stripes).step_by(step) {
            let mut x = 0;
            while x <= width - side {
                match cascade.stages_passed(&integral, x as usize, y as usize) {
                    Some(0) => x += step as i32,
                    Some(passed) if passed == cascade.stages.len() => hits.push(Window {
                        x: scaled(x, scale),
                        y: scaled(y, scale),
                        width: scaled(side, scale),
                        height: scaled(side, scale),
                    }),
                    _ => {}
                }
                x += step as i32;
            }
        }
    }
    hits
}

#[test]
fn hits_equal_the_reference_at_every_level() {
    let (width, height) = (150, 90);
    let mut random = fastrand::Rng::with_seed(5);
    // Noise over a coarse pattern, with a flat part that has no contrast.
    let data: Vec<u8> = (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            if x < 40 && y < 50 { 90 } else { ((x / 7 * 31 + y / 5 * 57) % 200) as u8 + random.u8(..56) }
        })
        .collect();
    let image = GreyView::new(&data, width, height, width).unwrap();
    let sizes = Sizes::Range { min_px: 0, max_px: 0, growth: 1.25 };
    for (seed, (haar, side, nodes)) in [
        (false, 24, 1),
        (false, 24, 3),
        (false, 60, 3),
        (false, 20, 12),
        (true, 20, 1),
        (true, 24, 3),
        (true, 20, 9),
    ]
    .into_iter()
    .enumerate()
    {
        let mut cascade = random_cascade(seed as u64, haar, side, nodes);
        if nodes == 3 {
            // A stage that begins with the trees of the one before.
            let before = cascade.stages[1].trees.clone();
            cascade.stages[2].trees.splice(0..0, before);
        }
        let mut expected: Option<Vec<Window>> = None;
        for level in Level::available() {
            let mut scanner = Scanner::at_level(&cascade, width + 9, height + 3, usize::MAX, level);
            let hits = scanner.scan(image, sizes).to_vec();
            let expected = expected.get_or_insert_with(|| plain_scan(&cascade, image, &scanner.scales));
            assert!(expected.len() > 20, "{seed}: {} hits", expected.len());
            assert!(
                hits == *expected,
                "{seed}: {} differs: {} of {}",
                level.name(),
                hits.len(),
                expected.len()
            );
            // The same memory again, with less room for hits.
            let mut small = Scanner::at_level(&cascade, width, height, 20, level);
            assert_eq!(small.scan(image, sizes), &expected[..20]);
        }
    }
}
