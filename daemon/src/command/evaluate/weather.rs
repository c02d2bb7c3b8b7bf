//! `lookout evaluate weather`.

use super::in_parallel::in_parallel;
use super::scene_run::{SceneRun, detection, reported};
use super::seed_range::seed_range;
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::stages::recognition::parameters::alarm_parameters;
use crate::stages::stereo::matcher::Method;
use clap::Args;
use clap::builder::PossibleValuesParser;
use config::Config;
use indicatif::ProgressBar;
use sources::PairSource;
use sources::scene::Scene;
use sources::scene::file::Weather;
use sources::scene::library;
use sources::scene::texture::hash;
use std::path::PathBuf;
use tools::evaluation::false_alarm::false_alarms;
use tools::evaluation::files::{prepare, write_report};
use tools::evaluation::scene_match::{Detection, match_frame};
use tools::evaluation::time_score::{FrameDuty, Undisturbed};
use tools::evaluation::weather::{ClassifiedTrack, FrameResult, PAPER, Tally, WeatherReport, WeatherRow};
use tools::reporting::overlay;
use tools::reporting::picture::Picture;
use tools::reporting::record::ObstacleLine;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate weather
  lookout evaluate weather --weather night,heavy_rain --json
  lookout evaluate weather crest-traffic dip-traffic --weather sunny --ablation
  lookout evaluate weather 'street?rig=kitti' my/road.toml --out results
  lookout evaluate weather random --seeds 100-129 --threads 2

Every frame is processed by the same stages as in the daemon, in one process. Its confirmed
obstacles are compared with the exact ground truth of the scene. The table has one line per scene and weather,
with the paper's accuracy beside it.

evaluable: objects named by the scene, 3 to 40 m away (debris to 20 m), at least half visible, in
both images, not cut by the left or right border. detected: share of these (true positives) with a
region that matches in place (box overlap of 0.25, or half of the object in a box up to six times
as large) and distance (within 1 m or 15 %). false/min: false regions within 40 m on the asphalt,
where nothing stands at their distance, each frame counted; tracks/min: confirmed tracks of such
regions; off-road/min: the same beside the asphalt. road cm: median and 95th percentile of the
road model's height error up to 40 m. covered: share of truths within two stated standard
deviations. Boxes: detected as above; strictly, where a box finds one object only; boxes for each
detected object; false boxes a minute on and off the road; for regions, and for confirmed tracks
that were detected in the frame; then the share of frames with an alarm that has no cause, and of the
free space: the share of the truly free ground, 5 to 40 m ahead, that is found, and how far it
reaches beyond the nearest thing, in metres, mean over the columns of the image.

--seeds sums the scenes of these seeds in one row: of each, 40 frames (--frames) from a place that
the seed decides, after 12 frames that are not evaluated. Results do not depend on --threads.

The objects that were missed most often are listed, twelve of each row (--json has all): scene, class,
frames in which they were missed and in which they were evaluable, and their place in the first of the
frames in which they were missed. Each alarm without a cause is listed: scene, first frame, what it
said when it was raised, the track.
--out writes SCENE-WEATHER.png (the frame with most evaluable objects), SCENE-WEATHER-false-alarms.png
(the frames in which they were raised, at most 20) and evaluation.json.";

#[derive(Args, Debug)]
pub struct EvaluateWeather {
    /// Scenes: names as in lookout replay scene:NAME, or TOML files
    #[arg(default_value = "street", value_name = "SCENE")]
    pub scenes: Vec<String>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Weather conditions, instead of the paper's six
    #[arg(long, value_name = "LIST", value_delimiter = ',',
        value_parser = PossibleValuesParser::new(Weather::ALL.map(Weather::name)))]
    pub weather: Vec<String>,
    /// Repeat with road.shape = "plane", a single plane instead of the road profile
    #[arg(long)]
    pub ablation: bool,
    /// Frames of each scene and weather at most [default: 200; with --seeds 40]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub frames: Option<u64>,
    /// Seeds of each scene, summed in one row: from and to, as 100-199
    #[arg(long, value_name = "A-B", value_parser = seed_range)]
    pub seeds: Option<(u64, u64)>,
    /// Scenes that are processed at the same time
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=64))]
    pub threads: u64,
    /// Folder for pictures and the tables
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Frames of each scene that are evaluated by default, alone and with `--seeds`.
const FRAMES: (u64, u64) = (200, 40);

/// Frames before those that are evaluated with `--seeds`, so that tracks are confirmed: a second.
const WARM_UP: u64 = 12;

/// Ends of the names of a row's pictures: the frame with most evaluable objects, and the frames in which false alarms were raised, one
/// below the other.
const BEST: &str = "";
const FALSE_ALARMS: &str = "-false-alarms";

/// Largest number of false alarms of a row that are drawn.
const MAX_DRAWN: usize = 20;

/// A scene in one weather: a row of the tables.
struct Condition {
    name: String,
    weather: Weather,
    /// `road.shape` to compare with `--ablation`; `None` for the configured one.
    road: Option<&'static str>,
}

impl Condition {
    fn picture(&self, of: &str) -> PathBuf {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '-' };
        let name: String = self.name.chars().map(plain).collect();
        let road = self.road.map_or(String::new(), |road| format!("-{road}"));
        format!("{}-{}{road}{of}.png", name.trim_matches('-'), self.weather.name()).into()
    }
}

/// One scene to process: a part of a row.
struct Job {
    /// Index of the row.
    row: usize,
    /// Text for [`library::load`], without the weather.
    scene: String,
    seed: Option<u64>,
}

/// Result of a job.
struct Part {
    tally: Tally,
    /// The frame with most evaluable objects.
    best: Option<(usize, Picture)>,
    /// Frames in which false alarms were raised.
    false_alarms: Vec<Picture>,
}

/// Every combination of scene, weather and, with `--ablation`, road shape; and the scenes to process for it.
fn conditions(args: &EvaluateWeather) -> Result<(Vec<Condition>, Vec<Job>), CommandError> {
    let names: Vec<&str> = match &args.weather[..] {
        [] => PAPER.iter().map(|(name, _)| *name).collect(),
        given => given.iter().map(String::as_str).collect(),
    };
    let (mut rows, mut jobs) = (Vec::new(), Vec::new());
    for name in &args.scenes {
        // Faults of the files are reported before anything runs.
        library::load(name)?;
        for weather in names.iter().filter_map(|name| Weather::named(name)) {
            let roads: &[_] = if args.ablation { &[Some("profile"), Some("plane")] } else { &[None] };
            for &road in roads {
                let row = rows.len();
                let (mut title, scene) = (name.clone(), name.clone());
                match args.seeds {
                    Some((from, to)) => {
                        title += &format!(" {from}-{to}");
                        let join = if name.contains('?') { '&' } else { '?' };
                        let of =
                            |seed| Job { row, scene: format!("{name}{join}seed={seed}"), seed: Some(seed) };
                        jobs.extend((from..=to).map(of));
                    }
                    None => jobs.push(Job { row, scene, seed: None }),
                }
                rows.push(Condition { name: title, weather, road });
            }
        }
    }
    Ok((rows, jobs))
}

/// The frames of a scene that are processed and those that are evaluated: with a seed from a place that the seed decides.
fn part_of(scene: &Scene, frames: u64, seed: Option<u64>) -> (std::ops::Range<u64>, u64) {
    let count = scene.count().unwrap_or(u64::MAX);
    let Some(seed) = seed else { return (0..count.min(frames), 0) };
    let whole = count.min(frames.saturating_add(WARM_UP));
    let start = if count == u64::MAX { 0 } else { hash(seed ^ 0xf3a3e5) % (count - whole + 1) };
    (start..start + whole, start + WARM_UP.min(whole.saturating_sub(1)))
}

/// Processes one scene.
fn process(
    job: &Job,
    row: &Condition,
    args: &EvaluateWeather,
    config: &Config,
    bar: &ProgressBar,
) -> Result<Part, CommandError> {
    let mut config = config.clone();
    if let Some(road) = row.road {
        road.clone_into(&mut config.road.shape);
    }
    let mut file = library::load(&job.scene)?;
    file.weather = row.weather;
    let scene = Scene::new(file)?;
    let frames = args.frames.unwrap_or(if job.seed.is_some() { FRAMES.1 } else { FRAMES.0 });
    let (processed, evaluated) = part_of(&scene, frames, job.seed);
    let mut run = SceneRun::new(&config, scene, u64::MAX)?;
    let rig = run.rig;
    let focal_baseline = rig.focal_px * rig.baseline_m;
    let mut tally = Tally::new(&row.name, row.weather.name(), rig, run.period_s);
    let rules = alarm_parameters(&config);
    let mut alarms = Undisturbed { period_s: run.period_s, ..Undisturbed::default() };
    // The frame with most evaluable objects, for the picture.
    let mut best: Option<(usize, Picture)> = None;
    // The frames in which the level rose to alarm.
    let (mut rises, mut pictures) = (Vec::new(), Vec::new());
    let first = processed.start;
    for index in processed {
        let (truth, result) = run.frame(index)?;
        bar.inc(1);
        alarms.duties.push(FrameDuty::of(&truth, &rules));
        let is_alarm = result.record.alarm.level == "alarm";
        alarms.alarms.push(is_alarm && index >= evaluated);
        if is_alarm && result.record.alarm.changed {
            rises.push((index, result.record.clone()));
            if args.out.is_some() {
                pictures.push((index, overlay::draw(result.images, &result.record)));
            }
        }
        if index < evaluated {
            continue;
        }
        let regions: Vec<Detection> = reported(&result.record.obstacles).collect();
        let matched = match_frame(&truth, focal_baseline, &regions);
        let tracks = tracks(&result.record.obstacles, &config.recognition.label);
        let is_false = |found: &Detection| {
            let alone = match_frame(&truth, focal_baseline, std::slice::from_ref(found));
            alone.false_positives.on_road > 0
        };
        // Predictions are no boxes that were measured.
        let detected = || tracks.iter().filter(|(o, _)| o.missed == 0);
        let false_tracks: Vec<u32> =
            detected().filter(|(_, t)| is_false(&t.found)).map(|(o, _)| o.track).collect();
        let boxes: Vec<Detection> = detected().map(|(_, t)| t.found).collect();
        let labelled: Vec<ClassifiedTrack> = tracks.iter().map(|(_, t)| *t).collect();
        tally.add_free_space(&truth.free, &result.record.free_space_m);
        tally.add(&FrameResult {
            scene: &job.scene,
            frame: index,
            matched: &matched,
            obstacles: &match_frame(&truth, focal_baseline, &boxes),
            false_tracks: &false_tracks,
            tracks: &labelled,
            profile_px: result.road_seen.then_some(result.images.profile_px),
            road: &truth.road,
        });
        let due = matched.evaluable.len();
        if args.out.is_some() && best.as_ref().is_none_or(|(most, _)| due > *most) {
            best = Some((due, overlay::draw(result.images, &result.record)));
        }
    }
    let names = (&job.scene[..], row.weather.name());
    let found = false_alarms(names, &alarms, rules.hold_ns as f64 * 1e-9, first, &rises);
    pictures.retain(|(rise, _)| found.iter().any(|alarm| alarm.rose == *rise));
    tally.add_false_alarms(found);
    Ok(Part { tally, best, false_alarms: pictures.into_iter().map(|(_, picture)| picture).collect() })
}

/// The confirmed tracks of a frame with their classes.
fn tracks<'a>(obstacles: &'a [ObstacleLine], vehicle: &str) -> Vec<(&'a ObstacleLine, ClassifiedTrack)> {
    let confirmed = obstacles.iter().filter(|o| o.confirmed);
    let track =
        |o: &'a ObstacleLine| (o, ClassifiedTrack { found: detection(o), is_vehicle: o.class == vehicle });
    confirmed.map(track).collect()
}

pub fn run(args: &EvaluateWeather, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "evaluate", Some("warn"))?;
    let (rows, jobs) = conditions(args)?;
    if let Some(out) = &args.out {
        let pictures = rows.iter().flat_map(|row| [BEST, FALSE_ALARMS].map(|of| row.picture(of)));
        prepare(out, &pictures.collect::<Vec<_>>())?;
    }
    let each = args.frames.unwrap_or(if args.seeds.is_some() { FRAMES.1 + WARM_UP } else { FRAMES.0 });
    let bar = progress(Some(jobs.len() as u64 * each), "frames");
    let parts = in_parallel(&jobs, args.threads, |job| {
        let row = &rows[job.row];
        bar.set_message(format!("{} {}", job.scene, row.weather.name()));
        process(job, row, args, &config, &bar)
    })?;
    bar.finish_and_clear();
    let mut merged: Vec<Option<Part>> = rows.iter().map(|_| None).collect();
    for (job, part) in jobs.iter().zip(parts) {
        match &mut merged[job.row] {
            Some(sum) => {
                sum.tally.merge(part.tally);
                let most = |best: &Option<(usize, Picture)>| best.as_ref().map_or(0, |(due, _)| *due);
                if most(&part.best) > most(&sum.best) {
                    sum.best = part.best;
                }
                sum.false_alarms.extend(part.false_alarms);
            }
            none => *none = Some(part),
        }
    }
    let mut report = WeatherReport { method: Method::configured(&config).name().into(), rows: Vec::new() };
    for (row, part) in rows.iter().zip(merged.into_iter().flatten()) {
        if let (Some(out), Some((_, picture))) = (&args.out, &part.best) {
            picture.save(&out.join(row.picture(BEST)))?;
        }
        let mut drawn = part.false_alarms.into_iter().take(MAX_DRAWN);
        if let (Some(out), Some(mut picture)) = (&args.out, drawn.next()) {
            drawn.for_each(|below| picture.append_below(&below));
            picture.save(&out.join(row.picture(FALSE_ALARMS)))?;
        }
        report.rows.push(WeatherRow { road: row.road.map(String::from), ..part.tally.row() });
    }
    if let Some(out) = &args.out {
        write_report(out, &report)?;
    }
    if args.json { say(serde_json::to_string_pretty(&report)?) } else { say(&report) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_part_of_a_scene_lies_within_it() {
        let scene = Scene::open("random?seed=3").expect("it is generated");
        let count = scene.count().expect("it ends");
        for seed in 1..50 {
            let (processed, evaluated) = part_of(&scene, 40, Some(seed));
            assert!(processed.end <= count && processed.end - processed.start == 52, "{processed:?}");
            assert_eq!(evaluated, processed.start + 12);
        }
        assert_eq!(part_of(&scene, 100_000, Some(1)), (0..count, 12));
        assert_eq!(part_of(&scene, 5, None), (0..5, 0));
    }
}
