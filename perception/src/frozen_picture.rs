//! A camera that shows the same picture again while the vehicle moves: such a picture tells of the time of the one before.
//!
//! Input: the images of each frame, the own motion until then, the step of time since the frame before. Output: how old the last new
//! picture is, or that the frame shows nothing new, and whether that lasts. Noise changes each picture of a camera that works; a camera, a driver or a network that hangs repeats it.
//! Every fourth row of both images is compared, bit for bit.

use crate::frame_clock::TimeStep;
use crate::image::GreyView;
use crate::motion::Motion;
use std::hash::{DefaultHasher, Hasher};

/// Every so many rows are compared.
const ROW_STEP: usize = 4;
/// The vehicle moves if its speed is more than this many standard deviations above 0 …
const MOVING_SIGMAS: f64 = 3.0;
/// … and above this, in m/s: more slowly, nothing moves by a pixel within a frame.
const MIN_SPEED_M_S: f64 = 1.0;
/// Time without a new picture after which nobody knows what is ahead, in seconds: half of that over which filters predict.
const MAX_FROZEN_S: f64 = 0.5;

/// Compares the pictures of each camera with those before.
#[derive(Clone, Debug, Default)]
pub struct FrozenPicture {
    /// Hashes of the last images.
    last: Option<[u64; 2]>,
    is_frozen: bool,
    /// Time since the last new picture, in seconds.
    since_s: f64,
}

impl FrozenPicture {
    /// Time between the last new picture and this one, in seconds; `None` if this one is the one before, although the vehicle moves:
    /// `motion` is what was known until then. It remains frozen until another one comes. A single pair that is shown again and again from
    /// the start is a scene that stands. After a gap or a step back, every picture is new.
    pub fn update(
        &mut self,
        images: [GreyView<'_>; 2],
        motion: Option<&Motion>,
        step: TimeStep,
    ) -> Option<f64> {
        let hashes = images.map(hash);
        let is_repeated =
            self.last.replace(hashes).is_some_and(|last| last[0] == hashes[0] || last[1] == hashes[1]);
        let moves = |m: &Motion| m.speed_m_s.abs() > MIN_SPEED_M_S.max(MOVING_SIGMAS * m.speed_sigma_m_s);
        self.is_frozen = is_repeated && (self.is_frozen || motion.is_some_and(moves));
        self.since_s = if step.is_discontinuity() { 0.0 } else { self.since_s + step.elapsed_s() };
        let is_new = !self.is_frozen || step.is_discontinuity();
        is_new.then(|| std::mem::take(&mut self.since_s))
    }

    /// Whether there has been no new picture for so long that silence tells nothing.
    pub fn lasts(&self) -> bool {
        self.is_frozen && self.since_s > MAX_FROZEN_S
    }
}

fn hash(image: GreyView<'_>) -> u64 {
    let mut hasher = DefaultHasher::new();
    (0..image.height()).step_by(ROW_STEP).for_each(|y| hasher.write(image.row(y)));
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (64, 48);

    fn picture(seed: u8) -> Vec<u8> {
        (0..SIZE.0 * SIZE.1).map(|i| (i * 7 % 251) as u8 ^ seed).collect()
    }

    const STEP: TimeStep = TimeStep::Forward { elapsed_s: 0.08 };

    fn at(speed_m_s: f64) -> Motion {
        Motion { speed_m_s, speed_sigma_m_s: 0.1, ..Motion::default() }
    }

    /// Pictures with these numbers, one each for the left and the right camera, with the motion until then: whether they are frozen.
    fn frozen(frames: &[([u8; 2], Option<Motion>)]) -> Vec<bool> {
        let mut state = FrozenPicture::default();
        let mut update = |numbers: [u8; 2], motion: Option<Motion>| {
            let [left, right] = numbers.map(picture);
            let [left, right] =
                [&left, &right].map(|data| GreyView::new(data, SIZE.0, SIZE.1, SIZE.0).expect("lengths fit"));
            state.update([left, right], motion.as_ref(), STEP).is_none()
        };
        frames.iter().map(|(numbers, motion)| update(*numbers, *motion)).collect()
    }

    #[test]
    fn the_picture_before_is_frozen_if_the_vehicle_moves() {
        let pair = [1, 2];
        let seen = |motion| frozen(&[(pair, motion), (pair, motion)])[1];
        assert!(seen(Some(at(10.0))) && seen(Some(at(-10.0))));
        assert!(!seen(Some(at(0.9))) && !seen(None));
        assert!(!seen(Some(Motion { speed_sigma_m_s: 5.0, ..at(10.0) })));
    }

    #[test]
    fn one_camera_that_hangs_is_enough() {
        let moves = Some(at(10.0));
        assert_eq!(frozen(&[([1, 2], moves), ([3, 2], moves), ([4, 5], moves)]), [false, true, false]);
        assert_eq!(frozen(&[([1, 2], moves), ([1, 3], moves), ([4, 5], moves)]), [false, true, false]);
    }

    #[test]
    fn it_remains_frozen_until_another_one_comes() {
        let pair = [1, 2];
        let frames = [
            (pair, Some(at(10.0))),
            (pair, Some(at(10.0))),
            (pair, None),
            (pair, Some(at(0.0))),
            ([3, 4], None),
            ([3, 4], None),
        ];
        assert_eq!(frozen(&frames), [false, true, true, true, false, false]);
    }

    #[test]
    fn it_lasts_after_half_a_second() {
        let data = picture(0);
        let view = GreyView::new(&data, SIZE.0, SIZE.1, SIZE.0).expect("lengths fit");
        let mut state = FrozenPicture::default();
        let lasts: Vec<bool> = (0..10)
            .map(|_| {
                state.update([view, view], Some(&at(10.0)), STEP);
                state.lasts()
            })
            .collect();
        // The first one is new; the seventh after it is 0.56 s old.
        assert_eq!(lasts.iter().position(|lasts| *lasts), Some(7));
        let other = picture(1);
        let view = GreyView::new(&other, SIZE.0, SIZE.1, SIZE.0).expect("lengths fit");
        let since_s = state.update([view, view], Some(&at(10.0)), STEP).expect("a new picture");
        assert!((since_s - 0.8).abs() < 1e-9 && !state.lasts(), "{since_s}");
    }

    #[test]
    fn after_a_gap_a_picture_is_new() {
        let data = picture(0);
        let view = GreyView::new(&data, SIZE.0, SIZE.1, SIZE.0).expect("lengths fit");
        let mut state = FrozenPicture::default();
        let mut update = |step| state.update([view, view], Some(&at(10.0)), step);
        let gap = TimeStep::Gap { elapsed_s: 5.0 };
        assert_eq!([TimeStep::First, STEP, gap, STEP].map(&mut update), [Some(0.0), None, Some(0.0), None]);
    }

    #[test]
    fn a_change_of_one_grey_level_in_a_compared_row_is_a_new_picture() {
        let (first, mut second) = (picture(0), picture(0));
        second[8 * SIZE.0 + 5] ^= 1;
        let [a, b] =
            [&first, &second].map(|data| GreyView::new(data, SIZE.0, SIZE.1, SIZE.0).expect("lengths fit"));
        let mut state = FrozenPicture::default();
        assert!(state.update([a, a], Some(&at(10.0)), STEP).is_some());
        assert!(state.update([b, b], Some(&at(10.0)), STEP).is_some());
    }
}
