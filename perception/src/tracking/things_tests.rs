//! Tests of what the tracker takes for a thing: existence, parts, sizes.

use super::*;
use crate::outline::Outline;
use crate::region::PixelBox;

const RIG: Rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 240.0 };
const SIZE: (usize, usize) = (640, 480);

/// A sighting between two places beside the axis, in metres; its foot is 1.25 m below the camera.
fn sighting(distance_m: f64, [left_m, right_m]: [f64; 2], height_m: f64, evidence: f64) -> Region {
    let px = |m: f64| RIG.focal_px * m / distance_m;
    let [left, right] = [left_m, right_m].map(|m| (RIG.cx_px + px(m)).clamp(0.0, 640.0));
    let bottom = (RIG.cy_px + px(1.25)).min(480.0);
    let top = (RIG.cy_px + px(1.25 - height_m)).clamp(0.0, bottom - 1.0);
    let bounds = PixelBox {
        x: left as u32,
        y: top as u32,
        width: ((right - left) as u32).max(1),
        height: ((bottom - top) as u32).max(1),
    };
    Region {
        bounds,
        disparity_px: RIG.disparity_px(distance_m),
        disparity_sigma_px: 0.12,
        distance_m,
        lateral_m: RIG.lateral_m(f64::from(bounds.x) + f64::from(bounds.width) / 2.0, distance_m),
        width_m: f64::from(bounds.width) * distance_m / RIG.focal_px,
        height_m,
        inset_m: [0.0; 2],
        is_hidden: [false; 2],
        goes_on: [false; 2],
        outline: Outline::default(),
        pixels: bounds.width * bounds.height,
        confidence: 0.9,
        evidence,
    }
}

fn car(distance_m: f64) -> Region {
    sighting(distance_m, [-0.9, 0.9], 1.5, 4.0)
}

fn tracker() -> Tracker {
    Tracker::new(TrackerParameters::default(), RIG, SIZE)
}

/// A tracker after a second with the same sightings at this frame rate, and the time of its last frame, in ns.
fn after_a_second(sightings: &[Region], rate_hz: u64) -> (Tracker, u64) {
    let mut tracker = tracker();
    for frame in 0..=rate_hz {
        tracker.update(frame * 1_000_000_000 / rate_hz, sightings);
    }
    (tracker, 1_000_000_000)
}

/// Seconds until a thing with this evidence is confirmed, and then, unseen, not any more.
fn rise_and_fall_s(evidence: f64, rate_hz: u64) -> (f64, f64) {
    let (mut tracker, period_ns) = (tracker(), 1_000_000_000 / rate_hz);
    let seen = [Region { evidence, ..car(20.0) }];
    let mut frame = 0;
    let mut count = |sightings: &[Region], until: bool| {
        let first = frame;
        loop {
            tracker.update(frame * period_ns, sightings);
            frame += 1;
            if (tracker.confirmed().count() == 1) == until || frame - first > 100 * rate_hz {
                return (frame - first) as f64 * period_ns as f64 * 1e-9;
            }
        }
    };
    let rise_s = count(&seen, true);
    for _ in 0..2 * rate_hz {
        count(&seen, true);
    }
    (rise_s, count(&[], false))
}

#[test]
fn existence_rises_and_falls_in_seconds_at_any_frame_rate() {
    for evidence in [1.6, 2.5] {
        let times = [8, 12, 25, 50].map(|rate_hz| rise_and_fall_s(evidence, rate_hz));
        println!("evidence {evidence}: confirmed and lost after (s) {times:.2?}");
        for (rise_s, fall_s) in times {
            assert!((rise_s - times[3].0).abs() <= 0.25, "{times:?}");
            assert!((fall_s - times[3].1).abs() <= 0.3 && (0.2..=1.4).contains(&fall_s), "{times:?}");
        }
    }
}

#[test]
fn a_hidden_thing_survives_and_a_missed_one_does_not() {
    // A van passes in front of a parked car.
    let van = sighting(10.0, [-1.2, 1.2], 2.4, 5.0);
    let (mut tracker, time) = after_a_second(&[car(24.0)], 12);
    let (mut missed, _) = after_a_second(&[car(24.0)], 12);
    for frame in 1..=11 {
        tracker.update(time + frame * 80_000_000, &[van]);
        missed.update(time + frame * 80_000_000, &[sighting(10.0, [3.0, 3.5], 2.4, 5.0)]);
    }
    let hidden = tracker.tracks().iter().find(|t| t.id == 1).expect("the hidden car");
    assert!(hidden.is_confirmed && hidden.missed == 11, "{hidden:?}");
    assert!(missed.confirmed().all(|t| t.id != 1), "{:?}", missed.tracks());
    // It is the same one when it is seen again.
    tracker.update(time + 12 * 80_000_000, &[car(24.0)]);
    let back = tracker.tracks().iter().find(|t| t.id == 1).expect("it is the same");
    assert_eq!(back.missed, 0);
}

#[test]
fn without_a_road_nothing_is_missed() {
    let (mut tracker, time) = after_a_second(&[car(24.0)], 12);
    for frame in 1..=8 {
        let nothing = Frame { could_detect: false, ..Frame::new(time + frame * 80_000_000, &[]) };
        tracker.follow(&nothing);
    }
    assert_eq!(tracker.confirmed().count(), 1);
}

#[test]
fn the_look_at_both_pictures_keeps_what_is_there_and_ends_what_is_not() {
    let confirmed_after = |shown: f64| {
        let (mut tracker, time) = after_a_second(&[car(24.0)], 12);
        for frame in 1..=12 {
            let verify = |region: &Region| (region.distance_m > 20.0).then_some(shown);
            tracker.follow(&Frame { verify: &verify, ..Frame::new(time + frame * 80_000_000, &[]) });
        }
        tracker.confirmed().count()
    };
    assert_eq!((confirmed_after(4.0), confirmed_after(-20.0)), (1, 0));
}

#[test]
fn fragments_are_parts_of_one_thing() {
    let (mut tracker, time) = after_a_second(&[car(15.0)], 12);
    let width_m = tracker.tracks()[0].extent.width_m;
    for frame in 1..=20 {
        // Rain splits the car into two or three parts, one of them a little nearer.
        let split = 0.3 * ((frame % 3) as f64 - 1.0);
        let parts = [
            sighting(15.0, [-0.9, split - 0.1], 1.5, 2.0),
            sighting(14.8, [split, 0.5], 1.2, 3.0),
            sighting(15.6, [0.55, 0.9], 1.4, 1.0),
        ];
        let tracks = tracker.update(time + frame * 80_000_000, &parts);
        assert_eq!((tracks.len(), tracks[0].id, tracks[0].missed), (1, 1, 0), "frame {frame}: {tracks:?}");
        assert!((tracks[0].extent.width_m - width_m).abs() < 0.3, "frame {frame}: {:?}", tracks[0].extent);
    }
}

#[test]
fn tracks_of_two_parts_become_one_when_the_whole_is_seen() {
    let parts = [sighting(15.0, [-0.9, -0.1], 1.5, 4.0), sighting(15.0, [0.0, 0.9], 1.5, 4.0)];
    let (mut tracker, time) = after_a_second(&parts, 12);
    assert_eq!(tracker.tracks().len(), 2);
    for frame in 1..=15 {
        tracker.update(time + frame * 80_000_000, &[car(15.0)]);
    }
    let tracks = tracker.tracks();
    assert_eq!((tracks.len(), tracks[0].id), (1, 1), "the older number remains: {tracks:?}");
    assert!((tracks[0].extent.width_m - 1.8).abs() < 0.3, "{:?}", tracks[0].extent);
}

#[test]
fn a_track_gives_its_motion_only_where_the_distances_agree() {
    // The edge of a wall, by which we drive with 5 m/s; then somebody comes out from behind it.
    let edge = |frame: u64| sighting(20.0 - 0.4 * frame as f64, [-0.3, 0.1], 1.5, 4.0);
    let seen_then = |distance_m: f64| {
        let mut tracker = tracker();
        let mut see = |frame: u64, sightings: &[Region]| {
            tracker.update(frame * 80_000_000, sightings);
            tracker.tracks().to_vec()
        };
        (0..=11).for_each(|frame| {
            see(frame, &[edge(frame)]);
        });
        // A new track beside it, then the whole.
        let both = see(12, &[edge(12), sighting(distance_m, [0.2, 0.9], 1.5, 4.0)]);
        assert_eq!(both.len(), 2, "{both:?}");
        (13..=14).for_each(|frame| {
            see(frame, &[car(distance_m)]);
        });
        let tracks = see(15, &[car(distance_m)]);
        assert_eq!((tracks.len(), tracks[0].id), (1, 1), "{tracks:?}");
        tracks[0]
    };
    let (same, other) = (seen_then(15.0), seen_then(11.5));
    assert!((same.closing_m_s() - 5.0).abs() < 2.0 && same.closing_sigma_m_s() < 2.0, "{same:?}");
    assert!((other.distance_m() - 11.5).abs() < 0.1 && other.closing_m_s().abs() < 1.0, "{other:?}");
}

#[test]
fn nothing_begins_inside_a_thing_but_in_front_of_it() {
    let (mut tracker, time) = after_a_second(&[car(15.0)], 12);
    let inside = sighting(16.5, [-0.3, 0.3], 1.0, 6.0);
    let tracks = tracker.update(time + 80_000_000, &[car(15.0), inside]);
    assert_eq!(tracks.len(), 1, "{tracks:?}");
    let child = sighting(9.0, [-0.2, 0.2], 1.1, 6.0);
    let tracks = tracker.update(time + 160_000_000, &[child, car(15.0)]);
    assert_eq!(tracks.len(), 2, "{tracks:?}");
}

#[test]
fn clutter_at_a_rate_is_hardly_ever_confirmed() {
    // Heavy snow: 150 sightings a second at any place, one in three rather like an obstacle.
    for rate_hz in [12, 25] {
        let (mut confirmed, mut seconds) = (0, 0);
        for seed in 0..10 {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut tracker = tracker();
            let mut known = 0;
            for frame in 0..10 * rate_hz {
                let flakes: Vec<Region> = (0..150 / rate_hz)
                    .map(|_| {
                        let distance_m = 3.0 + 25.0 * random.f64();
                        let middle_m = (random.f64() - 0.5) * 0.6 * distance_m;
                        let half_m = 0.1 + 0.3 * random.f64();
                        let evidence = 5.0 * random.f64() - 2.0;
                        sighting(
                            distance_m,
                            [middle_m - half_m, middle_m + half_m],
                            0.3 + random.f64(),
                            evidence,
                        )
                    })
                    .collect();
                tracker.update(frame * 1_000_000_000 / rate_hz, &flakes);
                let highest = tracker.confirmed().map(|t| t.id).max().unwrap_or(0);
                confirmed += i32::from(highest > known);
                known = known.max(highest);
            }
            seconds += 10;
        }
        println!("{rate_hz} Hz: {confirmed} false tracks in {seconds} s");
        // One sighting in a thousand.
        assert!(confirmed <= 15, "{confirmed} of 15000 sightings in {seconds} s at {rate_hz} Hz");
    }
}

#[test]
fn sizes_are_stable_and_never_nothing() {
    let mut random = fastrand::Rng::with_seed(3);
    let mut tracker = tracker();
    let (mut jumps, mut boxes, mut before) = (0, 0, None);
    for frame in 0..300_u64 {
        // One in four sightings is a part of the car, one in eight extends into what stands behind it.
        let mut sides = [-0.9, 0.9].map(|m: f64| m + 0.1 * (random.f64() - 0.5));
        match random.u8(0..8) {
            0 => sides[0] += 0.9,
            1 => sides[1] -= 0.9,
            2 => sides[1] += 1.5,
            _ => {}
        }
        let seen = Region { inset_m: [0.2, 0.0], ..sighting(14.0, sides, 1.2 + 0.6 * random.f64(), 3.0) };
        let track = tracker.update(frame * 100_000_000, &[seen])[0];
        assert!(track.front_m() > 0.0 && track.bounds.width > 0 && track.bounds.height > 0, "{track:?}");
        let width_px = f64::from(track.bounds.width);
        if let Some(before) = before {
            boxes += 1;
            jumps += i32::from(!(1.0 / 1.3..=1.3).contains(&(width_px / before)));
        }
        before = Some(width_px);
    }
    assert!(20 * jumps <= boxes, "{jumps} of {boxes}");
    let width_m = tracker.tracks()[0].extent.width_m;
    assert!((1.5..=2.3).contains(&width_m), "{width_m}");
}

#[test]
fn the_box_is_that_of_the_thing_clipped_at_the_border() {
    // A car that leaves the picture on the right.
    let mut tracker = tracker();
    for frame in 0..40_u64 {
        let x = 0.25 * frame as f64;
        let seen = sighting(8.0, [x - 0.9, x + 0.9], 1.5, 4.0);
        if seen.bounds.x >= 639 {
            break;
        }
        tracker.update(frame * 100_000_000, &[seen]);
        for track in tracker.tracks() {
            let b = track.bounds;
            assert!(b.x + b.width <= 640 && b.y + b.height <= 480 && b.width > 0, "{b:?}");
        }
    }
    let last = tracker.tracks().first().copied();
    assert!(last.is_none_or(|track| track.extent.width_m > 1.4), "{last:?}");
}

#[test]
fn two_tracks_of_one_thing_keep_the_motion_of_the_one_that_was_seen_more_often() {
    let (mut tracker, time) = after_a_second(&[sighting(15.0, [-0.9, -0.35], 1.5, 4.0)], 12);
    let known_m_s = tracker.tracks()[0].filter.speed_sigma_m_s();
    // The rest of it comes into view and seems to approach.
    let rest = |frame: u64| sighting(15.0 - 0.3 * frame as f64, [-0.3, 1.0], 1.5, 4.0);
    for frame in 1..=3 {
        let sightings = [sighting(15.0, [-0.9, -0.35], 1.5, 4.0), rest(frame)];
        tracker.update(time + frame * 80_000_000, &sightings);
    }
    assert_eq!(tracker.tracks().len(), 2);
    assert!(tracker.tracks()[1].filter.speed_sigma_m_s()[1] > 3.0 * known_m_s[1], "{:?}", tracker.tracks());
    // The box grows to the whole within less than the time after which the part is lost.
    for frame in 1..=8 {
        tracker.update(time + 240_000_000 + frame * 20_000_000, &[sighting(14.5, [-0.9, 1.0], 1.5, 4.0)]);
    }
    let tracks: Vec<&Track> = tracker.tracks().iter().filter(|track| !track.existence.is_over()).collect();
    assert_eq!((tracks.len(), tracks[0].id), (1, 1), "{tracks:?}");
    let (speed_m_s, sigma_m_s) = (tracks[0].filter.speed_m_s(), tracks[0].filter.speed_sigma_m_s());
    assert!(speed_m_s[1].abs() < 1.5, "it stands: {speed_m_s:?}");
    assert!(sigma_m_s[1] < 1.2 * known_m_s[1] && tracks[0].front_m() > 1.2, "{sigma_m_s:?} {known_m_s:?}");
}

#[test]
fn what_is_found_again_elsewhere_does_not_come_from_there() {
    let (mut tracker, period_ns) = (tracker(), 80_000_000);
    let far = sighting(50.0, [4.0, 6.0], 2.0, 4.0);
    let other = sighting(43.0, [3.4, 5.4], 2.0, 4.0);
    let mut closing_m_s = Vec::new();
    for frame in 0..10 {
        let seen: &[Region] = match frame {
            0..3 => &[far],
            3..7 => &[],
            _ => &[other],
        };
        tracker.update(frame * period_ns, seen);
        assert_eq!(tracker.tracks().len(), 1, "frame {frame}");
        closing_m_s.push(tracker.tracks()[0].closing_m_s());
    }
    println!("7 m nearer after four frames out of sight: closing speed {:.1?} m/s", &closing_m_s[6..]);
    assert!(closing_m_s[6..].iter().all(|v| v.abs() < 3.0), "{closing_m_s:?}");
    let track = &tracker.tracks()[0];
    assert!((track.distance_m() - 43.0).abs() < 2.0, "{track:?}");
}

#[test]
fn a_closing_speed_is_learnt_at_four_frames_a_second() {
    let mut tracker = tracker();
    for frame in 0..10 {
        tracker.update(frame * 250_000_000, &[car(30.0 - 5.0 * 0.25 * frame as f64)]);
    }
    let track = &tracker.tracks()[0];
    assert!((track.closing_m_s() - 5.0).abs() < 0.5 && track.time_to_collision().is_some(), "{track:?}");
}

#[test]
fn parts_of_walls_are_told_from_who_stands_before_them() {
    // A wall 4 m to the right; a door case in it, and a person who ends below its top.
    let case = |before_m: f64| sighting(14.0, [4.0 - before_m, 4.6 - before_m], 2.8, 6.0);
    let person = sighting(13.0, [3.3, 3.8], 1.8, 6.0);
    let before_wall = |points_m: &[Planar], height_m: f64| {
        let before_m = points_m.iter().map(|[right_m, _]| 4.0 - right_m);
        let [nearest_m, reach_m] =
            [before_m.clone().fold(f64::MAX, f64::min), before_m.fold(f64::MIN, f64::max)];
        (height_m > 2.5).then_some(BeforeWall { reach_m, nearest_m, is_in_path: false })
    };
    let mut tracker = tracker();
    let mut see = |frame: u64, sightings: &[Region]| {
        let motion = Some(Motion::default());
        let frame = Frame { motion, before_wall: &before_wall, ..Frame::new(frame * 80_000_000, sightings) };
        tracker.follow(&frame);
        let told = tracker.tracks().iter().filter(|t| t.is_confirmed && !t.is_part_of_boundary());
        let numbers = (0..sightings.len()).map(|s| tracker.track_of(s) > 0);
        (told.map(|t| t.region.height_m).collect::<Vec<_>>(), numbers.collect::<Vec<_>>())
    };
    for frame in 0..12 {
        assert_eq!(see(frame, &[case(0.1)]), (vec![], vec![false]), "frame {frame}");
    }
    let seen: Vec<_> = (12..24).map(|frame| see(frame, &[person, case(0.1)])).collect();
    assert_eq!(seen.last(), Some(&(vec![1.8], vec![true, false])), "{seen:?}");
    // What comes out of the wall, a gate that opens, is a thing.
    let seen: Vec<_> = (24..40).map(|frame| see(frame, &[case(0.9)])).collect();
    assert!(seen.last().is_some_and(|(told, _)| told.contains(&2.8)), "{seen:?}");
}

/// How many frames in a row a car has been seen after two seconds in which every second picture is the one before.
fn seen_in_a_row(coasts: bool) -> u32 {
    let mut tracker = tracker();
    for frame in 0..50_u32 {
        let time_ns = u64::from(frame) * 40_000_000;
        if frame % 2 == 0 {
            tracker.update(time_ns, &[car(40.0 - 0.4 * f64::from(frame))]);
        } else if coasts {
            tracker.coast(time_ns, None);
        } else {
            tracker.update(time_ns, &[]);
        }
    }
    tracker.confirmed().map(|track| track.consecutive_frames).max().unwrap_or(0)
}

#[test]
fn a_picture_that_shows_nothing_new_ends_no_row_of_sightings() {
    assert!(seen_in_a_row(true) >= 20, "{}", seen_in_a_row(true));
    assert!(seen_in_a_row(false) <= 1);
}

#[test]
fn tracks_coast_through_frozen_pictures_until_they_are_too_old() {
    let mut tracker = tracker();
    let distance_m = |frame: u32| 40.0 - 0.8 * f64::from(frame);
    let time_ns = |frame: u32| u64::from(frame) * 80_000_000;
    for frame in 0..20 {
        tracker.update(time_ns(frame), &[car(distance_m(frame))]);
    }
    for frame in 20..26 {
        let tracks = tracker.coast(time_ns(frame), None);
        assert!((tracks[0].distance_m() - distance_m(frame)).abs() < 0.5, "{}", tracks[0].distance_m());
    }
    // The next new picture shows it where it is expected, and its speed stays.
    let before_m_s = tracker.tracks()[0].closing_m_s();
    let tracks = tracker.update(time_ns(26), &[car(distance_m(26))]);
    assert!((tracks[0].closing_m_s() - before_m_s).abs() < 1.0 && tracks.len() == 1);
    // Who is not seen for long ends.
    let last = (27..60).map(|frame| tracker.coast(time_ns(frame), None).len()).last();
    assert_eq!(last, Some(0));
}

#[test]
fn of_a_thing_at_the_left_border_the_right_camera_misses_what_it_cannot_see() {
    let seen = |distance_m: f64| extent::in_view([-50.0, 100.0, 200.0, 600.0], distance_m, (640, 480), &RIG);
    // 4.5 m behind a near side at 5.5 m the disparity is 10.5 px.
    let [left, top, right, bottom] = seen(5.5);
    assert!((left - 10.548).abs() < 1e-3 && [top, right, bottom] == [100.0, 200.0, 480.0]);
    assert!(seen(1e6)[0] < 1e-3);
    assert_eq!(seen(f64::NAN)[0], 0.0);
}
