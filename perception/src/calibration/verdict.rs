//! Grades a calibration (good, usable, redo) with reasons.
//!
//! A small reprojection error is not sufficient: similar views, or a board that deviates from its specification,
//! also fit well but bias the result. The grade therefore also tests whether the views agree with each other, with
//! held-out views and with a flat board of square squares, and whether they determine the parameters well.

use super::stereo::{MOVED_PX, StereoCalibration, ViewFault};
use std::fmt;

/// Grade of a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// It can be used.
    Good,
    /// It can be used, but has a deficiency.
    Usable,
    /// The images must be taken again.
    Redo,
}

impl Grade {
    /// `good`, `usable` or `redo`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Usable => "usable",
            Self::Redo => "redo",
        }
    }
}

impl fmt::Display for Grade {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// One finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reason {
    /// The best grade that it allows.
    pub grade: Grade,
    /// The finding with its magnitude and a remedy.
    pub text: String,
}

/// The grade of a calibration with its reasons.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// The worst of the reasons.
    pub grade: Grade,
    /// All findings, the worst first.
    pub reasons: Vec<Reason>,
}

impl Verdict {
    /// The verdict that follows from the reasons.
    pub fn from_reasons(mut reasons: Vec<Reason>) -> Self {
        reasons.sort_by_key(|r| std::cmp::Reverse(r.grade));
        let grade = reasons.first().map_or(Grade::Good, |r| r.grade);
        Self { grade, reasons }
    }

    /// A verdict of redo for one reason.
    pub fn redo(text: impl Into<String>) -> Self {
        Self::from_reasons(vec![Reason { grade: Grade::Redo, text: text.into() }])
    }
}

/// Limits between good and usable, and between usable and redo.
struct Limits(f64, f64);

impl Limits {
    fn grade(&self, value: f64) -> Grade {
        if value <= self.0 {
            Grade::Good
        } else if value <= self.1 {
            Grade::Usable
        } else {
            // Includes NaN.
            Grade::Redo
        }
    }
}

/// Reprojection error, in pixels.
const RMS_PX: Limits = Limits(0.4, 1.0);
/// Vertical error on held-out views, in pixels.
const HELDOUT_PX: Limits = Limits(0.27, 0.5);
/// Difference between the results of two halves of the views, in standard deviations.
const HALVES: Limits = Limits(3.0, 5.0);
/// Uncertainty of the focal length over the focal length.
const FOCAL: Limits = Limits(0.005, 0.02);
/// Uncertainty of the baseline over the baseline.
const BASELINE: Limits = Limits(0.007, 0.02);
/// Uncertainty of the disparity at infinity, in pixels.
const DISPARITY_PX: Limits = Limits(0.75, 2.0);
/// Share of the image without corners.
const UNCOVERED: Limits = Limits(0.6, 0.85);
/// Relative deviation of the board's aspect ratio from its specification.
const STRETCH: Limits = Limits(0.003, 0.006);
/// Bend of the board over half its diagonal.
const BEND: Limits = Limits(0.02, 0.06);
/// Standard deviation of the boards' offsets in the right image, horizontally and vertically, in pixels. The limit
/// of good is where an offset of half a pixel is four standard deviations.
const SCATTER_PX: [Limits; 2] = [Limits(0.125, 0.8), Limits(0.125, 0.4)];
/// Share of rejected views.
const REJECTED: Limits = Limits(0.125, 0.34);
/// Step of the vertical offset between earlier and later views, in pixels.
const STEP_PX: Limits = Limits(0.25, 0.5);
/// Minimum size of a step, in standard errors.
const STEP_DEVIATIONS: f64 = 5.0;
/// Minimum tilt of a tilted view, in radians.
const TILT_RAD: f64 = 0.26;

/// Grades a calibration. `names` are the names of the views, in their order, for the messages.
pub fn judge(c: &StereoCalibration, names: &[String]) -> Verdict {
    let mut reasons = Vec::new();
    let mut note = |grade: Grade, text: String| reasons.push(Reason { grade, text });
    let mut check = |grade: Grade, text: &dyn Fn() -> String| {
        if grade > Grade::Good {
            note(grade, text());
        }
    };
    let used = c.views.iter().filter(|v| v.fault.is_none()).count();
    let few = if used >= 10 {
        Grade::Good
    } else if used >= 6 {
        Grade::Usable
    } else {
        Grade::Redo
    };
    check(few, &|| format!("only {used} views were used: take 10 to 30"));
    check(RMS_PX.grade(c.rms_px), &|| {
        format!("the reprojection error is {:.2} px: images are blurred, or the board is not flat", c.rms_px)
    });
    match c.vertical_heldout_px {
        Some(px) => check(HELDOUT_PX.grade(px), &|| {
            format!(
                "rows of held-out views differ by {px:.2} px ({:.2} px for used views): the views are too similar, or inconsistent",
                c.vertical_mean_px
            )
        }),
        None => {
            check(Grade::Usable, &|| "too few views to test the result on others: take 10 or more".into())
        }
    }
    consistency(c, &mut check);
    certainty(c, &mut check);
    board(c, &mut check);
    step(c, names, &mut check);
    for (axis, way) in [(1, "too high or low"), (0, "too far left or right")] {
        let sigma = c.shift_sigma_px[axis];
        check(SCATTER_PX[axis].grade(sigma), &|| {
            format!(
                "boards lie {sigma:.2} px {way} in the right image, varying from view to view: the cameras do not expose simultaneously while the board moves (hold it still), or are loose"
            )
        });
    }
    left_out(c, names, &mut note);
    Verdict::from_reasons(reasons)
}

type Check<'a> = dyn FnMut(Grade, &dyn Fn() -> String) + 'a;

/// Checks that two halves of the views give the same cameras.
fn consistency(c: &StereoCalibration, check: &mut Check<'_>) {
    let Some([(a, a_between), (b, b_between)]) = &c.halves else { return };
    let sigma = &c.uncertainty;
    let yaw = a_between.rotation_vector().y - b_between.rotation_vector().y;
    let mut worst: (f64, String) = (0.0, String::new());
    let mut consider = |what: &str, unit: &str, difference: f64, sigma: f64, scale: f64| {
        // Each half is √2 times as uncertain as the whole, so their difference is twice as uncertain.
        let deviations = difference.abs() / (2.0 * sigma).max(1e-12);
        if deviations > worst.0 {
            let text = format!(
                "{what} differs by {:.2} {unit} between two halves of the views, {deviations:.1} times what its uncertainty allows",
                difference.abs() * scale
            );
            worst = (deviations, text);
        }
    };
    for (side, name) in ["left", "right"].into_iter().enumerate() {
        let (p, q) = (a[side].parameters(), b[side].parameters());
        for (k, what) in [(0, "focal length"), (2, "principal point's column"), (3, "principal point's row")]
        {
            consider(&format!("the {name} {what}"), "px", p[k] - q[k], sigma.cameras[side][k], 1.0);
        }
    }
    consider("the angle between the cameras", "degrees", yaw, sigma.rotation_rad[1], 57.295_779_5);
    check(HALVES.grade(worst.0), &|| worst.1.clone());
}

/// Checks that the views determine the parameters well enough.
fn certainty(c: &StereoCalibration, check: &mut Check<'_>) {
    let sigma = &c.uncertainty;
    let focal = (0..2).map(|s| sigma.cameras[s][0] / c.cameras[s].fx_px).fold(0.0, f64::max);
    check(FOCAL.grade(focal), &|| {
        format!(
            "the focal length is known to {:.1} % only: tilt the board more, and bring it nearer",
            focal * 100.0
        )
    });
    let baseline = sigma.baseline_m / c.rectification.rig.baseline_m;
    check(BASELINE.grade(baseline), &|| {
        format!("the baseline is known to {:.1} % only: take more views, some of them near", baseline * 100.0)
    });
    check(DISPARITY_PX.grade(sigma.disparity_px), &|| {
        format!(
            "the disparity of distant objects is known to {:.2} px only: take more views, including distant ones",
            sigma.disparity_px
        )
    });
    for (side, name) in ["left", "right"].into_iter().enumerate() {
        check(UNCOVERED.grade(1.0 - c.coverage[side]), &|| {
            format!(
                "corners cover {:.0} % of the {name} image: also place the board in the corners and at the borders of the image",
                c.coverage[side] * 100.0
            )
        });
    }
    // Tilts in two perpendicular directions are needed.
    let mut tilts = [0; 2];
    for v in c.views.iter().filter(|v| v.fault.is_none() && v.tilt_rad > TILT_RAD) {
        tilts[usize::from(v.tilt_direction_rad.cos().abs() < v.tilt_direction_rad.sin().abs())] += 1;
    }
    for (count, way) in tilts.into_iter().zip(["to the sides", "up and down"]) {
        let grade = if count >= 2 { Grade::Good } else { Grade::Usable };
        check(grade, &|| {
            format!("{count} views show the board tilted {way} by 15 degrees or more: take at least 2")
        });
    }
}

/// Checks that the board matches its specification.
fn board(c: &StereoCalibration, check: &mut Check<'_>) {
    let stretch = c.shape.stretch - 1.0;
    if stretch.abs() > 3.0 * c.stretch_sigma {
        check(STRETCH.grade(stretch.abs()), &|| {
            format!(
                "the board's squares are {:.2} ± {:.2} % {} along its rows than down its columns: print it without scaling, and measure it",
                stretch.abs() * 100.0,
                c.stretch_sigma * 100.0,
                if stretch > 0.0 { "longer" } else { "shorter" }
            )
        });
    }
    let bend = c.shape.bend_m.iter().map(|b| b.abs()).fold(0.0, f64::max);
    let share = bend / c.board_reach_m;
    check(BEND.grade(share), &|| {
        format!("the board is bent by {:.1} mm (which is compensated): glue it to a stiff plate", bend * 1e3)
    });
}

/// Checks that the cameras did not move between earlier and later views.
fn step(c: &StereoCalibration, names: &[String], check: &mut Check<'_>) {
    let rows: Vec<(usize, f64)> = c
        .views
        .iter()
        .enumerate()
        .filter(|(_, v)| !matches!(v.fault, Some(ViewFault::Misfit(_))))
        .map(|(i, v)| (i, v.shift_px.y))
        .collect();
    let mean = |part: &[(usize, f64)]| part.iter().map(|r| r.1).sum::<f64>() / part.len() as f64;
    let mut best = (0.0, 0, 0.0);
    for k in 3..rows.len().saturating_sub(2) {
        let (before, after) = rows.split_at(k);
        let (a, b) = (mean(before), mean(after));
        let scatter = before.iter().map(|r| (r.1 - a).powi(2)).chain(after.iter().map(|r| (r.1 - b).powi(2)));
        let variance = scatter.sum::<f64>() / (rows.len() - 2) as f64 + 1e-4;
        let error = (variance * (1.0 / before.len() as f64 + 1.0 / after.len() as f64)).sqrt();
        let deviations = (b - a).abs() / error;
        if deviations > best.0 {
            best = (deviations, k, b - a);
        }
    }
    let (deviations, k, size) = best;
    if deviations > STEP_DEVIATIONS {
        let focal = c.cameras[1].fy_px;
        check(STEP_PX.grade(size.abs()), &|| {
            let name = rows.get(k).and_then(|r| names.get(r.0)).map_or("", String::as_str);
            format!(
                "from {name} on the right image is {:.2} px {} ({:.2} degrees): the cameras moved against each other; fasten them and take all views again",
                size.abs(),
                if size > 0.0 { "lower" } else { "higher" },
                (size.abs() / focal).atan().to_degrees()
            )
        });
    }
}

/// Lists rejected and shifted views by name.
fn left_out(c: &StereoCalibration, names: &[String], note: &mut dyn FnMut(Grade, String)) {
    let count = c.views.iter().filter(|v| v.fault.is_some()).count();
    let share = REJECTED.grade(count as f64 / c.views.len().max(1) as f64);
    if share > Grade::Good {
        note(
            share,
            format!(
                "{count} of {} views are inconsistent with the rest and were left out: take them again",
                c.views.len()
            ),
        );
    }
    for (view, name) in c.views.iter().zip(names) {
        match view.fault {
            Some(ViewFault::Misfit(px)) => note(
                Grade::Usable,
                format!(
                    "{name} was left out: its corners are {px:.2} px off; it is blurred, or its images were not taken at the same time"
                ),
            ),
            Some(ViewFault::Shifted(by)) => note(
                Grade::Usable,
                format!(
                    "{name} was left out: its right image is off by {:.2} px horizontally and {:.2} px vertically; the board or a camera moved between the exposures",
                    by.x, by.y
                ),
            ),
            None => {}
        }
    }
    let moved: Vec<String> = c
        .views
        .iter()
        .zip(names)
        .filter(|(v, _)| v.moved && v.fault.is_none())
        .map(|(v, name)| format!("{name} ({:.2} horizontally, {:.2} vertically)", v.shift_px.x, v.shift_px.y))
        .collect();
    if !moved.is_empty() {
        note(
            Grade::Usable,
            format!(
                "the right image is off by more than {MOVED_PX} px in used views: {}; the board or a camera moved between the exposures, take them again",
                moved.join(", ")
            ),
        );
    }
    let corners: Vec<String> = c
        .views
        .iter()
        .zip(names)
        .filter(|(v, _)| v.fault.is_none() && !v.rejected.is_empty())
        .map(|(v, name)| format!("{} in {name}", v.rejected.len()))
        .collect();
    if !corners.is_empty() {
        note(Grade::Good, format!("corners left out: {}", corners.join(", ")));
    }
}
