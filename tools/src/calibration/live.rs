//! Selection of calibration pairs from a running source, and feedback on what is still missing.
//!
//! A pair is kept when the board is at rest in both images and its position, size or slant differs from all
//! kept pairs. After each kept pair the calibration is solved and graded; the reasons of the verdict say what
//! is missing. Once there are enough pairs, those whose board moved between the two exposures are dropped, so
//! that the same positions can be captured again.

use super::features;
use perception::calibration::finder::{self, ordered_alike};
use perception::calibration::stereo::ViewReport;
use perception::calibration::{Board, Crop, Grade, Lens, Pair, Places, Verdict, calibrate, judge};
use perception::image::GreyView;

/// Minimum number of pairs for a complete session: the verdict needs enough data.
pub const MIN_PAIRS: usize = 12;

/// Maximum number of pairs.
pub const MAX_PAIRS: usize = 40;

/// A board whose corners move by less between two images, root mean square in pixels, is at rest.
const REST_PX: f64 = 0.7;

/// Distance of position, size and slants (see `features`) from every kept pair that makes a view new.
const NOVEL: f64 = 0.16;

/// With fewer pairs the calibration is not solved.
const MIN_SOLVED: usize = 4;

/// Result of offering a pair.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// The board is not visible in both images.
    NoBoard,
    /// The board is moving.
    Moving,
    /// The view is similar to a kept one.
    Known,
    /// The pair was kept.
    Kept {
        /// Verdict on all kept pairs; `None` while there are too few.
        verdict: Option<Verdict>,
        /// Numbers of dropped pairs, whose boards moved between the two exposures.
        dropped: Vec<usize>,
    },
}

/// A live calibration session with the kept pairs.
pub struct Session {
    board: Board,
    lens: Lens,
    crop: Crop,
    size: (usize, usize),
    needs_rest: bool,
    kept: Vec<Pair>,
    /// Numbers of the kept pairs; numbers of dropped pairs are not reused.
    numbers: Vec<usize>,
    taken: usize,
    features: Vec<[f64; 5]>,
    before: Option<[Places; 2]>,
    verdict: Option<Verdict>,
}

impl Session {
    /// A session for images of `size`. With `needs_rest` the board must not have moved since the previous pair,
    /// so that the cameras need not be synchronised.
    pub fn new(board: Board, lens: Lens, crop: Crop, size: (usize, usize), needs_rest: bool) -> Self {
        Self {
            board,
            lens,
            crop,
            size,
            needs_rest,
            kept: Vec::new(),
            numbers: Vec::new(),
            taken: 0,
            features: Vec::new(),
            before: None,
            verdict: None,
        }
    }

    /// Number of kept pairs.
    pub fn kept(&self) -> usize {
        self.kept.len()
    }

    /// Number of pairs ever kept, which is the number of the last one.
    pub fn taken(&self) -> usize {
        self.taken
    }

    /// Whether no more pairs are needed: the grade is good, or the maximum number is reached.
    pub fn is_complete(&self) -> bool {
        let is_good = self.verdict.as_ref().is_some_and(|v| v.grade == Grade::Good);
        (is_good && self.kept.len() >= MIN_PAIRS) || self.taken >= MAX_PAIRS
    }

    /// Processes the next pair.
    pub fn offer(&mut self, left: GreyView<'_>, right: GreyView<'_>) -> Step {
        let found = finder::find(left, &self.board).and_then(|l| Ok([l, finder::find(right, &self.board)?]));
        let Ok([left, right]) = found else {
            self.before = None;
            return Step::NoBoard;
        };
        let right = ordered_alike(&left.corners, &right.corners, &self.board);
        let now = [left.corners, right];
        let is_at_rest = !self.needs_rest || self.before.as_ref().is_some_and(|before| rests(before, &now));
        let features = features(&now[0], &self.board, self.size);
        let [left, right] = &now;
        let pair = Pair { left: left.clone(), right: right.clone() };
        self.before = Some(now);
        if !is_at_rest {
            return Step::Moving;
        }
        let apart = |a: &[f64; 5]| a.iter().zip(&features).map(|(x, y)| (x - y).abs()).sum::<f64>();
        if self.features.iter().any(|kept| apart(kept) < NOVEL) {
            return Step::Known;
        }
        self.features.push(features);
        self.kept.push(pair);
        self.taken += 1;
        self.numbers.push(self.taken);
        let mut dropped = Vec::new();
        if self.kept.len() >= MIN_SOLVED {
            let mut moved = self.judge();
            // One at a time, as an outlier affects the residuals of the others; none while there are few pairs.
            while let (Some(worst), MIN_PAIRS..) = (moved, self.kept.len()) {
                dropped.push(self.numbers.remove(worst));
                self.kept.remove(worst);
                self.features.remove(worst);
                moved = self.judge();
            }
        }
        Step::Kept { verdict: self.verdict.clone(), dropped }
    }

    /// Grades the kept pairs. Returns the one whose board moved most between the two exposures, if any.
    fn judge(&mut self) -> Option<usize> {
        let names: Vec<String> = self.numbers.iter().map(|n| format!("pair {n}")).collect();
        match calibrate(&self.board, self.size, &self.kept, self.lens, self.crop) {
            Ok(c) => {
                self.verdict = Some(judge(&c, &names));
                let moved = c.views.iter().enumerate().filter(|(_, v)| v.moved);
                let far = |v: &ViewReport| v.shift_px.amax();
                moved.max_by(|a, b| far(a.1).total_cmp(&far(b.1))).map(|(i, _)| i)
            }
            Err(error) => {
                self.verdict = Some(Verdict::redo(error.to_string()));
                None
            }
        }
    }
}

/// Whether the corners are unchanged in both images. Of a board that is seen in part, most of the same part must be seen again.
fn rests(before: &[Places; 2], now: &[Places; 2]) -> bool {
    before.iter().zip(now).all(|(a, b)| {
        let both = a.iter().zip(b).filter_map(|(p, q)| Some(((*p)? - (*q)?).norm_squared()));
        let (sum, count) = both.fold((0.0, 0), |(sum, count), d| (sum + d, count + 1));
        2 * count as usize > b.iter().flatten().count() && sum / f64::from(count.max(1)) <= REST_PX * REST_PX
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};
    use perception::calibration::{Camera, Pose};
    use perception::image::GreyImage;
    use sources::chessboard::{BoardRenderer, Conditions, poses};

    const SIZE: (usize, usize) = (320, 240);

    fn views(count: usize) -> Vec<[GreyImage; 2]> {
        let camera = Camera::pinhole(270.0, 270.0, 160.0, 120.0);
        let board = Board::new(9, 6, 0.025).unwrap();
        let studio = BoardRenderer::new(&camera, SIZE, board);
        let between = Pose {
            rotation: Rotation3::new(Vector3::new(0.004, 0.008, -0.003)),
            translation_m: Vector3::new(-0.1, 0.0, 0.0),
        };
        let take = |(i, mut pose): (usize, Pose)| {
            pose.translation_m.x += 0.05;
            let conditions = Conditions::default();
            let left = studio.picture(&pose, &conditions, 2 * i as u64);
            [left, studio.picture(&pose.then(&between), &conditions, 2 * i as u64 + 1)]
        };
        poses(count, (0.4, 0.7), 270.0 / 320.0, 5).into_iter().enumerate().map(take).collect()
    }

    #[test]
    fn new_views_at_rest_are_kept_until_the_verdict_is_good() {
        let board = Board::new(9, 6, 0.025).unwrap();
        let mut session = Session::new(board, Lens::Radial2, Crop::Valid, SIZE, true);
        let empty = GreyImage::new(SIZE.0, SIZE.1);
        assert_eq!(session.offer(empty.view(), empty.view()), Step::NoBoard);
        let mut missing = Vec::new();
        for [left, right] in views(40) {
            if session.is_complete() {
                break;
            }
            // The board arrives, rests, and stays for a while.
            assert_eq!(session.offer(left.view(), right.view()), Step::Moving);
            if let Step::Kept { verdict, .. } = session.offer(left.view(), right.view()) {
                missing.push(
                    verdict.map_or(String::new(), |v| {
                        v.reasons.first().map_or(String::new(), |r| r.text.clone())
                    }),
                );
                assert_eq!(session.offer(left.view(), right.view()), Step::Known);
            }
        }
        assert!(session.is_complete(), "{missing:#?}");
        assert!((MIN_PAIRS..=MAX_PAIRS).contains(&session.kept()), "{}", session.kept());
        assert!(
            missing.iter().any(|m| m.contains("views were used")),
            "it must say what is missing: {missing:#?}"
        );
    }

    #[test]
    fn a_board_with_markers_is_kept_where_only_a_part_of_it_is_seen() {
        let camera = Camera::pinhole(270.0, 270.0, 160.0, 120.0);
        let board = Board::charuco((7, 5), 0.03, 0.023, "4x4_50".parse().unwrap(), false).unwrap();
        let studio = BoardRenderer::new(&camera, SIZE, board);
        let mut session = Session::new(board, Lens::Radial2, Crop::Valid, SIZE, true);
        let cut = Pose {
            rotation: Rotation3::new(Vector3::new(0.2, -0.3, 0.1)),
            translation_m: Vector3::new(0.17, 0.05, 0.34),
        };
        let left = studio.picture(&cut, &Conditions::default(), 1);
        let mut beside = cut;
        beside.translation_m.x -= 0.08;
        let right = studio.picture(&beside, &Conditions::default(), 2);
        let seen = finder::find(left.view(), &board).unwrap().corners;
        assert!(seen.iter().any(Option::is_none), "the board is not cut off");
        assert_eq!(session.offer(left.view(), right.view()), Step::Moving);
        assert!(matches!(session.offer(left.view(), right.view()), Step::Kept { verdict: None, .. }));
        assert_eq!(session.offer(left.view(), right.view()), Step::Known);
        // Another part of the board is not the board at rest.
        let mut other = cut;
        other.translation_m.x = -0.17;
        let away = studio.picture(&other, &Conditions::default(), 3);
        assert_eq!(session.offer(away.view(), right.view()), Step::Moving);
    }

    #[test]
    fn a_folder_needs_no_rest() {
        let board = Board::new(9, 6, 0.025).unwrap();
        let mut session = Session::new(board, Lens::Radial2, Crop::Valid, SIZE, false);
        let [left, right] = &views(1)[0];
        assert!(matches!(session.offer(left.view(), right.view()), Step::Kept { verdict: None, .. }));
        assert_eq!(session.offer(left.view(), right.view()), Step::Known);
    }

    #[test]
    fn a_pair_whose_board_moved_is_dropped_and_its_place_taken_again() {
        let board = Board::new(9, 6, 0.025).unwrap();
        let mut session = Session::new(board, Lens::Radial2, Crop::Valid, SIZE, false);
        let mut dropped_all = Vec::new();
        let views = views(16);
        let mut moved = None;
        for (i, [left, right]) in views.iter().enumerate() {
            // The right image of one pair is a pixel lower.
            let mut lower = right.clone();
            if i == 5 {
                lower.as_mut_slice()[SIZE.0..].copy_from_slice(&right.as_slice()[..SIZE.0 * (SIZE.1 - 1)]);
            }
            if let Step::Kept { dropped, .. } = session.offer(left.view(), lower.view()) {
                if i == 5 {
                    moved = Some(session.taken());
                }
                dropped_all.extend(dropped);
            }
        }
        assert!(moved.is_some() && session.kept() >= MIN_PAIRS - 1, "{moved:?} {}", session.kept());
        assert_eq!(dropped_all, moved.as_slice());
        assert_eq!(session.kept(), session.taken() - 1);
        let [left, right] = &views[5];
        assert!(
            matches!(session.offer(left.view(), right.view()), Step::Kept { dropped, .. } if dropped.is_empty())
        );
        assert_eq!(session.offer(left.view(), right.view()), Step::Known);
    }
}
