//! A camera that shows the same picture again while the vehicle moves: such a picture tells of the time of the one before.
//!
//! Input: the left image of each frame and the own motion at its time. Output: whether the frame shows nothing new. Noise changes each
//! picture of a camera that works; a camera, a driver or a network that hangs repeats one bit for bit.

use crate::image::GreyView;
use crate::motion::Motion;
use std::hash::{DefaultHasher, Hasher};

/// Every so many rows are compared.
const ROW_STEP: usize = 4;
/// The vehicle moves if its speed is more than this many standard deviations above 0 …
const MOVING_SIGMAS: f64 = 3.0;
/// … and above this, in m/s: more slowly, nothing moves by a pixel within a frame.
const MIN_SPEED_M_S: f64 = 1.0;

/// Compares each picture with the one before.
#[derive(Clone, Debug, Default)]
pub struct FrozenPicture {
    /// Hash of the last picture.
    last: Option<u64>,
}

impl FrozenPicture {
    /// Whether this picture is the one before, although the vehicle moves. Without a known motion it is not: a single pair that is shown
    /// again and again is a scene that stands.
    pub fn update(&mut self, left: GreyView<'_>, motion: Option<&Motion>) -> bool {
        let mut hasher = DefaultHasher::new();
        (0..left.height()).step_by(ROW_STEP).for_each(|y| hasher.write(left.row(y)));
        let hash = hasher.finish();
        let is_repeated = self.last.replace(hash) == Some(hash);
        let moves = |m: &Motion| m.speed_m_s.abs() > MIN_SPEED_M_S.max(MOVING_SIGMAS * m.speed_sigma_m_s);
        is_repeated && motion.is_some_and(moves)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(seed: u8) -> Vec<u8> {
        (0..64_u32 * 48).map(|i| (i * 7 % 251) as u8 ^ seed).collect()
    }

    fn at(speed_m_s: f64) -> Motion {
        Motion { speed_m_s, speed_sigma_m_s: 0.1, ..Motion::default() }
    }

    #[test]
    fn the_picture_before_is_frozen_only_while_the_vehicle_moves() {
        let (first, second) = (picture(0), picture(1));
        let [a, b] = [&first, &second].map(|data| GreyView::new(data, 64, 48, 64).expect("lengths fit"));
        let mut frozen = FrozenPicture::default();
        for (view, motion, expected) in [
            (a, Some(at(10.0)), false),
            (b, Some(at(10.0)), false),
            (b, Some(at(10.0)), true),
            (b, Some(at(-10.0)), true),
            (b, Some(at(0.05)), false),
            (b, Some(Motion { speed_sigma_m_s: 5.0, ..at(10.0) }), false),
            (b, None, false),
            (a, Some(at(10.0)), false),
        ] {
            assert_eq!(frozen.update(view, motion.as_ref()), expected, "{motion:?}");
        }
    }

    #[test]
    fn a_change_of_one_grey_level_in_a_compared_row_is_a_new_picture() {
        let (first, mut second) = (picture(0), picture(0));
        second[8 * 64 + 5] ^= 1;
        let [a, b] = [&first, &second].map(|data| GreyView::new(data, 64, 48, 64).expect("lengths fit"));
        let mut frozen = FrozenPicture::default();
        assert!(!frozen.update(a, Some(&at(10.0))));
        assert!(!frozen.update(b, Some(&at(10.0))));
    }
}
