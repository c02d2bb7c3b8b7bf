//! `lookout calibrate`.

mod arguments;
mod drive;
mod live;

pub use arguments::{Calibrate, CropArgs, HELP, USAGE, pair, picture_size};

use crate::command::console::{progress, say};
use crate::command::error::CommandError;
use perception::calibration::stereo::ViewReport;
use perception::calibration::{Grade, StereoCalibration};
use serde::Serialize;
use std::time::{Instant, SystemTime, UNIX_EPOCH};
use tools::calibration::{Outcome, Request, report, run as calibrate};

#[derive(Serialize)]
struct Figures {
    verdict: &'static str,
    reasons: Vec<String>,
    pairs: usize,
    pairs_with_board: usize,
    pairs_used: usize,
    left_out: Vec<String>,
    moved: Vec<String>,
    rms_px: Option<f64>,
    rms_left_px: Option<f64>,
    rms_right_px: Option<f64>,
    vertical_mean_px: Option<f64>,
    vertical_heldout_px: Option<f64>,
    baseline_m: Option<f64>,
    baseline_sigma_m: Option<f64>,
    focal_px: Option<f64>,
    disparity_sigma_px: Option<f64>,
    projection_sigma_px: Option<[ProjectionSigma; 2]>,
    coverage_left: Option<f64>,
    coverage_right: Option<f64>,
    board_bend_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    all_views: Option<AllViews>,
    picture_ms_median: Option<f64>,
    picture_ms_most: Option<f64>,
    seconds: f64,
    cpu_seconds: f64,
    rig: Option<String>,
}

/// Uncertainty of where a camera, left or right, sees points far away, in pixels: worst direction.
#[derive(Clone, Copy, Serialize)]
struct ProjectionSigma {
    /// In the middle of the image.
    middle: f64,
    /// The largest of positions a tenth of the image away from its borders.
    largest: f64,
}

impl ProjectionSigma {
    fn of(c: &StereoCalibration, side: usize) -> Option<Self> {
        let (middle, largest) = c.projection.far_sigma_px(side, c.rectification.size)?;
        Some(Self { middle, largest })
    }
}

/// Result with all views, none rejected (`--cross-validate`).
#[derive(Serialize)]
struct AllViews {
    pairs_used: usize,
    rms_px: f64,
    vertical_mean_px: f64,
    vertical_heldout_px: Option<f64>,
    baseline_m: f64,
}

impl Figures {
    fn new(outcome: &Outcome) -> Self {
        let c = outcome.calibration.as_ref();
        let named = |which: fn(&ViewReport) -> bool| {
            let views = c.iter().flat_map(|c| &c.views).zip(&outcome.views);
            views.filter(|(v, _)| which(v)).map(|(_, p)| p.name.clone()).collect()
        };
        let all_views = outcome.of_all.as_ref().map(|c| AllViews {
            pairs_used: c.views.len(),
            rms_px: c.rms_px,
            vertical_mean_px: c.vertical_mean_px,
            vertical_heldout_px: c.vertical_heldout_px,
            baseline_m: c.rectification.rig.baseline_m,
        });
        let mut picture_ms = outcome.picture_ms.clone();
        picture_ms.sort_unstable_by(f64::total_cmp);
        Self {
            verdict: outcome.verdict.grade.name(),
            reasons: outcome.verdict.reasons.iter().map(|r| r.text.clone()).collect(),
            pairs: outcome.pairs,
            pairs_with_board: outcome.views.len(),
            pairs_used: outcome.pairs_used(),
            left_out: named(|v| v.fault.is_some()),
            moved: named(|v| v.moved),
            rms_px: c.map(|c| c.rms_px),
            rms_left_px: c.map(|c| c.rms_sides_px[0]),
            rms_right_px: c.map(|c| c.rms_sides_px[1]),
            vertical_mean_px: c.map(|c| c.vertical_mean_px),
            vertical_heldout_px: c.and_then(|c| c.vertical_heldout_px),
            baseline_m: c.map(|c| c.rectification.rig.baseline_m),
            baseline_sigma_m: c.map(|c| c.uncertainty.baseline_m),
            focal_px: c.map(|c| c.rectification.rig.focal_px),
            disparity_sigma_px: c.map(|c| c.uncertainty.disparity_px),
            projection_sigma_px: c
                .and_then(|c| Some([ProjectionSigma::of(c, 0)?, ProjectionSigma::of(c, 1)?])),
            coverage_left: c.map(|c| c.coverage[0]),
            coverage_right: c.map(|c| c.coverage[1]),
            board_bend_m: c.map(|c| c.shape.bend_m.iter().map(|b| b.abs()).fold(0.0, f64::max)),
            all_views,
            picture_ms_median: picture_ms.get(picture_ms.len() / 2).copied(),
            picture_ms_most: picture_ms.last().copied(),
            seconds: 0.0,
            cpu_seconds: 0.0,
            rig: None,
        }
    }
}

pub fn run(args: &Calibrate, log: Option<&str>) -> Result<(), CommandError> {
    if let Some(recording) = &args.from_drive {
        return drive::run(args, recording, log);
    }
    let described = args.board.as_ref();
    let none = "describe the board: --board COLSxROWS and --square-mm S; see lookout calibrate --help";
    let board = described.ok_or_else(|| CommandError::Other(none.into()))?.board()?;
    let folder = match &args.dir {
        Some(folder) if !args.live => folder.clone(),
        _ => live::collect(args, board, log)?,
    };
    let (start, cpu) = (Instant::now(), messages::clock::process_cpu_ns());
    let bar = progress(Some(0), "images");
    bar.set_message("detecting the board");
    let request = Request {
        folder: &folder,
        board,
        lens: args.lens.into(),
        crop: args.crop.into(),
        simultaneous: args.simultaneous,
        cross_validate: args.cross_validate,
    };
    let outcome = calibrate(&request, &|done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let mut figures = Figures::new(&outcome);
    figures.seconds = start.elapsed().as_secs_f64();
    figures.cpu_seconds = (messages::clock::process_cpu_ns() - cpu) as f64 * 1e-9;
    let redo = outcome.verdict.grade == Grade::Redo;
    let now = today();
    let serial = args.serial.clone().unwrap_or_else(|| format!("rig {now}"));
    if !redo && let Some(rig) = outcome.rig(&serial, &now) {
        rig.write(&args.out)?;
        figures.rig = Some(args.out.display().to_string());
    }
    if let Some(folder) = &args.report {
        report::write(folder, &outcome)?;
    }
    if args.json {
        say(serde_json::to_string_pretty(&figures)?)?;
    } else {
        print(args, &outcome, &figures)?;
    }
    if redo {
        let kept = if args.out.exists() { " is kept unchanged" } else { " is not written" };
        let reason = outcome.verdict.reasons.iter().find(|reason| reason.grade == Grade::Redo);
        let reason = reason.map(|reason| format!(": {}", reason.text)).unwrap_or_default();
        return Err(CommandError::Other(format!("verdict: redo; {}{kept}{reason}", args.out.display())));
    }
    Ok(())
}

fn print(args: &Calibrate, outcome: &Outcome, figures: &Figures) -> Result<(), CommandError> {
    say(format_args!("verdict: {}", figures.verdict))?;
    for reason in &outcome.verdict.reasons {
        say(format_args!("  {:7} {}", format!("({})", reason.grade), reason.text))?;
    }
    if let Some(c) = &outcome.calibration {
        let held = figures.vertical_heldout_px.map_or("-".into(), |v| format!("{v:.3} px"));
        say(format_args!(
            "{} of {} pairs used: reprojection error {:.3} px, mean vertical error {:.3} px ({held} on held-out views)",
            figures.pairs_used, figures.pairs, c.rms_px, c.vertical_mean_px
        ))?;
        if let Some(all) = &figures.all_views {
            let held = all.vertical_heldout_px.map_or("-".into(), |v| format!("{v:.3} px"));
            say(format_args!(
                "all {} pairs, none rejected: reprojection error {:.3} px, mean vertical error {:.3} px ({held} on the other half of the views)",
                all.pairs_used, all.rms_px, all.vertical_mean_px
            ))?;
        }
        let rig = &c.rectification.rig;
        say(format_args!(
            "baseline {:.2} +- {:.2} mm; rectified focal length {:.2} px; distance in m = {:.4} / disparity in px; \
             uncertainty of far disparities {:.2} px",
            rig.baseline_m * 1e3,
            c.uncertainty.baseline_m * 1e3,
            rig.focal_px,
            rig.focal_px * rig.baseline_m,
            c.uncertainty.disparity_px
        ))?;
        if let Some([left, right]) = figures.projection_sigma_px {
            say(format_args!(
                "uncertainty of where far points appear: left {:.2} px in the middle, {:.2} px towards the borders; right {:.2}, {:.2} px",
                left.middle, left.largest, right.middle, right.largest
            ))?;
        }
    }
    let picture = match (figures.picture_ms_median, figures.picture_ms_most) {
        (Some(median), Some(most)) => format!(" ({median:.0} ms per picture, at most {most:.0} ms)"),
        _ => String::new(),
    };
    say(format_args!("{:.2} s, {:.2} s of processor time{picture}", figures.seconds, figures.cpu_seconds))?;
    if let Some(rig) = &figures.rig {
        say(format_args!("rig: {rig}"))?;
    }
    if let Some(folder) = &args.report {
        say(format_args!("report: {}", folder.join("index.html").display()))?;
    }
    Ok(())
}

/// Date and time, UTC.
fn today() -> String {
    date(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()))
}

/// Formats seconds since 1970 as `year-month-day hours:minutes:seconds`, UTC.
fn date(seconds: u64) -> String {
    // Days to a date of the Gregorian calendar, years starting in March.
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    let shifted = days + 719_468;
    let era = shifted / 146_097;
    let day_of_era = shifted % 146_097;
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let (month, carry) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    let year = year_of_era + era * 400 + carry;
    format!("{year}-{month:02}-{day:02} {:02}:{:02}:{:02}", rest / 3600, rest / 60 % 60, rest % 60)
}

#[cfg(test)]
mod tests {
    use super::date;

    #[test]
    fn dates_are_those_of_the_calendar() {
        assert_eq!(date(0), "1970-01-01 00:00:00");
        assert_eq!(date(951_782_400), "2000-02-29 00:00:00");
        assert_eq!(date(1_772_366_399), "2026-03-01 11:59:59");
        assert_eq!(date(4_107_542_400), "2100-03-01 00:00:00");
    }
}
