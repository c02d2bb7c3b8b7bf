//! The detector against OpenCV 4.14: `parity/hits.txt` holds the result of `detectMultiScale` on the synthetic image
//! of this test, for two cascades that `lookout train` trained on such images.

use lookout_perception::image::GreyView;
use lookout_perception::recognition::{Detector, Sizes, Window, xml};

const CASCADES: [(&str, &str); 2] =
    [("lbp", include_str!("parity/lbp.xml")), ("haar-tilted", include_str!("parity/haar-tilted.xml"))];

const HITS: &str = include_str!("parity/hits.txt");

fn hash(x: usize, y: usize, seed: u32) -> usize {
    let mut v = (x as u32).wrapping_mul(73_856_093)
        ^ (y as u32).wrapping_mul(19_349_663)
        ^ seed.wrapping_mul(83_492_791);
    v = v.wrapping_mul(2_654_435_761);
    v ^= v >> 15;
    v = v.wrapping_mul(2_246_822_519);
    (v >> 24) as usize
}

/// Smooth noise with objects at (left, top, side): a roof, a window between posts, wheels.
fn synthetic_image(width: usize, height: usize, seed: u32, objects: &[(usize, usize, usize)]) -> Vec<u8> {
    const CELL: usize = 6;
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let (i, j, a, b) = (x / CELL, y / CELL, x % CELL, y % CELL);
            let upper = hash(i, j, seed) * (CELL - a) + hash(i + 1, j, seed) * a;
            let lower = hash(i, j + 1, seed) * (CELL - a) + hash(i + 1, j + 1, seed) * a;
            let noise = (upper * (CELL - b) + lower * b) / (CELL * CELL);
            let mut value = noise;
            for &(left, top, side) in objects {
                if (left..left + side).contains(&x) && (top..top + side).contains(&y) {
                    let (u, v) = ((x - left) * 24 / side, (y - top) * 24 / side);
                    let colour = match v {
                        0..8 => 60,
                        8..16 if (4..20).contains(&u) => 170,
                        8..16 => 30,
                        _ if (6..18).contains(&u) => 110,
                        _ => 20,
                    };
                    value = colour + noise / 8;
                }
            }
            pixels.push(value as u8);
        }
    }
    pixels
}

#[test]
fn hits_and_groups_are_those_of_opencv() {
    let (width, height) = (200, 150);
    let objects = [(20, 15, 30), (80, 40, 48), (140, 90, 36), (60, 100, 26)];
    let pixels = synthetic_image(width, height, 7, &objects);
    let image = GreyView::new(&pixels, width, height, width).expect("an image");
    let mut compared = 0;
    let mut lines = HITS.lines().peekable();
    while let Some(line) = lines.next() {
        let words: Vec<&str> = line.split(' ').collect();
        let [name, "growth", growth, "least", least, "greatest", greatest, "neighbours", neighbours] =
            words[..]
        else {
            panic!("{line}");
        };
        let text = CASCADES.iter().find(|(n, _)| *n == name).expect("a known cascade").1;
        let cascade = xml::read(text).expect("a cascade");
        let mut expected: Vec<[i32; 4]> = Vec::new();
        while let Some(hit) = lines.next_if(|l| l.starts_with(|c: char| c.is_ascii_digit())) {
            let numbers: Vec<i32> = hit.split(' ').map(|n| n.parse().expect("a number")).collect();
            expected.push(numbers.try_into().expect("four numbers"));
        }
        let sizes = Sizes::Range {
            min_px: least.parse().expect("a number"),
            max_px: greatest.parse().expect("a number"),
            growth: growth.parse().expect("a number"),
        };
        // A larger maximum size does not change the result.
        let mut detector = Detector::new(&cascade, width + 40, height + 1);
        let groups = detector.detect(image, sizes, neighbours.parse().expect("a number"));
        let mut found: Vec<[i32; 4]> = groups
            .iter()
            .map(|g| g.window)
            .map(|Window { x, y, width, height }| [x, y, width, height])
            .collect();
        found.sort_unstable();
        assert_eq!(found, expected, "{line}");
        compared += expected.len();
    }
    assert!(compared > 150, "{compared}");
}
