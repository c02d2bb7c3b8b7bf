//! Ablation study of the trainer: the full recipe, and the recipe without each of its measures, evaluated on
//! held-out images.

use super::augment::Variation;
use super::error::TrainError;
use super::parameters::TrainParameters;
use super::pictures::{self, SourcePicture};
use super::trainer::{Progress, train};
use crate::evaluation::detection::{judge_all, report};
use serde::Serialize;
use std::fmt::Write as _;
use std::time::Instant;

/// A row of the table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AblationRow {
    /// Change to the recipe.
    pub change: &'static str,
    /// Number of trained stages.
    pub stages: usize,
    /// Number of trees in them.
    pub trees: usize,
    /// Share of the held-out positives accepted, at the trained thresholds.
    pub hit_rate: f64,
    /// Share of the held-out negatives accepted, at the trained thresholds.
    pub false_alarm_rate: f64,
    /// Mean of the correctly classified shares.
    pub balanced_accuracy: f64,
    /// Hit rate at 1 % false alarms, with all thresholds shifted together.
    pub hit_rate_at_1_percent: f64,
    /// The same at 2 %.
    pub hit_rate_at_2_percent: f64,
    /// Area under the ROC curve.
    pub area: f64,
    /// Training time in seconds.
    pub seconds: f64,
}

/// The table.
#[derive(Clone, Debug, Serialize)]
pub struct Ablation {
    /// Number of held-out positives.
    pub positives: usize,
    /// Number of held-out negatives.
    pub negatives: usize,
    /// Rows, the unchanged recipe first.
    pub rows: Vec<AblationRow>,
}

/// A change to the recipe.
type Change = (&'static str, fn(&mut TrainParameters));

/// The changes, each applied on its own.
const CHANGES: [Change; 11] = [
    ("as asked for", |_| {}),
    ("nothing varied", |p| {
        p.variants = 0;
        p.variation = Variation::NONE;
    }),
    ("varied half as much", |p| p.variation = p.variation.times(0.5)),
    ("each stage from nothing", |p| (p.stage.chained, p.bags) = (false, 1)),
    ("one bag, or three for one", |p| p.bags = if p.bags == 1 { 3 } else { 1 }),
    ("trees count in full", |p| p.stage.learning_rate = 1.0),
    ("no prior of leaves", |p| p.stage.tree.leaf_prior = 0.0),
    ("no prior of codes", |p| p.stage.tree.category_prior = 0.0),
    ("leaves of any weight", |p| p.stage.tree.min_leaf = 0.0),
    ("judged by what was learned", |p| p.validation = 0.0),
    ("a quarter of the rest", |p| p.negatives = (p.negatives / 4).max(16)),
];

/// Trains one cascade per change. The last share `held_out` of each folder is used for evaluation; of the
/// remainder, the recipe's validation share validates stages as usual.
///
/// # Errors
/// When there are too few images.
pub fn ablation(
    p: &TrainParameters,
    objects: Vec<Vec<SourcePicture>>,
    rest: Vec<Vec<SourcePicture>>,
    held_out: f64,
    progress: &mut dyn FnMut(&str, Progress<'_>),
) -> Result<Ablation, TrainError> {
    let (objects, judged_objects) = pictures::hold_out(objects, held_out);
    let (rest, judged_rest) = pictures::hold_out(rest, held_out);
    let mut result =
        Ablation { positives: judged_objects.len(), negatives: judged_rest.len(), rows: Vec::new() };
    for (change, apply) in CHANGES {
        let mut p = *p;
        apply(&mut p);
        let begin = Instant::now();
        let split = |sequences: &[Vec<SourcePicture>]| pictures::split(sequences.to_vec(), p.validation);
        let trained =
            train(&p, split(&objects), split(&rest), Vec::new(), &mut |event| progress(change, event))?;
        let cascade = trained.cascade;
        let hits = judge_all(&cascade, &judged_objects, p.threads);
        let alarms = judge_all(&cascade, &judged_rest, p.threads);
        let figures = report(&hits, &alarms, cascade.stages.len())?;
        result.rows.push(AblationRow {
            change,
            stages: cascade.stages.len(),
            trees: cascade.trees(),
            hit_rate: figures.hit_rate,
            false_alarm_rate: figures.false_alarm_rate,
            balanced_accuracy: figures.balanced_accuracy,
            hit_rate_at_1_percent: figures.hit_rate_at_1_percent,
            hit_rate_at_2_percent: figures.hit_rate_at_2_percent,
            area: figures.area,
            seconds: begin.elapsed().as_secs_f64(),
        });
    }
    Ok(result)
}

impl Ablation {
    /// The table as text.
    pub fn text(&self) -> String {
        let mut out = format!(
            "evaluated on {} held-out objects and {} others\n\
             change                      stages  trees  hits %  false alarms %  balanced %  hits at 1 %  at 2 %    area      s\n",
            self.positives, self.negatives
        );
        for r in &self.rows {
            // Writing to a String cannot fail.
            let _ = writeln!(
                out,
                "{:<27} {:>6} {:>6} {:>7.1} {:>15.2} {:>11.1} {:>12.1} {:>7.1} {:>7.4} {:>6.0}",
                r.change,
                r.stages,
                r.trees,
                100.0 * r.hit_rate,
                100.0 * r.false_alarm_rate,
                100.0 * r.balanced_accuracy,
                100.0 * r.hit_rate_at_1_percent,
                100.0 * r.hit_rate_at_2_percent,
                r.area,
                r.seconds
            );
        }
        out
    }
}
