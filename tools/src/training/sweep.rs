//! The paper's two tables: accuracy and time by number of stages and tree depth, and by scale factor and window
//! size.

use super::augment::{Part, Sampling, window};
use super::error::TrainError;
use super::parameters::TrainParameters;
use super::pictures::{SourcePicture, Split};
use super::trainer::{Progress, train};
use crate::evaluation::detection::{judge_all, report};
use perception::image::GreyView;
use perception::recognition::{Cascade, Detector, Sizes};
use serde::Serialize;
use std::fmt::Write as _;
use std::time::Instant;

/// Size of the image for time measurements.
const SIZE: (usize, usize) = (640, 480);

/// Tree depths of the table.
const DEPTHS: [u32; 3] = [1, 2, 3];

/// Scale factors of the table.
const GROWTHS: [f64; 5] = [1.1, 1.2, 1.3, 1.4, 1.5];

/// Minimum and maximum window of the table, in pixels.
const WINDOWS: [(u32, u32); 3] = [(24, 90), (30, 90), (40, 120)];

/// A row of the first table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StageRow {
    /// Maximum depth of trees.
    pub max_depth: u32,
    /// Number of stages used.
    pub stages: usize,
    /// Number of trees in them.
    pub trees: usize,
    /// Share of the validation objects accepted.
    pub hit_rate: f64,
    /// Share of the validation negatives accepted.
    pub false_alarm_rate: f64,
    /// Mean of the correctly classified shares.
    pub balanced_accuracy: f64,
    /// Time for an image of 640 × 480 pixels in ms, with windows of 30 to 90 px and scale factor 1.3.
    pub ms: f64,
}

/// A row of the second table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WindowRow {
    /// Scale factor from one window size to the next.
    pub growth: f64,
    /// Minimum window side, in pixels.
    #[serde(rename = "least_px")]
    pub min_px: u32,
    /// Maximum window side, in pixels.
    #[serde(rename = "greatest_px")]
    pub max_px: u32,
    /// Share of the validation objects with at least one accepted window.
    pub hit_rate: f64,
    /// Share of the validation negatives with at least one accepted window.
    pub false_alarm_rate: f64,
    /// Mean of the correctly classified shares.
    pub balanced_accuracy: f64,
    /// Time for an image of 640 × 480 pixels, in ms.
    pub ms: f64,
}

/// Both tables.
#[derive(Clone, Debug, Serialize)]
pub struct Sweep {
    /// By number of stages and depth.
    pub stages: Vec<StageRow>,
    /// By scale factor and window, with the requested depth and all stages.
    pub windows: Vec<WindowRow>,
}

/// Validation negatives tiled to one image.
fn mosaic(pictures: &[SourcePicture]) -> Vec<u8> {
    const TILE: usize = 80;
    let mut pixels = vec![0; SIZE.0 * SIZE.1];
    let mut tile = Vec::new();
    for (i, picture) in pictures.iter().cycle().take(SIZE.0 * SIZE.1 / (TILE * TILE)).enumerate() {
        let view = picture.grey.view();
        window(view, Part::whole(view), Sampling::Bilinear, (TILE, TILE), &mut tile);
        let (left, top) = (i % (SIZE.0 / TILE) * TILE, i / (SIZE.0 / TILE) * TILE);
        for (y, row) in tile.chunks_exact(TILE).enumerate() {
            pixels[(top + y) * SIZE.0 + left..][..TILE].copy_from_slice(row);
        }
    }
    pixels
}

/// Minimum time of several runs over an image, in milliseconds.
fn time(cascade: &Cascade, pixels: &[u8], sizes: Sizes) -> f64 {
    let Ok(view) = GreyView::new(pixels, SIZE.0, SIZE.1, SIZE.0) else { return f64::NAN };
    let mut detector = Detector::new(cascade, SIZE.0, SIZE.1);
    let mut least = f64::INFINITY;
    for _ in 0..5 {
        let begin = Instant::now();
        detector.detect(view, sizes, 3);
        least = least.min(begin.elapsed().as_secs_f64() * 1e3);
    }
    least
}

/// Trains a cascade for each depth and evaluates it stage by stage, then scans with the one of the requested
/// depth.
///
/// # Errors
/// When there are too few images.
pub fn sweep(
    p: &TrainParameters,
    objects: &Split,
    rest: &Split,
    progress: &mut dyn FnMut(u32, Progress<'_>),
) -> Result<Sweep, TrainError> {
    let pixels = mosaic(&rest.validation);
    let mut result = Sweep { stages: Vec::new(), windows: Vec::new() };
    let mut asked: Option<Cascade> = None;
    let depths =
        DEPTHS.into_iter().chain([p.stage.tree.max_depth].into_iter().filter(|d| !DEPTHS.contains(d)));
    for max_depth in depths {
        let mut p = *p;
        p.stage.tree.max_depth = max_depth;
        let trained =
            train(&p, objects.clone(), rest.clone(), Vec::new(), &mut |event| progress(max_depth, event))?;
        let cascade = trained.cascade;
        let hits = judge_all(&cascade, &objects.validation, p.threads);
        let alarms = judge_all(&cascade, &rest.validation, p.threads);
        let figures = report(&hits, &alarms, cascade.stages.len())?;
        for (i, point) in figures.stages.iter().enumerate() {
            let part = Cascade { stages: cascade.stages[..=i].to_vec(), ..cascade.clone() };
            result.stages.push(StageRow {
                max_depth,
                stages: i + 1,
                trees: part.trees(),
                hit_rate: point.hit_rate,
                false_alarm_rate: point.false_alarm_rate,
                balanced_accuracy: (point.hit_rate + 1.0 - point.false_alarm_rate) / 2.0,
                ms: time(&part, &pixels, Sizes::default()),
            });
        }
        if max_depth == p.stage.tree.max_depth && asked.is_none() || max_depth == 2 && asked.is_none() {
            asked = Some(cascade);
        }
    }
    let Some(cascade) = asked else { return Ok(result) };
    for (min_px, max_px) in WINDOWS {
        for growth in GROWTHS {
            let sizes = Sizes::Range { min_px, max_px, growth };
            let found = |pictures: &[SourcePicture]| {
                let hits = super::threads::map(p.threads, pictures.len(), |i| {
                    let view = pictures[i].grey.view();
                    let mut detector = Detector::new(&cascade, view.width(), view.height());
                    !detector.detect(view, sizes, 0).is_empty()
                });
                hits.iter().filter(|h| **h).count() as f64 / pictures.len().max(1) as f64
            };
            let (hit_rate, false_alarm_rate) = (found(&objects.validation), found(&rest.validation));
            result.windows.push(WindowRow {
                growth,
                min_px,
                max_px,
                hit_rate,
                false_alarm_rate,
                balanced_accuracy: (hit_rate + 1.0 - false_alarm_rate) / 2.0,
                ms: time(&cascade, &pixels, sizes),
            });
        }
    }
    Ok(result)
}

impl Sweep {
    /// Both tables as text.
    pub fn text(&self) -> String {
        let mut out = String::from("depth  stages  trees  hits %  false alarms %  balanced %  ms\n");
        // Writing to a String cannot fail.
        for r in &self.stages {
            let _ = writeln!(
                out,
                "{:>5} {:>7} {:>6} {:>7.1} {:>15.2} {:>11.1} {:>5.1}",
                r.max_depth,
                r.stages,
                r.trees,
                100.0 * r.hit_rate,
                100.0 * r.false_alarm_rate,
                100.0 * r.balanced_accuracy,
                r.ms
            );
        }
        out.push_str("\ngrowth  window px  hits %  false alarms %  balanced %  ms\n");
        for r in &self.windows {
            let _ = writeln!(
                out,
                "{:>6} {:>10} {:>7.1} {:>15.2} {:>11.1} {:>5.1}",
                r.growth,
                format!("{}-{}", r.min_px, r.max_px),
                100.0 * r.hit_rate,
                100.0 * r.false_alarm_rate,
                100.0 * r.balanced_accuracy,
                r.ms
            );
        }
        out
    }
}
