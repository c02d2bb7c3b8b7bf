//! Alarms of a source with faults in its time, compared with the truth of the scenes and with the same scenes without
//! faults.

use super::time_faults::{ShownFrame, TimeFault};
use perception::alarm::AlarmParameters;
use serde::Serialize;
use sources::scene::{ObjectClass, SceneTruth};
use std::collections::BTreeMap;
use std::fmt;

/// An alarm may remain for this long after its cause, in seconds, beyond its hold time: five repeated stamps of 80 ms, by
/// which the source's time lags behind the scene, and a frame.
const SLACK_S: f64 = 0.5;

/// An alarm may precede its cause by this, in seconds: the rules are evaluated ahead by the time of their confirmation.
const LEAD_S: f64 = 0.24;

/// Tolerance of a distance: as [`super::scene_match`] matches regions with objects, a share of it and at least 1 m.
const TOLERANCE_SHARE: f64 = 0.15;
const TOLERANCE_M: f64 = 1.0;

/// After a fault, an alarm is due once this many normal frames in a row show an obstacle that is nearer than preset: up to
/// eight until the time is relied on again, three sightings until a region is confirmed, three until its track is, two
/// until the alarm is.
pub const DUE_FRAMES: usize = 16;

/// Number of false and of missed alarms that are listed.
const MAX_LISTED: usize = 50;

/// What the alarm should do in a frame, by its truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameDuty {
    /// Whether an obstacle is so near, or approaches so fast, that an alarm is right.
    pub may: bool,
    /// Whether an obstacle in the path is nearer than preset, at least half visible to both cameras.
    pub must: bool,
}

impl FrameDuty {
    /// The duty of an alarm with these parameters.
    pub fn of(truth: &SceneTruth, rules: &AlarmParameters) -> Self {
        let margin = 1.0 + rules.clear_share;
        let in_path = truth.objects.iter().filter(|o| o.in_path && o.class != ObjectClass::Bridge);
        let mut duty = Self::default();
        for object in in_path {
            let nearest_m = object.distance_m
                - (TOLERANCE_SHARE * object.distance_m).max(TOLERANCE_M).min(object.distance_m);
            let closing = object.closing_m_s.max(0.0) * (1.0 + TOLERANCE_SHARE);
            let is_near = rules.distance_m > 0.0 && nearest_m < rules.distance_m * margin;
            let gap_m = nearest_m - rules.front_m;
            let is_soon = rules.ttc_alarm_s > 0.0 && gap_m < closing * rules.ttc_alarm_s * margin;
            let needed = closing * closing / (2.0 * gap_m.max(0.1));
            let is_hard =
                rules.deceleration_alarm_m_s2 > 0.0 && needed > rules.deceleration_alarm_m_s2 / margin;
            duty.may |= is_near || is_soon || is_hard;
            duty.must |= object.subject
                && object.distance_m < rules.distance_m
                && object.visible * object.seen_by_both >= 0.5;
        }
        duty
    }
}

/// A scene without faults: the truth and the alarm of each frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Undisturbed {
    /// Time between two frames, in seconds.
    pub period_s: f64,
    /// Duty of each frame.
    pub duties: Vec<FrameDuty>,
    /// Whether the level was alarm, for each frame.
    pub alarms: Vec<bool>,
}

impl Undisturbed {
    /// Runs of frames whose alarm has no cause, by index.
    pub fn false_runs(&self, hold_s: f64) -> Vec<std::ops::Range<usize>> {
        let is_false = |k: usize| self.alarms[k] && !self.explains(k as u64, hold_s);
        runs(&(0..self.alarms.len().min(self.duties.len())).map(is_false).collect::<Vec<_>>()).collect()
    }

    /// Whether an alarm at frame `index` has a cause: at that frame, shortly after it, or at most the hold time before.
    fn explains(&self, index: u64, hold_s: f64) -> bool {
        self.window(index, hold_s).any(|k| self.duties[k].may)
    }

    /// The frames whose state an alarm at frame `index` may show.
    fn window(&self, index: u64, hold_s: f64) -> std::ops::Range<usize> {
        let frames = |seconds: f64| (seconds / self.period_s).ceil() as usize;
        let index = index as usize;
        let end = (index + frames(LEAD_S) + 1).min(self.duties.len());
        index.saturating_sub(frames(hold_s + SLACK_S)).min(end)..end
    }
}

/// A false or a missed alarm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Incident {
    /// Name of the scene.
    pub scene: String,
    /// Number of its session, from 0.
    pub session: usize,
    /// Number of its frame in the scene.
    pub frame: u64,
    /// The last fault before it.
    pub after: Option<TimeFault>,
    /// Distance of the nearest obstacle in the path that was reported, in metres.
    pub nearest_m: Option<f64>,
}

/// What an evaluation of faults in time found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TimeReport {
    /// Name of the matcher.
    pub method: String,
    /// Seed of the faults.
    pub seed: u64,
    /// Time that passed in the scenes with faults, with all gaps, in seconds.
    pub source_s: f64,
    /// Frames that were shown.
    pub frames: u64,
    /// Scenes that were shown.
    pub scenes: u64,
    /// Number of faults of each kind.
    pub faults: BTreeMap<TimeFault, u64>,
    /// Gaps, steps back, repeats and dropped obstacles that the recognition stage counted.
    pub counted: BTreeMap<String, u64>,
    /// Alarms that have a cause.
    pub true_alarms: u64,
    /// Alarms without a cause that the same scene does not have without faults.
    pub false_alarms: u64,
    /// Alarms without a cause that the same scene has without faults, too.
    pub false_alarms_of_scene: u64,
    /// Stretches of normal frames in which an alarm was due, as it is raised without faults.
    pub due: u64,
    /// Those without an alarm.
    pub missed: u64,
    /// Frames in which the alarm was off.
    pub off_frames: u64,
    /// Frames with an obstacle whose numbers mean nothing.
    pub meaningless: u64,
    /// The same scenes without faults, each once: frames, true alarms and false ones.
    pub undisturbed: UndisturbedReport,
    /// The first false alarms.
    pub listed_false: Vec<Incident>,
    /// The first missed alarms.
    pub listed_missed: Vec<Incident>,
}

/// The scenes without faults.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct UndisturbedReport {
    /// Scenes.
    pub scenes: u64,
    /// Frames.
    pub frames: u64,
    /// Alarms that have a cause.
    pub true_alarms: u64,
    /// Alarms without a cause.
    pub false_alarms: u64,
}

/// The result of a frame with faults in its time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimedResult {
    /// Whether the level was alarm.
    pub alarm: bool,
    /// Whether the level was off.
    pub off: bool,
    /// Distance of the nearest obstacle in the path, in metres.
    pub nearest_m: Option<f64>,
    /// Whether an obstacle had a number that means nothing.
    pub is_meaningless: bool,
}

/// A scene as it was shown.
#[derive(Clone, Copy, Debug)]
pub struct Showing<'a> {
    /// Name of the scene.
    pub scene: &'a str,
    /// Number of its session.
    pub session: usize,
    /// Its frames.
    pub shown: &'a [ShownFrame],
    /// Their results.
    pub results: &'a [TimedResult],
}

impl TimeReport {
    /// Whether no alarm was false, none was missed, and no number meant nothing.
    pub fn is_good(&self) -> bool {
        self.false_alarms == 0 && self.missed == 0 && self.meaningless == 0
    }

    /// Adds a scene without faults.
    pub fn add_undisturbed(&mut self, scene: &Undisturbed, hold_s: f64) {
        self.undisturbed.scenes += 1;
        self.undisturbed.frames += scene.alarms.len() as u64;
        for run in runs(&scene.alarms) {
            let has_cause = run.clone().all(|k| scene.explains(k as u64, hold_s));
            *(if has_cause {
                &mut self.undisturbed.true_alarms
            } else {
                &mut self.undisturbed.false_alarms
            }) += 1;
        }
    }

    /// Adds a scene with faults, compared with the same one without.
    pub fn add(&mut self, showing: Showing<'_>, undisturbed: &Undisturbed, hold_s: f64) {
        let Showing { shown, results, .. } = showing;
        self.scenes += 1;
        self.frames += shown.len() as u64;
        self.off_frames += results.iter().filter(|r| r.off).count() as u64;
        self.meaningless += results.iter().filter(|r| r.is_meaningless).count() as u64;
        for fault in shown.iter().filter_map(|frame| frame.fault) {
            *self.faults.entry(fault).or_default() += 1;
        }
        let is_false = |k: usize| results[k].alarm && !undisturbed.explains(shown[k].index, hold_s);
        let alarms: Vec<bool> = results.iter().map(|r| r.alarm).collect();
        for run in runs(&alarms) {
            let Some(first) = run.clone().find(|&k| is_false(k)) else {
                self.true_alarms += 1;
                continue;
            };
            let index = shown[first].index;
            if undisturbed.window(index, hold_s).any(|k| undisturbed.alarms[k]) {
                self.false_alarms_of_scene += 1;
                continue;
            }
            self.false_alarms += 1;
            if self.listed_false.len() < MAX_LISTED {
                self.listed_false.push(incident(showing, first));
            }
        }
        let is_due = |k: usize| {
            let (frame, index) = (shown[k], shown[k].index as usize);
            // The frame with the fault itself starts anew.
            frame.is_normal && undisturbed.duties[index].must && undisturbed.alarms[index]
        };
        let due: Vec<bool> = (0..shown.len()).map(is_due).collect();
        for run in runs(&due).filter(|run| run.len() > DUE_FRAMES) {
            self.due += 1;
            if !run.clone().skip(DUE_FRAMES).all(|k| results[k].alarm) {
                self.missed += 1;
                if self.listed_missed.len() < MAX_LISTED {
                    self.listed_missed.push(incident(showing, run.start + DUE_FRAMES));
                }
            }
        }
    }

    /// Adds another part of the same run.
    pub fn join(&mut self, part: Self) {
        self.source_s += part.source_s;
        self.frames += part.frames;
        self.scenes += part.scenes;
        for (fault, count) in part.faults {
            *self.faults.entry(fault).or_default() += count;
        }
        for (name, count) in part.counted {
            *self.counted.entry(name).or_default() += count;
        }
        self.true_alarms += part.true_alarms;
        self.false_alarms += part.false_alarms;
        self.false_alarms_of_scene += part.false_alarms_of_scene;
        self.due += part.due;
        self.missed += part.missed;
        self.off_frames += part.off_frames;
        self.meaningless += part.meaningless;
        self.listed_false.extend(part.listed_false);
        self.listed_false.truncate(MAX_LISTED);
        self.listed_missed.extend(part.listed_missed);
        self.listed_missed.truncate(MAX_LISTED);
    }
}

fn incident(showing: Showing<'_>, k: usize) -> Incident {
    Incident {
        scene: showing.scene.into(),
        session: showing.session,
        frame: showing.shown[k].index,
        after: showing.shown[..=k].iter().rev().find_map(|frame| frame.fault),
        nearest_m: showing.results[k].nearest_m,
    }
}

/// The maximal runs of `true`.
fn runs(flags: &[bool]) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
    let mut from = 0;
    std::iter::from_fn(move || {
        let start = from + flags.get(from..)?.iter().position(|&flag| flag)?;
        let length = flags[start..].iter().position(|&flag| !flag).unwrap_or(flags.len() - start);
        from = start + length;
        Some(start..from)
    })
}

impl fmt::Display for TimeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let u = &self.undisturbed;
        writeln!(
            f,
            "{:<16}{:>8}{:>9}{:>9}{:>13}{:>14}{:>6}{:>8}",
            "", "scenes", "frames", "seconds", "true alarms", "false alarms", "due", "missed"
        )?;
        writeln!(
            f,
            "{:<16}{:>8}{:>9}{:>9.0}{:>13}{:>14}{:>6}{:>8}",
            "with faults",
            self.scenes,
            self.frames,
            self.source_s,
            self.true_alarms,
            self.false_alarms,
            self.due,
            self.missed
        )?;
        writeln!(
            f,
            "{:<16}{:>8}{:>9}{:>9}{:>13}{:>14}{:>6}{:>8}",
            "without", u.scenes, u.frames, "", u.true_alarms, u.false_alarms, "", ""
        )?;
        writeln!(f, "\nfalse alarms that the scene has without faults, too: {}", self.false_alarms_of_scene)?;
        writeln!(
            f,
            "frames with the alarm off: {}; with meaningless numbers: {}",
            self.off_frames, self.meaningless
        )?;
        let list = |all: &mut dyn Iterator<Item = String>| all.collect::<Vec<_>>().join(", ");
        writeln!(
            f,
            "faults: {}",
            list(&mut self.faults.iter().map(|(kind, count)| format!("{count} {}", kind.name())))
        )?;
        writeln!(
            f,
            "counted by the stage: {}",
            list(&mut self.counted.iter().map(|(name, count)| format!("{count} {}", name.replace('_', " "))))
        )?;
        for (what, incidents) in [("false", &self.listed_false), ("missed", &self.listed_missed)] {
            for i in incidents {
                let after = i.after.map_or("the start", TimeFault::name);
                let nearest = i.nearest_m.map_or(String::new(), |m| format!(", nearest {m:.1} m"));
                writeln!(
                    f,
                    "{what}: session {}, {}, frame {}, after {after}{nearest}",
                    i.session, i.scene, i.frame
                )?;
            }
        }
        write!(f, "seed {}, method {}", self.seed, self.method)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 0.08;
    const HOLD_S: f64 = 1.0;

    /// A scene of 200 frames with a cause for an alarm from frame 100 to 139.
    fn scene() -> Undisturbed {
        let is_cause = |k: &usize| (100..140).contains(k);
        let duties = (0..200).map(|k| FrameDuty { may: is_cause(&k), must: is_cause(&k) }).collect();
        Undisturbed { period_s: PERIOD_S, duties, alarms: (0..200).map(|k| is_cause(&k)).collect() }
    }

    fn frames(range: std::ops::Range<u64>) -> Vec<ShownFrame> {
        let frame = |index| ShownFrame { index, source_ns: index, fault: None, is_normal: true };
        range.map(frame).collect()
    }

    fn report(shown: &[ShownFrame], alarms: std::ops::Range<usize>) -> TimeReport {
        let result = |k: usize| TimedResult { alarm: alarms.contains(&k), ..TimedResult::default() };
        let results: Vec<TimedResult> = (0..shown.len()).map(result).collect();
        let mut report = TimeReport::default();
        report.add(Showing { scene: "x", session: 0, shown, results: &results }, &scene(), HOLD_S);
        report
    }

    #[test]
    fn an_alarm_needs_a_cause_and_may_be_held() {
        let all = frames(0..200);
        let counts = |r: &TimeReport| (r.true_alarms, r.false_alarms, r.due, r.missed);
        assert_eq!(counts(&report(&all, 100..140)), (1, 0, 1, 0));
        assert_eq!(counts(&report(&all, 97..155)), (1, 0, 1, 0), "ahead by its confirmation, and held");
        assert_eq!(counts(&report(&all, 100..165)).1, 1, "held for too long");
        assert_eq!(counts(&report(&all, 20..35)), (0, 1, 1, 1));
        assert_eq!(counts(&report(&all, 0..0)), (0, 0, 1, 1));
        assert_eq!(counts(&report(&all, 120..140)).3, 1, "too late");
        // Fifteen frames of alarm after a gap of 3 s and more.
        let mut gap = frames(0..20);
        gap.extend(frames(70..100));
        gap[20].fault = Some(TimeFault::Gap);
        let found = report(&gap, 20..35);
        assert_eq!((found.false_alarms, found.listed_false[0].after), (1, Some(TimeFault::Gap)));
        assert!(!found.is_good() && report(&all, 100..140).is_good());
    }

    #[test]
    fn a_false_alarm_of_the_scene_itself_is_counted_apart() {
        let mut scene = scene();
        scene.alarms[30..40].fill(true);
        let mut found = TimeReport::default();
        found.add_undisturbed(&scene, HOLD_S);
        assert_eq!((found.undisturbed.true_alarms, found.undisturbed.false_alarms), (1, 1));
        let shown = frames(0..60);
        let results: Vec<TimedResult> =
            (0..60).map(|k| TimedResult { alarm: (32..38).contains(&k), ..TimedResult::default() }).collect();
        found.add(Showing { scene: "x", session: 0, shown: &shown, results: &results }, &scene, HOLD_S);
        assert_eq!((found.false_alarms, found.false_alarms_of_scene), (0, 1));
    }
}
