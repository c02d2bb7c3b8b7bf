//! Tests of the whole matcher.

use super::*;
use crate::image::GreyImage;

fn noise(width: usize, height: usize, seed: u64) -> GreyImage {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut image = GreyImage::new(width, height);
    image.as_mut_slice().iter_mut().for_each(|v| *v = random.u8(..));
    image
}

/// Noise smooth enough to survive downsampling, shifted by `shift` pixels in the right view.
fn moved(width: usize, height: usize, shift: usize, seed: u64) -> (GreyImage, GreyImage) {
    let coarse = noise(width / 4 + shift + 4, height / 4 + 4, seed);
    let at = |x: usize, y: usize| {
        let v = |dx, dy| u32::from(coarse.view().at(x / 4 + dx, y / 4 + dy));
        let (a, b) = (x as u32 % 4, y as u32 % 4);
        let row = |dy| v(0, dy) * (4 - a) + v(1, dy) * a;
        ((row(0) * (4 - b) + row(1) * b) / 16) as u8
    };
    let mut pair = (GreyImage::new(width, height), GreyImage::new(width, height));
    for y in 0..height {
        for x in 0..width {
            pair.0.as_mut_slice()[y * width + x] = at(x, y);
            pair.1.as_mut_slice()[y * width + x] = at(x + shift, y);
        }
    }
    pair
}

fn compute(matcher: &mut Mpv, pair: &(GreyImage, GreyImage)) -> (Vec<u16>, Vec<u8>) {
    let n = pair.0.width() * pair.0.height();
    // The previous content must not matter.
    let (mut disparity, mut confidence) = (vec![9; n], vec![9; n]);
    let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
    matcher.compute(pair.0.view(), pair.1.view(), output).unwrap();
    (disparity, confidence)
}

#[test]
fn a_shifted_image_gives_its_shift_reproducibly() {
    for (search, shift) in [(Search::Full, 11), (Search::Windows, 11), (Search::Windows, 50)] {
        let (width, height) = (256, 80);
        let pair = moved(width, height, shift, 5);
        let mut matcher = Mpv::new(MpvParameters::default(), search, width, height, 64).unwrap();
        let (disparity, confidence) = compute(&mut matcher, &pair);
        for y in 0..height {
            for x in shift + 8..width - 8 {
                let got = f32::from(disparity[y * width + x]) / 256.0;
                assert!((got - shift as f32).abs() < 0.5, "({x}, {y}): {got} of {shift}, {search:?}");
                assert!(confidence[y * width + x] > 0);
            }
        }
        // The workspace keeps no state between pairs.
        let other = moved(width, height, 30, 77);
        compute(&mut matcher, &other);
        assert!(compute(&mut matcher, &pair) == (disparity, confidence), "{search:?}");
        let share = matcher.nodes() as f64 / (width * height * 64) as f64;
        match search {
            Search::Full => assert!(share > 1.0),
            Search::Windows => assert!(share <= 0.3281, "{share} of all nodes"),
        }
    }
}

#[test]
fn levels_agree_and_no_size_panics() {
    let mut random = fastrand::Rng::with_seed(9);
    let mut sizes = vec![(8, 8, 255), (9, 100, 2), (200, 8, 255), (33, 65, 33), (64, 64, 16)];
    for _ in 0..25 {
        sizes.push((random.usize(8..140), random.usize(8..100), random.usize(2..=255)));
    }
    for (i, (width, height, disparities)) in sizes.into_iter().enumerate() {
        let pair = if i % 2 == 0 {
            (noise(width, height, i as u64), noise(width, height, 99))
        } else {
            moved(width, height, random.usize(0..30), i as u64)
        };
        for search in [Search::Full, Search::Windows] {
            let results: Vec<_> = Level::available()
                .into_iter()
                .map(|level| {
                    let parameters = MpvParameters { complete: i % 3 == 0, ..MpvParameters::default() };
                    let mut matcher =
                        Mpv::at_level(level, parameters, search, width, height, disparities).unwrap();
                    (level, compute(&mut matcher, &pair))
                })
                .collect();
            for (level, result) in &results {
                assert!(
                    *result == results[0].1,
                    "{} differs from plain: {width}x{height}, {disparities}, {search:?}",
                    level.name()
                );
            }
            for threads in [2, 3, 7] {
                let parameters = MpvParameters { complete: i % 3 == 0, ..MpvParameters::default() };
                let (crew, level) = (Crew::new(threads, |_| ()).unwrap(), Level::best());
                let mut matcher =
                    Mpv::with_crew(crew, level, parameters, search, width, height, disparities).unwrap();
                for _ in 0..2 {
                    assert!(compute(&mut matcher, &pair) == results[0].1, "{threads} threads differ");
                }
            }
            let (disparity, confidence) = &results[0].1;
            for (d, c) in disparity.iter().zip(confidence) {
                assert!(usize::from(*d) <= disparities * 256);
                assert_eq!(*d == 0, *c == 0);
            }
        }
    }
}

#[test]
fn at_the_deadline_the_finest_finished_scale_is_returned() {
    let (width, height, shift) = (256, 128, 20);
    let pair = moved(width, height, shift, 3);
    for (search, threads) in [Search::Windows, Search::Full].map(|s| [1, 2, 3].map(|t| (s, t))).concat() {
        let (crew, level) = (Crew::new(threads, |_| ()).unwrap(), Level::best());
        let mut matcher =
            Mpv::with_crew(crew, level, MpvParameters::default(), search, width, height, 64).unwrap();
        let complete = compute(&mut matcher, &pair);
        let mut reached = Vec::new();
        for patience in 0..40 {
            let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
            let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
            let mut asked = 0;
            let mut go_on = || {
                asked += 1;
                asked <= patience
            };
            let halved = matcher.compute_within(pair.0.view(), pair.1.view(), output, &mut go_on).unwrap();
            reached.push(halved);
            let right = (0..height)
                .flat_map(|y| (shift + 16..width - 16).map(move |x| y * width + x))
                .filter(|&i| (f32::from(disparity[i]) / 256.0 - shift as f32).abs() < 2.0)
                .count();
            assert!(
                right > (height * (width - shift - 32)) * 8 / 10,
                "scale {halved}: {right} pixels are right"
            );
            if halved == 0 {
                assert!((disparity, confidence) == complete);
            }
        }
        assert_eq!((reached[0], reached[39]), (2, 0));
        // Of several threads one asks, as often as it takes strips.
        if threads == 1 {
            assert!(reached.contains(&1), "the middle scale is given, too");
            assert!(reached.is_sorted_by(|a, b| a >= b), "more time is never worse: {reached:?}");
        }
    }
}

#[test]
fn the_workspace_stays_within_its_budget() {
    const MIB: usize = 1 << 20;
    let bytes = |search, width, height, disparities| {
        let matcher = Mpv::new(MpvParameters::default(), search, width, height, disparities).unwrap();
        matcher.workspace_bytes()
    };
    assert!(bytes(Search::Windows, 640, 480, 64) <= 20 * MIB);
    assert!(bytes(Search::Windows, 1242, 375, 128) <= 24 * MIB);
    for (width, height, disparities) in [(640, 480, 64), (640, 480, 128), (1242, 375, 128)] {
        let most = (width * height * disparities) * 22 / 10 + 10 * MIB;
        assert!(bytes(Search::Full, width, height, disparities) <= most);
    }
    // The full range exceeds what windows need, so the check can fail.
    assert!(bytes(Search::Full, 640, 480, 64) > 20 * MIB);
    assert!(bytes(Search::Full, 1242, 375, 128) > 24 * MIB);
}

#[test]
fn wrong_sizes_are_refused() {
    let p = MpvParameters::default();
    let make = |w, h, d| Mpv::new(p, Search::Full, w, h, d);
    assert!(matches!(make(1, 1, 16), Err(MatcherError::TooSmall { .. })));
    assert_eq!(make(64, 64, 256).unwrap_err(), MatcherError::Disparities(256));
    assert!(matches!(make(16_384, 16_384, 128), Err(MatcherError::TooLarge { .. })));
    assert!(matches!(make(usize::MAX, 8, 2), Err(MatcherError::TooLarge { .. })));
    let mut matcher = make(16, 16, 8).unwrap();
    assert!(matcher.workspace_bytes() > 16 * 16 * 8);
    let (small, right) = (noise(15, 16, 1), noise(16, 16, 1));
    let (mut disparity, mut confidence) = (vec![0; 256], vec![0; 256]);
    let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
    let error = matcher.compute(small.view(), right.view(), output).unwrap_err();
    assert!(error.to_string().contains("left image is 15x16"), "{error}");
    let output = MatchOutput { disparity: &mut disparity[1..], confidence: &mut confidence };
    assert!(matches!(
        matcher.compute(right.view(), right.view(), output),
        Err(MatchError::Output { given: 255, needed: 256 })
    ));
}
