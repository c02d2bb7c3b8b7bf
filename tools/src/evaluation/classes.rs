//! Classes of obstacles in synthetic scenes: recall and wrong labels by class, how true the probabilities are, and the
//! calibration of each detector's scores.

use super::scene_match::{Detection, is_evaluable, is_match, shared_area};
use crate::reporting::record::{ObstacleLine, tidy, tidy_finite};
use perception::recognition::{Calibration, Recognition};
use serde::Serialize;
use sources::scene::{ObjectClass, ObjectTruth, SceneTruth};
use std::fmt;

/// Iterations of Newton's method for the logistic fit; it converges in about ten.
const ITERATIONS: usize = 50;

/// Weight of a prior that draws offset and slope to 0, so that classes which never overlap have a finite fit: that of one
/// thousandth of a look.
const RIDGE: f64 = 1e-3;

/// Counts added to both sides of a share before its logarithm.
const SMOOTHING: f64 = 0.5;

/// Bins of told probabilities, from 0.5 to 1.
const BINS: usize = 5;

/// The label of what no detector knows.
const OTHER: &str = "other";

/// Share of a region's box that may lie within the box of a vehicle, a pedestrian or a rider if the region is an example of
/// something else.
const MAX_SHARED: f64 = 0.1;

/// The label that is right for an object; `other` for what no shipped detector knows.
pub fn right_label(class: ObjectClass) -> &'static str {
    match class {
        ObjectClass::Car | ObjectClass::Bus | ObjectClass::Lorry => "vehicle",
        ObjectClass::Pedestrian => "pedestrian",
        ObjectClass::Bicycle | ObjectClass::Motorcycle => "rider",
        _ => OTHER,
    }
}

/// The right label of a region: that of the object that it overlaps most, among those at its place.
pub fn region_label(truth: &SceneTruth, region: &Detection) -> &'static str {
    let there = truth.objects.iter().filter(|object| is_match(object, region));
    let most =
        there.max_by(|a, b| region.bounds.overlap(&a.bounds).total_cmp(&region.bounds.overlap(&b.bounds)));
    most.map_or(OTHER, |object| right_label(object.class))
}

/// The label of a region as an example to learn from; `None` where it is unclear, because it shows part of an object of
/// another label.
pub fn example_label(truth: &SceneTruth, region: &Detection) -> Option<&'static str> {
    let label = region_label(truth, region);
    let area = f64::from(region.bounds.width) * f64::from(region.bounds.height);
    let covers = |object: &ObjectTruth| {
        let own = right_label(object.class);
        own != OTHER && own != label && shared_area(&region.bounds, &object.bounds) > MAX_SHARED * area
    };
    (!truth.objects.iter().any(covers)).then_some(label)
}

/// Length of an object, in metres: so far behind its near side its parts may lie.
const LENGTH_M: f64 = 5.0;

/// Whether a region is part of an object with this label: at least half of its box lies within the object's, between its near side
/// (15 % or 1 m before it) and its far one.
fn is_part(truth: &SceneTruth, region: &Detection, label: &str) -> bool {
    let area = f64::from(region.bounds.width) * f64::from(region.bounds.height);
    truth.objects.iter().filter(|object| right_label(object.class) == label).any(|object| {
        let tolerance_m = (0.15 * object.distance_m).max(1.0);
        let depth_m = object.distance_m - tolerance_m..=object.distance_m + LENGTH_M + tolerance_m;
        depth_m.contains(&region.distance_m) && shared_area(&region.bounds, &object.bounds) >= 0.5 * area
    })
}

/// A look of a detector at a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// What it found.
    pub found: Option<Recognition>,
    /// Whether the region is of its class.
    pub is_class: bool,
}

/// Log-odds of a share.
fn log_odds(yes: usize, no: usize) -> f64 {
    ((yes as f64 + SMOOTHING) / (no as f64 + SMOOTHING)).ln()
}

/// The calibration that fits looks best: logistic regression on the scores of those that found something (Platt 1999), and
/// the shares of the class among those that found nothing and among all. `None` without looks at both kinds of regions.
pub fn fit(looks: &[Look]) -> Option<Calibration> {
    let count = |of: &dyn Fn(&Look) -> bool| {
        let yes = looks.iter().filter(|l| of(l) && l.is_class).count();
        (yes, looks.iter().filter(|l| of(l)).count() - yes)
    };
    let (all, missed) = (count(&|_| true), count(&|l| l.found.is_none()));
    if all.0 == 0 || all.1 == 0 {
        return None;
    }
    let scores =
        looks.iter().filter_map(|l| Some((f64::from(l.found?.score), f64::from(u8::from(l.is_class)))));
    let scores: Vec<(f64, f64)> = scores.collect();
    let (mut offset, mut slope) = (0.0_f64, 0.0_f64);
    for _ in 0..ITERATIONS {
        let mut gradient = [-RIDGE * offset, -RIDGE * slope];
        let mut hessian = [RIDGE, 0.0, RIDGE];
        for &(score, is_class) in &scores {
            let p = 1.0 / (1.0 + (-(offset + slope * score)).exp());
            let (error, weight) = (is_class - p, p * (1.0 - p));
            gradient[0] += error;
            gradient[1] += error * score;
            hessian[0] += weight;
            hessian[1] += weight * score;
            hessian[2] += weight * score * score;
        }
        let determinant = hessian[0] * hessian[2] - hessian[1] * hessian[1];
        let step = [
            (hessian[2] * gradient[0] - hessian[1] * gradient[1]) / determinant,
            (hessian[0] * gradient[1] - hessian[1] * gradient[0]) / determinant,
        ];
        if !step.iter().all(|s| s.is_finite()) {
            break;
        }
        // Far from the optimum Newton's step is too long.
        let scale = 1.0 / (step[0].abs().max(step[1].abs()) / 2.0).max(1.0);
        offset += scale * step[0];
        slope += scale * step[1];
    }
    let (prior, miss) = (log_odds(all.0, all.1), log_odds(missed.0, missed.1));
    Some(Calibration { prior, miss, offset, slope }.limited())
}

/// Results of a class.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ClassRow {
    /// Its name.
    pub label: String,
    /// Evaluable objects, summed over frames.
    pub due: usize,
    /// Those with a confirmed obstacle.
    pub tracked: usize,
    /// Those whose obstacle has the label.
    pub right: usize,
    /// `right` ÷ `due`.
    pub recall: Option<f64>,
    /// Confirmed obstacles with the label, seen in the frame.
    pub labels: usize,
    /// Those that match no such object.
    pub wrong: usize,
    /// Of these, those whose box lies mostly within the box of such an object, at its distance: a part of it.
    pub parts: usize,
    /// `wrong` ÷ frames.
    pub wrong_per_frame: Option<f64>,
    /// Regions that the detector could look at, those of the class, and of both those where it found something.
    pub looks: [usize; 4],
    /// Processor time of a look, in ms.
    pub look_ms: Option<f64>,
    /// By told probability from 0.5 to 1: obstacles, mean told probability, share that is right.
    pub reliability: Vec<(usize, Option<f64>, Option<f64>)>,
    #[serde(skip)]
    sums: [(usize, f64, usize); BINS],
    #[serde(skip)]
    spent_ms: f64,
}

/// Looks and labels of some frames.
#[derive(Clone, Debug, Default)]
pub struct ClassTally {
    frames: usize,
    rows: Vec<ClassRow>,
    looks: Vec<Vec<Look>>,
}

impl ClassTally {
    /// No frames yet, with detectors of these classes.
    pub fn new<'a>(labels: impl Iterator<Item = &'a str>) -> Self {
        let row = |label: &str| ClassRow { label: label.to_owned(), ..ClassRow::default() };
        let rows: Vec<ClassRow> = labels.map(row).collect();
        Self { frames: 0, looks: vec![Vec::new(); rows.len()], rows }
    }

    /// Adds a look of a detector, which took so long.
    pub fn add_look(&mut self, detector: usize, look: Look, ms: f64) {
        self.looks[detector].push(look);
        self.rows[detector].spent_ms += ms;
    }

    /// Adds the obstacles of a frame.
    pub fn add_frame(&mut self, truth: &SceneTruth, obstacles: &[(&ObstacleLine, Detection)]) {
        self.frames += 1;
        for object in truth.objects.iter().filter(|object| is_evaluable(object, truth.width)) {
            let label = right_label(object.class);
            let Some(row) = self.rows.iter_mut().find(|row| row.label == label) else { continue };
            let there = obstacles.iter().filter(|(_, found)| is_match(object, found));
            let best = there.max_by(|a, b| {
                a.1.bounds.overlap(&object.bounds).total_cmp(&b.1.bounds.overlap(&object.bounds))
            });
            row.due += 1;
            row.tracked += usize::from(best.is_some());
            row.right += usize::from(best.is_some_and(|(line, _)| line.class == label));
        }
        for (line, found) in obstacles.iter().filter(|(line, _)| line.missed == 0) {
            let Some(row) = self.rows.iter_mut().find(|row| row.label == line.class) else { continue };
            let is_right = region_label(truth, found) == line.class;
            row.labels += 1;
            row.wrong += usize::from(!is_right);
            row.parts += usize::from(!is_right && is_part(truth, found, &line.class));
            let told = line.score.unwrap_or(0.0);
            let bin = ((told - 0.5) * 2.0 * BINS as f64).clamp(0.0, BINS as f64 - 1.0) as usize;
            let (count, sum, right) = &mut row.sums[bin];
            *count += 1;
            *sum += told;
            *right += usize::from(is_right);
        }
    }

    /// Adds the frames of another tally of the same detectors.
    pub fn merge(&mut self, other: Self) {
        self.frames += other.frames;
        for (own, other) in self.looks.iter_mut().zip(other.looks) {
            own.extend(other);
        }
        for (own, other) in self.rows.iter_mut().zip(other.rows) {
            own.due += other.due;
            own.tracked += other.tracked;
            own.right += other.right;
            own.labels += other.labels;
            own.wrong += other.wrong;
            own.parts += other.parts;
            own.spent_ms += other.spent_ms;
            for (own, other) in own.sums.iter_mut().zip(other.sums) {
                *own = (own.0 + other.0, own.1 + other.1, own.2 + other.2);
            }
        }
    }

    /// The looks of a detector.
    pub fn looks(&self, detector: usize) -> &[Look] {
        &self.looks[detector]
    }

    /// The table.
    pub fn report(mut self) -> ClassReport {
        for (row, looks) in self.rows.iter_mut().zip(&self.looks) {
            let share = |a: f64, b: usize| tidy_finite(a / b as f64);
            let count = |of: &dyn Fn(&Look) -> bool| looks.iter().filter(|l| of(l)).count();
            row.recall = share(row.right as f64, row.due);
            row.wrong_per_frame = share(row.wrong as f64, self.frames);
            row.look_ms = share(row.spent_ms, looks.len());
            row.looks = [
                looks.len(),
                count(&|l| l.is_class),
                count(&|l| l.found.is_some()),
                count(&|l| l.found.is_some() && l.is_class),
            ];
            let bin = |&(count, sum, right): &(usize, f64, usize)| {
                (count, share(sum, count), share(right as f64, count))
            };
            row.reliability = row.sums.iter().map(bin).collect();
        }
        ClassReport { frames: self.frames, rows: self.rows }
    }
}

/// The table of all classes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClassReport {
    /// Number of frames.
    pub frames: usize,
    /// A row for each detector.
    pub rows: Vec<ClassRow>,
}

impl fmt::Display for ClassReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cell = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.3}"));
        writeln!(
            f,
            "{:<16}{:>7}{:>9}{:>7}{:>8}{:>8}{:>7}{:>7}{:>13}{:>8}{:>10}{:>9}",
            "class",
            "due",
            "tracked",
            "right",
            "recall",
            "labels",
            "wrong",
            "parts",
            "wrong/frame",
            "looks",
            "found",
            "ms/look"
        )?;
        for row in &self.rows {
            writeln!(
                f,
                "{:<16}{:>7}{:>9}{:>7}{:>8}{:>8}{:>7}{:>7}{:>13}{:>8}{:>10}{:>9}",
                row.label,
                row.due,
                row.tracked,
                row.right,
                cell(row.recall),
                row.labels,
                row.wrong,
                row.parts,
                cell(row.wrong_per_frame),
                row.looks[0],
                row.looks[2],
                cell(row.look_ms)
            )?;
        }
        writeln!(f, "\nTold probability, and the share that is right (obstacles):")?;
        for row in &self.rows {
            write!(f, "{:<16}", row.label)?;
            for &(count, told, right) in &row.reliability {
                write!(f, "  {} {} ({count})", cell(told), cell(right))?;
            }
            writeln!(f)?;
        }
        write!(f, "\n{} frames", tidy(self.frames as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(score: Option<f32>, is_class: bool) -> Look {
        let found = score.map(|score| Recognition { score, x: 0, y: 0, width: 1, height: 1 });
        Look { found, is_class }
    }

    #[test]
    fn a_fit_finds_the_logistic_curve_that_drew_the_looks() {
        let mut random = fastrand::Rng::with_seed(5);
        let mut looks = Vec::new();
        for _ in 0..20_000 {
            let score = 4.0 * random.f64() - 2.0;
            let p = 1.0 / (1.0 + (-(0.7 + 2.0 * score)).exp());
            looks.push(look(Some(score as f32), random.f64() < p));
        }
        for i in 0..4000 {
            looks.push(look(None, i % 10 == 0));
        }
        let fitted = fit(&looks).unwrap();
        assert!((fitted.offset - 0.7).abs() < 0.1 && (fitted.slope - 2.0).abs() < 0.1, "{fitted:?}");
        assert!((fitted.miss - (0.1_f64 / 0.9).ln()).abs() < 0.01, "{fitted:?}");
        assert!(fit(&looks[..0]).is_none() && fit(&[look(None, true)]).is_none());
        // Scores that separate the classes have a finite fit.
        let apart: Vec<Look> = (0..50).map(|i| look(Some(i as f32 - 25.5), i > 25)).collect();
        let fitted = fit(&apart).unwrap();
        assert!(fitted.slope > 1.0 && fitted.slope.is_finite(), "{fitted:?}");
    }

    #[test]
    fn told_probabilities_are_counted_with_the_truth() {
        let mut tally = ClassTally::new(["vehicle", "pedestrian"].into_iter());
        let line = ObstacleLine { class: "vehicle".into(), score: Some(0.97), ..ObstacleLine::default() };
        let found =
            Detection { bounds: perception::region::PixelBox::default(), distance_m: 9.0, sigma_m: 0.1 };
        tally.add_frame(&SceneTruth::default(), &[(&line, found)]);
        tally.add_look(1, look(Some(0.5), true), 2.0);
        let mut twice = tally.clone();
        twice.merge(tally);
        let report = twice.report();
        assert_eq!((report.frames, report.rows[0].labels, report.rows[0].wrong), (2, 2, 2));
        assert_eq!(report.rows[0].reliability[4], (2, Some(0.97), Some(0.0)));
        assert_eq!((report.rows[1].looks, report.rows[1].look_ms), ([2, 2, 2, 2], Some(2.0)));
        assert!(report.to_string().contains("pedestrian"));
    }
}
