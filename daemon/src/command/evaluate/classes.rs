//! `lookout evaluate classes`.

use super::in_parallel::in_parallel;
use super::scene_run::{SceneRun, detection};
use super::seed_range::seed_range;
use crate::command::config_args::{ConfigArgs, load};
use crate::command::console::{progress, say};
use crate::command::error::CommandError;
use crate::stages::recognition::detectors::{RegionView, detectors};
use crate::stages::stage::SetupError;
use clap::Args;
use config::Config;
use messages::clock::process_cpu_ns;
use messages::track::TrackRecord;
use perception::image::GreyView;
use perception::recognition::network::sample::{Rectangle, Sampler};
use perception::region::PixelBox;
use sources::scene::{Scene, SceneTruth, library};
use std::path::{Path, PathBuf};
use tools::evaluation::classes::{ClassTally, Look, example_label, fit, region_label};
use tools::evaluation::scene_match::Detection;
use tools::reporting::picture::save_grey;
use tools::reporting::record::ObstacleLine;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate classes street
  lookout evaluate classes random --seeds 100-129 --threads 2
  lookout evaluate classes random --seeds 1-60 --calibrate calibrations

All stages process synthetic scenes. due: objects of the class that can be evaluated (as in lookout
evaluate weather), summed over frames; tracked: those with a confirmed obstacle; right: those whose
obstacle has the label. labels: confirmed obstacles with the label; wrong: those that match no such
object; parts: those of them that lie within the box of one, at its distance. looks: regions that
fit the detector's sizes, all of them, not only those that recognition.looks_max lets it see; found:
those where it finds something.

--calibrate DIR writes LABEL.calibration for each detector but networks, whose scores are
probabilities: what its scores say, by a logistic fit on all looks. Beside a model FILE as
FILE.calibration it is used. Report with other scenes than those that were fitted. Rendered scenes
are not the street: the probabilities hold for them.

--examples DIR writes what the road stage found, by its true class, for models/objects.py.";

/// Evaluates the classes of obstacles.
#[derive(Args, Debug)]
pub struct EvaluateClasses {
    /// Scenes: names as in lookout replay scene:NAME, or TOML files
    #[arg(default_value = "street", value_name = "SCENE")]
    pub scenes: Vec<String>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Frames of each scene at most
    #[arg(long, default_value_t = 100, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub frames: u64,
    /// Seeds of each scene: from and to, as 100-199
    #[arg(long, value_name = "A-B", value_parser = seed_range)]
    pub seeds: Option<(u64, u64)>,
    /// Scenes that are processed at the same time
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=64))]
    pub threads: u64,
    /// Folder for the calibrations of all detectors
    #[arg(long, value_name = "DIR")]
    pub calibrate: Option<PathBuf>,
    /// Folder for examples to train a network with: grey pictures of regions, a folder for each class
    #[arg(long, value_name = "DIR")]
    pub examples: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Frames before those that are evaluated, so that tracks are confirmed: a second.
const WARM_UP: u64 = 12;

/// Frames from one example of a track to the next: neighbours look alike.
const EXAMPLE_FRAMES: u64 = 6;

/// Side of an example, in pixels, and its margin on each side of the region, as a share of the region's.
const EXAMPLE_PX: usize = 64;
const EXAMPLE_MARGIN: f32 = 0.25;

/// Writes the pictures of the regions of a frame whose class is clear.
fn write_examples(
    folder: &Path,
    name: &str,
    truth: &SceneTruth,
    image: GreyView<'_>,
    tracks: &[TrackRecord],
) -> Result<(), CommandError> {
    let mut sampler = Sampler::new(image.width(), image.height());
    let mut levels = [0.0; EXAMPLE_PX * EXAMPLE_PX];
    for track in tracks.iter().filter(|track| track.missed == 0) {
        let Some(label) = example_label(truth, &region(track)) else { continue };
        let [x, y, width, height] = track.bounds.map(|v| v as f32);
        let from = Rectangle { x, y, width, height }.grown(EXAMPLE_MARGIN);
        sampler.sample(image, from, (EXAMPLE_PX, EXAMPLE_PX), &mut levels);
        let grey = levels.map(|level| level.round() as u8);
        let folder = folder.join(label);
        std::fs::create_dir_all(&folder)
            .map_err(|e| CommandError::Other(format!("{}: {e}", folder.display())))?;
        save_grey(&folder.join(format!("{name}-{}.png", track.track)), &grey, EXAMPLE_PX, EXAMPLE_PX)?;
    }
    Ok(())
}

/// A track as a detection.
fn region(track: &TrackRecord) -> Detection {
    let [x, y, width, height] = track.bounds;
    Detection {
        bounds: PixelBox { x, y, width, height },
        distance_m: track.distance_m,
        sigma_m: track.distance_sigma_m,
    }
}

/// Processes one scene.
fn process(scene: &str, args: &EvaluateClasses, config: &Config) -> Result<ClassTally, CommandError> {
    let name = scene.replace(|c: char| !c.is_ascii_alphanumeric(), "-");
    let scene = Scene::new(library::load(scene)?)?;
    let mut run = SceneRun::new(config, scene, WARM_UP + args.frames)?;
    let (mut tally, mut known) = (None::<ClassTally>, Vec::new());
    for index in 0..run.frames {
        let baseline_m = run.rig.baseline_m;
        let (truth, result) = run.frame(index)?;
        let (width, height) = (result.images.width, result.images.height);
        if tally.is_none() {
            known = detectors(config, width, height).map_err(SetupError::from)?;
            tally = Some(ClassTally::new(known.iter().flat_map(|d| d.labels.iter().map(|label| &label[..]))));
        }
        let Some(tally) = tally.as_mut().filter(|_| index >= WARM_UP) else { continue };
        let image = GreyView::new(result.images.left, width, height, width)?;
        if let Some(folder) = args.examples.as_deref().filter(|_| index % EXAMPLE_FRAMES == 0) {
            write_examples(folder, &format!("{name}-{index}"), &truth, image, &result.tracks)?;
        }
        for track in result.tracks.iter().filter(|track| track.confirmed == 1 && track.missed == 0) {
            let [x, y, crop_width, crop_height] = track.crop.map(|v| v as usize);
            let Some(crop) = image.crop(x, y, crop_width, crop_height) else { continue };
            let view = RegionView::new(track, crop, baseline_m);
            let label = region_label(&truth, &region(track));
            let mut row = 0;
            for detector in &mut known {
                let first = row;
                row += detector.labels.len();
                if !detector.sizes.fit(track.width_m, track.height_m) {
                    continue;
                }
                let begin = process_cpu_ns();
                let found = detector.look(&view);
                let ms = (process_cpu_ns() - begin) as f64 * 1e-6;
                for (i, (own, found)) in detector.labels.iter().zip(found).enumerate() {
                    // A network says something of each region.
                    let found = found.filter(|f| !detector.is_network() || f.score > 0.0);
                    tally.add_look(first + i, Look { found, is_class: label == own }, ms);
                }
            }
        }
        let confirmed = result.record.obstacles.iter().filter(|o| o.confirmed);
        let confirmed: Vec<(&ObstacleLine, Detection)> = confirmed.map(|o| (o, detection(o))).collect();
        tally.add_frame(&truth, &confirmed);
    }
    Ok(tally.unwrap_or_default())
}

pub fn run(args: &EvaluateClasses, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "evaluate", Some("warn"))?;
    let mut scenes = Vec::new();
    for name in &args.scenes {
        // Faults of the files are reported before anything runs.
        library::load(name)?;
        let join = if name.contains('?') { '&' } else { '?' };
        match args.seeds {
            Some((from, to)) => scenes.extend((from..=to).map(|seed| format!("{name}{join}seed={seed}"))),
            None => scenes.push(name.clone()),
        }
    }
    let bar = progress(Some(scenes.len() as u64), "scenes");
    let parts = in_parallel(&scenes, args.threads, |scene| {
        let part = process(scene, args, &config);
        bar.inc(1);
        part
    })?;
    bar.finish_and_clear();
    let mut parts = parts.into_iter();
    let mut tally = parts.next().unwrap_or_default();
    parts.for_each(|part| tally.merge(part));
    if let Some(folder) = &args.calibrate {
        let failed = |e: std::io::Error| CommandError::Other(format!("{}: {e}", folder.display()));
        std::fs::create_dir_all(folder).map_err(failed)?;
        let known = detectors(&config, 8, 8).map_err(SetupError::from)?;
        let labels: Vec<(bool, &String)> =
            known.iter().flat_map(|d| d.labels.iter().map(|label| (d.is_network(), label))).collect();
        for (i, (is_network, label)) in labels.into_iter().enumerate() {
            if is_network {
                continue;
            }
            let looks = tally.looks(i);
            let Some(calibration) = fit(looks) else {
                let text =
                    format!("{label}: {} looks, not at both kinds of regions: give more scenes", looks.len());
                return Err(CommandError::Other(text));
            };
            let seeds = args.seeds.map_or(String::new(), |(from, to)| format!(" --seeds {from}-{to}"));
            let scenes = args.scenes.join(" ");
            let text = format!(
                "# lookout evaluate classes {scenes}{seeds} --frames {} --calibrate: {} looks.\n{calibration}",
                args.frames,
                looks.len()
            );
            std::fs::write(folder.join(format!("{label}.calibration")), text).map_err(failed)?;
        }
    }
    let report = tally.report();
    if args.json { say(serde_json::to_string_pretty(&report)?) } else { say(&report) }
}
