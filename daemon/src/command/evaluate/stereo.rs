//! `lookout evaluate stereo`.

mod estimator;

use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::disparity::read_pair;
use crate::command::error::CommandError;
use crate::command::left_out::LeftOut;
use crate::stages::stereo::matcher::{Backend, Method};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use estimator::{Estimate, Estimator, Images, Maps, Matchers, map_paths};
use sources::truth::{Region, Truth, TruthError, TruthPair, find};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use tools::evaluation::bias::ErrorsByRange;
use tools::evaluation::disturb::Disturbance;
use tools::evaluation::error_picture::{self, ErrorInput};
use tools::evaluation::files::{KITTI_FOLDERS, KittiPair, prepare, write_report};
use tools::evaluation::fill::interpolate_background;
use tools::evaluation::reliability::ReliabilityCounts;
use tools::evaluation::report::{Row, RowsCorrected, SetReport, StereoReport};
use tools::evaluation::roc::Sparsification;
use tools::evaluation::score::score;
use tools::evaluation::subpixel::SubpixelHistogram;
use tools::reporting::{colour, picture};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate stereo ../shared/data/kitti2015
  lookout evaluate stereo KITTI --pairs odd        tune parameters on these, report --pairs even
  lookout evaluate stereo KITTI --out results      error pictures, maps, plots
  lookout evaluate stereo KITTI --maps results     score maps instead of matching
  lookout evaluate stereo KITTI --disturb noise --save-pairs noisy
  lookout evaluate stereo KITTI --correct-rows     pairs whose misaligned rows are corrected first

DIR is searched recursively for KITTI 2012 (image_0, image_1, disp_noc, disp_occ), KITTI 2015
(image_2, image_3, disp_noc_0, disp_occ_0), KITTI depth (left, right, gt_depth_map, calib) and
Middlebury scenes (a folder each, such as im0.png, im1.png, disp0GT.pfm).

One line per image and region: all, pixels with ground truth; noc, those that are not occluded in
the right image. In percent: dens, pixels with an estimate; bad1, bad2, bad3, errors above 1, 2, 3
px; D1, above 3 px and 5 % of the truth. These and epe, the mean error in px, are computed after
background fill (holes take the background of their row, as in the KITTI devkit); hole3 is bad3
with holes counted as errors, val3 is bad3 without holes. ms is processor time. mean is the mean
over the images. bias is the median of estimate less truth, spread the robust standard deviation.
lookout scene NAME --pairs DIR writes pairs with exact ground truth.

--out writes SET/errors/PAIR.png (blue is correct, yellow to red is wrong by the rule of D1,
occluded pixels darker), SET/disparity/PAIR.png (16 bit, disparity x 256), SET/colour/PAIR.png,
subpixel.png, roc.png, reliability.png and evaluation.json. --save-pairs writes image_2, image_3, disp_noc_0 and
disp_occ_0; for several sets, into a folder for each.";

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
    /// Device that runs the matcher [default: stereo.backend]
    #[arg(long, value_enum, conflicts_with = "maps")]
    pub backend: Option<Backend>,
    /// Number of disparities to search
    #[arg(long, default_value_t = 128, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=255), conflicts_with = "maps")]
    pub max_disparity: u16,
    /// Pairs of each set to use, by their position in the table, from 1
    #[arg(long, value_enum, default_value_t = PairChoice::All)]
    pub pairs: PairChoice,
    /// Score the maps in this folder instead of matching: SET/PAIR.png, SET/disparity/PAIR.png or
    /// PAIR.png, 16 bit, disparity x 256, 0 = unknown; pairs without a map are skipped
    #[arg(long, value_name = "DIR")]
    pub maps: Option<PathBuf>,
    /// Disturb the right image: values x 0.7, gamma of 0.6, noise of 5 grey levels, Gaussian blur of
    /// 1 px, or a shift of half a row upwards
    #[arg(long, value_name = "WHAT", conflicts_with = "maps",
        value_parser = PossibleValuesParser::new(Disturbance::NAMES).try_map(|name| name.parse::<Disturbance>()))]
    pub disturb: Option<Disturbance>,
    /// Match each pair, measure by its matches how far its rows are misaligned, correct the rows of the right image by up to
    /// 2 px, and score the pair matched again; ms is of the second match. The daemon does so while it runs, by the estimate
    /// of many pairs and from a quarter of a pixel on
    #[arg(long, conflicts_with = "maps")]
    pub correct_rows: bool,
    /// Write the grey pairs as they are matched, and their ground truth, in the layout of KITTI 2015
    #[arg(long, value_name = "DIR")]
    pub save_pairs: Option<PathBuf>,
    /// Folder for error pictures, maps and plots
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Match each pair this many times; ms is the median
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000), conflicts_with = "maps")]
    pub repeat: u32,
    /// Stop at a pair that cannot be read, instead of leaving it out
    #[arg(long)]
    pub strict: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Pairs of a set by position, so that parameters are tuned on one half and results reported for the other.
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
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Odd => "odd",
            Self::Even => "even",
        }
    }
}

/// A data set of the command line.
struct Set {
    name: String,
    root: PathBuf,
    pairs: Vec<TruthPair>,
}

pub fn run(args: &EvaluateStereo, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "evaluate", Some("warn"))?;
    let sets = sets(args)?;
    let mut estimator: Box<dyn Estimator> = match &args.maps {
        Some(folder) => Box::new(Maps { folder }),
        None => Box::new(Matchers {
            config: &config,
            method: args.method.unwrap_or(Method::configured(&config)),
            backend: args.backend.unwrap_or(Backend::configured(&config)),
            disparities: usize::from(args.max_disparity),
            repeat: args.repeat,
            of_size: HashMap::new(),
        }),
    };
    keep_folders_apart(args)?;
    if let Some(out) = &args.out {
        prepare_pictures(out, &sets)?;
    }
    if let Some(folder) = &args.save_pairs {
        prepare_pairs(folder, &sets)?;
    }
    let count = sets.iter().map(|set| set.pairs.len() as u64).sum();
    let bar = progress(Some(count), "pairs");
    let is_strict = args.strict || config.source.strict;
    let mut statistics = Statistics { is_strict, ..Statistics::default() };
    let mut reports = Vec::new();
    for set in &sets {
        let (mut rows, mut left_out) = (Vec::new(), 0);
        let before = statistics.unreadable.count;
        for pair in &set.pairs {
            bar.set_message(pair.name.clone());
            match evaluate_pair(args, &sets, set, pair, estimator.as_mut(), &mut statistics)? {
                Outcome::Scored(of_pair) => rows.extend(of_pair),
                Outcome::NoMap => left_out += 1,
                Outcome::Unreadable => {}
            }
            bar.inc(1);
        }
        reports.push(SetReport::new(set.name.clone(), rows, left_out, statistics.unreadable.count - before));
    }
    bar.finish_and_clear();
    statistics.unreadable.check(count)?;
    if let Some(maps) = args.maps.as_ref().filter(|_| reports.iter().all(|set| set.rows.is_empty())) {
        return Err(CommandError::Other(format!(
            "{}: no map of any pair: expected SET/PAIR.png, SET/disparity/PAIR.png or PAIR.png, such as {}",
            maps.display(),
            map_paths(maps, &sets[0].name, &sets[0].pairs[0].name)[0].display()
        )));
    }
    let matched = args.maps.is_none();
    let report = StereoReport {
        method: if matched { args.method.unwrap_or(Method::configured(&config)).name() } else { "maps" }
            .to_owned(),
        disparities: matched.then_some(usize::from(args.max_disparity)),
        pairs: args.pairs.name().to_owned(),
        disturb: args.disturb.map(Disturbance::name),
        correct_rows: args.correct_rows,
        repeat: args.repeat,
        workspace_bytes: estimator.workspace_bytes(),
        sets: reports,
        roc: statistics.roc.curve(),
        reliability: statistics.reliability.report(),
        by_range: statistics.by_range.ranges(),
        subpixel: statistics.subpixel.shares(),
    };
    if let Some(out) = &args.out {
        write_results(out, &report)?;
    }
    if args.json { say(serde_json::to_string_pretty(&report)?) } else { say(&report) }
}

/// Statistics over the pixels of all pairs, and those pairs that cannot be read.
#[derive(Default)]
struct Statistics {
    is_strict: bool,
    unreadable: LeftOut,
    roc: Sparsification,
    reliability: ReliabilityCounts,
    by_range: ErrorsByRange,
    subpixel: SubpixelHistogram,
}

/// What came of a pair.
enum Outcome {
    /// A row for each region.
    Scored(Vec<Row>),
    /// There is no estimate.
    NoMap,
    /// A picture or a map of the ground truth cannot be decoded.
    Unreadable,
}

/// Scores a pair and writes its files.
fn evaluate_pair(
    args: &EvaluateStereo,
    sets: &[Set],
    set: &Set,
    pair: &TruthPair,
    estimator: &mut dyn Estimator,
    statistics: &mut Statistics,
) -> Result<Outcome, CommandError> {
    let read = read(pair, args.disturb);
    let read = statistics.unreadable.unless_broken(&pair.name, statistics.is_strict, read)?;
    let Some((truth, mut images)) = read else { return Ok(Outcome::Unreadable) };
    let rows_corrected = if args.correct_rows {
        estimator.correct_rows(pair, &mut images)?.map(RowsCorrected::from)
    } else {
        None
    };
    if let Some(folder) = &args.save_pairs {
        save_pair(&pair_folder(folder, sets.len(), &set.name), &pair.name, &truth, &images)?;
    }
    let Some(estimate) = estimator.estimate(&set.name, pair, &images)? else { return Ok(Outcome::NoMap) };
    let px = tools::evaluation::pixels(&estimate.disparity);
    let mut filled = px.clone();
    interpolate_background(&mut filled, images.width, images.height);
    let rows = truth.regions.iter().map(|(region, mask)| Row {
        name: pair.name.clone(),
        region: region.name(),
        scores: score(&truth.disparity_px, mask, &px, &filled),
        cpu_ms: estimate.cpu_ms,
        rows_corrected,
    });
    let rows = rows.collect();
    statistics.subpixel.add(&truth.disparity_px, truth.visible(), &px);
    statistics.by_range.add(&truth.disparity_px, truth.visible(), &px, images.width);
    if let Some(confidence) = &estimate.confidence {
        statistics.roc.add(&truth.disparity_px, truth.visible(), &px, confidence);
        statistics.reliability.add(&truth.disparity_px, truth.visible(), &px, confidence, images.width);
    }
    if let Some(out) = &args.out {
        let max_px = f32::from(args.max_disparity);
        save_pictures(&out.join(&set.name), &pair.name, &truth, &images, &estimate, &filled, max_px)?;
    }
    Ok(Outcome::Scored(rows))
}

/// Writes the plots and `evaluation.json`.
fn write_results(out: &Path, report: &StereoReport) -> Result<(), CommandError> {
    if let Some(shares) = &report.subpixel {
        shares.plot().save(&out.join("subpixel.png"))?;
    }
    if let Some(curve) = &report.roc {
        curve.plot().save(&out.join("roc.png"))?;
    }
    if let Some(reliability) = &report.reliability {
        reliability.plot().save(&out.join("reliability.png"))?;
    }
    Ok(write_report(out, report)?)
}

/// The chosen pairs of every set; each set has a unique name.
fn sets(args: &EvaluateStereo) -> Result<Vec<Set>, CommandError> {
    let mut sets: Vec<Set> = Vec::new();
    for root in &args.sets {
        let all = find(root)?;
        let count = all.len();
        let chosen = |position: usize| match args.pairs {
            PairChoice::All => true,
            PairChoice::Odd => position % 2 == 1,
            PairChoice::Even => position.is_multiple_of(2),
        };
        let pairs: Vec<TruthPair> = all
            .into_iter()
            .zip(1..)
            .filter(|(_, position)| chosen(*position))
            .map(|(pair, _)| pair)
            .collect();
        if pairs.is_empty() {
            let choice = args.pairs.name();
            return Err(CommandError::Other(format!(
                "{}: --pairs {choice} leaves none of its {count}: give --pairs all, or more pairs",
                root.display()
            )));
        }
        let name = set_name(root, |name| sets.iter().any(|set| set.name == *name));
        sets.push(Set { name, root: root.clone(), pairs });
    }
    Ok(sets)
}

/// Name of a data set: its folder's name, with a number if that is taken.
pub(super) fn set_name(root: &Path, taken: impl Fn(&str) -> bool) -> String {
    let own =
        root.canonicalize().ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let own = own.unwrap_or_else(|| "set".into());
    let mut names = std::iter::once(own.clone()).chain((2..).map(|n| format!("{own}-{n}")));
    names.find(|name| !taken(name)).unwrap_or(own)
}

/// Reads ground truth and images of a pair, and disturbs the right image.
fn read(pair: &TruthPair, disturb: Option<Disturbance>) -> Result<(Truth, Images), CommandError> {
    let truth = pair.truth()?;
    let (left, mut right, width, height) = read_pair(&pair.left, &pair.right)?;
    check_size(&pair.left, (width, height), pair.truth_file(), (truth.width, truth.height))?;
    if let Some(disturbance) = disturb {
        right = disturbance.apply(&right, width, height);
    }
    Ok((truth, Images { left, right, width, height }))
}

/// Checks that an image and its ground truth have the same size.
pub(super) fn check_size(
    path: &Path,
    size: (usize, usize),
    other: &Path,
    expected: (usize, usize),
) -> Result<(), TruthError> {
    if size == expected {
        return Ok(());
    }
    Err(TruthError::Size { path: path.to_owned(), size, other: other.to_owned(), expected })
}

fn roots(sets: &[Set]) -> impl Iterator<Item = &Path> {
    sets.iter().map(|set| set.root.as_path())
}

/// The canonical path of a file that may not exist yet.
fn resolved(path: &Path) -> PathBuf {
    for ancestor in path.ancestors() {
        let start = if ancestor.as_os_str().is_empty() { Path::new(".") } else { ancestor };
        if let Ok(real) = start.canonicalize() {
            return path.strip_prefix(ancestor).map_or(real.clone(), |rest| real.join(rest));
        }
    }
    path.to_owned()
}

/// Rejects folders that contain each other, because output folders are cleaned.
fn keep_folders_apart(args: &EvaluateStereo) -> Result<(), CommandError> {
    let is_in = |inner: &Option<PathBuf>, outer: &Option<PathBuf>| match (inner, outer) {
        (Some(inner), Some(outer)) => resolved(inner).starts_with(resolved(outer)),
        _ => false,
    };
    let clash = if is_in(&args.maps, &args.out) || is_in(&args.maps, &args.save_pairs) {
        "--maps is inside an output folder: give other folders for --out and --save-pairs"
    } else if is_in(&args.save_pairs, &args.out) || is_in(&args.out, &args.save_pairs) {
        "--save-pairs and --out contain each other: give separate folders"
    } else {
        return Ok(());
    };
    Err(CommandError::Other(clash.into()))
}

/// Refuses to write into a data set: results could be mistaken for ground truth, or overwrite it.
pub(super) fn keep_out_of<'a>(
    target: &Path,
    mut roots: impl Iterator<Item = &'a Path>,
    option: &str,
) -> Result<(), CommandError> {
    let target_path = resolved(target);
    match roots.find(|root| target_path.starts_with(resolved(root))) {
        None => Ok(()),
        Some(root) => Err(CommandError::Other(format!(
            "{}: is inside the data set {}: give {option} another folder",
            target.display(),
            root.display()
        ))),
    }
}

const PICTURE_FOLDERS: [&str; 3] = ["errors", "disparity", "colour"];

fn prepare_pictures(out: &Path, sets: &[Set]) -> Result<(), CommandError> {
    let mut files = vec![PathBuf::from("subpixel.png"), PathBuf::from("roc.png")];
    for set in sets {
        keep_out_of(&out.join(&set.name), roots(sets), "--out")?;
        for (pair, part) in set.pairs.iter().flat_map(|pair| PICTURE_FOLDERS.map(|part| (pair, part))) {
            files.push(Path::new(&set.name).join(part).join(format!("{}.png", pair.name)));
        }
    }
    Ok(prepare(out, &files)?)
}

/// Folder for the pairs of a set; a single set needs no subfolder.
fn pair_folder(folder: &Path, sets: usize, name: &str) -> PathBuf {
    if sets == 1 { folder.to_owned() } else { folder.join(name) }
}

fn prepare_pairs(folder: &Path, sets: &[Set]) -> Result<(), CommandError> {
    let mut files = Vec::new();
    for set in sets {
        let below = pair_folder(Path::new(""), sets.len(), &set.name);
        keep_out_of(&folder.join(&below), roots(sets), "--save-pairs")?;
        // A KITTI folder with any map of occluded pixels is read by those maps alone.
        let with_all = set.pairs.iter().filter(|pair| pair.regions().contains(&Region::All)).count();
        if with_all != 0 && with_all != set.pairs.len() {
            return Err(CommandError::Other(format!(
                "{}: only {with_all} of its {} pairs have ground truth for occluded pixels, which the KITTI layout \
                 cannot represent: give its subfolders one by one",
                set.root.display(),
                set.pairs.len()
            )));
        }
        for pair in &set.pairs {
            let [left, right, all, noc] = KITTI_FOLDERS;
            let maps = pair.regions().into_iter().map(|region| if region == Region::All { all } else { noc });
            files.extend(
                [left, right]
                    .into_iter()
                    .chain(maps)
                    .map(|part| below.join(part).join(format!("{}.png", pair.name))),
            );
        }
    }
    Ok(prepare(folder, &files)?)
}

fn save_pair(folder: &Path, name: &str, truth: &Truth, images: &Images) -> Result<(), CommandError> {
    let pair = KittiPair {
        left: &images.left,
        right: &images.right,
        truth: &truth.disparity_px,
        all: truth.region(Region::All),
        noc: truth.region(Region::Noc),
        width: images.width,
        height: images.height,
    };
    Ok(pair.save(folder, name)?)
}

fn save_pictures(
    folder: &Path,
    name: &str,
    truth: &Truth,
    images: &Images,
    estimate: &Estimate,
    filled: &[f32],
    max_px: f32,
) -> Result<(), CommandError> {
    let [errors, disparity, colours] =
        PICTURE_FOLDERS.map(|part| folder.join(part).join(format!("{name}.png")));
    let (width, height) = (images.width, images.height);
    let input = ErrorInput {
        left: &images.left,
        truth: &truth.disparity_px,
        visible: truth.visible(),
        filled,
        width,
        height,
    };
    error_picture::draw(input).save(&errors)?;
    picture::save_disparity(&disparity, &estimate.disparity, width, height)?;
    colour::disparity(&estimate.disparity, width, height, max_px).save(&colours)?;
    Ok(())
}
