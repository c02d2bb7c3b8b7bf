//! HOG against OpenCV: `parity/hog.txt`, written by `parity/hog.py`, holds descriptors and detections of OpenCV's
//! `HOGDescriptor` with its people detector on the synthetic picture of this test.

use lookout_perception::image::GreyView;
use lookout_perception::recognition::group::Grouper;
use lookout_perception::recognition::hog::{HogModel, HogScanner};
use lookout_perception::recognition::{Sizes, Window};

const FIXTURE: &str = include_str!("parity/hog.txt");
const PEOPLE: &str = include_str!("../../models/people.hog");
const CELL: usize = 6;

/// Descriptors have values up to 1; what differs is the order of sums, and OpenCV's text has six digits.
const DESCRIPTOR_TOLERANCE: f32 = 2e-5;

/// The same for scores: sums of 3780 products.
const SCORE_TOLERANCE: f32 = 1e-4;

fn noise(x: usize, y: usize, seed: u32) -> usize {
    let mut v = (x as u32).wrapping_mul(73_856_093)
        ^ (y as u32).wrapping_mul(19_349_663)
        ^ seed.wrapping_mul(83_492_791);
    v = v.wrapping_mul(2_654_435_761);
    v ^= v >> 15;
    v = v.wrapping_mul(2_246_822_519);
    (v >> 24) as usize
}

/// Smooth noise with figures (left, top, height), as `hog.py` draws it.
fn picture(width: usize, height: usize, seed: u32, people: &[(usize, usize, usize)]) -> Vec<u8> {
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let (i, j, a, b) = (x / CELL, y / CELL, x % CELL, y % CELL);
            let upper = noise(i, j, seed) * (CELL - a) + noise(i + 1, j, seed) * a;
            let lower = noise(i, j + 1, seed) * (CELL - a) + noise(i + 1, j + 1, seed) * a;
            let smooth = (upper * (CELL - b) + lower * b) / (CELL * CELL);
            let mut grey = smooth / 4 + 150;
            for &(left, top, size) in people {
                if x < left || y < top {
                    continue;
                }
                let (u, v) = ((x - left) * 24 / size, (y - top) * 24 / size);
                let is_figure = match v {
                    0..4 => (4..7).contains(&u),
                    4..13 => (2..9).contains(&u),
                    13..24 => (3..8).contains(&u) && u != 5,
                    _ => false,
                };
                if is_figure {
                    grey = 30 + smooth / 8;
                }
            }
            pixels.push(grey as u8);
        }
    }
    pixels
}

fn numbers<T: std::str::FromStr>(words: &[&str]) -> Vec<T> {
    words.iter().map(|word| word.parse().ok().expect("a number")).collect()
}

#[test]
fn descriptors_scores_and_windows_are_those_of_opencv() {
    let (width, height) = (200, 210);
    let pixels = picture(width, height, 7, &[(30, 20, 96), (110, 30, 130)]);
    let image = GreyView::new(&pixels, width, height, width).expect("an image");
    let model = HogModel::read(PEOPLE).expect("a model");
    let (mut descriptors, mut windows) = (0, 0);
    let mut lines = FIXTURE.lines().filter(|line| !line.starts_with('#')).peekable();
    while let Some(line) = lines.next() {
        let words: Vec<&str> = line.split(' ').collect();
        match words[..] {
            ["descriptor", left, top] => {
                let (left, top): (usize, usize) =
                    (left.parse().expect("a number"), top.parse().expect("a number"));
                let window = image.crop(left, top, 64, 128).expect("a part of the picture");
                let found = HogScanner::new(model.clone(), 64, 128, 0, 1).descriptor(window);
                let expected: Vec<f32> =
                    numbers(&lines.next().expect("values").split(' ').collect::<Vec<_>>());
                assert_eq!(found.len(), expected.len());
                for (i, (a, b)) in found.iter().zip(&expected).enumerate() {
                    assert!((a - b).abs() < DESCRIPTOR_TOLERANCE, "{line}: value {i}: {a}, OpenCV {b}");
                }
                descriptors += 1;
            }
            ["padding", padding, "growth", growth, "threshold", threshold, "group", group] => {
                let mut expected: Vec<([i32; 4], f32)> = Vec::new();
                while let Some(hit) = lines.next_if(|l| !l.starts_with('p')) {
                    let words: Vec<&str> = hit.split(' ').collect();
                    let place: Vec<i32> = numbers(&words[..4]);
                    expected.push((place.try_into().expect("four"), words[4].parse().expect("a score")));
                }
                let sizes = Sizes::Range { min_px: 0, max_px: 0, growth: growth.parse().expect("a number") };
                let padding = padding.parse().expect("a number");
                // A larger maximum size does not change the result.
                let mut scanner = HogScanner::new(model.clone(), width + 30, height + 1, padding, usize::MAX);
                let hits = scanner.scan(image, sizes, threshold.parse().expect("a number"));
                let group: u32 = group.parse().expect("a number");
                // OpenCV clips its windows to the picture at the end.
                let place = |w: Window| {
                    let (x, y) = (w.x.max(0), w.y.max(0));
                    let end = |at: i32, side: usize| at.min(i32::try_from(side).expect("a side"));
                    [x, y, end(w.x + w.width, width) - x, end(w.y + w.height, height) - y]
                };
                if group == 0 {
                    let mut found: Vec<_> = hits.iter().map(|h| (place(h.window), h.score)).collect();
                    found.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
                    assert_eq!(found.len(), expected.len(), "{line}");
                    for (found, expected) in found.iter().zip(&expected) {
                        assert_eq!(found.0, expected.0, "{line}");
                        let apart = (found.1 - expected.1).abs();
                        assert!(apart < SCORE_TOLERANCE, "{line}: {found:?}, OpenCV {expected:?}");
                    }
                } else {
                    let hits: Vec<Window> = hits.iter().map(|h| h.window).collect();
                    let mut grouper = Grouper::default();
                    let mut found: Vec<_> =
                        grouper.group(&hits, group).iter().map(|g| place(g.window)).collect();
                    found.sort_unstable();
                    let expected: Vec<_> = expected.iter().map(|e| e.0).collect();
                    assert_eq!(found, expected, "{line}");
                }
                windows += expected.len();
            }
            _ => panic!("{line}"),
        }
    }
    assert_eq!(descriptors, 2);
    assert!(windows > 50, "{windows}");
}
