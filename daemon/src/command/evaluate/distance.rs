//! `lookout evaluate distance`.

use super::scene_run::{SceneRun, reported};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::stages::stereo::matcher::Method;
use clap::Args;
use perception::region::PixelBox;
use sources::PairSource;
use sources::scene::{ObjectTruth, Scene};
use std::path::{Path, PathBuf};
use tools::evaluation::approach::{
    Approach, ApproachFrame, DistanceReport, Shot, Silent, filmstrip, shown_frames,
};
use tools::evaluation::files::{prepare, write_report};
use tools::evaluation::scene_match::{Detection, is_match, match_frame};
use tools::reporting::overlay;
use tools::reporting::record::ObstacleLine;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate distance
  lookout evaluate distance bus cone --out results
  lookout evaluate distance 'cone?weather=night' --json
  lookout evaluate distance --set alarm.distance_m=15

A scene that starts with a named object in the vehicle's path, around a bend too, is an approach. Its
line gives the distance at the first detection, the frames without a detection after that, and the distance at the alarm; late
counts frames from the first in which the object was nearer than alarm.distance_m. A scene without
such an object is silent: any alarm in it is false. True positives, false regions (false) and
off-road false positives are defined in lookout evaluate weather --help.

--out writes SCENE.png for each approach, a filmstrip (at 30, 20, 10, 5 and 3 m, at the first
detection and at the alarm), and evaluation.json.";

#[derive(Args, Debug)]
pub struct EvaluateDistance {
    /// Scenes [default: the built-in approaches and silent scenes]
    #[arg(value_name = "SCENE")]
    pub scenes: Vec<String>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Folder for filmstrips and the tables
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Default scenes: approaches, then silent ones.
pub(super) const SCENES: [&str; 18] = [
    "bus",
    "car-body",
    "green-belt",
    "cone",
    "car-rear",
    "debris",
    "stopped-car",
    "crest",
    "dip",
    "slope",
    "bend",
    "roll",
    "overtaken",
    "next-lane",
    "bridge",
    "lamps",
    "wet",
    "textureless",
];

/// Further default scenes, in which the vehicle turns: an approach, then silent ones. Kept apart, as
/// `lookout evaluate time` plays the others in an order that its seed chooses.
const BENDS: [&str; 7] = [
    "bend-stopped",
    "bend-parked",
    "bend-parked-left",
    "bend-overtaking",
    "bend-overtaken",
    "bend-oncoming",
    "junction-parked",
];

/// Number of frames that are used of an endless scene.
const ENDLESS: u64 = 1000;

fn strip_file(scene: &str) -> PathBuf {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '-' };
    let name: String = scene.chars().map(plain).collect();
    format!("{}.png", name.trim_matches('-')).into()
}

pub fn run(args: &EvaluateDistance, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "evaluate", Some("warn"))?;
    let defaults = SCENES.into_iter().chain(BENDS).map(String::from);
    let names: Vec<String> = if args.scenes.is_empty() { defaults.collect() } else { args.scenes.clone() };
    let mut scenes = Vec::new();
    for name in &names {
        let mut scene = Scene::open(name)?;
        let target = scene.target();
        scenes.push((name, scene, target));
    }
    if let Some(out) = &args.out {
        let approaches = scenes.iter().filter(|(.., target)| target.is_some());
        prepare(out, &approaches.map(|(name, ..)| strip_file(name)).collect::<Vec<_>>())?;
    }
    let frames = |scene: &Scene| scene.count().unwrap_or(ENDLESS);
    let bar = progress(Some(scenes.iter().map(|(_, scene, _)| frames(scene)).sum()), "frames");
    let mut report =
        DistanceReport { method: Method::configured(&config).name().into(), ..DistanceReport::default() };
    for (name, scene, target) in scenes {
        bar.set_message(name.clone());
        let mut run = SceneRun::new(&config, scene, ENDLESS)?;
        match target {
            Some(id) => {
                let frames = approach_frames(&mut run, id, &bar)?;
                let preset_m = config.alarm.distance_m;
                report.approaches.push(Approach::new(name, &run.title, preset_m, &frames));
                if let Some(out) = &args.out {
                    // A second run for the pictures: the first one decided which frames to show.
                    let again = SceneRun::new(&config, Scene::open(name)?, run.frames)?;
                    save_strip(again, &frames, &out.join(strip_file(name)))?;
                }
            }
            None => report.silent.push(silent(name, &mut run, &bar)?),
        }
    }
    bar.finish_and_clear();
    if let Some(out) = &args.out {
        write_report(out, &report)?;
    }
    if args.json { say(serde_json::to_string_pretty(&report)?) } else { say(&report) }
}

fn approach_frames(
    run: &mut SceneRun,
    id: u16,
    bar: &indicatif::ProgressBar,
) -> Result<Vec<ApproachFrame>, CommandError> {
    let mut frames = Vec::new();
    for index in 0..run.frames {
        let (truth, result) = run.frame(index)?;
        let object = truth.objects.iter().find(|o| o.id == id);
        let by = |object| {
            // The nearest of several matches, as the alarm uses.
            reported(&result.record.obstacles)
                .filter(|found| is_match(object, found))
                .min_by(|a: &Detection, b| a.distance_m.total_cmp(&b.distance_m))
        };
        let level = result.record.alarm.level.as_str();
        let track = object.and_then(|object| tracked(object, &result.record.obstacles));
        frames.push(ApproachFrame {
            truth_m: object.map(|o| o.distance_m),
            found: object.and_then(by),
            ttc_truth_s: object.filter(|o| o.closing_m_s > 0.1).map(|o| o.along_m / o.closing_m_s),
            ttc_s: track.and_then(|t| t.time_to_collision_s.zip(t.time_to_collision_sigma_s)),
            warning: level == "warning" || level == "alarm",
            alarm: level == "alarm",
        });
        bar.inc(1);
    }
    Ok(frames)
}

/// The confirmed track that matches an object; the nearest of several.
fn tracked<'a>(object: &ObjectTruth, obstacles: &'a [ObstacleLine]) -> Option<&'a ObstacleLine> {
    let is_it = |o: &&ObstacleLine| {
        let bounds = PixelBox { x: o.x_px, y: o.y_px, width: o.width_px, height: o.height_px };
        o.confirmed
            && is_match(object, &Detection { bounds, distance_m: o.distance_m, sigma_m: o.distance_sigma_m })
    };
    obstacles.iter().filter(is_it).min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
}

fn save_strip(mut run: SceneRun, frames: &[ApproachFrame], file: &Path) -> Result<(), CommandError> {
    let shown = shown_frames(frames);
    let mut shots = Vec::new();
    for index in 0..=shown.last().copied().unwrap_or(0) {
        let (_, result) = run.frame(index as u64)?;
        if shown.contains(&index) {
            let truth = frames[index].truth_m.map_or("out of the picture".into(), |m| format!("{m:.1} m"));
            let what = match (frames[index].alarm, frames[index].found) {
                (true, _) => "alarm",
                (false, _) if frames[index].warning => "warning",
                (false, Some(_)) => "found",
                (false, None) => "not found",
            };
            shots.push(Shot {
                picture: overlay::draw_plain(result.images, &result.record),
                found: frames[index].found,
                caption: format!("{truth}: {what}"),
            });
        }
    }
    match filmstrip(&run.title, &shots) {
        Some(strip) => Ok(strip.save(file)?),
        None => Ok(()),
    }
}

fn silent(name: &str, run: &mut SceneRun, bar: &indicatif::ProgressBar) -> Result<Silent, CommandError> {
    let rig = run.rig;
    let mut row = Silent { scene: name.into(), title: run.title.clone(), ..Silent::default() };
    let mut before = false;
    for index in 0..run.frames {
        let (truth, result) = run.frame(index)?;
        let regions: Vec<Detection> = reported(&result.record.obstacles).collect();
        let matched = match_frame(&truth, rig.focal_px * rig.baseline_m, &regions);
        let alarm = result.record.alarm.level == "alarm";
        row.frames += 1;
        row.alarm_frames += usize::from(alarm);
        row.alarms += usize::from(alarm && !before);
        row.warning_frames += usize::from(result.record.alarm.level == "warning");
        row.off_frames += usize::from(result.record.alarm.level == "off");
        row.blind_frames += usize::from(!result.road_seen);
        row.false_regions += matched.false_positives.on_road;
        row.off_road_regions += matched.false_positives.off_road;
        before = alarm;
        bar.inc(1);
    }
    Ok(row)
}
