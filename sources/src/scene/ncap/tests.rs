//! Tests of the standard tests' scenes: motion, truth and text agree.

use super::case::{Case, Selection, names};
use super::course::{Course, OWN_REACH_M};
use super::row::{Duty, Miss, Motion, ROWS, Target};
use super::text;
use crate::PairSource;
use crate::scene::Scene;
use crate::scene::file::{NamedRig, Weather};

fn all(year: u16) -> Selection {
    Selection {
        year,
        rows: Vec::new(),
        speeds_km_h: Vec::new(),
        is_nominal: false,
        is_extended: true,
        weathers: vec![Weather::Sunny],
        rig: NamedRig::Paper,
        fps: 12.5,
        seeds: (1, 1),
    }
}

fn cases(name: &str) -> Vec<Case> {
    Selection { rows: vec![name.into()], ..all(2026) }.cases()
}

#[test]
fn every_impact_is_at_its_time_and_no_near_miss_hits() {
    for year in [2023, 2026] {
        for case in all(year).cases() {
            let course = Course::new(&case);
            let (id, impact) = (case.id(), course.impact_s());
            match (case.miss, impact) {
                (None, Some(impact_s)) => {
                    // Corners of what crosses or is turned towards touch a little earlier.
                    let early = course.lead_s - impact_s;
                    let is_slanted = matches!(case.row.motion, Motion::Comes(_)) && case.row.turn.is_some();
                    let most = if is_slanted {
                        3.2
                    } else if case.row.turn.is_some() {
                        0.2
                    } else {
                        1e-3
                    };
                    assert!(early > -1e-3 && early < most, "{id}: {early} s early");
                }
                (Some(_), None) => {}
                other => panic!("{id}: {other:?}"),
            }
        }
    }
}

#[test]
fn the_scene_shows_what_the_course_says() {
    for (name, own_km_h) in [
        ("CCRs", 30.0),
        ("CCRb", 50.0),
        ("CPNA", 40.0),
        ("CPTA", 15.0),
        ("CBFA", 30.0),
        ("CMRs", 20.0),
        ("CCFhos", 50.0),
        ("CCFtap", 20.0),
        ("CCCscp", 20.0),
    ] {
        let case = cases(name).into_iter().find(|case| case.own_km_h == own_km_h).expect(name);
        let course = Course::new(&case);
        let mut scene = Scene::new(text::scene(&case).unwrap_or_else(|e| panic!("{e}"))).unwrap();
        let id = scene.first_subject().unwrap();
        let mut seen = 0;
        for index in (0..scene.count().unwrap().min(100)).step_by(3) {
            let truth = scene.truth(index);
            let is_seen = truth.time_s < course.impact_s().unwrap() - 0.1;
            let Some(object) = truth.objects.iter().find(|o| o.id == id && is_seen) else { continue };
            seen += 1;
            let way_m = course.own_m_s * truth.time_s;
            let outline = course.target(truth.time_s);
            let (ahead, (left, right)) = outline.seen_from(&course.own_pose(way_m));
            // Meshes are a little smaller than their box, a bicycle is thinner than its handlebar, and in a turn the nearest
            // visible part is not the nearest corner.
            let is_thin = matches!(case.row.target, Target::Bicycle | Target::Motorcycle);
            let slack = if case.row.turn.is_some() || is_thin { 0.5 } else { 0.16 };
            // Of what the border cuts, the nearest part may be outside.
            let is_cut =
                object.bounds.x == 0 || (object.bounds.x + object.bounds.width) as usize == truth.width;
            assert!(
                is_cut || (object.distance_m - ahead).abs() < slack,
                "{name} {index}: {} {ahead}",
                object.distance_m
            );
            let middle = 0.5 * (left + right);
            assert!(
                (object.lateral_m - middle).abs() < 2.0 * slack,
                "{name} {index}: {} {middle}",
                object.lateral_m
            );
        }
        assert!(seen >= 2, "{name}: {seen}");
    }
}

#[test]
fn the_impact_is_that_of_the_closed_form() {
    // A vehicle that brakes with 6 m/s² from 50 km/h, 12 m ahead: 12 = 6 t²/2.
    let row = ROWS.iter().find(|row| row.variant == "12 m, -6").unwrap();
    let case = Selection { rows: vec![row.name.into()], ..all(2023) }.cases();
    let case = case.into_iter().find(|case| case.row == row && case.miss.is_none()).unwrap();
    let course = Course::new(&case);
    assert!((course.impact_s().unwrap() - course.begins_s - 2.0).abs() < 1e-3);
    // 0.5 s after it began to brake it is 3 m/s slower.
    let time = course.begins_s + 0.5;
    assert!((course.target_m_s(course.own_m_s * time, time) - (course.own_m_s - 3.0)).abs() < 0.02);
    // An adult at 5 km/h who starts 4 m aside of our middle, where he is hit.
    let case = cases("CPNA")[0];
    let course = Course::new(&case);
    assert!((course.lead_s - course.begins_s - 4.0 * 3.6 / 5.0).abs() < 1e-9);
    assert!((course.meeting_m() - course.own_m_s * course.lead_s - OWN_REACH_M.1).abs() < 1e-9);
}

#[test]
fn clearances_are_those_that_are_named() {
    for case in all(2026).cases() {
        let course = Course::new(&case);
        let own = 0.9;
        let (_, (left, right)) = course.target(course.lead_s).seen_from(&Default::default());
        match case.miss {
            Some(Miss::Beside(m)) if case.row.turn.is_none() => {
                let clearance = if left > 0.0 { left - own } else { -right - own };
                assert!((clearance - m).abs() < 1e-6, "{}: {clearance}", case.id());
            }
            Some(Miss::HasPassed(m)) if case.row.turn.is_none() => {
                let clearance = if left > 0.0 { left - own } else { -right - own };
                assert!((clearance - m).abs() < 1e-6, "{}: {clearance}", case.id());
            }
            _ => {}
        }
    }
}

#[test]
fn a_child_is_hidden_and_then_seen() {
    let case = cases("CPNCO").into_iter().find(|case| case.own_km_h == 40.0).unwrap();
    let mut scene = Scene::new(text::scene(&case).unwrap()).unwrap();
    let id = scene.first_subject().unwrap();
    let mut visible = |index| {
        let truth = scene.truth(index);
        truth.objects.iter().find(|o| o.id == id).map_or(0.0, |o| o.visible)
    };
    assert!(visible(5) < 0.5 && visible(25) < 0.5, "hidden");
    assert!(visible(60) > 0.9, "in the open");
}

#[test]
fn rows_and_runs_have_names_of_their_own_and_a_scene_each() {
    for year in [2023, 2026] {
        let cases = all(year).cases();
        let mut ids: Vec<String> = cases.iter().map(Case::id).collect();
        ids.sort();
        let count = ids.len();
        ids.dedup();
        assert_eq!(ids.len(), count, "{year}");
        for case in cases.iter().step_by(7) {
            assert!(text::scene(case).is_ok(), "{}: {:?}", case.id(), text::scene(case));
        }
        assert!(names(year).contains(&"CPNCO") && names(year).len() > 15);
    }
    assert!(ROWS.iter().all(|row| !row.places.is_empty() && !row.own_km_h.is_empty()));
    let warned = ROWS.iter().filter(|row| row.duty == Duty::Warning);
    assert!(warned.clone().all(|row| row.name.ends_with("-FCW")) && warned.count() == 5);
    assert!(
        Selection { rows: vec!["ccrs".into()], ..all(2026) }.cases().iter().all(|c| c.row.name == "CCRs")
    );
    // What a seed decides is the same every time, and another seed's differs.
    let case = cases("CPNA")[0];
    assert_eq!(text::text(&case), text::text(&case));
    assert_ne!(text::text(&case), text::text(&Case { seed: 2, ..case }));
}
