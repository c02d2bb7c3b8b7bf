//! Calibration report: an HTML page with diagnostic plots.

use super::{Outcome, corner_list, projection_map};
use crate::reporting::picture::{Colour, Picture, PictureError};
use crate::reporting::plot::{Series, bars};
use perception::calibration::{Lens, StereoCalibration};
use perception::image::GreyView;
use perception::rectify::Remap;
use sources::SourceError;
use sources::folder::read_grey;
use sources::rig_file::RigFile;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use thiserror::Error;

const GROUND: Colour = [24, 26, 30];
const GRID: Colour = [58, 62, 70];
const INK: Colour = [240, 240, 240];
const LEFT: Colour = [80, 160, 255];
const RIGHT: Colour = [255, 120, 60];

/// Errors when writing a report.
#[derive(Debug, Error)]
pub enum ReportError {
    /// The folder or the page cannot be written.
    #[error("{}: {source}: give a folder that can be written with --report", path.display())]
    Io {
        /// Path that was written.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// A plot cannot be written.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// An image cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
}

/// Writes `index.html` and its plots to a folder.
///
/// # Errors
/// When a file cannot be written or read.
pub fn write(folder: &Path, outcome: &Outcome) -> Result<(), ReportError> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |source| ReportError::Io { path, source }
    };
    std::fs::create_dir_all(folder).map_err(io(folder))?;
    let mut figures = Vec::new();
    if let Some(c) = &outcome.calibration {
        let mut save =
            |name: &'static str, text: &'static str, picture: Picture| -> Result<(), ReportError> {
                picture.save(&folder.join(name))?;
                figures.push((name, text));
                Ok(())
            };
        save(
            "rectified.png",
            "A pair after rectification: corresponding points lie on the same row",
            pair(outcome, c)?,
        )?;
        save(
            "epipolar.png",
            "Row difference of corresponding corners, before and after rectification",
            epipolar(outcome, c),
        )?;
        save(
            "residuals.png",
            "Reprojection residuals, left (blue) and right (orange); the outer circle is 1 px",
            residuals(c),
        )?;
        save("views.png", "Reprojection error of each view", views(c))?;
        save("coverage.png", "Coverage of the images by corners, left and right", coverage(outcome, c))?;
        save(
            "projection.png",
            "Uncertainty of projection: standard deviation in px, in the worst direction, of where a point at this distance \
             appears; red from 0.5 px on",
            projection_map::picture(c),
        )?;
        let texts = [
            ("projection.csv", projection_map::table(c)),
            ("corners.vnl", corner_list::text(&outcome.board, &outcome.views, &outcome.corners, c)),
        ];
        for (name, text) in texts {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(io(&path))?;
        }
    }
    let path = folder.join("index.html");
    std::fs::write(&path, page(outcome, &figures)).map_err(io(&path))
}

/// A used view, rectified, with horizontal lines across both images.
fn pair(outcome: &Outcome, c: &StereoCalibration) -> Result<Picture, ReportError> {
    let used = c.views.iter().zip(&outcome.views).filter(|(v, _)| v.fault.is_none());
    // The view of median error is the most representative one.
    let mut errors: Vec<_> = used.map(|(v, p)| (v.rms_px[0] + v.rms_px[1], p)).collect();
    errors.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (width, height) = c.rectification.size;
    let mut picture = Picture::new(2 * width + 4, height, GROUND);
    if let Some((_, files)) = errors.get(errors.len() / 2) {
        for (side, path) in [&files.left, &files.right].into_iter().enumerate() {
            let (pixels, w, h) = read_grey(path)?;
            let Ok(view) = GreyView::new(&pixels, w, h, w) else { continue };
            let Ok(image) = Remap::rectifying(&c.cameras, &c.rectification, side).applied(view) else {
                continue;
            };
            for y in 0..height {
                for (x, &v) in image.view().row(y).iter().enumerate() {
                    picture.tint(side * (width + 4) + x, y, [v; 3], 256);
                }
            }
            let [x, y, w, h] = c.rectification.valid.map(|v| v as u32);
            picture.frame([x + (side * (width + 4)) as u32, y, w, h], [90, 210, 110], 1);
        }
    }
    for y in (12..height as i32).step_by((height / 15).max(8)) {
        picture.line((0, y), (2 * width as i32 + 3, y), [250, 220, 80], 1);
    }
    Ok(picture)
}

/// Histograms of the row differences.
fn epipolar(outcome: &Outcome, c: &StereoCalibration) -> Picture {
    let used = || c.views.iter().zip(&outcome.corners).filter(|(v, _)| v.fault.is_none());
    let after: Vec<f64> = used().flat_map(|(v, _)| v.vertical_px.iter().flatten().copied()).collect();
    let before: Vec<f64> = used()
        .flat_map(|(_, p)| p.left.iter().zip(&p.right).filter_map(|(l, r)| Some((*l)?.y - (*r)?.y)))
        .collect();
    let mean = |v: &[f64]| v.iter().map(|x| x.abs()).sum::<f64>() / v.len().max(1) as f64;
    // Before rectification rows differ by more than the range: the outermost bins hold the rest.
    let histogram = |values: &[f64]| {
        let mut counts = [0.0; 41];
        for v in values.iter().filter(|v| v.is_finite()) {
            let bin = (v / 0.1 + 20.0).round().clamp(0.0, 40.0) as usize;
            counts[bin] += 100.0 / values.len() as f64;
        }
        counts.iter().enumerate().map(|(i, n)| ((i as f64 - 20.0) * 0.1, *n)).collect()
    };
    let series = [
        Series { name: format!("before, mean {:.2} px", mean(&before)), points: histogram(&before) },
        Series { name: format!("after, mean {:.3} px", mean(&after)), points: histogram(&after) },
    ];
    bars("Epipolar error", "row left - row right in px", "% of the corners", &series)
}

/// Scatter plot of the residuals.
fn residuals(c: &StereoCalibration) -> Picture {
    const SIZE: i32 = 520;
    let mut picture = Picture::new(SIZE as usize, SIZE as usize, GROUND);
    let (middle, scale) = (SIZE / 2, 240.0);
    picture.line((0, middle), (SIZE, middle), GRID, 1);
    picture.line((middle, 0), (middle, SIZE), GRID, 1);
    for radius in [0.25, 0.5, 1.0] {
        for i in 0..720 {
            let a = f64::from(i) * std::f64::consts::PI / 360.0;
            let at = |v: f64| (f64::from(middle) + scale * radius * v).max(0.0) as usize;
            picture.tint(at(a.cos()), at(a.sin()), GRID, 256);
        }
        picture.text(&format!("{radius} px"), middle + (scale * radius) as i32 - 40, middle + 2, INK);
    }
    for view in c.views.iter().filter(|v| v.fault.is_none()) {
        for (side, colour) in [LEFT, RIGHT].into_iter().enumerate() {
            for r in view.residuals_px[side].iter().flatten().filter(|r| r.norm() < 1.05) {
                let (x, y) = (middle + (scale * r.x) as i32, middle + (scale * r.y) as i32);
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    if let (Ok(x), Ok(y)) = (usize::try_from(x + dx), usize::try_from(y + dy)) {
                        picture.tint(x, y, colour, 150);
                    }
                }
            }
        }
    }
    picture
}

fn views(c: &StereoCalibration) -> Picture {
    let series = |side: usize, name: &str| Series {
        name: name.into(),
        points: c.views.iter().enumerate().map(|(i, v)| (i as f64 + 1.0, v.rms_px[side])).collect(),
    };
    bars("Reprojection error", "view", "px", &[series(0, "left"), series(1, "right")])
}

/// Heat map of the corner positions.
fn coverage(outcome: &Outcome, c: &StereoCalibration) -> Picture {
    let (width, height) = c.rectification.size;
    let mut picture = Picture::new(2 * width + 4, height, GROUND);
    for side in 0..2 {
        let from = side * (width + 4);
        for k in 1..8 {
            let x = (from + k * width / 8) as i32;
            picture.line((x, 0), (x, height as i32), GRID, 1);
        }
        for k in 1..6 {
            let y = (k * height / 6) as i32;
            picture.line((from as i32, y), ((from + width) as i32, y), GRID, 1);
        }
        for (view, pair) in c.views.iter().zip(&outcome.corners) {
            let colour = if view.fault.is_some() { [200, 60, 60] } else { [LEFT, RIGHT][side] };
            for p in [&pair.left, &pair.right][side].iter().flatten() {
                picture.fill([from as i32 + p.x as i32 - 1, p.y as i32 - 1, 3, 3], colour);
            }
        }
        picture.text(&format!("{:.0} % of the cells", 100.0 * c.coverage[side]), from as i32 + 6, 6, INK);
    }
    picture
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn page(outcome: &Outcome, figures: &[(&str, &str)]) -> String {
    let mut html = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Calibration: {0}</title>\
         <style>body{{font:15px/1.5 sans-serif;max-width:70em;margin:2em auto;padding:0 1em;background:#fafafa}}\
         img{{max-width:100%}}table{{border-collapse:collapse}}td,th{{padding:.15em .8em;text-align:right;\
         border-bottom:1px solid #ddd}}td:first-child,th:first-child{{text-align:left}}</style>\n<h1>Verdict: {0}</h1>\n<ul>\n",
        outcome.verdict.grade
    );
    for reason in &outcome.verdict.reasons {
        let _ = writeln!(html, "<li>{} <small>({})</small></li>", escaped(&reason.text), reason.grade);
    }
    html.push_str("</ul>\n");
    if let Some(c) = &outcome.calibration {
        numbers(&mut html, outcome, c);
    }
    for (name, text) in figures {
        let _ = writeln!(html, "<h2>{}</h2>\n<img src=\"{name}\" alt=\"\">", escaped(text));
    }
    if let Some(c) = &outcome.calibration {
        html.push_str(
            "<h2>Views</h2>\n<table><tr><th>view<th>left px<th>right px<th>offset x px<th>offset y px<th>tilt °<th>distance m<th></tr>\n",
        );
        for (view, files) in c.views.iter().zip(&outcome.views) {
            let _ = writeln!(
                html,
                "<tr><td>{}<td>{:.3}<td>{:.3}<td>{:.2}<td>{:.2}<td>{:.0}<td>{:.2}<td>{}</tr>",
                escaped(&files.name),
                view.rms_px[0],
                view.rms_px[1],
                view.shift_px.x,
                view.shift_px.y,
                view.tilt_rad.to_degrees(),
                view.distance_m,
                match (view.fault.is_some(), view.moved) {
                    (true, _) => "excluded",
                    (false, true) => "moved",
                    (false, false) => "",
                }
            );
        }
        html.push_str("</table>\n");
    }
    html.push_str("</html>\n");
    html
}

fn numbers(html: &mut String, outcome: &Outcome, c: &StereoCalibration) {
    let held = c.vertical_heldout_px.map_or("-".into(), |v| format!("{v:.3}"));
    let rig = &c.rectification.rig;
    let _ = writeln!(
        html,
        "<p>{} of {} pairs used; reprojection error {:.3} px; mean row difference {:.3} px (held-out views: {held} px).</p>\n\
         <p>Baseline {:.2} ± {:.2} mm. Rectified: focal length {:.2} px, distance in m = {:.4} / disparity in px.</p>",
        outcome.pairs_used(),
        outcome.pairs,
        c.rms_px,
        c.vertical_mean_px,
        rig.baseline_m * 1e3,
        c.uncertainty.baseline_m * 1e3,
        rig.focal_px,
        rig.focal_px * rig.baseline_m
    );
    html.push_str("<table><tr><th>parameter<th>left<th>±<th>right<th>±</tr>\n");
    let names = match c.lens {
        Lens::Fisheye => ["fx px", "fy px", "cx px", "cy px", "k1", "k2", "k3", "k4", "", "", "", ""],
        _ => ["fx px", "fy px", "cx px", "cy px", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
    };
    let (l, r) = (c.cameras[0].parameters(), c.cameras[1].parameters());
    for k in 0..c.lens.parameters() {
        let digits = if k < 4 { 2 } else { 5 };
        let _ = writeln!(
            html,
            "<tr><td>{}<td>{:.digits$}<td>{:.digits$}<td>{:.digits$}<td>{:.digits$}</tr>",
            names[k], l[k], c.uncertainty.cameras[0][k], r[k], c.uncertainty.cameras[1][k]
        );
    }
    html.push_str("</table>\n");
}

/// An image pair before and after rectification, side by side, with horizontal lines across.
pub fn before_and_after(rig: &RigFile, before: [GreyView<'_>; 2], after: [GreyView<'_>; 2]) -> Picture {
    let (width, height) = rig.size();
    let mut picture = Picture::new(2 * width + 4, 2 * height + 4, GROUND);
    for (row, images) in [before, after].into_iter().enumerate() {
        for (side, image) in images.into_iter().enumerate() {
            for y in 0..height.min(image.height()) {
                for (x, &v) in image.row(y).iter().enumerate() {
                    picture.tint(side * (width + 4) + x, row * (height + 4) + y, [v; 3], 256);
                }
            }
        }
        for y in (12..height).step_by((height / 15).max(8)) {
            let y = (row * (height + 4) + y) as i32;
            picture.line((0, y), (2 * width as i32 + 3, y), [250, 220, 80], 1);
        }
    }
    picture
}
