//! Tells at the first pairs of a source when they are no pairs: left and right exchanged, one picture twice, or rows far
//! apart. The daemon has the same check in its stereo stage, which goes on during a run.

use messages::calibration::{CalibrationCause, CalibrationRecord, CalibrationState};
use perception::image::GreyView;
use perception::stereo::epipolar::EpipolarParameters;
use perception::stereo::epipolar::pairing::{Pairing, PairingCheck};

/// Pairs in a row that have to agree.
const AGREEING: u64 = 3;

/// Pairs that are looked at until the check knows what they are; the first may be dark.
const MAX_LOOKS: u64 = 30;

/// What is wrong with two pictures of a size, with what to do; `None` if nothing is known to be wrong.
pub fn fault(left: &[u8], right: &[u8], (width, height): (usize, usize)) -> Option<String> {
    let view = |pixels| GreyView::new(pixels, width, height, width).ok();
    text(check(width, height).of_one_pair(view(left)?, view(right)?))
}

fn check(width: usize, height: usize) -> PairingCheck {
    // What the measurement by corners searches, less its border.
    PairingCheck::new(width, height, EpipolarParameters::default().reach_px as f64 - 1.0)
}

fn text(pairing: Pairing) -> Option<String> {
    let (cause, total_px) = match pairing {
        Pairing::Swapped => (CalibrationCause::Swapped, 0.0),
        Pairing::Identical => (CalibrationCause::Identical, 0.0),
        Pairing::RowsApart(px) => (CalibrationCause::Apart, px.abs() as f32),
        Pairing::Unknown | Pairing::Pair => return None,
    };
    let state = CalibrationState::Degraded as u32;
    let record = CalibrationRecord { state, cause: cause as u32, total_px, ..CalibrationRecord::default() };
    Some(format!("calibration {record}: {}", record.remedy()))
}

/// The check of the first pairs of a source.
pub struct FirstPairs {
    /// Until it is known what the pairs are.
    check: Option<PairingCheck>,
    size: (usize, usize),
    /// Number of pairs of the source.
    count: Option<u64>,
    looks: u64,
}

impl FirstPairs {
    /// The check of a source; with `is_on` false it does nothing.
    pub fn new(size: (usize, usize), count: Option<u64>, is_on: bool) -> Self {
        Self { check: is_on.then(|| check(size.0, size.1)), size, count, looks: 0 }
    }

    /// Looks at the next pair, and logs what is wrong with the source.
    pub fn look(&mut self, left: &[u8], right: &[u8]) {
        if let Some(fault) = self.found(left, right) {
            tracing::warn!("{fault}");
        }
    }

    fn found(&mut self, left: &[u8], right: &[u8]) -> Option<String> {
        let check = self.check.as_mut()?;
        let view = |pixels| GreyView::new(pixels, self.size.0, self.size.1, self.size.0).ok();
        let (left, right) = (view(left)?, view(right)?);
        self.looks += 1;
        let found = match self.count {
            // There are no others that could agree.
            Some(count) if count < AGREEING => check.of_one_pair(left, right),
            _ => check.update(left, right),
        };
        if found != Pairing::Unknown || self.looks >= MAX_LOOKS {
            self.check = None;
        }
        text(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sources::PairSource;
    use sources::scene::Drive;

    /// What is told of `count` pairs of the built-in drive, exchanged or not, and after how many.
    fn told(count: u64, exchanged: bool) -> Option<(u64, String)> {
        let mut drive = Drive::paper(1);
        let (mut left, mut right) = (vec![0; 640 * 480], vec![0; 640 * 480]);
        let mut check = FirstPairs::new((640, 480), Some(count), true);
        for index in 0..count {
            drive.read(index, &mut left, &mut right).unwrap();
            let (a, b) = if exchanged { (&right, &left) } else { (&left, &right) };
            if let Some(text) = check.found(a, b) {
                return Some((index, text));
            }
        }
        None
    }

    #[test]
    fn exchanged_pictures_are_told_at_the_first_pairs() {
        assert_eq!(told(5, false), None);
        assert_eq!(told(1, false), None);
        let (index, text) = told(5, true).unwrap();
        assert_eq!(index, 2);
        assert!(text.contains("swapped") && text.contains("exchange left and right"), "{text}");
        assert_eq!(told(1, true), Some((0, text)), "one pair alone");
    }

    #[test]
    fn one_picture_twice_is_told() {
        let mut drive = Drive::paper(1);
        let (mut left, mut right) = (vec![0; 640 * 480], vec![0; 640 * 480]);
        drive.read(0, &mut left, &mut right).unwrap();
        assert_eq!(fault(&left, &right, (640, 480)), None);
        assert!(fault(&left, &left, (640, 480)).unwrap().contains("both pictures are the same"));
        assert_eq!(fault(&vec![0; 640 * 480], &vec![0; 640 * 480], (640, 480)), None);
        assert_eq!(FirstPairs::new((640, 480), Some(1), false).found(&left, &left), None, "switched off");
    }
}
