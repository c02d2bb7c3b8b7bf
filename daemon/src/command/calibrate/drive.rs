//! `lookout calibrate --from-drive`: turns the right camera of a calibration by what a drive shows.

use super::arguments::Calibrate;
use super::today;
use crate::command::config_args::load;
use crate::command::console::{progress, say};
use crate::command::error::CommandError;
use crate::command::own_motion::set_recording;
use crate::input;
use crate::stages::stereo::matcher::{Backend, Method};
use config::automatic::Automatic;
use perception::calibration::RightTurn;
use serde::Serialize;
use sources::calibration_file::{self, Calibration};
use sources::rig_file::RigFile;
use std::path::{Path, PathBuf};
use tools::calibration::drive::{DriveOutcome, rectified_rig, run as calibrate};

/// Pairs of an endless source.
const MAX_ENDLESS: u64 = 600;
/// Standard errors up to which an angle counts as told, in degrees.
const MAX_ROWS_ERROR_DEG: f64 = 0.02;
const MAX_YAW_ERROR_DEG: f64 = 0.05;
/// Distance for which the effect of a turn is told, in metres.
const EXAMPLE_M: f64 = 30.0;

#[derive(Serialize)]
struct Angle {
    degrees: f64,
    error_degrees: f64,
}

#[derive(Serialize)]
struct Figures {
    pairs: u64,
    known_motion: usize,
    way_m: f64,
    passes: usize,
    settled: bool,
    pitch: Option<Angle>,
    yaw: Option<Angle>,
    roll: Option<Angle>,
    rows_before_px: f64,
    rows_after_px: f64,
    /// Error of a distance of 30 m that the yaw makes with the given calibration, in percent.
    distance_error_30_m_percent: Option<f64>,
    /// Factor on distances by the vehicle's speed.
    distance_factor: Option<f64>,
    distance_factor_error: Option<f64>,
    baseline_m: f64,
    rig: String,
}

pub fn run(args: &Calibrate, recording: &Path, log: Option<&str>) -> Result<(), CommandError> {
    let mut config = load(&args.config, log, "calibrate", Some("warn"))?;
    set_recording(&mut config, recording, None);
    config.source.rig = PathBuf::new();
    // As the cameras took them: this program rectifies, with a rig that changes from pass to pass.
    config.source.rectify = Automatic::Off;
    let mut source = input::open(&config).map_err(|error| CommandError::Other(error.to_string()))?;
    let size = source.size();
    let path = args.rig.clone().or_else(|| source.rig_file().map(Path::to_path_buf));
    let (given, name) = match &path {
        Some(path) => {
            let read = calibration_file::open_for(path, source.has_colour_cameras(), size)?;
            (cameras(read, size), path.display().to_string())
        }
        None => {
            let rig = source.rig().ok_or_else(|| {
                CommandError::Other(format!(
                    "{}: no calibration beside it: give the one to begin with by --rig FILE (lookout calibrate makes \
                     one, or that of the factory)",
                    recording.display()
                ))
            })?;
            (rectified_rig(&rig, size), recording.display().to_string())
        }
    };
    given.check_size(size).map_err(|reason| CommandError::Other(format!("{name}: {reason}")))?;
    let pairs = source.count().unwrap_or(MAX_ENDLESS).min(args.limit.unwrap_or(u64::MAX));
    let disparities = usize::try_from(config.stereo.disparities).unwrap_or_default();
    let matcher = Method::configured(&config).matcher(
        Backend::configured(&config),
        &config,
        size.0,
        size.1,
        disparities,
    );
    let mut matcher = matcher.map_err(|error| CommandError::Other(error.to_string()))?;
    let bar = progress(Some(pairs), "pairs");
    let outcome =
        calibrate(source.as_mut(), pairs, &given, &name, matcher.as_mut(), &mut |what, done, all| {
            bar.set_message(what.to_owned());
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        })
        .map_err(|error| CommandError::Other(format!("{}: {error}", recording.display())))?;
    bar.finish_and_clear();
    check(&outcome, recording)?;
    let mut rig = outcome.rig.clone();
    let now = today();
    rig.serial = args
        .serial
        .clone()
        .unwrap_or_else(|| if given.serial.is_empty() { format!("rig {now}") } else { given.serial.clone() });
    // The quality is that of a calibration with a board.
    (rig.date, rig.quality) = (now, None);
    rig.write(&args.out)?;
    let figures = figures(&outcome, pairs, &given, &args.out);
    if args.json { say(serde_json::to_string_pretty(&figures)?) } else { print(&figures) }
}

/// The cameras of a calibration; of a rectified pair, cameras without distortion.
fn cameras(read: Calibration, size: (usize, usize)) -> RigFile {
    match read {
        Calibration::Cameras(file) => *file,
        Calibration::Rectified { rig, .. } => rectified_rig(&rig, size),
    }
}

/// Refuses a result that is none; nothing is written then.
fn check(outcome: &DriveOutcome, recording: &Path) -> Result<(), CommandError> {
    let fail = |text: String| Err(CommandError::Other(format!("{}: {text}", recording.display())));
    let Some((_, error)) = outcome.last.rows else {
        return fail(
            "too few points for pitch and roll: a longer drive with texture and light is needed".into(),
        );
    };
    let error_deg = error.largest_rad().to_degrees();
    if error_deg > MAX_ROWS_ERROR_DEG {
        return fail(format!(
            "pitch and roll are uncertain by {error_deg:.3} degrees, above {MAX_ROWS_ERROR_DEG}: a longer drive is \
             needed; nothing is written"
        ));
    }
    if !outcome.is_settled {
        return fail(format!(
            "the angles did not settle in {} passes: are the pictures those of this calibration? nothing is written",
            outcome.passes
        ));
    }
    if let Some((_, error)) = outcome.last.yaw
        && error.to_degrees() > MAX_YAW_ERROR_DEG
    {
        return fail(format!(
            "yaw is uncertain by {:.3} degrees, above {MAX_YAW_ERROR_DEG}: a longer drive, past things near and far, is \
             needed; nothing is written",
            error.to_degrees()
        ));
    }
    Ok(())
}

fn figures(outcome: &DriveOutcome, pairs: u64, given: &RigFile, out: &Path) -> Figures {
    let (turn, last) = (&outcome.turn, &outcome.last);
    let angle =
        |rad: f64, error_rad: f64| Angle { degrees: rad.to_degrees(), error_degrees: error_rad.to_degrees() };
    let rig = &given.rectification.rig;
    let is_yaw_told = last.yaw.is_some();
    let example_px = rig.disparity_px(EXAMPLE_M);
    let too_large_px =
        RightTurn { yaw_rad: turn.yaw_rad, ..RightTurn::default() }.disparity_error_px(rig.cx_px, rig);
    Figures {
        pairs,
        known_motion: last.known,
        way_m: last.way_m,
        passes: outcome.passes,
        settled: outcome.is_settled,
        pitch: last.rows.map(|(_, error)| angle(turn.pitch_rad, error.pitch_rad)),
        yaw: last.yaw.map(|(_, error)| angle(turn.yaw_rad, error)),
        roll: last.rows.map(|(_, error)| angle(turn.roll_rad, error.roll_rad)),
        rows_before_px: outcome.rows_px[0],
        rows_after_px: outcome.rows_px[1],
        distance_error_30_m_percent: (is_yaw_told && example_px + too_large_px > 0.0)
            .then(|| 100.0 * (example_px / (example_px + too_large_px) - 1.0)),
        distance_factor: outcome.scale.map(|(factor, _)| factor),
        distance_factor_error: outcome.scale.map(|(_, error)| error),
        baseline_m: outcome.rig.rectification.rig.baseline_m,
        rig: out.display().to_string(),
    }
}

fn print(figures: &Figures) -> Result<(), CommandError> {
    let angle = |name: &str, turned: [&str; 2], angle: &Option<Angle>| match angle {
        Some(Angle { degrees, error_degrees }) => format!(
            "  {name:5} {:.3} +- {error_degrees:.3} degrees {}",
            degrees.abs(),
            turned[usize::from(*degrees < 0.0)]
        ),
        None => format!(
            "  {name:5} not told: the vehicle hardly moved, or its motion was not found; kept as it was"
        ),
    };
    say(format_args!(
        "{} pairs, {:.0} m with known motion ({} pairs); {} passes",
        figures.pairs, figures.way_m, figures.known_motion, figures.passes
    ))?;
    say("the right camera against the calibration:")?;
    say(angle("pitch", ["up", "down"], &figures.pitch))?;
    say(angle("yaw", ["to the right", "to the left"], &figures.yaw))?;
    say(angle("roll", ["clockwise", "counterclockwise"], &figures.roll))?;
    let distance = figures
        .distance_error_30_m_percent
        .map_or(String::new(), |percent| format!(", distances at {EXAMPLE_M:.0} m by {percent:+.1} %"));
    say(format_args!(
        "rows differed by {:.2} px{distance}; now by {:.2} px",
        figures.rows_before_px, figures.rows_after_px
    ))?;
    say(match (figures.distance_factor, figures.distance_factor_error) {
        (Some(factor), Some(error)) => format!(
            "by the vehicle's speed, distances are to be multiplied by {factor:.4} +- {error:.4}: a baseline of \
             {:.2} mm instead of {:.2} mm (not applied)",
            1e3 * figures.baseline_m * factor,
            1e3 * figures.baseline_m
        ),
        _ => "not told by a drive: baseline (no speed of the vehicle to compare with), lenses; kept as they were".into(),
    })?;
    say(format_args!("rig: {}", figures.rig))
}
