//! Approach tests as in the paper's system test, and silent scenes, in which no alarm is allowed.

use super::scene_match::Detection;
use super::weather::BAR_SIGMAS;
use crate::reporting::picture::{Colour, Picture};
use crate::reporting::record::tidy;
use serde::Serialize;
use std::fmt;

/// One frame of an approach.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ApproachFrame {
    /// True distance of the object; `None` when it is not in the image.
    pub truth_m: Option<f64>,
    /// The matching region.
    pub found: Option<Detection>,
    /// True time to collision; `None` when the object does not approach.
    pub ttc_truth_s: Option<f64>,
    /// Time to collision of the matching track and its standard deviation, in seconds.
    pub ttc_s: Option<(f64, f64)>,
    /// Whether the level was warning or alarm.
    pub warning: bool,
    /// Whether the level was alarm.
    pub alarm: bool,
}

/// Errors of the time to collision count from this value down, in seconds.
pub const TTC_FROM_S: f64 = 2.5;

/// Result of one approach.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Approach {
    /// Name of the scene.
    pub scene: String,
    /// Description of the scene.
    pub title: String,
    /// Number of frames.
    pub frames: usize,
    /// Distance of the object at the start, in metres.
    pub start_m: f64,
    /// Distance at the first detection, in metres.
    pub first_found_m: Option<f64>,
    /// Frames without detection after the first one.
    pub missed_after: usize,
    /// Preset distance of the alarm, in metres.
    pub preset_m: f64,
    /// Distance at the alarm, in metres.
    pub alarm_m: Option<f64>,
    /// Frames from the first in which the object was nearer than preset to the alarm; negative is too
    /// early.
    pub alarm_late_frames: Option<i64>,
    /// Number of times that the alarm was cleared while the object was nearer than preset.
    pub alarm_flickers: usize,
    /// Median absolute distance error, in percent.
    pub distance_median_percent: Option<f64>,
    /// Share of true distances within the stated error bar.
    pub covered: Option<f64>,
    /// True time to collision at the first warning or alarm.
    pub warning_ttc_s: Option<f64>,
    /// True time to collision at the alarm.
    pub alarm_ttc_s: Option<f64>,
    /// Median absolute error of the time to collision from 2.5 s down, in percent.
    pub ttc_median_percent: Option<f64>,
    /// Largest of these errors, in percent.
    pub ttc_worst_percent: Option<f64>,
    /// Share of true times within the stated error bar.
    pub ttc_covered: Option<f64>,
    /// Frames from 2.5 s down without a time to collision.
    pub ttc_missed: usize,
}

/// Result of one silent scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Silent {
    /// Name of the scene.
    pub scene: String,
    /// Description of the scene.
    pub title: String,
    /// Number of frames.
    pub frames: usize,
    /// Frames at level alarm.
    pub alarm_frames: usize,
    /// Number of alarms.
    pub alarms: usize,
    /// Frames at level warning.
    pub warning_frames: usize,
    /// Frames in which the alarm was off.
    pub off_frames: usize,
    /// Frames without a road estimate: the alarm is off then, so its silence proves nothing.
    pub blind_frames: usize,
    /// False positives on the road, summed over frames.
    pub false_regions: usize,
    /// Off-road false positives, summed over frames.
    #[serde(rename = "stray_regions")]
    pub off_road_regions: usize,
}

/// Report of the distance evaluation.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DistanceReport {
    /// Name of the matcher.
    pub method: String,
    /// Approaches.
    pub approaches: Vec<Approach>,
    /// Silent scenes.
    pub silent: Vec<Silent>,
}

/// Distances shown in a filmstrip, in metres.
const SHOWN_M: [f64; 5] = [30.0, 20.0, 10.0, 5.0, 3.0];
/// Largest difference between a frame's distance and the distance it represents, in metres.
const NEAR_M: f64 = 0.5;

/// Frames shown in a filmstrip: those nearest to the fixed distances, the first detection and the alarm.
pub fn shown_frames(frames: &[ApproachFrame]) -> Vec<usize> {
    let nearest = |wanted: f64| {
        let off = frames.iter().enumerate().filter_map(|(k, f)| Some((k, (f.truth_m? - wanted).abs())));
        off.filter(|(_, off)| *off <= NEAR_M).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| k)
    };
    let found = frames.iter().position(|f| f.found.is_some());
    let alarm = frames.iter().position(|f| f.alarm);
    let mut shown: Vec<usize> = SHOWN_M.into_iter().map(nearest).chain([found, alarm]).flatten().collect();
    if shown.is_empty() {
        shown.push(0);
    }
    shown.sort_unstable();
    shown.dedup();
    shown
}

impl Approach {
    /// Evaluates the frames of an approach.
    pub fn new(scene: &str, title: &str, preset_m: f64, frames: &[ApproachFrame]) -> Self {
        let truth = |k: usize| frames[k].truth_m.map(tidy);
        let first = frames.iter().position(|f| f.found.is_some());
        let alarm = frames.iter().position(|f| f.alarm);
        let below_preset = frames.iter().position(|f| f.truth_m.is_some_and(|m| m < preset_m));
        let missed =
            |k: usize| frames[k..].iter().filter(|f| f.truth_m.is_some() && f.found.is_none()).count();
        let flickers = frames
            .windows(2)
            .filter(|w| w[0].alarm && !w[1].alarm && w[1].truth_m.is_some_and(|m| m < preset_m));
        let pairs: Vec<(f64, Detection)> =
            frames.iter().filter_map(|f| Some((f.truth_m?, f.found?))).collect();
        let mut errors: Vec<f64> = pairs.iter().map(|(m, f)| 100.0 * (f.distance_m - m).abs() / m).collect();
        errors.sort_unstable_by(f64::total_cmp);
        let warning = frames.iter().position(|f| f.warning);
        let ttc_pairs: Vec<(f64, Option<(f64, f64)>)> = frames
            .iter()
            .filter_map(|f| Some((f.ttc_truth_s.filter(|t| *t <= TTC_FROM_S)?, f.ttc_s)))
            .collect();
        let times: Vec<(f64, f64, f64)> = ttc_pairs
            .iter()
            .filter_map(|&(truth, given)| given.map(|(s, sigma)| (truth, s, sigma)))
            .collect();
        let mut ttc_errors: Vec<f64> =
            times.iter().map(|(truth, s, _)| 100.0 * (s - truth).abs() / truth.max(1e-3)).collect();
        ttc_errors.sort_unstable_by(f64::total_cmp);
        let ttc_covered =
            times.iter().filter(|(truth, s, sigma)| (s - truth).abs() <= BAR_SIGMAS * sigma).count();
        let ttc_at = |k: usize| frames[k].ttc_truth_s.map(tidy);
        let covered =
            pairs.iter().filter(|(m, f)| (f.distance_m - m).abs() <= BAR_SIGMAS * f.sigma_m).count();
        Self {
            scene: scene.into(),
            title: title.into(),
            frames: frames.len(),
            start_m: frames.first().and_then(|f| f.truth_m).map_or(0.0, tidy),
            first_found_m: first.and_then(truth),
            missed_after: first.map_or(0, missed),
            preset_m,
            alarm_m: alarm.and_then(truth),
            alarm_late_frames: alarm
                .zip(below_preset)
                .map(|(alarm, below_preset)| alarm as i64 - below_preset as i64),
            alarm_flickers: flickers.count(),
            distance_median_percent: errors.get(errors.len() / 2).copied().map(tidy),
            covered: (!pairs.is_empty()).then(|| tidy(covered as f64 / pairs.len() as f64)),
            warning_ttc_s: warning.and_then(ttc_at),
            alarm_ttc_s: alarm.and_then(ttc_at),
            ttc_median_percent: ttc_errors.get(ttc_errors.len() / 2).copied().map(tidy),
            ttc_worst_percent: ttc_errors.last().copied().map(tidy),
            ttc_covered: (!times.is_empty()).then(|| tidy(ttc_covered as f64 / times.len() as f64)),
            ttc_missed: ttc_pairs.len() - times.len(),
        }
    }
}

/// A table cell with two decimals; a dash for `None`.
fn cell(value: Option<f64>) -> String {
    value.map_or("-".into(), |v| format!("{v:.2}"))
}

impl DistanceReport {
    fn write_approaches(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<14}{:>8}{:>9}{:>13}{:>9}{:>10}{:>9}{:>8}{:>9}{:>9}{:>9}",
            "approach",
            "frames",
            "start m",
            "first found",
            "missed",
            "preset m",
            "alarm m",
            "late",
            "flicker",
            "error %",
            "covered"
        )?;
        for row in &self.approaches {
            let late = row.alarm_late_frames.map_or("-".into(), |late| format!("{late:+}"));
            writeln!(
                f,
                "{:<14}{:>8}{:>9.2}{:>13}{:>9}{:>10.2}{:>9}{:>8}{:>9}{:>9}{:>9}",
                row.scene,
                row.frames,
                row.start_m,
                cell(row.first_found_m),
                row.missed_after,
                row.preset_m,
                cell(row.alarm_m),
                late,
                row.alarm_flickers,
                cell(row.distance_median_percent),
                cell(row.covered)
            )?;
        }
        Ok(())
    }

    fn write_times_to_collision(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "\n{:<14}{:>12}{:>10}{:>10}{:>10}{:>9}{:>8}",
            "approach", "warning TTC", "alarm TTC", "TTC err %", "worst %", "covered", "missed"
        )?;
        for row in &self.approaches {
            writeln!(
                f,
                "{:<14}{:>12}{:>10}{:>10}{:>10}{:>9}{:>8}",
                row.scene,
                cell(row.warning_ttc_s),
                cell(row.alarm_ttc_s),
                cell(row.ttc_median_percent),
                cell(row.ttc_worst_percent),
                cell(row.ttc_covered),
                row.ttc_missed
            )?;
        }
        Ok(())
    }

    fn write_silent(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<14}{:>8}{:>8}{:>14}{:>10}{:>6}{:>14}{:>15}{:>18}",
            "silent",
            "frames",
            "alarms",
            "alarm frames",
            "warnings",
            "off",
            "blind frames",
            "false regions",
            "off-road regions"
        )?;
        for row in &self.silent {
            writeln!(
                f,
                "{:<14}{:>8}{:>8}{:>14}{:>10}{:>6}{:>14}{:>15}{:>18}",
                row.scene,
                row.frames,
                row.alarms,
                row.alarm_frames,
                row.warning_frames,
                row.off_frames,
                row.blind_frames,
                row.false_regions,
                row.off_road_regions
            )?;
        }
        Ok(())
    }
}

/// Tables of the approaches, of their times to collision, and of the silent scenes.
impl fmt::Display for DistanceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.approaches.is_empty() {
            self.write_approaches(f)?;
            self.write_times_to_collision(f)?;
            if !self.silent.is_empty() {
                writeln!(f)?;
            }
        }
        if !self.silent.is_empty() {
            self.write_silent(f)?;
        }
        write!(f, "\nmethod: {}", self.method)
    }
}

const GROUND: Colour = [24, 24, 24];
const INK: Colour = [240, 240, 240];
const BOX: Colour = [255, 220, 60];

/// One image of a filmstrip.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The image, shown at half size.
    pub picture: Picture,
    /// The matching region, drawn into the image.
    pub found: Option<Detection>,
    /// Caption below the image.
    pub caption: String,
}

/// Maximum number of images per row.
const ROW: usize = 4;

/// Images of one approach at half size, each with the object's box and distance and a caption.
pub fn filmstrip(title: &str, shots: &[Shot]) -> Option<Picture> {
    const GAP: usize = 6;
    const LINE: usize = 18;
    let first = &shots.first()?.picture;
    let (width, height) = (first.width() / 2, first.height() / 2);
    let (columns, rows) = (shots.len().min(ROW), shots.len().div_ceil(ROW));
    let size = (columns * (width + GAP) + GAP, LINE + rows * (height + LINE + GAP) + GAP);
    let mut strip = Picture::new(size.0, size.1, GROUND);
    strip.text(title, GAP as i32, 3, INK);
    for (k, shot) in shots.iter().enumerate() {
        let left = GAP + k % ROW * (width + GAP);
        let top = LINE + GAP + k / ROW * (height + LINE + GAP);
        for y in 0..height {
            for x in 0..width {
                let mut sum = [0_u16; 3];
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    for (sum, v) in sum.iter_mut().zip(shot.picture.at(2 * x + dx, 2 * y + dy)) {
                        *sum += u16::from(v);
                    }
                }
                strip.tint(left + x, top + y, sum.map(|v| (v / 4) as u8), 256);
            }
        }
        if let Some(Detection { bounds, distance_m, sigma_m }) = shot.found {
            let (x, y) = (left as u32 + bounds.x / 2, top as u32 + bounds.y / 2);
            strip.frame([x, y, bounds.width / 2, bounds.height / 2], BOX, 1);
            let label = format!("{distance_m:.1}±{sigma_m:.1}m");
            let above = (y as i32 - 14).max(top as i32);
            // A label near the right border is moved left so that it fits.
            let room = (left + width) as i32 - 7 * label.chars().count() as i32 - 8;
            strip.text(&label, (x as i32).min(room), above, BOX);
        }
        strip.text(&shot.caption, left as i32, (top + height + 3) as i32, INK);
    }
    Some(strip)
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::region::PixelBox;

    fn frames() -> Vec<ApproachFrame> {
        (0..28)
            .map(|k| {
                let truth = 30.0 - f64::from(k);
                let found = (k >= 2 && k != 9).then(|| Detection {
                    bounds: PixelBox::default(),
                    distance_m: truth * 1.01,
                    sigma_m: 0.004 * truth,
                });
                // 2.5 s are left at 25 m; the estimate is 4 % too high, with a standard deviation of 1 %.
                let ttc = truth / 10.0;
                ApproachFrame {
                    truth_m: Some(truth),
                    found,
                    ttc_truth_s: Some(ttc),
                    ttc_s: (k != 12).then_some((1.04 * ttc, 0.01 * ttc)),
                    warning: k >= 7,
                    alarm: k >= 22 && k != 25,
                }
            })
            .collect()
    }

    #[test]
    fn an_approach_tells_first_find_alarm_and_steadiness() {
        let approach = Approach::new("bus", "A bus", 10.0, &frames());
        assert_eq!((approach.start_m, approach.first_found_m, approach.missed_after), (30.0, Some(28.0), 1));
        // Below 10 m from frame 21 on; the alarm was raised at frame 22.
        assert_eq!((approach.alarm_m, approach.alarm_late_frames), (Some(8.0), Some(1)));
        assert_eq!((approach.alarm_flickers, approach.distance_median_percent), (1, Some(1.0)));
        // The error bar is 0.8 % to either side.
        assert_eq!(approach.covered, Some(0.0));
        assert_eq!((approach.warning_ttc_s, approach.alarm_ttc_s), (Some(2.3), Some(0.8)));
        assert_eq!((approach.ttc_median_percent, approach.ttc_worst_percent), (Some(4.0), Some(4.0)));
        assert_eq!((approach.ttc_covered, approach.ttc_missed), (Some(0.0), 1));
        // 30, 20, 10, 5 and 3 m, the first detection and the alarm.
        assert_eq!(shown_frames(&frames()), [0, 2, 10, 20, 22, 25, 27]);
        let text = DistanceReport { approaches: vec![approach], ..DistanceReport::default() }.to_string();
        assert!(text.contains("28.00") && text.contains("+1"), "{text}");
    }

    #[test]
    fn what_is_never_found_is_told() {
        let frames = vec![ApproachFrame { truth_m: Some(9.0), ..ApproachFrame::default() }; 4];
        let approach = Approach::new("cone", "A cone", 10.0, &frames);
        assert_eq!((approach.first_found_m, approach.alarm_m, approach.covered), (None, None, None));
        assert_eq!(shown_frames(&frames), [0]);
        assert!(filmstrip("x", &[]).is_none());
        let bounds = PixelBox { x: 8, y: 4, width: 20, height: 10 };
        let found = Some(Detection { bounds, distance_m: 9.1, sigma_m: 0.1 });
        let shot = |found| Shot { picture: Picture::new(40, 20, [200, 0, 0]), found, caption: "9 m".into() };
        let strip = filmstrip("x", &[shot(None)]).unwrap();
        assert_eq!((strip.width(), strip.height(), strip.at(16, 30)), (32, 58, [200, 0, 0]));
        // Five images take two rows; the box of the second is drawn at half size.
        let strip = filmstrip("x", &[shot(None), shot(found), shot(None), shot(None), shot(None)]).unwrap();
        assert_eq!((strip.width(), strip.height()), (4 * 26 + 6, 92));
        assert_eq!(strip.at(32 + 4 + 9, 24 + 2 + 4), BOX);
    }
}
