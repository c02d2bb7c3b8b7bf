//! `lookout train`.

use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::number::number;
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use perception::recognition::xml::{self, TrainedWith};
use serde::Serialize;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::Instant;
use tools::evaluation::detection::{self, DetectionReport};
use tools::training::checkpoint::Checkpoint;
use tools::training::finish::Aim;
use tools::training::pictures::{self, Split};
use tools::training::{FeatureKind, Progress, StageFigures, TrainParameters, ablation, report, sweep, train};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout train --positives vehicles --negatives others -o vehicle.xml
  lookout train --positives vehicles --negatives others -o v.xml --report out/training --threads 4
  lookout train --positives vehicles --negatives others -o v.xml --features haar --window 24x20
  lookout train --positives vehicles --negatives others -o v.xml --sweep

Each picture of --positives shows one object that fills it. Pictures of --negatives show none and
may have any size from the window size up; windows are sampled from them. The last part of every
folder is held out for validation and not trained on (--validation): keep the pictures of one
drive in one folder, in order. The same pictures and options give the same cascade on any number
of threads.

An interrupted run resumes when it is started again; finished stages are kept in CASCADE.part. The
cascade is written as OpenCV XML.";

/// Defaults are those of `tools::training::TrainParameters::usual`.
#[derive(Args, Debug)]
pub struct Train {
    /// Pictures of one object each
    #[arg(long, value_name = "DIR")]
    pub positives: PathBuf,
    /// Pictures without objects; may be repeated
    #[arg(long, value_name = "DIR", required = true)]
    pub negatives: Vec<PathBuf>,
    /// Output file
    #[arg(short, long, value_name = "CASCADE.xml")]
    pub out: PathBuf,
    /// Kind of features
    #[arg(long, value_enum, default_value_t = FeatureChoice::Lbp)]
    pub features: FeatureChoice,
    /// Maximum number of stages
    #[arg(long, default_value_t = 17, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=100))]
    pub stages: u16,
    /// Maximum depth of a tree: decisions from the root to a leaf
    #[arg(long, default_value_t = 2, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=6))]
    pub max_depth: u32,
    /// Size of the detection window, in pixels
    #[arg(long, default_value = "24x24", value_name = "WxH", value_parser = window)]
    pub window: (u16, u16),
    /// Share of the objects that each stage accepts (hit rate)
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub hit_rate: Option<f64>,
    /// A stage is complete when it accepts at most this share of the negatives
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub false_alarm_rate: Option<f64>,
    /// Maximum number of trees that a stage adds
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=5000))]
    pub max_trees: Option<u16>,
    /// Share of the validation objects that the last stage accepts; thresholds of the earlier stages are
    /// then set so that they reject hardly any of those (--refused-early)
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub final_hit_rate: Option<f64>,
    /// Share of the validation negatives that the last stage accepts; thresholds of the earlier stages are
    /// then set so that they reject hardly any object that it would accept
    #[arg(long, value_name = "SHARE", value_parser = rate, conflicts_with = "final_hit_rate")]
    pub final_false_alarm_rate: Option<f64>,
    /// With either: share of the objects accepted by the last stage that the first stage may reject; later
    /// stages may reject less. A larger share makes detection faster
    #[arg(long, default_value_t = 0.0, value_name = "SHARE", value_parser = rate)]
    pub refused_early: f64,
    /// Share of each folder, its last pictures, that is held out for validation; 0 validates on the
    /// training pictures
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub validation: Option<f64>,
    /// Augmented windows per object, in addition to the unchanged one
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=1000))]
    pub variants: Option<u16>,
    /// Strength of the augmentation: 0 none, 1 default, 2 twice as strong
    #[arg(long, default_value_t = 1.0, value_name = "F", value_parser = strength)]
    pub variation: f64,
    /// Negative windows per stage
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(16..=1_000_000))]
    pub negative_windows: Option<u32>,
    /// Candidate features per stage, drawn at random for each
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub pool: Option<u32>,
    /// Learning rate: factor on the values of a new tree
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub learning_rate: Option<f64>,
    /// Minimum share of the weight in a leaf
    #[arg(long = "least-leaf", value_name = "SHARE", value_parser = rate)]
    pub min_leaf: Option<f64>,
    /// Shrinkage of a leaf's mean towards 0, in samples
    #[arg(long, value_name = "SAMPLES", value_parser = prior)]
    pub leaf_prior: Option<f64>,
    /// Shrinkage of an LBP code's mean towards that of its node, in samples
    #[arg(long, value_name = "SAMPLES", value_parser = prior)]
    pub category_prior: Option<f64>,
    /// Number of cascades that are trained with different random numbers and merged into one (bagging):
    /// fewer errors, but training time and trees grow by this factor
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=50), conflicts_with = "unchained")]
    pub bags: u16,
    /// Start each stage without the trees of the previous one
    #[arg(long)]
    pub unchained: bool,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub seed: u64,
    /// Threads [default: all of the machine]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub threads: Option<u16>,
    /// Folder for a report with plots: stages, ROC, features on the mean object
    #[arg(long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Discard the stages of an interrupted run
    #[arg(long)]
    pub restart: bool,
    /// Print the paper's tables, stages x depth and scale factor x window, instead of writing a cascade
    #[arg(long, conflicts_with_all = ["restart", "report"])]
    pub sweep: bool,
    /// Print an ablation of the trainer's measures, evaluated on the last 30 % of each folder, instead of
    /// writing a cascade
    #[arg(long, conflicts_with_all = ["restart", "report", "sweep"])]
    pub ablation: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Kind of features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FeatureChoice {
    /// Multi-block local binary patterns: fast
    Lbp,
    /// Upright Haar features
    Haar,
    /// Upright and tilted Haar features
    HaarTilted,
}

fn rate(text: &str) -> Result<f64, String> {
    number(text, 0.0, 1.0)
}

fn strength(text: &str) -> Result<f64, String> {
    number(text, 0.0, 4.0)
}

fn prior(text: &str) -> Result<f64, String> {
    number(text, 0.0, 1e6)
}

fn window(text: &str) -> Result<(u16, u16), String> {
    let sides =
        text.split_once('x').and_then(|(w, h)| Some((w.parse::<u16>().ok()?, h.parse::<u16>().ok()?)));
    match sides {
        Some((w, h)) if (8..=64).contains(&w) && (8..=64).contains(&h) => Ok((w, h)),
        _ => Err("give WIDTHxHEIGHT, each from 8 to 64, for example 24x24".into()),
    }
}

#[derive(Serialize)]
struct Figures {
    positives: usize,
    negatives: usize,
    stages: Vec<StageFigures>,
    trees: usize,
    /// Training ended before all stages because hardly any negative window passed the stages so far.
    exhausted: bool,
    wall_s: f64,
    cpu_s: f64,
    /// Stages of the cascade that was written; `stages` has those of every bag.
    #[serde(skip)]
    cascade_stages: usize,
    validation: Option<DetectionReport>,
}

fn parameters(args: &Train) -> TrainParameters {
    let mut p = TrainParameters::usual(match args.features {
        FeatureChoice::Lbp => FeatureKind::Lbp,
        FeatureChoice::Haar => FeatureKind::Haar,
        FeatureChoice::HaarTilted => FeatureKind::HaarTilted,
    });
    fn set<T>(target: &mut T, value: Option<impl Into<T>>) {
        if let Some(value) = value {
            *target = value.into();
        }
    }
    p.window = args.window;
    p.stages = args.stages.into();
    p.seed = args.seed;
    p.threads = match args.threads {
        Some(threads) => threads.into(),
        None => std::thread::available_parallelism().map_or(1, usize::from),
    };
    p.early = args.refused_early;
    p.aim = match (args.final_hit_rate, args.final_false_alarm_rate) {
        (Some(share), _) => Aim::HitRate(share),
        (_, Some(share)) => Aim::FalseAlarmRate(share),
        _ => p.aim,
    };
    set(&mut p.validation, args.validation);
    set(&mut p.variants, args.variants);
    set(&mut p.stage.hit_rate, args.hit_rate);
    set(&mut p.stage.false_alarm_rate, args.false_alarm_rate);
    set(&mut p.stage.max_trees, args.max_trees);
    set(&mut p.stage.learning_rate, args.learning_rate);
    p.negatives = args.negative_windows.map_or(p.negatives, |n| n as usize);
    p.pool = args.pool.map_or(p.pool, |n| n as usize);
    p.stage.chained = !args.unchained;
    p.bags = args.bags.into();
    p.stage.tree.max_depth = args.max_depth;
    set(&mut p.stage.tree.min_leaf, args.min_leaf);
    set(&mut p.stage.tree.leaf_prior, args.leaf_prior);
    set(&mut p.stage.tree.category_prior, args.category_prior);
    p.variation = p.variation.times(args.variation);
    p
}

/// Shows the progress: a bar on a terminal, and a line per stage.
struct Show {
    bar: ProgressBar,
    begin: Instant,
    /// Stages of each bag.
    stages: usize,
    bags: usize,
    /// The stage that this run started with; later than 0 if it was resumed.
    first: Option<usize>,
}

impl Show {
    fn new(p: &TrainParameters) -> Self {
        let stages = p.stages * p.bags;
        let bar = if std::io::stderr().is_terminal() {
            ProgressBar::new(stages as u64)
        } else {
            ProgressBar::hidden()
        };
        let style = ProgressStyle::with_template("{wide_bar} {pos}/{len} stages, {msg}");
        let bar = match style {
            Ok(style) => bar.with_style(style),
            Err(_) => bar,
        };
        Self { bar, begin: Instant::now(), stages: p.stages, bags: p.bags, first: None }
    }

    /// Estimate of the time left, if each stage takes as long as those before. `within` is the finished
    /// share of stage `index`.
    fn time_left(&mut self, index: usize, within: f64) -> String {
        let first = *self.first.get_or_insert(index);
        let done = (index - first) as f64 + within;
        if done < 0.2 {
            return "time left unknown".into();
        }
        // A row of the ablation may have more bags than requested.
        let to_come = ((self.stages * self.bags) as f64 - first as f64 - done).max(0.0);
        let left = self.begin.elapsed().as_secs_f64() * to_come / done;
        if left >= 90.0 {
            format!("about {:.0} min left", left / 60.0)
        } else {
            format!("about {left:.0} s left")
        }
    }

    fn event(&mut self, name: &str, event: Progress<'_>, max_trees: usize) {
        match event {
            Progress::Stage { index, acceptance } => {
                self.bar.set_position(index as u64);
                let left = self.time_left(index, 0.0);
                self.bar.set_message(format!("{name}acceptance so far {acceptance:.1e}, {left}"));
            }
            Progress::Tree { stage, trees, false_alarm_rate } => {
                let left = self.time_left(stage, trees as f64 / max_trees as f64);
                let alarms = 100.0 * false_alarm_rate;
                self.bar.set_message(format!("{name}{trees} trees, {alarms:.0} % false alarms, {left}"));
            }
            Progress::Done { bag, cascade, figures } => {
                let done = bag * self.stages + cascade.stages.len();
                let bag = if self.bags > 1 || bag > 0 { format!("bag {}: ", bag + 1) } else { String::new() };
                let line = format!(
                    "{name}{bag}stage {} of {}: {} trees, {:.2} % hits, {:.1} % false alarms, acceptance {:.1e}",
                    cascade.stages.len(),
                    self.stages,
                    figures.trees,
                    100.0 * figures.hit_rate,
                    100.0 * figures.false_alarm_rate,
                    figures.acceptance
                );
                if self.bar.is_hidden() {
                    let left = self.time_left(done, 0.0);
                    eprintln!("{line}, {left}");
                } else {
                    self.bar.println(line);
                }
            }
        }
    }
}

/// Share of each folder that is held out to evaluate the ablation.
const HELD_OUT: f64 = 0.3;

/// The pictures of `--positives` and `--negatives`, split into training and validation.
struct Pictures {
    objects: Split,
    rest: Split,
}

impl Pictures {
    fn read(args: &Train, validation: f64) -> Result<Self, CommandError> {
        let objects = pictures::split(pictures::read(&args.positives)?, validation);
        let mut rest = Split::default();
        for folder in &args.negatives {
            let part = pictures::split(pictures::read(folder)?, validation);
            rest.training.extend(part.training);
            rest.validation.extend(part.validation);
        }
        Ok(Self { objects, rest })
    }
}

pub fn run(args: &Train, log: Option<&str>) -> Result<(), CommandError> {
    crate::logging::start("train", log.unwrap_or("info"));
    let p = parameters(args);
    if args.ablation {
        return print_ablation(args, &p);
    }
    let pictures = Pictures::read(args, p.validation)?;
    if args.sweep {
        return print_sweep(args, &p, &pictures);
    }
    let figures = train_cascade(args, &p, &pictures)?;
    if args.json {
        return say(serde_json::to_string_pretty(&figures)?);
    }
    print_figures(args, &figures)
}

/// `--ablation`: prints the table instead of writing a cascade.
fn print_ablation(args: &Train, p: &TrainParameters) -> Result<(), CommandError> {
    let mut rest = Vec::new();
    for folder in &args.negatives {
        rest.extend(pictures::read(folder)?);
    }
    let mut show = Show::new(p);
    let objects = pictures::read(&args.positives)?;
    let table = ablation::ablation(p, objects, rest, HELD_OUT, &mut |change, event| {
        show.event(&format!("{change}: "), event, p.stage.max_trees);
    })?;
    show.bar.finish_and_clear();
    if args.json { say(serde_json::to_string_pretty(&table)?) } else { say(table.text()) }
}

/// `--sweep`: prints the paper's tables instead of writing a cascade.
fn print_sweep(args: &Train, p: &TrainParameters, pictures: &Pictures) -> Result<(), CommandError> {
    let mut show = Show::new(p);
    let sweep = sweep::sweep(p, &pictures.objects, &pictures.rest, &mut |depth, event| {
        show.event(&format!("depth {depth}: "), event, p.stage.max_trees);
    })?;
    show.bar.finish_and_clear();
    if args.json { say(serde_json::to_string_pretty(&sweep)?) } else { say(sweep.text()) }
}

/// Trains a cascade, resuming from its checkpoint if there is one, and writes it with its report.
fn train_cascade(args: &Train, p: &TrainParameters, pictures: &Pictures) -> Result<Figures, CommandError> {
    let Pictures { objects, rest } = pictures;
    let mut show = Show::new(p);
    let with = TrainedWith {
        hit_rate: p.stage.hit_rate,
        false_alarm_rate: p.stage.false_alarm_rate,
        max_depth: p.stage.tree.max_depth,
        max_trees: u32::try_from(p.stage.max_trees * p.stages * p.bags).unwrap_or(u32::MAX),
    };
    let checkpoint = Checkpoint::new(&args.out, p, objects, rest);
    if args.restart {
        checkpoint.remove()?;
    }
    let begun = checkpoint.load()?.unwrap_or_default();
    if !begun.figures.is_empty() {
        eprintln!("resuming after stage {} of {}", begun.figures.len(), checkpoint.path().display());
    }
    let mut figures = begun.figures.clone();
    let mut failed = None;
    let mut kept = begun.clone();
    let cpu = messages::clock::process_cpu_ns();
    let trained = train(p, objects.clone(), rest.clone(), begun.cascades, &mut |event| {
        show.event("", event, p.stage.max_trees);
        if let Progress::Done { bag, cascade, figures } = event {
            kept.cascades.truncate(bag);
            kept.cascades.push(cascade.clone());
            kept.figures.push(*figures);
            failed = failed.take().or(checkpoint.save(&kept.cascades, &with, &kept.figures).err());
        }
    })?;
    show.bar.finish_and_clear();
    if let Some(error) = failed {
        // Not fatal: the cascade matters more than the checkpoint.
        tracing::warn!(%error, "the checkpoint could not be saved while training");
    }
    figures.extend(trained.stages);
    let cascade = trained.cascade;
    if cascade.stages.is_empty() {
        let text = "no stage could be trained: give more or larger pictures without objects";
        return Err(CommandError::Other(text.into()));
    }
    std::fs::write(&args.out, xml::write(&cascade, &with))
        .map_err(|e| CommandError::Other(format!("{}: {e}", args.out.display())))?;
    checkpoint.remove()?;
    let validation = if p.validation > 0.0 {
        let hits = detection::judge_all(&cascade, &objects.validation, p.threads);
        let alarms = detection::judge_all(&cascade, &rest.validation, p.threads);
        Some(detection::report(&hits, &alarms, cascade.stages.len())?)
    } else {
        None
    };
    if let Some(folder) = &args.report {
        report::write(folder, &cascade, &figures, validation.as_ref(), &objects.training)?;
    }
    Ok(Figures {
        positives: objects.training.len() + objects.validation.len(),
        negatives: rest.training.len() + rest.validation.len(),
        trees: cascade.trees(),
        exhausted: trained.exhausted,
        wall_s: show.begin.elapsed().as_secs_f64(),
        cpu_s: (messages::clock::process_cpu_ns() - cpu) as f64 * 1e-9,
        cascade_stages: cascade.stages.len(),
        stages: figures,
        validation,
    })
}

fn print_figures(args: &Train, figures: &Figures) -> Result<(), CommandError> {
    say(report::table(&figures.stages))?;
    if figures.exhausted {
        say("Training ended early: hardly any window without an object passes the stages so far.")?;
    }
    if let Some(v) = &figures.validation {
        say(format_args!(
            "on validation pictures: {:.2} % of {} objects detected, {:.2} % of {} negatives accepted",
            100.0 * v.hit_rate,
            v.positives,
            100.0 * v.false_alarm_rate,
            v.negatives
        ))?;
    }
    say(format_args!(
        "{}: {} stages, {} trees, {:.1} s, {:.1} s of processor time",
        args.out.display(),
        figures.cascade_stages,
        figures.trees,
        figures.wall_s,
        figures.cpu_s
    ))
}
