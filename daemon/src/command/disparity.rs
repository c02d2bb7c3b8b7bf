//! `lookout disparity`.

use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::number::{number, whole};
use crate::input::{first_pairs, interpretation};
use crate::stages::stereo::matcher::{Backend, Method};
use clap::Args;
use perception::image::{GreyImage, GreyView};
use perception::simd::Level;
use perception::stereo::device::STAGES;
use perception::stereo::epipolar::correction::DEFAULT_LIMIT_PX;
use perception::stereo::epipolar::field::RowField;
use perception::stereo::epipolar::single_pair;
use perception::stereo::reliability::{Reliability, scores};
use perception::stereo::{DisparityView, MatchError, MatchOutput, Matcher};
use serde::Serialize;
use sources::check_two_files;
use sources::picture::{Decoded, Interpretation, scaled_note};
use std::collections::BTreeMap;
use std::path::Path;
use std::path::PathBuf;
use std::time::Instant;
use tools::evaluation::report::RowsCorrected;
use tools::reporting::colour;
use tools::reporting::picture::{check_ending, save_grey};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout disparity left.png right.png -o disparity.png
  lookout disparity left.png right.png -o d.png --max-disparity 64 --color d-color.png
  lookout disparity left.png right.png -o d.png --method full --probability p.png
  lookout disparity left.png right.png -o d.png --budget-ms 5
  lookout disparity left.png right.png -o d.png --correct-rows
  lookout disparity left.png right.png -o d.png --repeat 10 --json";

#[derive(Args, Debug)]
pub struct Disparity {
    /// Left image (PNG, JPEG, TIFF, BMP, WebP, PGM, PPM; colour is converted to grey)
    pub left: PathBuf,
    /// Right image, rectified like the left
    pub right: PathBuf,
    /// Disparity map: 16-bit PNG, disparity x 256, 0 = unknown
    #[arg(short, long, value_name = "OUT.png")]
    pub out: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Number of disparities to search, from 0 px on [default: stereo.disparities]
    #[arg(long, value_name = "N", value_parser = whole::<u16>(2, 255))]
    pub max_disparity: Option<u16>,
    /// Time limit in milliseconds: when it passes, the finest scale reached so far is the result
    /// [default: stereo.budget_ms]
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    pub budget_ms: Option<f64>,
    /// Matcher [default: stereo.method]
    #[arg(long, value_enum)]
    pub method: Option<Method>,
    /// Device that runs the matcher [default: stereo.backend]
    #[arg(long, value_enum)]
    pub backend: Option<Backend>,
    /// Measure by the matches how far the rows of the images are misaligned, correct those of the right image, and match
    /// again; times are of the second match. The daemon does so while it runs, from a quarter of a pixel on
    #[arg(long)]
    pub correct_rows: bool,
    /// Run the matcher this many times; times are medians
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = whole::<u32>(1, 10_000))]
    pub repeat: u32,
    /// Also write the map in colour, with a scale below it
    #[arg(long, value_name = "FILE")]
    pub color: Option<PathBuf>,
    /// Also write how likely each disparity is right: 8-bit PNG, probability of an error of at most 3 px
    /// x 255, 0 = unknown
    #[arg(long, value_name = "FILE.png")]
    pub probability: Option<PathBuf>,
    /// Print density, times and memory as JSON
    #[arg(long)]
    pub json: bool,
}

fn milliseconds(text: &str) -> Result<f64, String> {
    number(text, 0.0, 10_000.0)
}

#[derive(Serialize)]
struct Figures {
    method: Method,
    width: usize,
    height: usize,
    disparities: usize,
    density: f64,
    cpu_ms_median: f64,
    cpu_ms_min: f64,
    wall_ms_median: f64,
    workspace_bytes: usize,
    /// Finest scale within the budget: 1 for full resolution, 2 for half, 4 for a quarter.
    scale: u32,
    /// Nodes visited over width × height × disparities.
    nodes_share: f64,
    /// By how much the rows of the right image were corrected; `None` if they were not.
    #[serde(skip_serializing_if = "Option::is_none")]
    rows_corrected: Option<RowsCorrected>,
    /// `None` on the CPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    device: Option<DeviceFigures>,
}

/// The GPU and its times.
#[derive(Serialize)]
struct DeviceFigures {
    adapter: String,
    driver: String,
    /// Why the device was lost and the CPU used instead, if so.
    loss: Option<String>,
    /// Pairs per second, processed one after the other.
    fps: f64,
    /// Median of the sum over all GPU stages, from the device's timestamps; `None` without timestamps.
    gpu_ms_median: Option<f64>,
    /// Median of each GPU stage.
    stages_ms_median: BTreeMap<&'static str, f64>,
}

impl DeviceFigures {
    fn new(
        matcher: &dyn Matcher,
        wall_ms: f64,
        stages_ms: &mut [Vec<f64>],
        mut total_ms: Vec<f64>,
    ) -> Option<Self> {
        let device = matcher.device()?;
        Some(Self {
            adapter: device.adapter.to_owned(),
            driver: device.driver.to_owned(),
            loss: device.loss.map(|loss| loss.to_string()),
            fps: 1e3 / wall_ms,
            gpu_ms_median: (!total_ms.is_empty()).then(|| median(&mut total_ms)),
            stages_ms_median: STAGES
                .into_iter()
                .zip(stages_ms)
                .filter(|(_, times)| !times.is_empty())
                .map(|(stage, times)| (stage, median(times)))
                .collect(),
        })
    }

    fn text(&self) -> String {
        let stages: Vec<String> =
            self.stages_ms_median.iter().map(|(stage, ms)| format!("{stage} {ms:.3}")).collect();
        let mut text = format!("\n{} ({}): {:.1} pairs per second", self.adapter, self.driver, self.fps);
        if let Some(ms) = self.gpu_ms_median {
            text += &format!(", {ms:.3} ms on the device ({})", stages.join(", "));
        }
        if let Some(loss) = &self.loss {
            text += &format!("; device lost ({loss}), the CPU was used instead");
        }
        text
    }
}

/// Grey pixels of both images, width and height.
type GreyPair = (Vec<u8>, Vec<u8>, usize, usize);

/// Reads a pair of images as grey pixels, with width and height.
///
/// # Errors
/// If an image cannot be read, or the sizes differ.
pub fn read_pair(left: &Path, right: &Path) -> Result<GreyPair, CommandError> {
    Ok(read(left, right, Interpretation::default())?.0)
}

/// The same, with values that become grey levels as `how` says. Both images are taken to have the same depth; one that was
/// found is told.
///
/// # Errors
/// See [`read_pair`].
pub fn read_pair_as(left: &Path, right: &Path, how: Interpretation) -> Result<GreyPair, CommandError> {
    let (pair, found) = read(left, right, how)?;
    if how.bits.is_none()
        && let Some(bits) = found
    {
        tracing::warn!("{}", scaled_note(left, bits));
    }
    Ok(pair)
}

/// Also the depth of 16-bit images that was found.
fn read(left: &Path, right: &Path, how: Interpretation) -> Result<(GreyPair, Option<u8>), CommandError> {
    if let Some(path) = [left, right].into_iter().find(|path| matches!(path.try_exists(), Ok(false))) {
        return Err(CommandError::Other(format!(
            "{}: there is no such file: give an image file",
            path.display()
        )));
    }
    if left.is_file() {
        check_two_files(left, right)?;
    }
    let (left_image, right_image) = (Decoded::read(left)?, Decoded::read(right)?);
    let (width, height) = (left_image.width, left_image.height);
    if (right_image.width, right_image.height) != (width, height) {
        return Err(CommandError::Other(format!(
            "{} is {width}x{height}, but {} is {}x{}: give both images of a rectified pair",
            left.display(),
            right.display(),
            right_image.width,
            right_image.height
        )));
    }
    let found = left_image.bits().max(right_image.bits());
    let how = Interpretation { bits: how.bits.or(found), ..how };
    Ok(((left_image.grey(how), right_image.grey(how), width, height), found))
}

/// The median of some times, the upper one of an even number; sorts them. NaN for none.
pub fn median(times: &mut [f64]) -> f64 {
    times.sort_unstable_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The right image with its rows corrected, and by how much; `None`, with a warning, where the pair does not tell.
fn rows_corrected(
    matcher: &mut dyn Matcher,
    left: GreyView<'_>,
    right: GreyView<'_>,
) -> Result<Option<(RowField, GreyImage)>, MatchError> {
    let corrected = single_pair::corrected(Level::best(), matcher, left, right)?;
    if corrected.is_none() {
        tracing::warn!(
            "the matches do not tell for certain how far the rows are misaligned, or it is more than {DEFAULT_LIMIT_PX} px: the rows stay \
             as they are"
        );
    }
    Ok(corrected)
}

/// Times of the runs, in ms, and how often the resolution of the last one was halved.
#[derive(Default)]
struct Times {
    halved: u32,
    cpu_ms: Vec<f64>,
    wall_ms: Vec<f64>,
    /// Of each GPU stage, and the sum over all of a run.
    stages_ms: [Vec<f64>; STAGES.len()],
    total_ms: Vec<f64>,
}

impl Times {
    /// Matches a pair and adds its times; `budget_ms` is the time limit, 0 for none.
    fn add(
        &mut self,
        matcher: &mut dyn Matcher,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
        budget_ms: f64,
    ) -> Result<(), MatchError> {
        let (cpu, wall) = (messages::clock::process_cpu_ns(), Instant::now());
        let mut go_on = || budget_ms <= 0.0 || wall.elapsed().as_secs_f64() * 1e3 < budget_ms;
        self.halved = matcher.compute_within(left, right, output, &mut go_on)?;
        if let Some(device) = matcher.device().filter(|device| !device.stages.is_empty()) {
            for (times, stage) in self.stages_ms.iter_mut().zip(device.stages) {
                times.push(stage.ns as f64 * 1e-6);
            }
            self.total_ms.push(device.stages.iter().map(|stage| stage.ns as f64 * 1e-6).sum());
        }
        self.cpu_ms.push((messages::clock::process_cpu_ns() - cpu) as f64 * 1e-6);
        self.wall_ms.push(wall.elapsed().as_secs_f64() * 1e3);
        Ok(())
    }
}

pub fn run(args: &Disparity, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "disparity", None)?;
    check_ending(&args.out, true)?;
    args.color.as_deref().map(|path| check_ending(path, false)).transpose()?;
    args.probability.as_deref().map(|path| check_ending(path, true)).transpose()?;
    let disparities =
        args.max_disparity.map_or(usize::try_from(config.stereo.disparities).unwrap_or(0), usize::from);
    let (left, right, width, height) = read_pair_as(&args.left, &args.right, interpretation(&config))?;
    if config.calibration.check
        && let Some(fault) = first_pairs::fault(&left, &right, (width, height))
    {
        tracing::warn!("{fault}");
    }
    let left = GreyView::new(&left, width, height, width)?;
    let mut right = GreyView::new(&right, width, height, width)?;
    let method = args.method.unwrap_or(Method::configured(&config));
    let backend = args.backend.unwrap_or(Backend::configured(&config));
    let mut matcher = method
        .matcher(backend, &config, width, height, disparities)
        .map_err(|error| CommandError::Other(format!("{}: {error}", args.left.display())))?;
    let corrected = if args.correct_rows { rows_corrected(&mut *matcher, left, right)? } else { None };
    if let Some((_, image)) = &corrected {
        right = image.view();
    }
    let budget_ms = args.budget_ms.unwrap_or(config.stereo.budget_ms);
    let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
    let mut times = Times::default();
    for _ in 0..args.repeat {
        let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
        times.add(&mut *matcher, left, right, output, budget_ms)?;
    }
    tools::reporting::picture::save_disparity(&args.out, &disparity, width, height)?;
    if let Some(path) = &args.color {
        let mut colours = colour::disparity(&disparity, width, height, disparities as f32);
        colours.append_below(&colour::scale(width, disparities as f32));
        colours.save(path)?;
    }
    if let Some(path) = &args.probability {
        let within = |&score: &u8| match score {
            0 => 0,
            score => (255.0 * Reliability::of(score).within_3px).round() as u8,
        };
        let levels: Vec<u8> = scores(&confidence, width).iter().map(within).collect();
        save_grey(path, &levels, width, height)?;
    }
    let view = DisparityView::new(&disparity, width, height)
        .ok_or_else(|| CommandError::Other("the disparity map and the image differ in size".into()))?;
    let wall_ms_median = median(&mut times.wall_ms);
    let figures = Figures {
        device: DeviceFigures::new(&*matcher, wall_ms_median, &mut times.stages_ms, times.total_ms),
        method,
        width,
        height,
        disparities,
        density: view.density(),
        cpu_ms_median: median(&mut times.cpu_ms),
        cpu_ms_min: times.cpu_ms[0],
        wall_ms_median,
        workspace_bytes: matcher.workspace_bytes(),
        scale: 1 << times.halved,
        rows_corrected: corrected.as_ref().map(|(field, _)| RowsCorrected::from(*field)),
        nodes_share: matcher.nodes() as f64 / (width * height * disparities) as f64,
    };
    if args.json {
        return say(serde_json::to_string_pretty(&figures)?);
    }
    let rows = figures.rows_corrected.map_or(String::new(), |rows| format!("\nrows corrected by {rows}"));
    let scale = if times.halved == 0 { String::new() } else { format!(" at 1/{} scale", figures.scale) };
    say(format_args!(
        "{width}x{height}{scale}, {disparities} disparities: {:.1} % known, {:.1} ms of processor time \
             (median of {}), visited nodes {:.1} % of width x height x disparities, workspace {:.1} MiB; {}{}{rows}",
        figures.density * 100.0,
        figures.cpu_ms_median,
        args.repeat,
        figures.nodes_share * 100.0,
        figures.workspace_bytes as f64 / (1 << 20) as f64,
        args.out.display(),
        figures.device.as_ref().map(DeviceFigures::text).unwrap_or_default()
    ))
}
