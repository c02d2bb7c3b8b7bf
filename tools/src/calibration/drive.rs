//! Calibrates the orientation of the right camera from a drive, in several passes over its pairs: rows as far as a reduced
//! picture tells, rows precisely, a yaw of which motion can make sense at all, and then all angles together until they rest.

use nalgebra::Rotation3;
use perception::calibration::drive::{DriveEstimate, DriveEstimator, YawSearch, lasting_rows, mean};
use perception::calibration::{Camera, Pose, Rectification, RectificationError, RightTurn};
use perception::image::GreyView;
use perception::rectify::Remap;
use perception::rig::Rig;
use perception::stereo::epipolar::MatchedPair;
use perception::stereo::epipolar::coarse::{CoarseMatch, CoarseMatcher};
use perception::stereo::epipolar::field::RowField;
use perception::stereo::{DisparityView, MatchError, MatchOutput, Matcher};
use sources::rig_file::RigFile;
use sources::{PairSource, SourceError};
use std::ops::Range;
use thiserror::Error;

/// Pairs of the passes that look at rows alone, spread over the drive.
const COARSE_PAIRS: usize = 24;
const ROW_PAIRS: usize = 24;
/// Passes of each kind at most.
const MAX_PASSES: usize = 4;
/// Coarse offsets below this, in px, are left to the next pass.
const COARSE_PX: f64 = 0.7;
/// Threshold of Huber's loss for coarse matches, in px of the reduced picture.
const COARSE_HUBER: f64 = 0.7;
/// Fewest coarse matches that tell anything.
const MIN_MATCHES: usize = 60;
/// A pass that changes rows by less than this, in px, ends those that look at rows alone.
const ROWS_REST_PX: f64 = 0.3;
/// Parts of the drive in which a yaw is searched and improved, and pairs of each.
const PARTS: usize = 4;
const PART_PAIRS: usize = 20;
/// Angles that are tried: to both sides, and the distance between them as a disparity, in px.
const SEARCH_DEG: f64 = 0.6;
const SEARCH_STEP_PX: f64 = 0.75;
/// A pass over these parts that turns the camera by less than this, in degrees, is the last.
const PARTS_REST_DEG: f64 = 0.02;
/// A full pass that turns the camera by less than this, in degrees, is the last.
const REST_DEG: f64 = 0.004;
/// Fewest blocks and frames with a speed of the vehicle with which distances are compared with it.
const MIN_SPEED_FRAMES: usize = 20;
const MIN_SPEED_M_S: f64 = 2.0;

/// Why a drive cannot be used.
#[derive(Debug, Error)]
pub enum DriveError {
    /// The source has too few pairs.
    #[error("{0} pairs: a drive of some seconds is needed, with at least {MIN_PAIRS}")]
    TooShort(u64),
    /// A pair cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// A pair cannot be matched.
    #[error(transparent)]
    Match(#[from] MatchError),
    /// Nothing is left in common of both images.
    #[error("after the turn that was found: {0}")]
    Rectification(#[from] RectificationError),
    /// Too few points were found in both images.
    #[error(
        "too few points are found in both pictures: is {0} the calibration of these cameras, and is there texture and light?"
    )]
    NoMatches(String),
}

/// Fewest pairs.
const MIN_PAIRS: u64 = 40;

/// Progress of a calibration: what is done, pairs so far and pairs of this pass.
pub type Progress<'a> = dyn FnMut(&str, usize, usize) + 'a;

/// What was found.
#[derive(Clone, Debug)]
pub struct DriveOutcome {
    /// The rig with the right camera turned.
    pub rig: RigFile,
    /// The turn against the given calibration.
    pub turn: RightTurn,
    /// What the last pass found, with standard errors; what it still found to correct is in [`Self::turn`], too.
    pub last: DriveEstimate,
    /// Typical (root mean square) row offset over the image with the given calibration, and now, in px.
    pub rows_px: [f64; 2],
    /// Factor by which distances would have to be multiplied so that the speed is that of the vehicle's bus, with its
    /// standard error; `None` without a bus.
    pub scale: Option<(f64, f64)>,
    /// Passes over the whole drive, and whether the last one changed nothing more.
    pub passes: usize,
    /// See [`Self::passes`].
    pub is_settled: bool,
}

/// A rig of cameras without distortion for a pair that is rectified already.
pub fn rectified_rig(rig: &Rig, size: (usize, usize)) -> RigFile {
    let camera = Camera::pinhole(rig.focal_px, rig.focal_px, rig.cx_px, rig.cy_px);
    let mut between = Pose::identity();
    between.translation_m.x = -rig.baseline_m;
    RigFile {
        serial: String::new(),
        date: String::new(),
        cameras: [camera; 2],
        between,
        rectification: Rectification {
            turns: [Rotation3::identity(); 2],
            rig: *rig,
            size,
            valid: [0, 0, size.0, size.1],
        },
        quality: None,
    }
}

/// Calibrates from the pairs of a source, as the cameras took them. `name` is that of the calibration, for errors.
///
/// # Errors
/// If a pair cannot be read or matched, the drive is too short, or the pictures do not fit to the calibration at all.
pub fn run(
    source: &mut dyn PairSource,
    pairs: u64,
    given: &RigFile,
    name: &str,
    matcher: &mut dyn Matcher,
    progress: &mut Progress<'_>,
) -> Result<DriveOutcome, DriveError> {
    if pairs < MIN_PAIRS {
        return Err(DriveError::TooShort(pairs));
    }
    let pairs = usize::try_from(pairs).unwrap_or(usize::MAX);
    let mut drive = Drive::new(source, given, matcher, progress);
    let no_matches = || DriveError::NoMatches(name.to_owned());
    let mut first_rows_px = None;
    for pass in 0..MAX_PASSES {
        let field = drive.coarse_rows(&spread(pairs, COARSE_PAIRS))?.ok_or_else(no_matches)?;
        first_rows_px.get_or_insert(typical_px(&field));
        if field.largest_px() < COARSE_PX || pass + 1 == MAX_PASSES {
            break;
        }
        drive.turn(&RightTurn::of_rows(&field, &drive.rig(), drive.size))?;
    }
    for pass in 0..MAX_PASSES {
        let field = drive.rows(&spread(pairs, ROW_PAIRS))?.ok_or_else(no_matches)?;
        if pass == 0 && drive.is_as_given {
            first_rows_px = Some(typical_px(&field));
        }
        drive.turn(&RightTurn::of_rows(&field, &drive.rig(), drive.size))?;
        if field.largest_px() < ROWS_REST_PX {
            break;
        }
    }
    if let Some(yaw_rad) = drive.search_yaw(pairs)? {
        drive.turn(&RightTurn { yaw_rad, ..RightTurn::default() })?;
    }
    let parts = parts(pairs);
    for _ in 0..MAX_PASSES {
        let (estimate, _) = drive.estimate("all angles, parts of the drive", &parts)?;
        drive.turn(&estimate.turn())?;
        if estimate.turn().largest_rad().to_degrees() < PARTS_REST_DEG {
            break;
        }
    }
    let mut result = None;
    for pass in 1..=MAX_PASSES {
        let text = format!("all angles, pass {pass}");
        let (estimate, scale) = drive.estimate(&text, std::slice::from_ref(&(0..pairs)))?;
        let turn = estimate.turn();
        drive.turn(&turn)?;
        let is_settled = turn.largest_rad().to_degrees() < REST_DEG;
        result = Some((estimate, scale, pass, is_settled));
        if is_settled || (estimate.rows.is_none() && estimate.yaw.is_none()) {
            break;
        }
    }
    let Some((last, scale, passes, is_settled)) = result else { return Err(no_matches()) };
    let mut turn = RightTurn::between(&given.rectification, &drive.now.rectification);
    if last.yaw.is_none() {
        // What a search alone has found is no measurement.
        drive.turn(&RightTurn { yaw_rad: -turn.yaw_rad, ..RightTurn::default() })?;
        turn = RightTurn::between(&given.rectification, &drive.now.rectification);
    }
    let rows_px = [first_rows_px.unwrap_or_default(), typical_px(&last.field)];
    Ok(DriveOutcome { rig: drive.now, turn, last, rows_px, scale, passes, is_settled })
}

/// `count` of `pairs` indices, evenly spread.
fn spread(pairs: usize, count: usize) -> Vec<usize> {
    let count = count.min(pairs).max(1);
    (0..count).map(|k| (2 * k + 1) * pairs / (2 * count)).collect()
}

/// Parts of a drive, evenly spread; the whole of a short one.
fn parts(pairs: usize) -> Vec<Range<usize>> {
    if pairs < PARTS * PART_PAIRS {
        return std::iter::once(0..pairs).collect();
    }
    let starts = (0..PARTS).map(|part| part * (pairs - PART_PAIRS) / (PARTS - 1));
    starts.map(|first| first..first + PART_PAIRS).collect()
}

/// The pairs of all parts, and whether each is the first of its part.
fn indices(parts: &[Range<usize>]) -> impl Iterator<Item = (usize, bool)> {
    parts.iter().flat_map(|part| part.clone().map(|index| (index, index == part.start)))
}

/// Root mean square of a field over the image.
fn typical_px(field: &RowField) -> f64 {
    (field.offset_px.powi(2) + (field.across_px.powi(2) + field.down_px.powi(2)) / 3.0).sqrt()
}

/// The state between passes.
struct Drive<'a, 'b> {
    source: &'a mut dyn PairSource,
    matcher: &'a mut dyn Matcher,
    progress: &'a mut Progress<'b>,
    size: (usize, usize),
    is_as_given: bool,
    now: RigFile,
    remaps: [Remap; 2],
    raw: [Vec<u8>; 2],
    rectified: [Vec<u8>; 2],
    disparity: Vec<u16>,
    confidence: Vec<u8>,
}

impl<'a, 'b> Drive<'a, 'b> {
    fn new(
        source: &'a mut dyn PairSource,
        given: &RigFile,
        matcher: &'a mut dyn Matcher,
        progress: &'a mut Progress<'b>,
    ) -> Self {
        let size = given.size();
        let pixels = size.0 * size.1;
        let image = || [vec![0; pixels], vec![0; pixels]];
        Self {
            source,
            matcher,
            progress,
            size,
            is_as_given: true,
            now: given.clone(),
            remaps: [0, 1].map(|side| Remap::rectifying(&given.cameras, &given.rectification, side)),
            raw: image(),
            rectified: image(),
            disparity: vec![0; pixels],
            confidence: vec![0; pixels],
        }
    }

    fn rig(&self) -> Rig {
        self.now.rectification.rig
    }

    /// Turns the right camera.
    fn turn(&mut self, turn: &RightTurn) -> Result<(), DriveError> {
        let rig = &mut self.now;
        (rig.rectification, rig.between) = turn.applied(&rig.cameras, &rig.rectification, &rig.between)?;
        self.remaps[1] = Remap::rectifying(&rig.cameras, &rig.rectification, 1);
        self.is_as_given = false;
        Ok(())
    }

    /// Reads and rectifies a pair.
    fn read(&mut self, index: usize) -> Result<(), DriveError> {
        let [left, right] = &mut self.raw;
        self.source.read(index as u64, left, right)?;
        let (width, height) = self.size;
        for ((raw, remap), out) in self.raw.iter().zip(&self.remaps).zip(&mut self.rectified) {
            // The sizes are equal: the buffers are those of the source and of the table.
            if let Ok(raw) = GreyView::new(raw, width, height, width) {
                let _ = remap.apply(raw, out);
            }
        }
        Ok(())
    }

    fn views(&self) -> Option<[GreyView<'_>; 2]> {
        let (width, height) = self.size;
        let [left, right] =
            [0, 1].map(|side| GreyView::new(&self.rectified[side], width, height, width).ok());
        Some([left?, right?])
    }

    /// Reads, rectifies and matches a pair.
    fn matched(&mut self, index: usize) -> Result<(), DriveError> {
        self.read(index)?;
        let (width, height) = self.size;
        let [left, right] = [0, 1].map(|side| GreyView::new(&self.rectified[side], width, height, width));
        if let (Ok(left), Ok(right)) = (left, right) {
            let output = MatchOutput { disparity: &mut self.disparity, confidence: &mut self.confidence };
            self.matcher.compute(left, right, output)?;
        }
        Ok(())
    }

    fn pair(&self) -> Option<MatchedPair<'_>> {
        let [left, right] = self.views()?;
        let disparity = DisparityView::new(&self.disparity, self.size.0, self.size.1)?;
        Some(MatchedPair { left, right, disparity, confidence: &self.confidence })
    }

    /// Row offsets by matches of reduced pictures.
    fn coarse_rows(&mut self, indices: &[usize]) -> Result<Option<RowField>, DriveError> {
        let mut matcher = CoarseMatcher::new(self.size.0, self.size.1);
        let mut matches: Vec<CoarseMatch> = Vec::new();
        for (done, &index) in indices.iter().enumerate() {
            (self.progress)("rows, coarse", done, indices.len());
            self.read(index)?;
            if let Some([left, right]) = self.views() {
                matches.extend(matcher.matches(left, right));
            }
        }
        let points: Vec<[f64; 3]> = matches.iter().map(|m| [m.at[0], m.at[1], m.moved_px[1]]).collect();
        let huber_px = COARSE_HUBER * matcher.scale() as f64;
        Ok(if points.len() < MIN_MATCHES { None } else { RowField::fitted(&points, huber_px) })
    }

    /// Row offsets by the estimator of the running correction.
    fn rows(&mut self, indices: &[usize]) -> Result<Option<RowField>, DriveError> {
        let mut check = lasting_rows();
        for (done, &index) in indices.iter().enumerate() {
            (self.progress)("rows", done, indices.len());
            self.matched(index)?;
            if let Some(pair) = self.pair() {
                check.update(pair, &RowField::ZERO, 0.0);
            }
        }
        Ok((check.weight() > MIN_MATCHES as f64).then(|| check.health().total))
    }

    /// A yaw with which the motion of the vehicle makes sense, in radians.
    fn search_yaw(&mut self, pairs: usize) -> Result<Option<f64>, DriveError> {
        let rig = self.rig();
        let step_rad = SEARCH_STEP_PX / rig.focal_px;
        let steps = (SEARCH_DEG.to_radians() / step_rad).ceil() as i32;
        let angles = (-steps..=steps).map(|k| f64::from(k) * step_rad);
        let mut search = YawSearch::new(rig, self.size, angles);
        let parts = parts(pairs);
        let all = parts.iter().map(Range::len).sum();
        for (done, (index, is_first)) in indices(&parts).enumerate() {
            (self.progress)("yaw, coarse", done, all);
            self.matched(index)?;
            let elapsed_s = (!is_first).then(|| self.elapsed_s(index));
            if let Some(pair) = self.pair() {
                search.update(pair, elapsed_s);
            }
        }
        Ok(search.best_rad())
    }

    /// Time since the pair before, in seconds.
    fn elapsed_s(&self, index: usize) -> f64 {
        let (before, now) = (self.source.time_ns(index as u64 - 1), self.source.time_ns(index as u64));
        now.saturating_sub(before) as f64 * 1e-9
    }

    /// All angles, and the scale by the vehicle's speed.
    fn estimate(
        &mut self,
        text: &str,
        parts: &[Range<usize>],
    ) -> Result<(DriveEstimate, Option<(f64, f64)>), DriveError> {
        let all = parts.iter().map(Range::len).sum();
        let mut estimator = DriveEstimator::new(self.rig(), self.size, all);
        let mut ways: Vec<[f64; 2]> = Vec::new();
        for (done, (index, is_first)) in indices(parts).enumerate() {
            (self.progress)(text, done, all);
            self.matched(index)?;
            let elapsed_s = (!is_first).then(|| self.elapsed_s(index));
            let Some(pair) = self.pair() else { continue };
            let way_m = estimator.update(pair, elapsed_s);
            let speed = self.source.vehicle(index as u64).sample.speed_m_s;
            if let (Some(way_m), Some(speed), Some(elapsed_s)) = (way_m, speed, elapsed_s)
                && speed.value.abs() >= MIN_SPEED_M_S
            {
                ways.push([speed.value.abs() * elapsed_s, way_m]);
            }
        }
        Ok((estimator.estimate(), scale(&ways)))
    }
}

/// Mean of the ratio of two ways over parts of the drive, with its standard error.
fn scale(ways: &[[f64; 2]]) -> Option<(f64, f64)> {
    if ways.len() < MIN_SPEED_FRAMES {
        return None;
    }
    let parts = ways.chunks(ways.len().div_ceil(8));
    mean(parts.map(|part| {
        let [bus, own] = part.iter().fold([0.0; 2], |sum, way| [sum[0] + way[0], sum[1] + way[1]]);
        bus / own.max(1e-6)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_spread_over_the_drive() {
        assert_eq!(spread(100, 4), [12, 37, 62, 87]);
        assert_eq!(spread(3, 8), [0, 1, 2]);
    }

    #[test]
    fn the_scale_is_that_of_the_ways_and_needs_enough_of_them() {
        let ways: Vec<[f64; 2]> = (0..80).map(|k| [1.02, if k % 2 == 0 { 0.99 } else { 1.01 }]).collect();
        let (factor, error) = scale(&ways).unwrap();
        assert!((factor - 1.02).abs() < 1e-3 && error < 1e-3, "{factor} ± {error}");
        assert_eq!(scale(&ways[..10]), None);
    }
}
