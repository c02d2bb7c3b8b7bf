//! One run of a standard test: plays its scene through the stages and judges it.

use super::scene_run::SceneRun;
use crate::command::error::CommandError;
use crate::in_process::FrameResult;
use config::Config;
use messages::alarm::Faults;
use sources::PairSource;
use sources::scene::Scene;
use sources::scene::ncap::case::Case;
use sources::scene::ncap::course::{Course, OWN_REACH_M, OWN_WIDTH_M};
use sources::scene::ncap::row::{Duty, Motion};
use sources::scene::ncap::text;
use tools::evaluation::ncap::page::Still;
use tools::evaluation::ncap::report::{FirstTimes, Run};
use tools::evaluation::ncap::rules::{Encounter, Raised, Verdict, judge};
use tools::reporting::html::picture_source;
use tools::reporting::overlay;
use tools::reporting::record::{FrameRecord, ObstacleLine};

/// How long a near miss goes on after the target is passed, in seconds: a level that is raised then is false, too.
const AFTER_S: f64 = 0.4;

/// The target is seen from this share of it, as in the other tables.
const MIN_VISIBLE: f64 = 0.5;

/// What is reported belongs to the target up to this difference in distance (share of it, and metres) and beside it, in
/// metres.
const SAME_PLACE: (f64, f64, f64) = (0.15, 1.5, 0.75);

/// A level may be about any part of the target, and about where it will be: the same, wider.
const SAME_CAUSE: (f64, f64, f64) = (0.3, 3.0, 1.5);

/// TTC of the pictures of a run, in seconds, besides those at its warning and alarm.
const STILLS_S: [f64; 4] = [3.0, 2.0, 1.2, 0.6];

/// Width of the pictures, in px.
const PICTURE_WIDTH: usize = 560;

/// A run and its pictures.
pub struct Played {
    /// What happened.
    pub run: Run,
    /// Its pictures, if they were wanted and it failed.
    pub film: Vec<Still>,
}

/// Where the target truly is, from the camera: distance, and from left to right, in metres.
#[derive(Clone, Copy)]
struct Spot {
    ahead_m: f64,
    across_m: (f64, f64),
}

impl Spot {
    fn has(&self, distance_m: f64, lateral_m: f64, (share, metres, beside): (f64, f64, f64)) -> bool {
        let (left, right) = self.across_m;
        (distance_m - self.ahead_m).abs() <= metres.max(share * self.ahead_m)
            && (left - beside..=right + beside).contains(&lateral_m)
    }
}

/// What happened so far in a run.
#[derive(Default)]
struct Watch {
    visible_s: Option<f64>,
    detected_s: Option<f64>,
    tracked_s: Option<f64>,
    raised: Raised,
    off: Option<(f64, String)>,
    /// Tracks that were where the target is.
    tracks: Vec<u32>,
    film: Vec<Still>,
}

/// The configuration with the vehicle of the scenes: its camera moves where it looks, so it stands above the rear axle.
fn configured(config: &Config, case: &Case) -> Config {
    let mut config = config.clone();
    (config.vehicle.width_m, config.vehicle.front_m, config.vehicle.camera_right_m) =
        (OWN_WIDTH_M, OWN_REACH_M.1, 0.0);
    if text::turns(case) {
        config.vehicle.rear_axle_m = 0.0;
    }
    config
}

/// Plays a run and judges it.
///
/// # Errors
/// If a stage cannot be configured or cannot use a frame.
pub fn play(case: &Case, config: &Config, with_pictures: bool) -> Result<Played, CommandError> {
    let course = Course::new(case);
    let scene = Scene::new(text::scene(case)?)?;
    let (target, frames) = (scene.first_subject(), scene.count().unwrap_or(0));
    let mut run = SceneRun::new(&configured(config, case), scene, frames)?;
    let impact_s = course.impact_s();
    // Time to which TTC counts, and at which the run ends.
    let meets_s = impact_s.unwrap_or(course.lead_s);
    let end_s = if impact_s.is_some() { meets_s } else { meets_s + AFTER_S };
    let is_hidden = impact_s.is_some() && matches!(case.row.motion, Motion::Crosses { is_hidden: true, .. });
    let mut watch = Watch::default();
    let mut stills = STILLS_S.into_iter().peekable();
    for index in 0..frames {
        let time_s = index as f64 * run.period_s;
        if time_s >= end_s || watch.is_over(case) {
            break;
        }
        let pose = course.own_pose(course.own_m_s * time_s);
        let (ahead_m, across_m) = course.target(time_s).seen_from(&pose);
        let spot = Spot { ahead_m, across_m };
        if watch.visible_s.is_none() && impact_s.is_some() && is_visible(&run, target, index) {
            watch.visible_s = Some(time_s);
        }
        let result = run.process(index)?;
        let before = watch.raised;
        // What is reported where a hidden target is belongs to what hides it.
        let spot = (watch.visible_s.is_some() || !is_hidden).then_some(spot);
        watch.look(time_s, spot, &result);
        let ttc_s = meets_s - time_s;
        let is_due = stills.next_if(|&still| ttc_s <= still).is_some();
        if with_pictures && (is_due || watch.raised != before) {
            let picture = overlay::draw(result.images, &result.record);
            let caption = format!("TTC {ttc_s:.2} s: {}", result.record.alarm.text());
            watch.film.push(Still { caption, source: picture_source(&picture, PICTURE_WIDTH) });
        }
    }
    Ok(watch.judged(case, &course, impact_s))
}

/// Whether at least half of the target is visible in both pictures, and its middle in the left one.
fn is_visible(run: &SceneRun, target: Option<u16>, index: u64) -> bool {
    let truth = run.truth(index);
    let Some(object) = truth.objects.iter().find(|object| Some(object.id) == target) else { return false };
    let column = run.rig.cx_px + run.rig.focal_px * object.lateral_m / object.distance_m.max(0.1);
    object.visible.min(object.seen_by_both) >= MIN_VISIBLE && (0.0..truth.width as f64).contains(&column)
}

impl Watch {
    /// Whether everything that the rules ask for has happened; near misses are driven to their end.
    fn is_over(&self, case: &Case) -> bool {
        let raised = match case.row.duty {
            Duty::Both => self.raised.alarm_s,
            Duty::Warning => self.raised.warning_s,
        };
        case.miss.is_none() && raised.is_some()
    }

    /// Takes in a frame; `spot` is where the target is seen.
    fn look(&mut self, time_s: f64, spot: Option<Spot>, result: &FrameResult<'_>) {
        let is_there = |distance_m, lateral_m| spot.is_some_and(|s| s.has(distance_m, lateral_m, SAME_PLACE));
        // Detected: sighted at all, confirmed or not.
        let is_detected = |o: &ObstacleLine| o.missed == 0 && is_there(o.distance_m, o.lateral_m);
        if self.detected_s.is_none() && result.record.obstacles.iter().any(is_detected) {
            self.detected_s = Some(time_s);
        }
        let record = &result.record;
        for obstacle in record.obstacles.iter().filter(|obstacle| obstacle.confirmed) {
            if is_there(obstacle.distance_m, obstacle.lateral_m) {
                self.tracked_s.get_or_insert(time_s);
                if !self.tracks.contains(&obstacle.track) {
                    self.tracks.push(obstacle.track);
                }
            }
        }
        match &record.alarm.level[..] {
            "off" => {
                let faults = Faults(result.alarm.faults);
                let reason = faults.descriptions().next().map_or("no reason given".into(), String::from);
                self.off.get_or_insert((time_s, reason));
            }
            "clear" => {}
            _ if !self.is_target(spot, record) => {
                self.raised.other_s.get_or_insert(time_s);
            }
            level => {
                self.raised.warning_s.get_or_insert(time_s);
                if level == "alarm" {
                    self.raised.alarm_s.get_or_insert(time_s);
                }
            }
        }
    }

    /// Whether the level of a frame is about the target.
    fn is_target(&self, spot: Option<Spot>, record: &FrameRecord) -> bool {
        let Some(track) = record.alarm.track else { return self.raised.warning_s.is_some() };
        let obstacle = record.obstacles.iter().find(|obstacle| obstacle.track == track);
        self.tracks.contains(&track)
            || spot.zip(obstacle).is_some_and(|(s, o)| s.has(o.distance_m, o.lateral_m, SAME_CAUSE))
    }

    fn judged(self, case: &Case, course: &Course, impact_s: Option<f64>) -> Played {
        let meets_s = impact_s.unwrap_or(course.lead_s);
        let ttc = |time: Option<f64>| time.map(|time| meets_s - time);
        let known_s = self.visible_s.map(|visible| visible.max(course.begins_s));
        let is_warning_only = case.row.duty == Duty::Warning;
        let (due, verdict) = match impact_s {
            Some(impact_s) => {
                let encounter = Encounter {
                    own_m_s: course.own_m_s,
                    impact_s,
                    touches: &|way_m, time_s| course.touches(way_m, time_s),
                    target_m_s: &|way_m, time_s| course.target_m_s(way_m, time_s),
                };
                let due = encounter.due(known_s.unwrap_or(impact_s));
                (Some(due), judge(&encounter, due, &self.raised, is_warning_only))
            }
            None => (None, self.silence(meets_s)),
        };
        let run = Run {
            id: case.id(),
            row: case.row.label(),
            title: case.row.title.into(),
            own_km_h: case.own_km_h,
            place_percent: case.place.percent(),
            miss: case.miss.map(|miss| miss.name()),
            weather: case.weather.name().into(),
            seed: case.seed,
            is_warning_only,
            due,
            ttc_s: FirstTimes {
                visible: ttc(self.visible_s),
                known: ttc(known_s),
                detected: ttc(self.detected_s),
                tracked: ttc(self.tracked_s),
                warning: ttc(self.raised.warning_s),
                alarm: ttc(self.raised.alarm_s),
                other: ttc(self.raised.other_s),
                off: ttc(self.off.as_ref().map(|(time, _)| *time)),
            },
            off_reason: self.off.map(|(_, reason)| reason),
            verdict,
        };
        let film = if run.verdict.passed == Some(false) { self.film } else { Vec::new() };
        Played { run, film }
    }

    /// The judgement of a near miss: it is silent.
    fn silence(&self, meets_s: f64) -> Verdict {
        let Raised { warning_s, alarm_s, other_s } = self.raised;
        let levels = [("warning", warning_s), ("alarm", alarm_s), ("warned of something else", other_s)];
        let said = levels.iter().filter_map(|(what, time)| {
            time.map(|time| format!("{what}, {:.2} s before it is passed", meets_s - time))
        });
        let reasons: Vec<String> = said.collect();
        Verdict { passed: Some(reasons.is_empty()), reasons, ..Verdict::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tools::reporting::record::AlarmLine;

    const SPOT: Spot = Spot { ahead_m: 20.0, across_m: (-0.9, 0.9) };

    #[test]
    fn what_is_reported_at_the_targets_place_is_the_target() {
        for (distance_m, lateral_m, is_there) in
            [(20.0, 0.0, true), (22.9, 1.6, true), (23.1, 0.0, false), (20.0, -1.7, false), (17.1, 0.0, true)]
        {
            assert_eq!(SPOT.has(distance_m, lateral_m, SAME_PLACE), is_there, "{distance_m} {lateral_m}");
        }
        // Near, some metres count.
        assert!(Spot { ahead_m: 3.0, ..SPOT }.has(4.4, 0.0, SAME_PLACE));
    }

    #[test]
    fn a_level_belongs_to_the_target_by_track_or_place() {
        let obstacle =
            |track, lateral_m| ObstacleLine { track, distance_m: 20.0, lateral_m, ..ObstacleLine::default() };
        let record = |track| FrameRecord {
            alarm: AlarmLine { level: "warning".into(), track: Some(track), ..AlarmLine::default() },
            obstacles: vec![obstacle(1, 0.0), obstacle(2, 6.0)],
            ..FrameRecord::default()
        };
        let watch = Watch { tracks: vec![9], ..Watch::default() };
        let is_target = |track, spot| watch.is_target(spot, &record(track));
        assert!(is_target(1, Some(SPOT)) && !is_target(2, Some(SPOT)));
        // A lost track that was the target; and nothing is, while the target is hidden.
        assert!(is_target(9, Some(SPOT)) && !is_target(1, None));
    }

    #[test]
    fn a_near_miss_passes_in_silence_only() {
        assert_eq!(Watch::default().silence(5.0).passed, Some(true));
        for raised in [
            Raised { warning_s: Some(3.0), ..Raised::default() },
            Raised { other_s: Some(3.0), ..Raised::default() },
        ] {
            let verdict = Watch { raised, ..Watch::default() }.silence(5.0);
            assert_eq!(verdict.passed, Some(false));
            assert!(verdict.reasons[0].contains("2.00 s before it is passed"), "{verdict:?}");
        }
    }
}
