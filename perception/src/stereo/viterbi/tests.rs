use super::*;
use crate::simd::{LANES, Level};

fn random_lanes(random: &mut fastrand::Rng, most: u8) -> Lanes {
    Lanes(std::array::from_fn(|_| random.u8(..=most)))
}

/// A padded state with random energies within a window and no nodes elsewhere.
fn state(random: &mut fastrand::Rng, (low, high): (usize, usize), disparities: usize) -> Vec<Lanes> {
    let mut state = vec![Lanes::FULL; disparities + 2 * PAD];
    state[PAD + low..PAD + high].iter_mut().for_each(|l| *l = random_lanes(random, 180));
    state
}

fn column(state: &[Lanes], (low, high): (usize, usize), lane: usize) -> Vec<(usize, u8)> {
    (low..high).map(|d| (d, state[PAD + d].0[lane])).collect()
}

fn windows(random: &mut fastrand::Rng, disparities: usize) -> (usize, usize) {
    let low = random.usize(0..disparities);
    (low, random.usize(low + 1..=disparities))
}

#[test]
fn the_fast_recursion_equals_the_reference_at_every_level() {
    let mut random = fastrand::Rng::with_seed(7);
    for round in 0..300 {
        let disparities = random.usize(1..70);
        let full = round % 3 == 0;
        let all = (0, disparities);
        let window = if full { all } else { windows(&mut random, disparities) };
        let before = if full { all } else { windows(&mut random, disparities) };
        let beside = if full { all } else { windows(&mut random, disparities) };
        let truncation = random.u8(..=75);
        let slopes: [i8; 3] = std::array::from_fn(|_| random.i8(-1..=1));
        let weights: [Lanes; 3] = std::array::from_fn(|_| Lanes(std::array::from_fn(|_| random.u8(1..30))));
        let n = window.1 - window.0;
        let data: Vec<Lanes> = (0..n).map(|_| random_lanes(&mut random, 112)).collect();
        let states: [Vec<Lanes>; 3] = std::array::from_fn(|_| state(&mut random, before, disparities));
        let sides: [Vec<Lanes>; 3] = std::array::from_fn(|_| state(&mut random, beside, disparities));
        let other: Vec<Lanes> = (0..n).map(|_| random_lanes(&mut random, 100)).collect();
        let both = (before.0.min(beside.0), before.1.max(beside.1));
        let span = Span::new(window, both, 1);

        // Expected value of each lane of each path, from the reference implementation.
        let node =
            |lane: usize| -> Vec<(usize, u8)> { (0..n).map(|i| (window.0 + i, data[i].0[lane])).collect() };
        let expected: [Vec<Vec<u8>>; 3] = std::array::from_fn(|p| {
            (0..LANES)
                .map(|lane| {
                    let from = match (p, lane) {
                        (1, 0) => column(&sides[p], beside, LANES - 1),
                        (2, l) if l == LANES - 1 => column(&sides[p], beside, 0),
                        (1, _) => column(&states[p], before, lane - 1),
                        (2, _) => column(&states[p], before, lane + 1),
                        _ => column(&states[p], before, lane),
                    };
                    reference_step(&from, &node(lane), weights[p].0[lane], truncation, slopes[p])
                })
                .collect()
        });
        for level in Level::available() {
            let mut scratch = vec![Lanes::ZERO; 3 * n];
            let mut copies = states.clone();
            let mut out = vec![Lanes::ZERO; n];
            let mut least = Lanes(std::array::from_fn(|lane| {
                column(&states[0], before, lane).iter().map(|&(_, e)| e).min().unwrap()
            }));
            let first_least = least;
            let mut after = vec![Lanes::FULL; disparities + 2 * PAD];
            single(
                level,
                &copies[0],
                &mut least,
                &mut after,
                &data,
                &mut out,
                &weights[0],
                truncation,
                slopes[0],
                Span::new(window, before, 1),
                Merge::First,
                &mut scratch,
            );
            copies[0] = after;
            for lane in 0..LANES {
                assert_eq!(least.0[lane], out.iter().map(|l| l.0[lane]).min().unwrap());
            }
            for lane in 0..LANES {
                let got: Vec<u8> = out.iter().map(|l| l.0[lane]).collect();
                assert_eq!(got, expected[0][lane], "single, lane {lane}, {}", level.name());
            }
            assert_eq!(copies[0][PAD + window.0..PAD + window.1], out[..]);
            for merge in [Merge::Min, Merge::Mean] {
                let mut merged = other.clone();
                let mut least = first_least;
                let mut after = vec![Lanes::FULL; disparities + 2 * PAD];
                single(
                    level,
                    &states[0],
                    &mut least,
                    &mut after,
                    &data,
                    &mut merged,
                    &weights[0],
                    truncation,
                    slopes[0],
                    Span::new(window, before, 1),
                    merge,
                    &mut scratch,
                );
                for ((merged, out), other) in merged.iter().zip(&out).zip(&other) {
                    for lane in 0..LANES {
                        let (a, b) = (out.0[lane], other.0[lane]);
                        let expected =
                            if merge == Merge::Min { a.min(b) } else { a.midpoint(b) + (a ^ b) % 2 };
                        assert_eq!(merged.0[lane], expected);
                    }
                }
            }

            for (kind, last) in [(0, false), (1, false), (2, false), (3, true)] {
                let mut copies = states.clone();
                let (mut out, mut kept) = (vec![Lanes::ZERO; n], data.clone());
                if kind == 2 {
                    kept.fill(Lanes::ZERO);
                }
                let [a, b, c] = &mut copies;
                let mut energies = Energies {
                    straight: a,
                    right: c,
                    right_beside: &sides[2],
                    left: [&states[1], &sides[1]],
                    left_after: b,
                };
                let weights = [&weights[0], &weights[1], &weights[2]];
                let mut sum = match kind {
                    0 => Sum::Keep(&mut out),
                    1 => Sum::Stream(&mut out),
                    2 => Sum::StreamBoth { sum: &mut out, data: &mut kept },
                    _ => Sum::Finish { other: &other, total: &mut out },
                };
                triple(
                    level,
                    &mut energies,
                    weights,
                    slopes,
                    &data,
                    &mut sum,
                    truncation,
                    span,
                    &mut vec![[Lanes::ZERO; 3]; n],
                );
                assert_eq!(kept, data);
                for (i, lanes) in out.iter().enumerate() {
                    for lane in 0..LANES {
                        let cost = i32::from(data[i].0[lane]);
                        let mut sum = 0;
                        for p in 0..3 {
                            let e = i32::from(expected[p][lane][i]);
                            sum += e - cost;
                            assert_eq!(
                                copies[p][PAD + window.0 + i].0[lane],
                                expected[p][lane][i],
                                "path {p}, lane {lane}, {}",
                                level.name()
                            );
                        }
                        if last {
                            sum += cost + i32::from(other[i].0[lane]);
                        }
                        assert_eq!(i32::from(lanes.0[lane]), sum.min(255));
                    }
                }
            }
        }
    }
}

#[test]
fn a_new_path_starts_with_the_data_term() {
    let data: Vec<Lanes> = (0..9).map(Lanes::splat).collect();
    let mut out = vec![Lanes::ZERO; 9];
    let fresh = vec![Lanes::ZERO; 9 + 2 * PAD];
    let mut after = fresh.clone();
    single(
        Level::best(),
        &fresh,
        &mut Lanes::ZERO.clone(),
        &mut after,
        &data,
        &mut out,
        &Lanes::splat(4),
        38,
        0,
        Span::new((0, 9), (0, 9), 0),
        Merge::First,
        &mut vec![Lanes::ZERO; 9],
    );
    assert_eq!(out, data);
}
