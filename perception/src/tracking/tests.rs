use super::*;
use crate::alarm::{Alarm, AlarmLevel, AlarmParameters, Candidate};
use crate::outline::Outline;
use crate::region::PixelBox;

const RIG: Rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 240.0 };
const SIZE: (usize, usize) = (640, 480);
const PERIOD_NS: u64 = 80_000_000;

/// Region of an object 1.8 m wide and 1.5 m high; its foot is 1.25 m below the camera.
fn region(distance_m: f64, lateral_m: f64) -> Region {
    sized(distance_m, lateral_m, 1.8, 1.5)
}

fn sized(distance_m: f64, lateral_m: f64, width_m: f64, height_m: f64) -> Region {
    let px = |m: f64| RIG.focal_px * m / distance_m;
    let left = (RIG.cx_px + px(lateral_m - width_m / 2.0)).clamp(0.0, 639.0);
    let right = (RIG.cx_px + px(lateral_m + width_m / 2.0)).clamp(left + 1.0, 640.0);
    let bottom = (RIG.cy_px + px(1.25)).min(480.0);
    let top = (RIG.cy_px + px(1.25 - height_m)).clamp(0.0, bottom);
    Region {
        bounds: PixelBox {
            x: left as u32,
            y: top as u32,
            width: (right - left) as u32,
            height: (bottom - top) as u32,
        },
        disparity_px: RIG.disparity_px(distance_m),
        disparity_sigma_px: 0.12,
        distance_m,
        lateral_m,
        width_m,
        height_m,
        inset_m: [0.0; 2],
        is_hidden: [false; 2],
        goes_on: [false; 2],
        outline: Outline::default(),
        pixels: 2000,
        confidence: 0.9,
        evidence: 4.0,
    }
}

/// The region with measurement noise.
fn noisy(region: Region, random: &mut fastrand::Rng) -> Region {
    let normal = (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
    let disparity_px = (region.disparity_px + 0.12 * normal).max(0.3);
    let jitter = |random: &mut fastrand::Rng, v: u32| v.saturating_add_signed(random.i32(-4..5));
    let b = region.bounds;
    let bounds = PixelBox {
        x: jitter(random, b.x).min(600),
        width: jitter(random, b.width).clamp(4, 40 + b.width).min(640 - jitter(random, b.x).min(600)),
        ..b
    };
    let bounds = PixelBox { width: bounds.width.min(640 - bounds.x), ..bounds };
    let distance_m = RIG.distance_m(disparity_px);
    // Columns are known; an error of the disparity moves everything along the lines of sight.
    let lateral_m = region.lateral_m * distance_m / region.distance_m;
    Region { bounds, disparity_px, distance_m, lateral_m, ..region }
}

fn tracker() -> Tracker {
    Tracker::new(TrackerParameters::default(), RIG, SIZE)
}

/// A tracker after ten frames with the same regions, and the time of the last frame.
fn settled(regions: &[Region]) -> (Tracker, u64) {
    let mut tracker = tracker();
    for frame in 0..10 {
        tracker.update(frame * PERIOD_NS, regions);
    }
    (tracker, 9 * PERIOD_NS)
}

#[test]
fn approaching_cars_keep_their_identity_and_yield_time_to_collision() {
    // Accuracy of disparity alone: 0.12 px are 12 % of the speed at 35 m, and 4 % at 12 m.
    for (from_m, closing, limit) in [(50.0, 14.0, 0.6), (30.0, 5.0, 0.2)] {
        let mut worst = (0.0_f64, 0.0_f64);
        for seed in 0..40 {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut tracker = tracker();
            let (mut distance, mut frame) = (from_m, 0);
            while distance > 4.0 {
                let car = noisy(region(distance, 0.2), &mut random);
                tracker.update(frame * PERIOD_NS, &[noisy(region(25.0, -6.0), &mut random), car]);
                if distance < closing * 2.5 {
                    let track = tracker.tracks()[1];
                    assert_eq!(
                        (tracker.tracks().len(), track.id, track.missed),
                        (2, 2, 0),
                        "at {distance} m"
                    );
                    let ttc = track.time_to_collision().expect("the car approaches");
                    let error = (ttc.seconds - distance / closing).abs();
                    worst = (worst.0.max(error * closing / distance), worst.1.max(error / ttc.sigma_s));
                }
                distance -= closing * 0.08;
                frame += 1;
            }
            assert!(tracker.tracks()[0].closing_m_s().abs() < 3.0);
        }
        println!(
            "{closing} m/s, seeds 0 to 39: worst TTC error from 2.5 s down {:.1} %, {:.1} of its stated deviations",
            100.0 * worst.0,
            worst.1
        );
        assert!(worst.0 < limit && worst.1 < 4.5, "{worst:?}");
    }
}

#[test]
fn tracks_are_confirmed_bridged_and_deleted() {
    let mut tracker = tracker();
    let mut time = 0;
    let mut step = |tracker: &mut Tracker, regions: &[Region]| {
        time += PERIOD_NS;
        tracker.update(time, regions).to_vec()
    };
    let car = [region(20.0, 0.0)];
    let first = step(&mut tracker, &car)[0];
    assert!(!first.is_confirmed);
    assert!(step(&mut tracker, &car)[0].is_confirmed, "strong evidence: in the second frame");
    for _ in 0..10 {
        step(&mut tracker, &car);
    }
    // Four missed frames are bridged, a second is not.
    for missed in 1..5 {
        let track = step(&mut tracker, &[])[0];
        assert_eq!((track.missed, track.is_confirmed), (missed, true));
    }
    assert_eq!(step(&mut tracker, &car)[0].id, first.id);
    for _ in 0..15 {
        step(&mut tracker, &[]);
    }
    assert_eq!(tracker.tracks(), []);
    assert_ne!(step(&mut tracker, &car)[0].id, first.id);
    // A track that was hardly begun ends soon.
    for _ in 0..8 {
        step(&mut tracker, &[]);
    }
    assert_eq!(tracker.tracks(), []);
}

/// Sightings of a thing beside the way at 10 m/s until it is confirmed.
fn sightings_to_confirm(distance_m: f64, lateral_m: f64, speed_m_s: Option<f64>) -> u64 {
    let (mut tracker, period_s) = (tracker(), PERIOD_NS as f64 * 1e-9);
    for frame in 0.. {
        let ahead_m = distance_m - speed_m_s.unwrap_or(0.0) * period_s * frame as f64;
        let motion = speed_m_s.map(|speed_m_s| Motion { speed_m_s, ..Motion::default() });
        let sightings = [sized(ahead_m, lateral_m, 0.8, 1.5)];
        tracker.follow(&Frame { motion, ..Frame::new(frame * PERIOD_NS, &sightings) });
        if tracker.confirmed().count() > 0 {
            return frame + 1;
        }
        assert!(frame < 20, "never at {distance_m} m, {lateral_m} m");
    }
    unreachable!()
}

#[test]
fn what_is_not_urgent_is_confirmed_later() {
    let speed = Some(10.0);
    assert_eq!(sightings_to_confirm(20.0, 0.5, speed), 2);
    // The vehicle is 1.8 m wide, the thing 0.8 m: 2.5 m beside are 3.8 m from the middle.
    assert_eq!(sightings_to_confirm(20.0, 3.6, speed), 2);
    // 0.24 s after the first one.
    assert_eq!(sightings_to_confirm(20.0, -4.1, speed), 4);
    // At 10 m/s traffic that comes as fast is met within 3.2 s from 64 m.
    assert_eq!((sightings_to_confirm(56.0, 0.0, speed), sightings_to_confirm(56.0, 0.0, Some(6.0))), (2, 4));
    // Nobody knows what is urgent.
    assert_eq!(sightings_to_confirm(56.0, 0.0, None), 2);
}

#[test]
fn what_is_confirmed_at_a_low_probability_stays_confirmed() {
    let parameters = TrackerParameters { confirm_probability: 0.6, ..TrackerParameters::default() };
    let mut tracker = Tracker::new(parameters, RIG, SIZE);
    let weak = [Region { evidence: 0.45, ..region(20.0, 0.0) }];
    let confirmed: Vec<bool> =
        (0..60).map(|frame| tracker.update(frame * PERIOD_NS, &weak)[0].is_confirmed).collect();
    let first = confirmed.iter().position(|is_confirmed| *is_confirmed).expect("it is confirmed in the end");
    assert!(first > 3 && confirmed[first..].iter().all(|is_confirmed| *is_confirmed), "{confirmed:?}");
}

#[test]
fn an_undetected_car_is_predicted_along_its_motion() {
    let mut tracker = tracker();
    let place = |frame: u64| region(30.0 - 0.8 * frame as f64, -3.0 + 0.12 * frame as f64);
    for frame in 0..15 {
        tracker.update(frame * PERIOD_NS, &[place(frame)]);
    }
    let id = tracker.tracks()[0].id;
    for frame in 15..18 {
        tracker.update(frame * PERIOD_NS, &[]);
    }
    let (expected, truth) = (tracker.tracks()[0].bounds, place(17).bounds);
    assert!(expected.overlap(&truth) > 0.7, "{expected:?} for {truth:?}");
    let back = tracker.update(18 * PERIOD_NS, &[place(18)]);
    assert_eq!((back.len(), back[0].id, back[0].missed), (1, id, 0));
}

#[test]
fn a_bad_frame_changes_neither_track_nor_speed() {
    for bad in [6.0, 14.0, 27.0, 55.0] {
        let (mut tracker, time) = settled(&[region(20.0, 0.0)]);
        // The same box at another distance for one frame, then as before.
        let wrong = Region { disparity_px: RIG.disparity_px(bad), distance_m: bad, ..region(20.0, 0.0) };
        tracker.update(time + PERIOD_NS, &[wrong]);
        let tracks = tracker.update(time + 2 * PERIOD_NS, &[region(20.0, 0.0)]).to_vec();
        let track = tracks.iter().find(|t| t.id == 1).expect("the track still exists");
        assert_eq!(track.missed, 0, "{bad} m");
        assert!(
            (track.distance_m() - 20.0).abs() < 0.5 && track.closing_m_s().abs() < 1.5,
            "{bad} m: {track:?}"
        );
        let time = time + 3 * PERIOD_NS;
        tracker.update(time, &[region(20.0, 0.0)]);
        assert_eq!(tracker.confirmed().count(), 1, "the outlier confirms nothing");
    }
}

#[test]
fn a_jumping_near_side_is_followed_without_a_false_speed() {
    let (mut tracker, time) = settled(&[region(14.0, 0.0)]);
    let mut fastest = 0.0_f64;
    for frame in 1..12 {
        let tracks = tracker.update(time + frame * PERIOD_NS, &[region(12.0, 0.0)]);
        assert_eq!((tracks.len(), tracks[0].id), (1, 1));
        fastest = fastest.max(tracks[0].closing_m_s());
    }
    let track = &tracker.tracks()[0];
    assert!((track.distance_m() - 12.0).abs() < 0.3, "{track:?}");
    assert!(fastest < 2.0, "{fastest} m/s");
}

#[test]
fn regions_that_split_and_merge_keep_their_tracks() {
    // A car and a van beside it, 1 m apart.
    let (car, van) = (region(15.0, -1.4), region(15.2, 1.4));
    let (mut tracker, time) = settled(&[car, van]);
    // For two frames they are merged.
    let both = sized(15.0, 0.0, 4.6, 1.5);
    for frame in 1..3 {
        let tracks = tracker.update(time + frame * PERIOD_NS, &[both]);
        assert!(tracks.iter().filter(|t| t.id <= 2).count() == 2, "{tracks:?}");
    }
    tracker.update(time + 3 * PERIOD_NS, &[car, van]);
    let tracks = tracker.update(time + 4 * PERIOD_NS, &[car, van]);
    let ids: Vec<u32> = tracks.iter().map(|t| t.id).collect();
    assert_eq!(ids, [1, 2], "{tracks:?}");
    assert!(tracks[0].lateral_m() < -0.9 && tracks[1].lateral_m() > 0.9, "{tracks:?}");
    // A track whose region splits remains one.
    let (mut tracker, time) = settled(&[sized(15.0, 0.0, 2.4, 1.5)]);
    let parts = [sized(15.0, -0.45, 1.5, 1.5), sized(15.0, 0.85, 0.7, 1.5)];
    let tracks = tracker.update(time + PERIOD_NS, &parts);
    assert_eq!((tracks[0].id, tracks[0].missed, tracks.len()), (1, 0, 1));
}

#[test]
fn a_jump_back_in_time_resets() {
    let (mut tracker, _) = settled(&[region(20.0, 0.0), region(10.0, 3.0)]);
    let tracks = tracker.update(5, &[region(20.0, 0.0)]);
    assert_eq!((tracks.len(), tracks[0].seen), (1, 1));
}

const S: u64 = 1_000_000_000;

/// A tracker and an alarm that have seen, for twenty frames, a car in the path that approaches with 8 m/s and one beside it,
/// and the time of the last frame. Both are beyond the limits of the alarm.
fn followed() -> (Tracker, Alarm, u64) {
    let (mut tracker, mut alarm) = (tracker(), Alarm::new(AlarmParameters::default()));
    let mut time = S;
    for frame in 0..20 {
        time = S + frame * PERIOD_NS;
        let ahead = 38.0 - 8.0 * 0.08 * frame as f64;
        let level = process_frame(&mut tracker, &mut alarm, time, &[region(ahead, 0.0), region(ahead, -3.4)]);
        assert_eq!(level, AlarmLevel::Clear);
    }
    (tracker, alarm, time)
}

#[test]
fn a_gap_in_time_ends_all_tracks_and_raises_nothing() {
    for gap_ns in [S + 1, 3 * S, 10 * S, 60 * S, S * S, u64::MAX - 3 * S] {
        let (mut tracker, mut alarm, time) = followed();
        for frame in 0..20 {
            let time = (time + gap_ns).saturating_add(frame * PERIOD_NS);
            let level = process_frame(&mut tracker, &mut alarm, time, &[]);
            assert_eq!((level, tracker.tracks().len()), (AlarmLevel::Clear, 0), "{gap_ns} ns, frame {frame}");
        }
    }
}

#[test]
fn what_is_not_seen_raises_nothing_and_ends_after_a_second() {
    for step_ns in [40_000_000, 80_000_000, 300_000_000, 900_000_000, S] {
        let (mut tracker, mut alarm, time) = followed();
        for frame in 1..40 {
            let level = process_frame(&mut tracker, &mut alarm, time + frame * step_ns, &[]);
            assert_eq!(level, AlarmLevel::Clear, "steps of {step_ns} ns, frame {frame}");
            let unseen_s = (frame * step_ns) as f64 * 1e-9;
            if unseen_s < 0.25 {
                assert_eq!(tracker.confirmed().count(), 2, "{unseen_s} s unseen, steps of {step_ns} ns");
            }
            assert!(unseen_s < 1.3 || tracker.confirmed().count() == 0, "{unseen_s} s unseen");
            assert!(unseen_s <= 3.0 || tracker.tracks().is_empty(), "{unseen_s} s unseen");
        }
    }
}

#[test]
fn an_alarm_is_kept_at_most_for_the_hold_time_without_a_detection() {
    let car = [region(8.0, 0.0)];
    let hold_ns = AlarmParameters::default().hold_ns;
    let (mut tracker, mut alarm) = (tracker(), Alarm::new(AlarmParameters::default()));
    for frame in 0..20 {
        process_frame(&mut tracker, &mut alarm, frame * PERIOD_NS, &car);
    }
    let last_ns = 19 * PERIOD_NS;
    for frame in 20..40 {
        let time = frame * PERIOD_NS;
        let level = process_frame(&mut tracker, &mut alarm, time, &[]);
        let expected = if time - last_ns < hold_ns { AlarmLevel::Alarm } else { AlarmLevel::Clear };
        assert_eq!(level, expected, "{} ns after the last detection", time - last_ns);
    }
}

#[test]
fn a_step_back_starts_anew_and_a_repeated_time_adds_nothing() {
    let car = [region(8.0, 0.0)];
    for back_ns in [1, 1_000_000, S] {
        let (mut tracker, mut alarm, time) = followed();
        let level = process_frame(&mut tracker, &mut alarm, time - back_ns, &car);
        assert_eq!((level, tracker.tracks().len(), tracker.tracks()[0].seen), (AlarmLevel::Clear, 1, 1));
    }
    // One sighting of a car that comes from the side, repeated: neither track nor alarm is confirmed by it.
    let (mut tracker, mut alarm, time) = followed();
    process_frame(&mut tracker, &mut alarm, time + PERIOD_NS, &car);
    let tracks = tracker.tracks().to_vec();
    for repeat_ns in [0, 1, 400_000] {
        let level = process_frame(&mut tracker, &mut alarm, time + PERIOD_NS + repeat_ns, &car);
        assert_eq!((level, tracker.tracks()), (AlarmLevel::Clear, &tracks[..]));
    }
}

/// Frames until a standing car at 8 m raises the alarm, from time `from_ns` on.
fn frames_to_alarm(tracker: &mut Tracker, alarm: &mut Alarm, from_ns: u64) -> u64 {
    let is_raised = |frame: &u64| {
        let time = from_ns + frame * PERIOD_NS;
        process_frame(tracker, alarm, time, &[region(8.0, 0.0)]) == AlarmLevel::Alarm
    };
    (0..50).find(is_raised).expect("the car raises the alarm")
}

#[test]
fn after_a_reset_the_alarm_is_raised_as_quickly_as_at_the_start() {
    let fresh = frames_to_alarm(&mut tracker(), &mut Alarm::new(AlarmParameters::default()), 0);
    let nexts: [fn(u64) -> u64; 4] = [|t| t + 3 * S, |t| t + S * S, |t| t - S, |_| 0];
    for next in nexts {
        let (mut tracker, mut alarm, time) = followed();
        assert_eq!(frames_to_alarm(&mut tracker, &mut alarm, next(time)), fresh);
    }
}

#[test]
fn an_approach_through_gaps_raises_the_alarm() {
    for (gap_ns, every) in [(300_000_000, 10), (S, 10), (2 * S, 12)] {
        let (mut tracker, mut alarm) = (tracker(), Alarm::new(AlarmParameters::default()));
        let (mut time, mut ahead_m, mut raised_m) = (S, 64.0, None);
        let mut frame = 0;
        while ahead_m > 2.0 && raised_m.is_none() {
            frame += 1;
            let step = if frame % every == 0 { gap_ns } else { PERIOD_NS };
            (time, ahead_m) = (time + step, ahead_m - 4.0 * step as f64 * 1e-9);
            let level = process_frame(&mut tracker, &mut alarm, time, &[region(ahead_m.max(1.0), 0.0)]);
            raised_m = (level == AlarmLevel::Alarm).then_some(ahead_m);
        }
        // At 10 m, or as soon as it is confirmed after a gap of up to 8 m.
        let raised_m = raised_m.unwrap_or_else(|| panic!("no alarm with gaps of {gap_ns} ns"));
        assert!((2.0..=12.0).contains(&raised_m), "{raised_m} m");
    }
}

#[test]
fn regions_whose_numbers_mean_nothing_are_dropped_and_counted() {
    let wrong = [
        Region { distance_m: f64::NAN, disparity_px: f64::NAN, ..region(20.0, 0.0) },
        Region { disparity_px: 0.0, ..region(20.0, 0.0) },
        Region { lateral_m: f64::INFINITY, ..region(20.0, 0.0) },
        Region { lateral_m: 5e6, ..region(20.0, 0.0) },
        Region { width_m: f64::NAN, ..region(20.0, 0.0) },
        Region { disparity_sigma_px: 1e30, ..region(20.0, 0.0) },
    ];
    for wrong in wrong {
        let mut tracker = tracker();
        for frame in 0..10 {
            let tracks = tracker.update(frame * PERIOD_NS, &[wrong, region(20.0, 0.0)]);
            assert!(tracks.iter().all(|t| t.is_plausible()), "{wrong:?}: {tracks:?}");
        }
        assert!(tracker.dropped() > 0, "{wrong:?}");
        assert!(tracker.tracks().iter().any(|t| t.seen >= 5), "the other one is tracked: {wrong:?}");
    }
}

#[test]
fn arbitrary_regions_cause_no_invalid_track() {
    let mut random = fastrand::Rng::with_seed(9);
    let mut tracker = tracker();
    for frame in 0..2000_u64 {
        let regions: Vec<Region> = (0..random.usize(0..90))
            .map(|_| {
                let mut r = sized(
                    0.5 + 80.0 * random.f64(),
                    30.0 * random.f64() - 15.0,
                    0.01 + 6.0 * random.f64(),
                    0.1 + 3.0 * random.f64(),
                );
                if random.u8(0..20) == 0 {
                    r.disparity_sigma_px = [0.0, 1e-9, 50.0][random.usize(0..3)];
                    r.width_m = 0.0;
                }
                r
            })
            .collect();
        let tracks = tracker.update(frame * PERIOD_NS, &regions);
        assert!(tracks.len() <= 128);
        for t in tracks {
            let b = t.bounds;
            assert!(b.x + b.width <= 640 && b.y + b.height <= 480, "{b:?}");
            assert!(t.distance_m().is_finite() && t.closing_m_s().is_finite());
            assert!(t.lateral_m().is_finite() && t.extent.width_m > 0.0, "{t:?}");
        }
    }
}

/// Processes a frame like the recognition stage.
fn process_frame(tracker: &mut Tracker, alarm: &mut Alarm, time_ns: u64, regions: &[Region]) -> AlarmLevel {
    tracker.update(time_ns, regions);
    let confirmed = tracker.confirmed().map(Track::state);
    alarm.update(time_ns, true, confirmed.map(|obstacle| Candidate::of(&obstacle))).level
}

#[test]
fn a_single_bad_frame_raises_no_alarm() {
    for seed in 0..60 {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut tracker = tracker();
        let mut alarm = Alarm::new(AlarmParameters::default());
        for frame in 0..60 {
            // A car ahead at a constant 16 m; in frame 40 all measurements are wrong.
            let mut regions =
                vec![noisy(region(16.0, 0.0), &mut random), noisy(region(22.0, 4.5), &mut random)];
            if frame == 40 {
                let wrong = 3.0 + 9.0 * random.f64();
                for r in &mut regions {
                    (r.disparity_px, r.distance_m) = (RIG.disparity_px(wrong), wrong);
                }
                regions.push(region(4.0 + 4.0 * random.f64(), random.f64() - 0.5));
            }
            let level = process_frame(&mut tracker, &mut alarm, frame * PERIOD_NS, &regions);
            assert_eq!(level, AlarmLevel::Clear, "seed {seed}, frame {frame}");
        }
    }
}

#[test]
fn a_car_in_the_path_raises_an_alarm_and_one_in_the_next_lane_does_not() {
    for seed in 0..40 {
        let mut random = fastrand::Rng::with_seed(seed);
        for (lateral, expected) in
            [(3.5, AlarmLevel::Clear), (-3.3, AlarmLevel::Clear), (0.4, AlarmLevel::Alarm)]
        {
            let mut tracker = tracker();
            let mut alarm = Alarm::new(AlarmParameters::default());
            let (mut z, mut frame, mut worst) = (60.0, 0, AlarmLevel::Clear);
            while z > 3.0 {
                let car = noisy(region(z, lateral), &mut random);
                worst = worst.max(process_frame(&mut tracker, &mut alarm, frame * PERIOD_NS, &[car]));
                z -= 13.9 * 0.08;
                frame += 1;
            }
            assert_eq!(worst, expected, "seed {seed}, {lateral} m");
        }
    }
}

#[test]
fn regions_with_garbage_are_ignored() {
    let good = region(20.0, 0.0);
    let garbage = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 1e300];
    let with = |set: fn(&mut Region, f64)| {
        garbage.map(|value| {
            let mut region = region(30.0, 3.0);
            set(&mut region, value);
            region
        })
    };
    let mut bad: Vec<Region> = [
        with(|r, v| r.disparity_px = v),
        with(|r, v| r.disparity_sigma_px = v),
        with(|r, v| r.distance_m = v),
        with(|r, v| r.lateral_m = if v == -1.0 { 1e7 } else { v }),
        with(|r, v| r.width_m = v),
        with(|r, v| r.height_m = v),
    ]
    .concat();
    bad.push(Region { disparity_px: 0.0, ..good });
    bad.push(Region { bounds: PixelBox { x: u32::MAX, ..good.bounds }, ..good });
    for bad in bad {
        let mut tracker = tracker();
        for frame in 0..5 {
            tracker.update(frame * PERIOD_NS, &[bad, good]);
            assert_eq!(tracker.tracks().len(), 1, "{bad:?}");
            assert_eq!(tracker.tracks()[0].detection, Some(1), "{bad:?}");
        }
        assert!((tracker.tracks()[0].distance_m() - 20.0).abs() < 0.1);
    }
}
