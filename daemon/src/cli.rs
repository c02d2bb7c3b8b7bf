//! The command line. Its words are stable.

use crate::stages::stereo::matcher::{Backend, Method};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use sources::scene::file::Weather;
use std::path::PathBuf;
use tools::evaluation::disturb::Disturbance;

/// Watches the road ahead of a vehicle with two cameras.
///
/// An aid, no safety element: it actuates nothing.
#[derive(Debug, Parser)]
#[command(
    name = "lookout",
    version,
    max_term_width = 100,
    after_help = "Examples:
  lookout demo                                    see it work, no hardware needed
  lookout replay RECORDING --out results          recorded pairs through the daemon
  lookout disparity left.png right.png -o d.png   one pair, dense disparity
  lookout evaluate stereo KITTI                   its errors against ground truth
  lookout evaluate weather                        obstacles found in six weathers
  lookout calibrate PICTURES --board 9x6 --square-mm 25 -o rig.toml
  lookout train --positives DIR --negatives DIR -o CASCADE.xml
  lookout status --watch                          what the running daemon is doing
  lookout view                                    the same in a browser, with pictures
  lookout record -o drive.mcap                    record it

Exit code: 0 on success, 2 for bad usage, 1 for everything else."
)]
pub struct Cli {
    /// Least severe message logged: error, warn, info, debug, trace [default: log.level of the
    /// configuration; warn for demo and replay]
    #[arg(long, global = true, value_name = "LEVEL", value_parser = ["error", "warn", "info", "debug", "trace"])]
    pub log: Option<String>,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// The whole daemon on a built-in synthetic drive: live table, pictures, plots, summary
    #[command(after_help = "Examples:
  lookout demo
  lookout demo --seconds 30 --out /tmp/demo")]
    Demo(Demo),
    /// The daemon in the foreground: what systemd starts
    #[command(after_help = "Examples:
  lookout run -c /etc/lookout/car.toml
  lookout run -c tk1

Stop it with SIGTERM or Ctrl-C: frames in flight come out first. SIGHUP reads the configuration
again; what may change then, and what it tells systemd, is in docs/operations.md.")]
    Run(Run),
    /// The daemon on recorded pairs, or on a synthetic scene
    #[command(after_help = "Examples:
  lookout replay ../shared/data/kitti_sequence_1 --lockstep --out results
  lookout replay RECORDING --fps 12.5 --loop --limit 1000
  lookout replay RECORDING --in-process --out reference
  lookout replay drive.mcap --lockstep --out again
  lookout replay RECORDING --lockstep --record drive.mcap
  lookout replay scene:street --out results
  lookout replay 'scene:street?weather=night&seed=7' --lockstep --out night
  lookout replay scene:my/road.toml

PATH holds two folders with images of the same names: image_2 and image_3, image_0 and image_1,
image_l and image_r, left and right, image_02/data and image_03/data, or image_00/data and
image_01/data. The calibration is taken from rig.toml, calib.txt or calib/NAME.txt beside them.

PATH may also be an MCAP file: a recording of lookout record, or a ROS 2 bag with two image topics
whose names differ by left and right, and their camera_info. One that was cut off is read up to its
last whole chunk.

scene:NAME is a synthetic scene with its own rig: one that ships (drive, street, crest, dip, slope,
bend, roll, overtaken, bridge, lamps, wet, textureless, bus, car-body, car-rear, green-belt, cone,
debris, crest-traffic, dip-traffic), or a TOML file (docs/scenes.md). Settings may follow:
?weather=sunny, light_rain, heavy_rain, night, snow, backlight or overcast; seed=N; rig=paper or kitti.

--out writes overlay/NNNNNN.png, disparity/NNNNNN.png (16 bit, disparity x 256), obstacles.jsonl
(a line per frame) and summary.json.")]
    Replay(Replay),
    /// What a running daemon is doing
    #[command(after_help = "Examples:
  lookout status
  lookout status --watch
  lookout status --json")]
    Status(Status),
    /// A running daemon in a browser: pictures, bird's-eye view, figures over time
    #[command(after_help = crate::cli_view::VIEW_HELP)]
    View(crate::cli_view::View),
    /// One pair to a cloud of points
    #[command(after_help = crate::cli_view::POINT_CLOUD_HELP)]
    PointCloud(crate::cli_view::PointCloudCommand),
    /// Records a running daemon to MCAP, for replays, Foxglove and Lichtblick
    #[command(after_help = crate::cli_record::RECORD_HELP)]
    Record(crate::cli_record::Record),
    /// Two runs of the same frames: which differ, and by how much
    #[command(after_help = crate::cli_record::COMPARE_HELP)]
    Compare(crate::cli_record::Compare),
    /// Dense disparity of one pair
    #[command(after_help = "Examples:
  lookout disparity left.png right.png -o disparity.png
  lookout disparity left.png right.png -o d.png --max-disparity 64 --color d-color.png
  lookout disparity left.png right.png -o d.png --method full
  lookout disparity left.png right.png -o d.png --budget-ms 5
  lookout disparity left.png right.png -o d.png --repeat 10 --json")]
    Disparity(Disparity),
    /// One pair through road and recognition
    #[command(after_help = "Examples:
  lookout obstacles left.png right.png --rig calib.txt --overlay found.png
  lookout obstacles left.png right.png --rig rig.toml --json

A rig is a KITTI calib.txt, or a TOML file with focal_px, baseline_m, cx_px and cy_px.")]
    Obstacles(Obstacles),
    /// Pictures of a chessboard to a rig file, with a verdict
    #[command(after_help = crate::cli_rig::CALIBRATE_HELP)]
    Calibrate(crate::cli_rig::Calibrate),
    /// One pair rectified: see a rig at work
    #[command(after_help = "Example:
  lookout rectify rig.toml left.png right.png -o seen

Writes left.png, right.png and lines.png: both pictures before (above) and after, with lines across.")]
    Rectify(crate::cli_rig::Rectify),
    /// Shows a calibration, or turns it into another program's format
    #[command(after_help = "Examples:
  lookout rig rig.toml
  lookout rig rig.toml --format ros -o left.yaml       writes left.yaml and right.yaml
  lookout rig extrinsics.yml intrinsics.yml --size 640x480 --format toml -o rig.toml")]
    Rig(crate::cli_rig::RigCommand),
    /// Objects in pictures, by a cascade
    #[command(after_help = "Examples:
  lookout detect haarcascade_frontalface_default.xml people.jpg
  lookout detect vehicle.xml road.png --growth 1.3 --min-px 30 --max-px 90 --json
  lookout detect cascade.xml a.png b.png --neighbours 0     every window that passes
  lookout detect vehicle.xml road.png --overlay found.png

CASCADE is an OpenCV cascade XML, boosted LBP or Haar, of the current or the older format. The
boxes are those of OpenCV's detectMultiScale with the same image and options; so are the defaults.")]
    Detect(crate::cli_cascade::Detect),
    /// Trains a cascade
    #[command(after_help = "Examples:
  lookout train --positives vehicles --negatives others -o vehicle.xml
  lookout train --positives vehicles --negatives others -o v.xml --report out/training --threads 4
  lookout train --positives vehicles --negatives others -o v.xml --features haar --window 24x20
  lookout train --positives vehicles --negatives others -o v.xml --sweep

Each picture of --positives holds one object that fills it; those of --negatives hold none and may
have any size from the window's on: windows are cut out of them. Of every folder below, the last
part judges and is not learned from (--validation): keep pictures of one drive in one folder, in
order. The same pictures and options give the same cascade, on any number of threads.

A run that is stopped goes on where it was when it is started again; its stages are kept in
CASCADE.part. The cascade is OpenCV's XML.")]
    Train(Box<crate::cli_cascade::Train>),
    /// Tables against ground truth: recorded data sets, and synthetic scenes
    #[command(after_help = "Examples:
  lookout evaluate stereo ../shared/data/kitti2015
  lookout evaluate stereo KITTI MIDDLEBURY --out results --json
  lookout evaluate detection vehicle.xml --positives vehicles --negatives others
  lookout evaluate weather                       synthetic scenes, six weathers
  lookout evaluate distance                      approaches, and scenes without danger
  lookout evaluate lidar DIR                     real pictures with LiDAR depth and labels
  lookout evaluate stereo --help")]
    Evaluate {
        /// What is evaluated.
        #[command(subcommand)]
        what: Evaluate,
    },
    /// The board's qualification: rates, latencies, memory, processor time and faults survived, judged
    #[command(after_help = crate::cli_soak::HELP)]
    Soak(crate::cli_soak::Soak),
    /// Every error of a configuration with line and remedy; the effective configuration
    #[command(after_help = "Examples:
  lookout check-config car.toml
  lookout check-config rpi5
  lookout check-config --reference > docs/configuration.md")]
    CheckConfig(CheckConfig),
    /// Puts the board's clocks back as they were before a daemon that was killed had set them
    #[command(after_help = crate::cli_board::RESTORE_CLOCKS_HELP)]
    RestoreClocks(crate::cli_board::RestoreClocks),
    /// Words of the command line for a shell
    #[command(after_help = crate::cli_board::COMPLETIONS_HELP)]
    Completions(crate::cli_board::Completions),
    /// Manual pages; for packages
    #[command(hide = true)]
    Man(crate::cli_board::Man),
    /// A stage process; started by the scheduler
    #[command(hide = true)]
    Stage {
        /// Which.
        role: String,
    },
}

/// Which configuration.
#[derive(Args, Debug, Clone)]
pub struct ConfigArgs {
    /// Configuration file, or one of the profiles replay, tk1, orin-nano, rpi5
    #[arg(short, long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Sets one key of the configuration, as in stereo.lambda_vertical=8; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Name of this daemon among those on the machine [default: instance.name]
    #[arg(long, value_name = "NAME")]
    pub instance: Option<String>,
}

#[derive(Args, Debug)]
pub struct Demo {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Seconds to drive
    #[arg(long, default_value_t = 10.0, value_name = "N", value_parser = seconds)]
    pub seconds: f64,
    /// Folder for pictures, plots and the summary
    #[arg(long, default_value = "out/demo", value_name = "DIR")]
    pub out: PathBuf,
}

#[derive(Args, Debug)]
pub struct Run {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Ends when the process that started it does
    #[arg(long, hide = true)]
    pub with_parent: bool,
}

#[derive(Args, Debug)]
pub struct Replay {
    /// Folder or MCAP file of the recording, or scene:NAME
    pub path: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Pairs per second [default: the recording's own rate]
    #[arg(long, value_name = "N", value_parser = fps, conflicts_with = "lockstep")]
    pub fps: Option<f64>,
    /// Every frame, one at a time: the same result every time
    #[arg(long)]
    pub lockstep: bool,
    /// Start again at the end
    #[arg(long = "loop", requires = "limit")]
    pub repeat: bool,
    /// Stop after this many pairs
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub limit: Option<u64>,
    /// Rig TOML or KITTI calib.txt [default: the calibration beside the recording]
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Folder for overlays, disparity maps, obstacles.jsonl and summary.json
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Also records the run to an MCAP file; with --lockstep without loss
    #[arg(long, value_name = "FILE.mcap", conflicts_with = "in_process")]
    pub record: Option<PathBuf>,
    /// The same algorithms in this process, without shared memory
    #[arg(long, conflicts_with_all = ["fps", "lockstep", "instance"])]
    pub in_process: bool,
    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Debug)]
pub struct Status {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Show it every second until Ctrl-C, or until the daemon ends: a screen of its own on a terminal,
    /// a line each time elsewhere
    #[arg(long)]
    pub watch: bool,
    /// Print as JSON, one document (with --watch: one a line)
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Debug)]
pub struct Disparity {
    /// Left image (PNG, PGM, PPM; colour is turned to grey)
    pub left: PathBuf,
    /// Right image, rectified like the left
    pub right: PathBuf,
    /// 16-bit PNG, disparity x 256, 0 = unknown
    #[arg(short, long, value_name = "OUT.png")]
    pub out: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// How many disparities are searched, from 0 px on [default: stereo.disparities]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=255))]
    pub max_disparity: Option<u16>,
    /// Milliseconds after which the finest scale reached is given [default: stereo.budget_ms]
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    pub budget_ms: Option<f64>,
    /// Matcher [default: stereo.method]
    #[arg(long, value_enum)]
    pub method: Option<Method>,
    /// What matches [default: stereo.backend]
    #[arg(long, value_enum)]
    pub backend: Option<Backend>,
    /// Times the matcher alone this often
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub repeat: u32,
    /// Also writes the map in colour
    #[arg(long, value_name = "FILE")]
    pub color: Option<PathBuf>,
    /// Print figures as JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Debug)]
pub struct Obstacles {
    /// Left image
    pub left: PathBuf,
    /// Right image, rectified like the left
    pub right: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Rig TOML or KITTI calib.txt [default: source.rig]
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Writes the left image with what was found
    #[arg(long, value_name = "FILE")]
    pub overlay: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Subcommand)]
pub enum Evaluate {
    /// Disparity maps, scored as the KITTI devkit does
    #[command(after_help = "Examples:
  lookout evaluate stereo ../shared/data/kitti2015
  lookout evaluate stereo KITTI --pairs odd        choose parameters on these, report --pairs even
  lookout evaluate stereo KITTI --out results      error pictures, maps, plots
  lookout evaluate stereo KITTI --maps results     score maps instead of matching
  lookout evaluate stereo KITTI --disturb noise --save-pairs noisy

DIR and what lies below it is searched for KITTI 2012 (image_0, image_1, disp_noc, disp_occ),
KITTI 2015 (image_2, image_3, disp_noc_0, disp_occ_0), KITTI depth (left, right, gt_depth_map,
calib) and Middlebury scenes (a folder each, such as im0.png, im1.png, disp0GT.pfm).

A line for each image and region: all pixels with truth, and noc, those that the right camera sees
too. In percent: dens, pixels with an estimate; bad1, bad2, bad3, errors above 1, 2, 3 px; D1,
above 3 px and 5 % of the truth; all of them and epe, the mean error in px, after holes are filled
with the background of their row as KITTI does; hole3, a hole counts as wrong; val3, holes are
left out. ms is processor time. mean is that of the images' figures.

--out writes SET/errors/PAIR.png (blue is right, yellow to red is wrong by the rule of D1, occluded
pixels darker), SET/disparity/PAIR.png (16 bit, disparity x 256), SET/colour/PAIR.png, subpixel.png,
roc.png and evaluation.json. --save-pairs writes image_2, image_3, disp_noc_0 and disp_occ_0; with
several sets, below a folder for each.")]
    Stereo(EvaluateStereo),
    /// Obstacles, distances and the road in synthetic scenes, by weather
    #[command(after_help = "Examples:
  lookout evaluate weather
  lookout evaluate weather --weather night,heavy_rain --json
  lookout evaluate weather crest-traffic dip-traffic --weather sunny --ablation
  lookout evaluate weather 'street?rig=kitti' my/road.toml --out results

Every frame goes through the same rooms as in the daemon, in one process; its regions are compared
with the exact truth of the scene. A line for each scene and weather, the paper's accuracy beside it.

due: objects that the scene names, 3 to 40 m away (debris to 20 m), at least half of them visible, in
both images, not cut by the left or right border. detected: share of these with a region at their
place (box overlap of 0.25, or half of the object in a box up to six times as large) and distance
(within 1 m or 15 %). false/min: regions within 40 m on the asphalt where nothing stands at their
distance, each frame counted; tracks/min: confirmed tracks of such; stray/min: the same beside the
asphalt. road cm: median and 95 % of the road model's height error up to 40 m. covered: share of
truths within two stated standard deviations.

--out writes SCENE-WEATHER.png (the frame with most objects due) and evaluation.json.")]
    Weather(EvaluateWeather),
    /// Approaches to single obstacles, and scenes that must stay silent
    #[command(after_help = "Examples:
  lookout evaluate distance
  lookout evaluate distance bus cone --out results
  lookout evaluate distance 'cone?weather=night' --json
  lookout evaluate distance --set alarm.distance_m=15

A scene with an object in the vehicle's path is an approach: where the object was first found, frames
in which it was missed after that, and where it was when the alarm came; late counts frames from the
first in which it was nearer than alarm.distance_m. A scene without one is silent: an alarm there is
false. What counts as found, false and stray is told by lookout evaluate weather --help.

--out writes SCENE.png for each approach, a filmstrip (at 30, 20, 10, 5 and 3 m, at the first find and at
the alarm), and evaluation.json.")]
    Distance(EvaluateDistance),
    /// Road, regions and labelled cars of real pictures, against LiDAR depth
    #[command(after_help = crate::cli_lidar::HELP)]
    Lidar(crate::cli_lidar::EvaluateLidar),
    /// A cascade on patches with and without objects
    #[command(after_help = "Examples:
  lookout evaluate detection vehicle.xml --positives vehicles --negatives others
  lookout evaluate detection vehicle.xml --positives vehicles --negatives others --roc roc.png --json

Every picture in and below the folders is brought to the size of the cascade's window, each pixel
the mean of what it covers, and classified. Use pictures that the cascade was not trained on. The
ROC is that of moving all stages' thresholds together.")]
    Detection(crate::cli_cascade::EvaluateDetection),
    /// Running time of cascades: whole pictures and regions, beside the paper's
    #[command(after_help = crate::cli_cascade::RECOGNITION_HELP)]
    Recognition(crate::cli_cascade::EvaluateRecognition),
}

#[derive(Args, Debug)]
pub struct EvaluateWeather {
    /// Scenes: names as in lookout replay scene:NAME, or TOML files
    #[arg(default_value = "street", value_name = "SCENE")]
    pub scenes: Vec<String>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Weathers, in place of the paper's six
    #[arg(long, value_name = "LIST", value_delimiter = ',',
        value_parser = PossibleValuesParser::new(Weather::ALL.map(Weather::name)))]
    pub weather: Vec<String>,
    /// Once more with road.shape = "plane": a single plane in place of the road profile
    #[arg(long)]
    pub ablation: bool,
    /// Frames of each scene and weather, at most
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub frames: u64,
    /// Folder for pictures and the tables
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Debug)]
pub struct EvaluateDistance {
    /// Scenes [default: the approaches and the silent scenes that ship]
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

#[derive(Args, Debug)]
pub struct EvaluateStereo {
    /// Data sets with ground truth
    #[arg(required = true, value_name = "DIR")]
    pub sets: Vec<PathBuf>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Matcher [default: stereo.method]
    #[arg(long, value_enum, conflicts_with = "maps")]
    pub method: Option<Method>,
    /// What matches [default: stereo.backend]
    #[arg(long, value_enum, conflicts_with = "maps")]
    pub backend: Option<Backend>,
    /// Disparities searched, in px
    #[arg(long, default_value_t = 128, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=255), conflicts_with = "maps")]
    pub max_disparity: u16,
    /// Which pairs of each set, by their position in the table, from 1
    #[arg(long, value_enum, default_value_t = PairChoice::All)]
    pub pairs: PairChoice,
    /// Scores maps of this folder instead of matching: SET/PAIR.png, SET/disparity/PAIR.png or
    /// PAIR.png, 16 bit, disparity x 256, 0 = unknown; pairs without one are left out
    #[arg(long, value_name = "DIR")]
    pub maps: Option<PathBuf>,
    /// Disturbs the right image: values x 0.7, gamma of 0.6, noise of 5 grey levels, Gaussian blur of
    /// 1 px, or half a row upwards
    #[arg(long, value_name = "WHAT", conflicts_with = "maps",
        value_parser = PossibleValuesParser::new(Disturbance::NAMES).try_map(|name| name.parse::<Disturbance>()))]
    pub disturb: Option<Disturbance>,
    /// Writes the grey pairs, as they are matched, and their truth in the layout of KITTI 2015
    #[arg(long, value_name = "DIR")]
    pub save_pairs: Option<PathBuf>,
    /// Folder for error pictures, maps and plots
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Matches each pair this often; ms is the median
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000), conflicts_with = "maps")]
    pub repeat: u32,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Pairs of a set by position: parameters are chosen on one half, figures reported of the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PairChoice {
    /// Every pair
    All,
    /// The first, third, …
    Odd,
    /// The second, fourth, …
    Even,
}

impl PairChoice {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Odd => "odd",
            Self::Even => "even",
        }
    }
}

#[derive(Args, Debug)]
pub struct CheckConfig {
    /// Configuration file or profile
    #[arg(required_unless_present = "reference")]
    pub file: Option<PathBuf>,
    /// Print the reference of all keys instead
    #[arg(long, conflicts_with = "file")]
    pub reference: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    number(text, 0.5, 86_400.0)
}

fn milliseconds(text: &str) -> Result<f64, String> {
    number(text, 0.0, 10_000.0)
}

pub fn fps(text: &str) -> Result<f64, String> {
    number(text, 0.01, 1000.0)
}

pub fn number(text: &str, low: f64, high: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (low..=high).contains(&value) => Ok(value),
        _ => Err(format!("give a number from {low} to {high}")),
    }
}
