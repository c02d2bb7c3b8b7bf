//! Calibrates a stereo pair from a folder of images of a calibration board and grades the result.

mod corner_list;
pub mod drive;
pub mod live;
mod pictures;
pub mod print;
mod projection_map;
pub mod report;

pub use pictures::{PicturePair, Pictures, PicturesError};

use nalgebra::Vector2;
use perception::calibration::finder::{self, ordered_alike};
use perception::calibration::homography;
use perception::calibration::{
    Board, Crop, Grade, Lens, NoBoard, Pair, Places, Reason, Sighting, StereoCalibration, Verdict, calibrate,
    calibrate_all, calibrate_simultaneous, judge,
};
use perception::image::GreyView;
use rustix::time::{ClockId, clock_gettime};
use sources::folder::read_grey;
use sources::rig_file::{Quality, RigFile};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Maximum number of views; of more, the most different ones are kept.
const MAX_VIEWS: usize = 60;

/// Input and options of a calibration.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// Folder with the images.
    pub folder: &'a Path,
    /// The board.
    pub board: Board,
    /// Estimated distortion coefficients.
    pub lens: Lens,
    /// Rectification of the pair.
    pub crop: Crop,
    /// Whether both cameras expose at the same moment, so that the board does not move between the pictures of a pair.
    pub simultaneous: bool,
    /// Whether to calibrate from all views as well, including outliers.
    pub cross_validate: bool,
}

/// Result of a calibration.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Grade with reasons.
    pub verdict: Verdict,
    /// The calibrated cameras, if there was a solution.
    pub calibration: Option<StereoCalibration>,
    /// Pairs in which both images show the board, used or excluded, in the order of the calibration's views.
    pub views: Vec<PicturePair>,
    /// Their corners.
    pub corners: Vec<Pair>,
    /// The board.
    pub board: Board,
    /// Number of image pairs in the folder.
    pub pairs: usize,
    /// Images in which the board was not detected: file and reason.
    pub without: Vec<(PathBuf, NoBoard)>,
    /// Processor time of the board detection per image, in ms.
    pub picture_ms: Vec<f64>,
    /// The calibration from all views, including outliers, where requested.
    pub of_all: Option<StereoCalibration>,
}

/// Image size, detected board and processor time of the detection in ms.
type Search = Result<((usize, usize), Result<Sighting, NoBoard>, f64), String>;

/// [`finder::find`], and its processor time on this thread in ms.
pub fn timed(view: GreyView<'_>, board: &Board) -> (Result<Sighting, NoBoard>, f64) {
    let now = || {
        let t = clock_gettime(ClockId::ThreadCPUTime);
        t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
    };
    let start = now();
    let found = finder::find(view, board);
    (found, now() - start)
}

/// Detects the board in all images, with one thread per processor.
fn search(paths: &[&Path], board: &Board, progress: &(dyn Fn(usize, usize) + Sync)) -> Vec<Search> {
    let next = AtomicUsize::new(0);
    let done = AtomicUsize::new(0);
    let results: Mutex<Vec<Option<Search>>> = Mutex::new(vec![None; paths.len()]);
    let work = || {
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(path) = paths.get(i) else { return };
            let result = read_grey(path).map_err(|e| e.to_string()).and_then(|(pixels, width, height)| {
                let view = GreyView::new(&pixels, width, height, width)
                    .map_err(|e| format!("{}: {e}", path.display()))?;
                let (found, ms) = timed(view, board);
                Ok(((width, height), found, ms))
            });
            if let Ok(mut results) = results.lock() {
                results[i] = Some(result);
            }
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, paths.len());
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(paths.len().max(1));
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work);
        }
        work();
    });
    let results = results.into_inner().unwrap_or_default();
    results.into_iter().map(|r| r.unwrap_or_else(|| Err("not searched".into()))).collect()
}

/// Calibrates from a folder. Faults of the images become part of the verdict. `progress` is called with the
/// numbers of processed and of all images.
pub fn run(request: &Request<'_>, progress: &(dyn Fn(usize, usize) + Sync)) -> Outcome {
    let mut outcome = Outcome {
        verdict: Verdict::redo(""),
        calibration: None,
        views: Vec::new(),
        corners: Vec::new(),
        board: request.board,
        pairs: 0,
        without: Vec::new(),
        picture_ms: Vec::new(),
        of_all: None,
    };
    outcome.verdict = attempt(request, progress, &mut outcome).unwrap_or_else(Verdict::redo);
    outcome
}

fn attempt(
    request: &Request<'_>,
    progress: &(dyn Fn(usize, usize) + Sync),
    outcome: &mut Outcome,
) -> Result<Verdict, String> {
    let pictures = Pictures::find(request.folder).map_err(|e| e.to_string())?;
    outcome.pairs = pictures.pairs.len();
    let board = &request.board;
    let (size, other_boards) = collect_views(&pictures, board, progress, outcome)?;
    let Some(size) = size else { return Err(format!("{}: no pairs", request.folder.display())) };
    thin_out(outcome, board, size);
    let names: Vec<String> = outcome.views.iter().map(|p| p.name.clone()).collect();
    let calibrate = if request.simultaneous { calibrate_simultaneous } else { calibrate };
    let result = calibrate(board, size, &outcome.corners, request.lens, request.crop);
    let mut verdict = match &result {
        Ok(calibration) => judge(calibration, &names),
        Err(error) => Verdict::redo(error.to_string()),
    };
    judge_missing_boards(&mut verdict, outcome, board, &other_boards);
    if let Some(path) = pictures.single.first() {
        let text = format!("{} images have no partner, such as {}", pictures.single.len(), path.display());
        verdict.reasons.push(Reason { grade: Grade::Good, text });
    }
    outcome.calibration = result.ok();
    if request.cross_validate {
        outcome.of_all = calibrate_all(board, size, &outcome.corners, request.lens, request.crop).ok();
    }
    Ok(verdict)
}

/// Size of an image or a board, in pixels or corners: columns, rows.
type Size = (usize, usize);

/// Searches all images and collects the pairs in which both show the board. Returns the common size of the
/// images, and how often a board of another size was detected.
fn collect_views(
    pictures: &Pictures,
    board: &Board,
    progress: &(dyn Fn(usize, usize) + Sync),
    outcome: &mut Outcome,
) -> Result<(Option<Size>, BTreeMap<Size, usize>), String> {
    let paths: Vec<&Path> =
        pictures.pairs.iter().flat_map(|p| [p.left.as_path(), p.right.as_path()]).collect();
    let searches = search(&paths, board, progress);
    let mut size: Option<(Size, &Path)> = None;
    let mut other_boards = BTreeMap::new();
    for ((pair, path), sides) in pictures.pairs.iter().zip(paths.chunks(2)).zip(searches.chunks(2)) {
        let mut found = Vec::new();
        for (path, search) in path.iter().zip(sides) {
            let (own, sighting, ms) = search.as_ref().map_err(Clone::clone)?;
            outcome.picture_ms.push(*ms);
            match size {
                None => size = Some((*own, path)),
                Some((first, first_path)) if first != *own => {
                    return Err(format!(
                        "{} has {}x{} pixels, but {} has {}x{}: all images must have one size, that of the running cameras",
                        path.display(),
                        own.0,
                        own.1,
                        first_path.display(),
                        first.0,
                        first.1
                    ));
                }
                Some(_) => {}
            }
            match sighting {
                Ok(sighting) => found.push(sighting.corners.clone()),
                Err(why) => {
                    if let NoBoard::Other { columns, rows } = why {
                        *other_boards.entry((*columns, *rows)).or_default() += 1;
                    }
                    outcome.without.push((path.to_path_buf(), *why));
                }
            }
        }
        if let [left, right] = &found[..] {
            outcome.corners.push(Pair { left: left.clone(), right: ordered_alike(left, right, board) });
            outcome.views.push(pair.clone());
        }
    }
    Ok((size.map(|(size, _)| size), other_boards))
}

/// Adds to the verdict why images have no board.
fn judge_missing_boards(
    verdict: &mut Verdict,
    outcome: &Outcome,
    board: &Board,
    other_boards: &BTreeMap<Size, usize>,
) {
    // A size that was detected in most of these images is that of the board.
    let most = other_boards.iter().max_by_key(|(_, count)| **count);
    if let Some(((columns, rows), count)) = most
        && 2 * count > outcome.without.len()
        && outcome.without.len() > outcome.views.len()
        && *count >= 3
    {
        let text = format!(
            "{count} images show {columns}x{rows} corners, not {}x{}: count the inner corners again \
             (--board {columns}x{rows}?), and keep the whole board in sight",
            board.columns(),
            board.rows()
        );
        verdict.reasons.insert(0, Reason { grade: Grade::Redo, text });
        verdict.grade = Grade::Redo;
    } else if !outcome.without.is_empty() {
        // A partly detected board is the more helpful example.
        let is_part = |why: &NoBoard| matches!(why, NoBoard::Other { .. } | NoBoard::Part { .. });
        let part = outcome.without.iter().find(|w| is_part(&w.1));
        let (path, why) = part.unwrap_or(&outcome.without[0]);
        let count = outcome.without.len();
        let total = 2 * outcome.pairs;
        let grade = if count > total / 2 { Grade::Usable } else { Grade::Good };
        let text = format!("the board was not found in {count} of {total} images; {}: {why}", path.display());
        verdict.reasons.push(Reason { grade, text });
        verdict.grade = verdict.grade.max(grade);
    }
}

/// Keeps the views that differ most in position, size and slant, when there are too many.
fn thin_out(outcome: &mut Outcome, board: &Board, size: (usize, usize)) {
    if outcome.views.len() <= MAX_VIEWS {
        return;
    }
    let features: Vec<[f64; 5]> = outcome.corners.iter().map(|p| features(&p.left, board, size)).collect();
    let apart = |a: &[f64; 5], b: &[f64; 5]| a.iter().zip(b).map(|(x, y)| (x - y).abs()).sum::<f64>();
    let mut kept = vec![0];
    let mut nearest: Vec<f64> = features.iter().map(|f| apart(f, &features[0])).collect();
    while kept.len() < MAX_VIEWS {
        let Some(next) = (0..nearest.len()).max_by(|&a, &b| nearest[a].total_cmp(&nearest[b])) else { break };
        kept.push(next);
        for (n, f) in nearest.iter_mut().zip(&features) {
            *n = n.min(apart(f, &features[next]));
        }
    }
    kept.sort_unstable();
    outcome.views = kept.iter().map(|&i| outcome.views[i].clone()).collect();
    outcome.corners = kept.iter().map(|&i| outcome.corners[i].clone()).collect();
}

/// Position, size and slants of a board in an image, each about 0 to 1. What is not seen of it is predicted, so that the features do
/// not depend on which of its corners were found.
fn features(corners: &Places, board: &Board, (width, height): (usize, usize)) -> [f64; 5] {
    let points = board.points_m();
    let (from, to): (Vec<_>, Vec<_>) =
        points.iter().zip(corners).filter_map(|(p, c)| Some((*p, (*c)?))).unzip();
    let to_image = if to.len() < points.len() { homography::fit(&from, &to) } else { None };
    let predicted = |p: &Vector2<f64>| to_image.as_ref().map(|h| homography::map(h, p));
    let whole: Places = points.iter().zip(corners).map(|(p, c)| c.or_else(|| predicted(p))).collect();
    let seen = || whole.iter().flatten();
    let n = seen().count().max(1) as f64;
    let mean = seen().sum::<Vector2<f64>>() / n;
    let spread = (seen().map(|c| (c - mean).norm_squared()).sum::<f64>() / n).sqrt();
    // Perspective convergence: third moments relative to the spread.
    let skew = |axis: usize| {
        seen().map(|c| (c[axis] - mean[axis]).powi(3)).sum::<f64>() / n / spread.powi(3).max(1e-9)
    };
    [mean.x / width as f64, mean.y / height as f64, 2.0 * spread / width as f64, 3.0 * skew(0), 3.0 * skew(1)]
}

impl Outcome {
    /// The rig file of the result; `None` without a solution.
    pub fn rig(&self, serial: &str, date: &str) -> Option<RigFile> {
        let c = self.calibration.as_ref()?;
        Some(RigFile {
            serial: serial.to_owned(),
            date: date.to_owned(),
            cameras: c.cameras,
            between: c.between,
            rectification: c.rectification,
            quality: Some(Quality {
                verdict: self.verdict.grade.name().to_owned(),
                pairs_used: self.pairs_used(),
                rms_px: c.rms_px,
                vertical_mean_px: c.vertical_mean_px,
                vertical_heldout_px: c.vertical_heldout_px,
                baseline_sigma_m: c.uncertainty.baseline_m,
                disparity_sigma_px: c.uncertainty.disparity_px,
                left_sigma: c.uncertainty.cameras[0],
                right_sigma: c.uncertainty.cameras[1],
            }),
        })
    }

    /// Number of views used in the solution.
    pub fn pairs_used(&self) -> usize {
        self.calibration.as_ref().map_or(0, |c| c.views.iter().filter(|v| v.fault.is_none()).count())
    }
}
