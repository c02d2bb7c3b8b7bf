//! The trainer: stages of boosted trees, each trained on the windows that the previous stages accept.

use super::augment::{self, Part, Sampling};
use super::bags;
use super::error::TrainError;
use super::features::{self, Codes, FeatureKind, Sums};
use super::finish::{self, Aim, ValidationMargins};
use super::mine::Miner;
use super::parameters::TrainParameters;
use super::pictures::{SourcePicture, Split};
use super::stage::{self, CodedSamples, InitialSums, Samples, StageParameters, TrainedStage};
use super::threads;
use super::tree::{Child, TreeNode};
use fastrand::Rng;
use perception::recognition::cascade::{Branch, Cascade, Features, Node, Stage};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Maximum number of trees in the first stage, which sees every window; each further stage may have twice as many
/// as the previous one, up to [`StageParameters::max_trees`].
const FIRST_TREES: usize = 16;

/// Statistics of a stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageFigures {
    /// Number of trees.
    pub trees: usize,
    /// Share of the validation objects accepted.
    pub hit_rate: f64,
    /// Share of the validation negatives that reached it and are accepted.
    pub false_alarm_rate: f64,
    /// Share of the training objects accepted.
    pub learned_hit_rate: f64,
    /// Share of the training negatives accepted.
    pub learned_false_alarm_rate: f64,
    /// Share of all negative windows that reached the stage.
    pub acceptance: f64,
    /// Number of negative training windows.
    pub negatives: usize,
}

impl StageFigures {
    fn of(stage: &TrainedStage, acceptance: f64, negatives: usize) -> Self {
        Self {
            trees: stage.trees.len(),
            hit_rate: stage.judged.0,
            false_alarm_rate: stage.judged.1,
            learned_hit_rate: stage.learned.0,
            learned_false_alarm_rate: stage.learned.1,
            acceptance,
            negatives,
        }
    }
}

/// Progress of training.
#[derive(Clone, Copy, Debug)]
pub enum Progress<'a> {
    /// A stage starts.
    Stage {
        /// Index over all bags, from 0.
        index: usize,
        /// Share of the negative windows that reach it.
        acceptance: f64,
    },
    /// A tree was added.
    Tree {
        /// Stage index over all bags.
        stage: usize,
        /// Number of trees so far.
        trees: usize,
        /// Share of the validation negatives accepted.
        false_alarm_rate: f64,
    },
    /// A stage is finished; the cascade so far can be saved.
    Done {
        /// Index of the bag, from 0.
        bag: usize,
        /// The cascade with all stages so far.
        cascade: &'a Cascade,
        /// Statistics of the stage.
        figures: &'a StageFigures,
    },
}

/// A trained cascade.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The cascade.
    pub cascade: Cascade,
    /// Statistics of the stages trained in this run.
    pub stages: Vec<StageFigures>,
    /// Whether training ended early because too few negative windows were left.
    pub exhausted: bool,
}

/// Windows of images as a whole: each in its original form, and augmented.
fn whole_windows(pictures: &[SourcePicture], p: &TrainParameters, variants: usize, salt: u64) -> Vec<Sums> {
    let window = (usize::from(p.window.0), usize::from(p.window.1));
    let made = threads::map(p.threads, pictures.len(), |i| {
        let view = pictures[i].grey.view();
        let mut random = Rng::with_seed(p.seed ^ salt ^ (i as u64) << 20);
        let mut out = Vec::new();
        (0..=variants)
            .map(|variant| {
                if variant == 0 {
                    augment::window(view, Part::whole(view), Sampling::Area, window, &mut out);
                } else {
                    augment::vary(view, Part::whole(view), &p.variation, &mut random, window, &mut out);
                }
                Sums::of(&out, p.window, p.features)
            })
            .filter(|sums| sums.is_valid)
            .collect::<Vec<_>>()
    });
    made.into_iter().flatten().collect()
}

fn sums_of(windows: &[Vec<u8>], p: &TrainParameters) -> Vec<Sums> {
    threads::map(p.threads, windows.len(), |i| Sums::of(&windows[i], p.window, p.features))
}

/// Trains a cascade. `begun` contains the cascades (one per bag, the last possibly incomplete) of an interrupted
/// run with the same parameters and images; training continues to the same result.
///
/// # Errors
/// When there are too few images.
pub fn train(
    p: &TrainParameters,
    objects: Split,
    rest: Split,
    begun: Vec<Cascade>,
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Trained, TrainError> {
    if p.bags > 1 && !p.stage.chained {
        let text = "cascades with unchained stages cannot be joined: give --bags 1, or omit --unchained";
        return Err(TrainError::Data(text.into()));
    }
    let mut result = Trained { cascade: Builder::new(p, None).cascade, stages: Vec::new(), exhausted: false };
    let mut cascades = begun;
    for bag in cascades.len().saturating_sub(1)..p.bags {
        let before = (cascades.len() > bag).then(|| cascades.split_off(bag)).and_then(|mut last| last.pop());
        let one = train_one(p, bag, &objects, &rest, before, progress)?;
        result.stages.extend(one.stages);
        result.exhausted |= one.exhausted;
        cascades.push(one.cascade);
    }
    let judging = |split: Split| if p.validation > 0.0 { split.validation } else { split.training };
    let (objects, rest) = (judging(objects), judging(rest));
    let varied = whole_windows(&objects, p, p.variants, 2);
    result.cascade = bags::join(cascades, p.stage.hit_rate, &varied).unwrap_or(result.cascade);
    let margins = |windows: &[Sums]| bags::margins(&result.cascade, windows, p.threads);
    let judged = match p.aim {
        Aim::AsTrained => ValidationMargins::default(),
        _ => ValidationMargins {
            objects: margins(&whole_windows(&objects, p, 0, 2)),
            rest: margins(&without_objects(&rest, p)),
            varied: margins(&varied),
        },
    };
    finish::finish(p.aim, p.early, &mut result.cascade.stages, &judged);
    Ok(result)
}

/// The patches among the images; random windows if there are no patches.
fn without_objects(pictures: &[SourcePicture], p: &TrainParameters) -> Vec<Sums> {
    let window = (usize::from(p.window.0), usize::from(p.window.1));
    let miner = Miner::new(pictures, window, p.variation, p.seed ^ 0x5EED);
    let patches: Vec<SourcePicture> = miner.patches().iter().map(|&i| pictures[i].clone()).collect();
    let windows = whole_windows(&patches, p, 0, 3);
    if windows.is_empty() {
        return sums_of(&miner.mine(&Builder::new(p, None).cascade, 0, p.negatives, p.threads).windows, p);
    }
    windows
}

/// Trains the cascade of one bag.
fn train_one(
    p: &TrainParameters,
    bag: usize,
    objects: &Split,
    rest: &Split,
    begun: Option<Cascade>,
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Trained, TrainError> {
    let p = &TrainParameters { seed: p.seed.wrapping_add(bag as u64), ..*p };
    let earlier = bag * p.stages;
    let window = (usize::from(p.window.0), usize::from(p.window.1));
    let all = p.features.all(p.window.0, p.window.1);
    let miner = Miner::new(&rest.training, window, p.variation, p.seed);
    let validation_miner = Miner::new(&rest.validation, window, p.variation, p.seed ^ 0x5EED);
    let held_out = p.validation > 0.0;
    check_pictures(p, objects, &miner, &validation_miner)?;
    let mut learned = whole_windows(&objects.training, p, p.variants, 1);
    let judges = whole_windows(&objects.validation, p, p.variants, 2);
    let mut builder = Builder::new(p, begun);
    let mut alive = vec![true; judges.len()];
    let mut figures = Vec::new();
    let mut exhausted = false;
    // When resuming: samples rejected by an existing stage are removed.
    for stage in &builder.cascade.stages.clone() {
        let single = Cascade { stages: vec![stage.clone()], ..builder.cascade.clone() };
        let passes = |s: &Sums| single.stages_passed(s.integral(), 0, 0) == Some(1);
        builder.reject(stage, &judges, &mut alive);
        learned.retain(passes);
    }
    while builder.cascade.stages.len() < p.stages {
        let index = builder.cascade.stages.len();
        let round = index as u64 + 1;
        let mined = miner.mine(&builder.cascade, round, p.negatives, p.threads);
        let acceptance = mined.acceptance();
        if mined.windows.len() < (p.negatives / 16).max(8) || learned.len() < 8 {
            exhausted = true;
            break;
        }
        progress(Progress::Stage { index: earlier + index, acceptance });
        let objects_now = learned.len();
        let rest_now = sums_of(&mined.windows, p);
        let rest_count = rest_now.len();
        let mut samples = std::mem::take(&mut learned);
        samples.extend(rest_now);
        let mut random = Rng::with_seed(p.seed ^ round << 48);
        let pool = features::draw(&all, p.pool, &mut random);
        let codes = Codes::new(&pool, &samples, p.threads);
        let judge_objects: Vec<Sums>;
        let judge_rest: Vec<Sums>;
        let judging = if held_out {
            let mined = validation_miner.mine(&builder.cascade, round, (p.negatives / 3).max(500), p.threads);
            judge_rest = sums_of(&mined.windows, p);
            judge_objects = judges.iter().zip(&alive).filter(|(_, a)| **a).map(|(j, _)| j.clone()).collect();
            Samples { objects: &judge_objects, rest: &judge_rest }
        } else {
            Samples { objects: &samples[..objects_now], rest: &samples[objects_now..] }
        };
        let mut each = |trees, false_alarm_rate| {
            progress(Progress::Tree { stage: earlier + index, trees, false_alarm_rate });
        };
        let begin = InitialSums {
            learned: builder.sums(&samples, p),
            judged_objects: builder.sums(judging.objects, p),
            judged_rest: builder.sums(judging.rest, p),
        };
        let limits =
            StageParameters { max_trees: p.stage.max_trees.min(FIRST_TREES << index.min(16)), ..p.stage };
        let coded = CodedSamples { features: &pool, codes: &codes, objects: objects_now };
        let trained =
            stage::train(&limits, coded, judging, begin, p.threads, &mut each).ok_or_else(|| {
                TrainError::Data(format!(
                    "stage {index}: no feature separates objects from background: are the folders right?"
                ))
            })?;
        let stage_figures = StageFigures::of(&trained, acceptance, rest_count);
        builder.push(&trained, &pool, p.stage.chained);
        samples.truncate(objects_now);
        learned = samples;
        let mut kept = trained.learned_sums.iter().map(|&s| stage::passes(s, trained.threshold));
        learned.retain(|_| kept.next().unwrap_or(false));
        if let Some(stage) = builder.cascade.stages.last() {
            builder.reject(stage, &judges, &mut alive);
        }
        progress(Progress::Done { bag, cascade: &builder.cascade, figures: &stage_figures });
        figures.push(stage_figures);
    }
    Ok(Trained { cascade: builder.cascade, stages: figures, exhausted })
}

/// Checks that there are images of both classes for training and, if held out, for validation.
fn check_pictures(
    p: &TrainParameters,
    objects: &Split,
    miner: &Miner<'_>,
    validation_miner: &Miner<'_>,
) -> Result<(), TrainError> {
    let held_out = p.validation > 0.0;
    if objects.training.is_empty() || held_out && objects.validation.is_empty() {
        let text =
            "too few images of objects to train on some and validate on others: give more, or --validation 0";
        return Err(TrainError::Data(text.into()));
    }
    if miner.is_empty() || held_out && validation_miner.is_empty() {
        let text = format!(
            "too few images without objects of at least {}x{} pixels to train on some and validate on others: give more",
            p.window.0, p.window.1
        );
        return Err(TrainError::Data(text));
    }
    Ok(())
}

/// Assembles a cascade from stages over changing feature pools.
struct Builder {
    cascade: Cascade,
}

impl Builder {
    fn new(p: &TrainParameters, begun: Option<Cascade>) -> Self {
        let features = match p.features {
            FeatureKind::Lbp => Features::Lbp(Vec::new()),
            _ => Features::Haar(Vec::new()),
        };
        let empty = Cascade { width: p.window.0, height: p.window.1, features, stages: Vec::new() };
        Self { cascade: begun.unwrap_or(empty) }
    }

    /// Clears the flags in `alive` of the samples that a stage rejects.
    fn reject(&self, stage: &Stage, samples: &[Sums], alive: &mut [bool]) {
        for (alive, sample) in alive.iter_mut().zip(samples) {
            *alive &= stage::passes(bags::sum(&self.cascade, stage, sample), stage.threshold);
        }
    }

    /// Sums that samples start the next stage with.
    fn sums(&self, samples: &[Sums], p: &TrainParameters) -> Vec<f64> {
        match self.cascade.stages.last().filter(|_| p.stage.chained) {
            Some(stage) => {
                const RUN: usize = 256;
                let runs = threads::map(p.threads, samples.len().div_ceil(RUN), |run| {
                    let part = &samples[run * RUN..samples.len().min((run + 1) * RUN)];
                    part.iter().map(|s| bags::sum(&self.cascade, stage, s)).collect::<Vec<f64>>()
                });
                runs.into_iter().flatten().collect()
            }
            None => vec![0.0; samples.len()],
        }
    }

    fn push(&mut self, trained: &TrainedStage, pool: &Features, chained: bool) {
        // Pool features that are already in the cascade.
        let mut names: HashMap<usize, u32> = HashMap::new();
        let features = &mut self.cascade.features;
        let trees = trained.trees.iter().map(|tree| {
            let nodes = tree.iter().map(|node: &TreeNode| {
                let branch = |child: Child| match child {
                    Child::Node(n) => Branch::Node(n as u16),
                    Child::Leaf(value) => Branch::Leaf(value),
                };
                Node {
                    feature: *names
                        .entry(node.feature)
                        .or_insert_with(|| features::add(features, pool, node.feature)),
                    split: node.split,
                    left: branch(node.children[0]),
                    right: branch(node.children[1]),
                }
            });
            nodes.collect()
        });
        let before = self.cascade.stages.last().filter(|_| chained).map(|s| s.trees.clone());
        let trees = before.unwrap_or_default().into_iter().chain(trees).collect();
        self.cascade.stages.push(Stage { threshold: trained.threshold, trees });
    }
}
