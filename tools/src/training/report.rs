//! Training report: stages as table and plot, ROC on validation images, and the chosen features drawn on the mean
//! object.

use super::augment::{Part, Sampling, window};
use super::error::TrainError;
use super::pictures::SourcePicture;
use super::trainer::StageFigures;
use crate::evaluation::detection::DetectionReport;
use crate::reporting::picture::{Colour, Picture};
use crate::reporting::plot::{self, Series};
use perception::recognition::cascade::{Cascade, Features};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::Path;

/// Magnification of the drawing.
const ZOOM: usize = 6;

/// Number of features drawn, taken in turn from the first stages.
const DRAWN: usize = 24;

const BRIGHT: Colour = [90, 230, 120];
const DARK: Colour = [255, 90, 60];
const CENTRE: Colour = [255, 210, 60];

#[derive(Serialize)]
struct Document<'a> {
    stages: &'a [StageFigures],
    validation: Option<&'a DetectionReport>,
}

/// The stages as a text table.
pub fn table(stages: &[StageFigures]) -> String {
    let mut out = String::from(
        "stage  trees  hits %  false alarms %  learned: hits %  false alarms %  reached by  negatives\n",
    );
    for (i, s) in stages.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = writeln!(
            out,
            "{i:>5} {:>6} {:>7.2} {:>15.2} {:>16.2} {:>15.2} {:>11.2e} {:>10}",
            s.trees,
            100.0 * s.hit_rate,
            100.0 * s.false_alarm_rate,
            100.0 * s.learned_hit_rate,
            100.0 * s.learned_false_alarm_rate,
            s.acceptance,
            s.negatives
        );
    }
    out
}

/// Least rate of false alarms that the ROC shows, in percent: a few windows of a thousand are what matters.
const MIN_ROC_PERCENT: f64 = 0.01;

/// The ROC as a plot, with both axes in percent; false alarms are logarithmic.
pub fn roc_plot(title: &str, report: &DetectionReport) -> Picture {
    let points = |least: f64| {
        let points = report.roc.iter().filter(|p| p.false_alarm_rate <= least);
        points.map(|p| (100.0 * p.false_alarm_rate, 100.0 * p.hit_rate)).collect()
    };
    let by_stage = report.stages.iter().map(|p| (100.0 * p.false_alarm_rate, 100.0 * p.hit_rate)).collect();
    plot::lines_over_log(
        title,
        "false alarms in %",
        "% hits",
        MIN_ROC_PERCENT,
        &[
            Series { name: "thresholds shifted".into(), points: points(1.0) },
            Series { name: "stage by stage".into(), points: by_stage },
        ],
    )
}

/// Writes `training.json`, `stages.txt`, `stages.png`, `features.png` and, given a report on validation images,
/// `roc.png` to a folder.
///
/// # Errors
/// When they cannot be written.
pub fn write(
    folder: &Path,
    cascade: &Cascade,
    stages: &[StageFigures],
    validation: Option<&DetectionReport>,
    objects: &[SourcePicture],
) -> Result<(), TrainError> {
    let io = |path: &Path, error: &dyn std::fmt::Display| {
        TrainError::Data(format!("{}: {error}: give a writable folder", path.display()))
    };
    std::fs::create_dir_all(folder).map_err(|e| io(folder, &e))?;
    let path = folder.join("training.json");
    let text = serde_json::to_string_pretty(&Document { stages, validation }).map_err(|e| io(&path, &e))?;
    std::fs::write(&path, text).map_err(|e| io(&path, &e))?;
    let path = folder.join("stages.txt");
    std::fs::write(&path, table(stages)).map_err(|e| io(&path, &e))?;
    let series = |name: &str, value: &dyn Fn(&StageFigures) -> f64| Series {
        name: name.into(),
        points: stages.iter().enumerate().map(|(i, s)| (i as f64, 100.0 * value(s))).collect(),
    };
    plot::lines(
        "Stages",
        "stage",
        "%",
        &[
            series("hits", &|s| s.hit_rate),
            series("false alarms", &|s| s.false_alarm_rate),
            series("learned false alarms", &|s| s.learned_false_alarm_rate),
        ],
    )
    .save(&folder.join("stages.png"))?;
    if let Some(report) = validation {
        roc_plot("ROC on validation images", report).save(&folder.join("roc.png"))?;
    }
    draw_features(cascade, objects).save(&folder.join("features.png"))?;
    Ok(())
}

/// The mean of the objects, resized to the window.
fn mean_patch(objects: &[SourcePicture], size: (usize, usize)) -> Vec<u8> {
    let mut sums = vec![0_u64; size.0 * size.1];
    let mut pixels = Vec::new();
    for picture in objects {
        let view = picture.grey.view();
        window(view, Part::whole(view), Sampling::Area, size, &mut pixels);
        sums.iter_mut().zip(&pixels).for_each(|(sum, &v)| *sum += u64::from(v));
    }
    sums.iter().map(|&sum| (sum / objects.len().max(1) as u64) as u8).collect()
}

/// The first features of each stage in turn, each drawn on the mean object.
fn draw_features(cascade: &Cascade, objects: &[SourcePicture]) -> Picture {
    let (width, height) = (usize::from(cascade.width), usize::from(cascade.height));
    let mean = mean_patch(objects, (width, height));
    let per_stage = DRAWN.div_ceil(cascade.stages.len().max(1));
    let chosen: Vec<u32> = cascade
        .stages
        .iter()
        .flat_map(|s| s.trees.iter().take(per_stage).filter_map(|tree| tree.first()))
        .map(|node| node.feature)
        .take(DRAWN)
        .collect();
    let columns = 8.min(chosen.len()).max(1);
    let cell = (width * ZOOM + 8, height * ZOOM + 8);
    let rows = chosen.len().div_ceil(columns).max(1);
    let mut picture = Picture::new(columns * cell.0, rows * cell.1, [16, 16, 16]);
    for (i, &feature) in chosen.iter().enumerate() {
        let (left, top) = (i % columns * cell.0, i / columns * cell.1);
        for y in 0..height * ZOOM {
            for x in 0..width * ZOOM {
                let v = mean[y / ZOOM * width + x / ZOOM];
                picture.fill([(left + x) as i32, (top + y) as i32, 1, 1], [v; 3]);
            }
        }
        let at =
            |x: u16, y: u16| ((left + usize::from(x) * ZOOM) as i32, (top + usize::from(y) * ZOOM) as i32);
        let mut frame = |x: u16, y: u16, w: u16, h: u16, colour| {
            let (x, y) = at(x, y);
            let side = |v: u16| u32::from(v) * ZOOM as u32;
            picture.frame([x as u32, y as u32, side(w), side(h)], colour, 1);
        };
        match &cascade.features {
            Features::Lbp(features) => {
                let f = &features[feature as usize];
                for j in 0..3 {
                    for i in 0..3 {
                        let colour = if (i, j) == (1, 1) { CENTRE } else { BRIGHT };
                        frame(f.x + i * f.width, f.y + j * f.height, f.width, f.height, colour);
                    }
                }
            }
            Features::Haar(features) => {
                let f = &features[feature as usize];
                for r in f.rects() {
                    let colour = if r.weight > 0.0 { BRIGHT } else { DARK };
                    if f.tilted {
                        let corners = [
                            at(r.x, r.y),
                            at(r.x + r.width, r.y + r.width),
                            at(r.x + r.width - r.height, r.y + r.width + r.height),
                            at(r.x - r.height, r.y + r.height),
                        ];
                        for i in 0..4 {
                            picture.line(corners[i], corners[(i + 1) % 4], colour, 1);
                        }
                    } else {
                        let (x, y) = at(r.x, r.y);
                        let side = |v: u16| u32::from(v) * ZOOM as u32;
                        picture.frame([x as u32, y as u32, side(r.width), side(r.height)], colour, 1);
                    }
                }
            }
        }
    }
    picture
}
