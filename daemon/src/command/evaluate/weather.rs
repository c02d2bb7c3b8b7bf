//! `lookout evaluate weather`.

use super::scene_run::{SceneRun, detection, reported};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::stages::stereo::matcher::Method;
use clap::Args;
use clap::builder::PossibleValuesParser;
use sources::scene::Scene;
use sources::scene::file::Weather;
use sources::scene::library;
use std::path::PathBuf;
use tools::evaluation::files::{prepare, write_report};
use tools::evaluation::scene_match::{Detection, match_frame};
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
deviations.

--out writes SCENE-WEATHER.png (the frame with most evaluable objects) and evaluation.json.";

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
    /// Maximum number of frames of each scene and weather
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub frames: u64,
    /// Folder for pictures and the tables
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// A scene in one weather.
struct Condition {
    name: String,
    weather: Weather,
    scene: Scene,
    /// `road.shape` to compare with `--ablation`; `None` for the configured one.
    road: Option<&'static str>,
}

impl Condition {
    fn picture(&self) -> PathBuf {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '-' };
        let name: String = self.name.chars().map(plain).collect();
        let road = self.road.map_or(String::new(), |road| format!("-{road}"));
        format!("{}-{}{road}.png", name.trim_matches('-'), self.weather.name()).into()
    }
}

/// Every combination of scene, weather and, with `--ablation`, road shape.
fn conditions(args: &EvaluateWeather) -> Result<Vec<Condition>, CommandError> {
    let names: Vec<&str> = match &args.weather[..] {
        [] => PAPER.iter().map(|(name, _)| *name).collect(),
        given => given.iter().map(String::as_str).collect(),
    };
    let mut all = Vec::new();
    for name in &args.scenes {
        for weather in names.iter().filter_map(|name| Weather::named(name)) {
            let roads: &[_] = if args.ablation { &[Some("profile"), Some("plane")] } else { &[None] };
            for &road in roads {
                let mut file = library::load(name)?;
                file.weather = weather;
                all.push(Condition { name: name.clone(), weather, scene: Scene::new(file)?, road });
            }
        }
    }
    Ok(all)
}

pub fn run(args: &EvaluateWeather, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "evaluate", Some("warn"))?;
    let conditions = conditions(args)?;
    if let Some(out) = &args.out {
        prepare(out, &conditions.iter().map(Condition::picture).collect::<Vec<_>>())?;
    }
    let bar = progress(Some(conditions.len() as u64 * args.frames), "frames");
    let mut report = WeatherReport { method: Method::configured(&config).name().into(), rows: Vec::new() };
    for condition in conditions {
        let picture_file = condition.picture();
        let (name, weather) = (condition.name, condition.weather.name());
        bar.set_message(format!("{name} {weather}"));
        let mut config = config.clone();
        if let Some(road) = condition.road {
            road.clone_into(&mut config.road.shape);
        }
        let mut run = SceneRun::new(&config, condition.scene, args.frames)?;
        let (rig, frames) = (run.rig, run.frames);
        let mut tally = Tally::new(&name, weather, rig, run.period_s);
        // The frame with most evaluable objects, for the picture.
        let mut best: Option<(usize, Picture)> = None;
        for index in 0..frames {
            let (truth, result) = run.frame(index)?;
            let regions: Vec<Detection> = reported(&result.record.obstacles).collect();
            let matched = match_frame(&truth, rig.focal_px * rig.baseline_m, &regions);
            let tracks: Vec<(&ObstacleLine, ClassifiedTrack)> = result
                .record
                .obstacles
                .iter()
                .filter(|o| o.confirmed)
                .map(|o| {
                    let is_vehicle = o.class == config.recognition.label;
                    (o, ClassifiedTrack { found: detection(o), is_vehicle })
                })
                .collect();
            let is_false = |found: &Detection| {
                match_frame(&truth, rig.focal_px * rig.baseline_m, std::slice::from_ref(found))
                    .false_positives
                    .on_road
                    > 0
            };
            // A track that was not detected in this frame has no region to compare.
            let false_tracks: Vec<u32> = tracks
                .iter()
                .filter(|(o, t)| o.missed == 0 && is_false(&t.found))
                .map(|(o, _)| o.track)
                .collect();
            let labelled: Vec<ClassifiedTrack> = tracks.iter().map(|(_, t)| *t).collect();
            tally.add(&FrameResult {
                matched: &matched,
                false_tracks: &false_tracks,
                tracks: &labelled,
                profile_px: result.road_seen.then_some(result.images.profile_px),
                road: &truth.road,
            });
            let due = matched.evaluable.len();
            if args.out.is_some() && best.as_ref().is_none_or(|(most, _)| due > *most) {
                best = Some((due, overlay::draw(result.images, &result.record)));
            }
            bar.inc(1);
        }
        if let (Some(out), Some((_, picture))) = (&args.out, &best) {
            picture.save(&out.join(&picture_file))?;
        }
        bar.inc(args.frames - frames);
        report.rows.push(WeatherRow { road: condition.road.map(String::from), ..tally.row() });
    }
    bar.finish_and_clear();
    if let Some(out) = &args.out {
        write_report(out, &report)?;
    }
    if args.json { say(serde_json::to_string_pretty(&report)?) } else { say(&report) }
}
