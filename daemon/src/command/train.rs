//! `lookout train`.

use super::{CommandError, say};
use crate::cli_cascade::{FeatureChoice, Train};
use indicatif::{ProgressBar, ProgressStyle};
use perception::recognition::xml::{self, TrainedWith};
use serde::Serialize;
use std::io::IsTerminal;
use std::time::Instant;
use tools::evaluation::detection::{self, DetectionReport};
use tools::training::checkpoint::Checkpoint;
use tools::training::finish::Aim;
use tools::training::pictures::{self, Split};
use tools::training::{FeatureKind, Progress, StageFigures, TrainParameters, ablation, report, sweep, train};

#[derive(Serialize)]
struct Figures {
    positives: usize,
    negatives: usize,
    stages: Vec<StageFigures>,
    trees: usize,
    /// Hardly any window without object was left before all stages were trained.
    exhausted: bool,
    wall_s: f64,
    cpu_s: f64,
    validation: Option<DetectionReport>,
}

fn parameters(args: &Train) -> TrainParameters {
    let mut p = TrainParameters::usual(match args.features {
        FeatureChoice::Lbp => FeatureKind::Lbp,
        FeatureChoice::Haar => FeatureKind::Haar,
        FeatureChoice::HaarTilted => FeatureKind::HaarTilted,
    });
    fn set<T>(place: &mut T, value: Option<impl Into<T>>) {
        if let Some(value) = value {
            *place = value.into();
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

/// Shows what happens: a bar on a terminal, a line per stage anywhere.
struct Show {
    bar: ProgressBar,
    begin: Instant,
    /// Of each bag.
    stages: usize,
    bags: usize,
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

    /// Stages take about as long as those before; `within` is how much of stage `index` is done.
    fn left(&mut self, index: usize, within: f64) -> String {
        let first = *self.first.get_or_insert(index);
        let done = (index - first) as f64 + within;
        if done < 0.2 {
            return "time left unknown".into();
        }
        // A row of the ablation may have more bags than were asked for.
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
                let left = self.left(index, 0.0);
                self.bar.set_message(format!("{name}reached by {acceptance:.1e}, {left}"));
            }
            Progress::Tree { stage, trees, false_alarm_rate } => {
                let left = self.left(stage, trees as f64 / max_trees as f64);
                let alarms = 100.0 * false_alarm_rate;
                self.bar.set_message(format!("{name}{trees} trees, {alarms:.0} % false alarms, {left}"));
            }
            Progress::Done { bag, cascade, figures } => {
                let done = bag * self.stages + cascade.stages.len();
                let bag = if self.bags > 1 || bag > 0 { format!("bag {}: ", bag + 1) } else { String::new() };
                let line = format!(
                    "{name}{bag}stage {} of {}: {} trees, {:.2} % hits, {:.1} % false alarms, reached by {:.1e}",
                    cascade.stages.len(),
                    self.stages,
                    figures.trees,
                    100.0 * figures.hit_rate,
                    100.0 * figures.false_alarm_rate,
                    figures.acceptance
                );
                if self.bar.is_hidden() {
                    let left = self.left(done, 0.0);
                    eprintln!("{line}, {left}");
                } else {
                    self.bar.println(line);
                }
            }
        }
    }
}

/// Share of each folder that judges the ablation.
const HELD_OUT: f64 = 0.3;

fn ablation_table(args: &Train, p: &TrainParameters) -> Result<(), CommandError> {
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

pub fn run(args: &Train, log: Option<&str>) -> Result<(), CommandError> {
    crate::logging::start("train", log.unwrap_or("info"));
    let p = parameters(args);
    if args.ablation {
        return ablation_table(args, &p);
    }
    let objects = pictures::split(pictures::read(&args.positives)?, p.validation);
    let mut rest = Split::default();
    for folder in &args.negatives {
        let part = pictures::split(pictures::read(folder)?, p.validation);
        rest.training.extend(part.training);
        rest.validation.extend(part.validation);
    }
    let mut show = Show::new(&p);
    if args.sweep {
        let sweep = sweep::sweep(&p, &objects, &rest, &mut |depth, event| {
            show.event(&format!("depth {depth}: "), event, p.stage.max_trees);
        })?;
        show.bar.finish_and_clear();
        return if args.json { say(serde_json::to_string_pretty(&sweep)?) } else { say(sweep.text()) };
    }
    let with = TrainedWith {
        hit_rate: p.stage.hit_rate,
        false_alarm_rate: p.stage.false_alarm_rate,
        max_depth: p.stage.tree.max_depth,
        max_trees: u32::try_from(p.stage.max_trees * p.stages * p.bags).unwrap_or(u32::MAX),
    };
    let checkpoint = Checkpoint::new(&args.out, &p, &objects, &rest);
    if args.restart {
        checkpoint.remove()?;
    }
    let begun = checkpoint.load()?.unwrap_or_default();
    if !begun.figures.is_empty() {
        eprintln!("going on after stage {} of {}", begun.figures.len(), checkpoint.path().display());
    }
    let mut figures = begun.figures.clone();
    let (positives, negatives) =
        (objects.training.len() + objects.validation.len(), rest.training.len() + rest.validation.len());
    let mut failed = None;
    let mut kept = begun.clone();
    let cpu = messages::clock::process_cpu_ns();
    let trained = train(&p, objects.clone(), rest.clone(), begun.cascades, &mut |event| {
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
        // Training went on without: the cascade matters more than the checkpoint.
        tracing::warn!(%error, "the stages could not be kept while training");
    }
    figures.extend(trained.stages);
    let cascade = trained.cascade;
    if cascade.stages.is_empty() {
        let text = "not one stage could be trained: give more or larger pictures without objects";
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
    let result = Figures {
        positives,
        negatives,
        trees: cascade.trees(),
        exhausted: trained.exhausted,
        wall_s: show.begin.elapsed().as_secs_f64(),
        cpu_s: (messages::clock::process_cpu_ns() - cpu) as f64 * 1e-9,
        stages: figures,
        validation,
    };
    if args.json {
        return say(serde_json::to_string_pretty(&result)?);
    }
    say(report::table(&result.stages))?;
    if result.exhausted {
        say("It ended early: hardly any window without object passes the stages it has.")?;
    }
    if let Some(v) = &result.validation {
        say(format_args!(
            "on validation pictures: {:.2} % of {} objects found, {:.2} % of {} others taken for one",
            100.0 * v.hit_rate,
            v.positives,
            100.0 * v.false_alarm_rate,
            v.negatives
        ))?;
    }
    say(format_args!(
        "{}: {} stages, {} trees, {:.1} s, {:.1} s of processor time",
        args.out.display(),
        cascade.stages.len(),
        result.trees,
        result.wall_s,
        result.cpu_s
    ))
}
