//! `lookout evaluate recognition`.

use super::scene_run::SceneRun;
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::detect::read_cascade;
use crate::command::error::CommandError;
use clap::Args;
use messages::clock::process_cpu_ns;
use perception::image::GreyView;
use perception::recognition::{Detector, Sizes};
use sources::PairSource;
use sources::scene::Scene;
use std::path::PathBuf;
use tools::evaluation::running_time::{PictureTimes, RunningTime, RunningTimes};

pub const HELP: &str = "Examples:
  lookout evaluate recognition lbp.xml models/vehicle.xml
  lookout evaluate recognition lbp.xml --scene drive --frames 50 --json

Stereo and road process a scene. Each cascade, in turn, then searches each image three times: the
whole image, and the crops of its regions, both with windows of 30 to 90 px and a scale factor of
1.3; and the crops with the two window sizes that the region's distance suggests
(recognition.window_m, recognition.growth). Times are medians of the processor time per image. The
paper's table was measured on its own board.";

/// Measures the running time of cascades.
#[derive(Args, Debug)]
pub struct EvaluateRecognition {
    /// OpenCV cascade XML files
    #[arg(required = true, value_name = "CASCADE")]
    pub cascades: Vec<PathBuf>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Scene to search, named as in lookout replay scene:NAME
    #[arg(long, default_value = "street", value_name = "SCENE")]
    pub scene: String,
    /// Number of images
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub frames: u64,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Frames at the start that are not measured, until regions are confirmed.
const SETTLED: u64 = 20;

/// Processor time of a closure, in milliseconds.
fn ms(work: impl FnOnce()) -> f64 {
    let begin = process_cpu_ns();
    work();
    (process_cpu_ns() - begin) as f64 * 1e-6
}

pub fn run(args: &EvaluateRecognition, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "evaluate", Some("warn"))?;
    let scene = Scene::open(&args.scene)?;
    let (width, height) = scene.size();
    let mut cascades = Vec::new();
    for path in &args.cascades {
        let cascade = read_cascade(path)?;
        let detector = Detector::new(&cascade, width, height);
        cascades.push((path, cascade, detector, Vec::new()));
    }
    let mut run = SceneRun::new(&config, scene, SETTLED + args.frames)?;
    let baseline_m = run.rig.baseline_m;
    let bar = progress(Some(run.frames), "frames");
    let (mut pictures, mut regions) = (0, 0);
    let r = &config.recognition;
    let min_neighbours = u32::try_from(r.neighbours_min).unwrap_or(0);
    for index in 0..run.frames {
        let (_, frame) = run.frame(index)?;
        bar.inc(1);
        if index < SETTLED {
            continue;
        }
        let image = GreyView::new(frame.images.left, width, height, width)?;
        let crops: Vec<(GreyView<'_>, f64)> = frame
            .tracks
            .iter()
            .filter_map(|track| {
                let [x, y, width, height] = track.crop.map(|v| v as usize);
                let expected_px = r.window_m * track.disparity_px / baseline_m;
                Some((image.crop(x, y, width, height)?, expected_px))
            })
            .collect();
        pictures += 1;
        regions += crops.len();
        for (_, _, detector, times) in &mut cascades {
            let mut search = |view, sizes| {
                detector.detect(view, sizes, min_neighbours);
            };
            times.push(PictureTimes {
                sliding_ms: ms(|| search(image, Sizes::default())),
                regions_ms: ms(|| crops.iter().for_each(|(crop, _)| search(*crop, Sizes::default()))),
                expected_ms: ms(|| {
                    for (crop, width_px) in &crops {
                        search(*crop, Sizes::Around { width_px: *width_px, growth: r.growth });
                    }
                }),
            });
        }
    }
    bar.finish_and_clear();
    let rows = cascades.iter().map(|(path, cascade, _, times)| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        RunningTime::new(&name, &cascade.features, times)
    });
    let table = RunningTimes::new(pictures, regions, rows.collect());
    if args.json { say(serde_json::to_string_pretty(&table)?) } else { say(&table) }
}
