//! Whether two images are the left and the right view of one scene: swapped cameras, one picture twice, and rows that
//! are too far apart to be measured by [`super::EpipolarCheck`].
//!
//! Corners are searched without any disparity map ([`super::coarse`]). Points of a scene lie farther left in the right
//! image; with swapped cameras they lie farther right.

use super::coarse::{CoarseMatcher, MAX_MATCHES};
use crate::image::GreyView;

/// What two images are to each other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Pairing {
    /// Too few corners were found again.
    #[default]
    Unknown,
    /// Left and right view of a scene.
    Pair,
    /// The right view is given as the left one.
    Swapped,
    /// Both are the same picture.
    Identical,
    /// The rows are this many pixels apart (right minus left), beyond what is measured more precisely.
    RowsApart(f64),
}

/// Fewest matches that decide, and the majority that they need.
const MIN_VOTES: usize = 8;
const MAJORITY: usize = 4;
/// Consecutive equal results that are reported.
const DEBOUNCE: u32 = 3;
/// Identical pictures: fewest textured pixels, and the share of them (in 1/1000) that differ by at most one grey level.
/// The noise of two cameras alone separates most pixels by more.
const MIN_TEXTURED: usize = 200;
const MIN_EQUAL: usize = 995;
/// Difference of neighbours of a textured pixel, in grey levels.
const TEXTURE: u8 = 8;

/// Check of a run's pairs. Updates do not allocate.
#[derive(Clone, Debug)]
pub struct PairingCheck {
    matcher: CoarseMatcher,
    /// Vertical offsets up to this are left to the measurement by corners, in px.
    measured_px: f64,
    last: Pairing,
    count: u32,
    result: Pairing,
}

impl PairingCheck {
    /// A check for images of `width` × `height` pixels, where vertical offsets up to `measured_px` are no fault.
    pub fn new(width: usize, height: usize, measured_px: f64) -> Self {
        let matcher = CoarseMatcher::new(width, height);
        Self { matcher, measured_px, last: Pairing::Unknown, count: 0, result: Pairing::Unknown }
    }

    /// The result so far.
    pub fn result(&self) -> Pairing {
        self.result
    }

    /// Updates the result with a pair; images of another size are ignored. Something new is reported after three
    /// equal results, and what cannot be decided changes nothing.
    pub fn update(&mut self, left: GreyView<'_>, right: GreyView<'_>) -> Pairing {
        let found = self.of_one_pair(left, right);
        let is_same = std::mem::discriminant(&found) == std::mem::discriminant(&self.last);
        self.count = if is_same { self.count + 1 } else { 1 };
        self.last = found;
        if found != Pairing::Unknown && self.count >= DEBOUNCE {
            self.result = found;
        }
        self.result
    }

    /// What a pair says alone, without others that agree.
    pub fn of_one_pair(&mut self, left: GreyView<'_>, right: GreyView<'_>) -> Pairing {
        if are_identical(left, right) { Pairing::Identical } else { self.search(left, right) }
    }

    fn search(&mut self, left: GreyView<'_>, right: GreyView<'_>) -> Pairing {
        let scale = self.matcher.scale() as f64;
        let found = self.matcher.matches(left, right);
        let votes = found.len();
        if votes < MIN_VOTES {
            return Pairing::Unknown;
        }
        let side =
            |is_there: fn(f64) -> bool| found.iter().filter(|m| is_there(m.moved_px[0] / scale)).count();
        let (to_left, to_right) = (side(|columns| columns <= -2.0), side(|columns| columns >= 2.0));
        let mut rows = [0_i32; MAX_MATCHES];
        for (row, found) in rows.iter_mut().zip(found) {
            *row = (found.moved_px[1] / scale).round() as i32;
        }
        let rows = &mut rows[..votes];
        rows.sort_unstable();
        let apart_px = f64::from(rows[votes / 2]) * scale;
        // Most matches lie in that row: chance matches lie anywhere.
        let alike = rows.iter().filter(|row| row.abs_diff(rows[votes / 2]) <= 1).count();
        if to_right >= MIN_VOTES && to_right > MAJORITY * to_left {
            Pairing::Swapped
        } else if 4 * alike < 3 * votes {
            Pairing::Unknown
        } else if apart_px.abs() > self.measured_px {
            Pairing::RowsApart(apart_px)
        } else {
            Pairing::Pair
        }
    }
}

/// Whether both images show the same where there is texture.
fn are_identical(left: GreyView<'_>, right: GreyView<'_>) -> bool {
    if (left.width(), left.height()) != (right.width(), right.height()) {
        return false;
    }
    let (mut textured, mut equal) = (0, 0);
    for y in (0..left.height()).step_by(4) {
        let (a, b) = (left.row(y), right.row(y));
        for x in (1..left.width()).step_by(4) {
            if a[x].abs_diff(a[x - 1]) >= TEXTURE {
                textured += 1;
                equal += usize::from(a[x].abs_diff(b[x]) <= 1);
            }
        }
    }
    textured >= MIN_TEXTURED && 1000 * equal >= MIN_EQUAL * textured
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GreyImage;

    const SIZE: (usize, usize) = (720, 300);

    /// A textured pair: disparities grow from 5 to 45 px down the image; the right rows are `rows` lower. With noise of
    /// two grey levels, as of a camera.
    fn pair(rows: f64, seed: u64) -> [GreyImage; 2] {
        let mut random = fastrand::Rng::with_seed(seed);
        let coarse: Vec<f64> = (0..200 * 100).map(|_| random.f64() * 255.0).collect();
        let mut noise = fastrand::Rng::with_seed(seed + 1);
        let mut image = |shift: f64, rows: f64| {
            let pixels = (0..SIZE.0 * SIZE.1).map(|i| {
                let y = (i / SIZE.0) as f64 - rows;
                let x = (i % SIZE.0) as f64 + shift * (5.0 + 40.0 * y / SIZE.1 as f64) + 60.0;
                let (x, y) = (x / 9.0, (y + 60.0) / 9.0);
                let (i, j, fx, fy) = (x as usize, y as usize, x.fract(), y.fract());
                let at = |di: usize, dj: usize| coarse[(j + dj) * 200 + i + di];
                let (a, b) = (at(0, 0) + fx * (at(1, 0) - at(0, 0)), at(0, 1) + fx * (at(1, 1) - at(0, 1)));
                (a + fy * (b - a) + 7.0 * (noise.f64() - 0.5)).clamp(0.0, 255.0) as u8
            });
            GreyImage::from_vec(pixels.collect(), SIZE.0, SIZE.1).unwrap()
        };
        [image(0.0, 0.0), image(1.0, rows)]
    }

    fn found(left: &GreyImage, right: &GreyImage) -> Pairing {
        let mut check = PairingCheck::new(SIZE.0, SIZE.1, 4.0);
        assert_eq!(check.update(left.view(), right.view()), Pairing::Unknown, "one result decides nothing");
        check.update(left.view(), right.view());
        check.update(left.view(), right.view())
    }

    #[test]
    fn pairs_are_told_from_swapped_identical_and_shifted_ones() {
        for seed in 1..6 {
            let [left, right] = pair(0.0, seed);
            assert_eq!(found(&left, &right), Pairing::Pair);
            assert_eq!(found(&right, &left), Pairing::Swapped);
            assert_eq!(found(&left, &left), Pairing::Identical);
            let [left, right] = pair(2.0, seed);
            assert_eq!(found(&left, &right), Pairing::Pair, "measured by corners");
            for rows in [-12.0, 9.0] {
                let [left, right] = pair(rows, seed);
                let Pairing::RowsApart(px) = found(&left, &right) else { panic!("{rows} rows") };
                assert!((px - rows).abs() <= 3.0, "{px} px");
            }
        }
    }

    #[test]
    fn unrelated_or_empty_pictures_decide_nothing() {
        let ([left, _], [_, right]) = (pair(0.0, 1), pair(0.0, 99));
        assert_eq!(found(&left, &right), Pairing::Unknown);
        let flat = GreyImage::new(SIZE.0, SIZE.1);
        assert_eq!(found(&flat, &flat), Pairing::Unknown);
        // Pictures of another size, and tiny ones.
        let small = GreyImage::new(40, 20);
        let mut check = PairingCheck::new(SIZE.0, SIZE.1, 4.0);
        assert_eq!(check.update(small.view(), small.view()), Pairing::Unknown);
        assert_eq!(PairingCheck::new(40, 20, 4.0).update(small.view(), small.view()), Pairing::Unknown);
    }

    #[test]
    fn a_pair_that_was_told_stays_told_while_nothing_can_be_seen() {
        let [left, right] = pair(0.0, 3);
        let flat = GreyImage::new(SIZE.0, SIZE.1);
        let mut check = PairingCheck::new(SIZE.0, SIZE.1, 4.0);
        for _ in 0..3 {
            check.update(right.view(), left.view());
        }
        for _ in 0..5 {
            assert_eq!(check.update(flat.view(), flat.view()), Pairing::Swapped);
        }
        for _ in 0..3 {
            check.update(left.view(), right.view());
        }
        assert_eq!(check.result(), Pairing::Pair);
    }
}
