//! Grey pictures from the raw pixels of a colour sensor.

use crate::luma::luma;

/// Colours of the first two pixels of the first and of the second row, as V4L2 and ROS name the pattern.
///
/// OpenCV names a pattern by the second row from the second pixel on: its `BayerBG` is [`Bayer::Rggb`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bayer {
    /// Red, green; green, blue.
    Rggb,
    /// Blue, green; green, red.
    Bggr,
    /// Green, red; blue, green.
    Grbg,
    /// Green, blue; red, green.
    Gbrg,
}

/// The patterns by their names.
const NAMES: [(&str, Bayer); 4] =
    [("rggb", Bayer::Rggb), ("bggr", Bayer::Bggr), ("grbg", Bayer::Grbg), ("gbrg", Bayer::Gbrg)];

/// A channel of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Channel {
    Red,
    Green,
    Blue,
}

impl Bayer {
    /// The pattern of a name such as `rggb`.
    pub fn named(name: &str) -> Option<Self> {
        NAMES.iter().find(|(known, _)| *known == name).map(|(_, bayer)| *bayer)
    }

    fn channel(self, x: usize, y: usize) -> Channel {
        // Where red is; blue is diagonally opposite.
        let (red_x, red_y) = match self {
            Self::Rggb => (0, 0),
            Self::Bggr => (1, 1),
            Self::Grbg => (1, 0),
            Self::Gbrg => (0, 1),
        };
        match (x % 2 == red_x, y % 2 == red_y) {
            (true, true) => Channel::Red,
            (false, false) => Channel::Blue,
            _ => Channel::Green,
        }
    }

    /// Grey levels of a raw picture: in each pixel the missing colours are the means of the nearest pixels that have
    /// them (bilinear interpolation), and the three together give BT.601 luma. At the border the picture is mirrored.
    pub fn grey(self, raw: &[u8], width: usize, height: usize) -> Vec<u8> {
        // Mirrored about the outermost pixel, so that the pattern continues.
        let mirrored = |at: usize, by: isize, length: usize| -> usize {
            let last = length.saturating_sub(1) as isize;
            let moved = (at as isize + by).abs();
            (if moved > last { 2 * last - moved } else { moved }).clamp(0, last) as usize
        };
        let mut out = Vec::with_capacity(raw.len());
        for y in 0..height {
            let rows = [-1, 0, 1].map(|by| mirrored(y, by, height) * width);
            for x in 0..width {
                let columns = [-1, 0, 1].map(|by| mirrored(x, by, width));
                let at = |i: usize, j: usize| u16::from(raw[rows[j] + columns[i]]);
                let here = at(1, 1) as u8;
                let beside = (at(0, 1) + at(2, 1)).div_ceil(2) as u8;
                let above = (at(1, 0) + at(1, 2)).div_ceil(2) as u8;
                let cross = ((at(0, 1) + at(2, 1) + at(1, 0) + at(1, 2) + 2) / 4) as u8;
                let corners = ((at(0, 0) + at(2, 0) + at(0, 2) + at(2, 2) + 2) / 4) as u8;
                let rgb = match self.channel(x, y) {
                    Channel::Red => [here, cross, corners],
                    Channel::Blue => [corners, cross, here],
                    Channel::Green if self.channel(x + 1, y) == Channel::Red => [beside, here, above],
                    Channel::Green => [above, here, beside],
                };
                out.push(luma(&rgb));
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a sensor behind a filter measures of a picture of one colour.
    fn mosaic(bayer: Bayer, rgb: [u8; 3], (width, height): (usize, usize)) -> Vec<u8> {
        let of = |i: usize| match bayer.channel(i % width, i / width) {
            Channel::Red => rgb[0],
            Channel::Green => rgb[1],
            Channel::Blue => rgb[2],
        };
        (0..width * height).map(of).collect()
    }

    #[test]
    fn one_colour_gives_its_luma_everywhere_with_the_right_pattern_only() {
        let colour = [200, 120, 30];
        for size in [(8, 6), (7, 5), (2, 2)] {
            for (name, bayer) in NAMES {
                assert_eq!(Bayer::named(name), Some(bayer));
                let raw = mosaic(bayer, colour, size);
                assert_eq!(bayer.grey(&raw, size.0, size.1), vec![luma(&colour); size.0 * size.1], "{name}");
                let wrong = if bayer == Bayer::Rggb { Bayer::Grbg } else { Bayer::Rggb };
                assert_ne!(wrong.grey(&raw, size.0, size.1), vec![luma(&colour); size.0 * size.1], "{name}");
            }
        }
        assert_eq!(Bayer::named("rgbg"), None);
    }

    #[test]
    fn the_smallest_pictures_are_read() {
        for size in [(1, 1), (1, 3), (3, 1)] {
            let raw = vec![50; size.0 * size.1];
            assert_eq!(Bayer::Rggb.grey(&raw, size.0, size.1), raw);
        }
        assert!(Bayer::Rggb.grey(&[], 0, 0).is_empty());
    }
}
