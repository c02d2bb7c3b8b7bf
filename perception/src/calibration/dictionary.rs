//! Square markers: the dictionaries of ArUco and AprilTag.

use std::fmt;
use std::str::FromStr;
use std::sync::LazyLock;

/// A set of markers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dictionary {
    /// ArUco's markers of `side` × `side` bits, 4 to 7, as numbered by OpenCV's `DICT_4X4_50` to `DICT_7X7_1000`.
    Aruco {
        /// Bits along a side.
        side: usize,
        /// Number of markers: 50, 100, 250 or 1000.
        count: usize,
    },
    /// The AprilTag family 36h11.
    AprilTag36h11,
}

/// The text names no dictionary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("give 4x4, 5x5, 6x6 or 7x7 with _50, _100, _250 or _1000, for example 5x5_100, or apriltag_36h11")]
pub struct UnknownDictionary;

impl FromStr for Dictionary {
    type Err = UnknownDictionary;

    fn from_str(text: &str) -> Result<Self, UnknownDictionary> {
        let text = text.to_ascii_lowercase();
        let name = text.strip_prefix("dict_").unwrap_or(&text);
        if name == "apriltag_36h11" {
            return Ok(Self::AprilTag36h11);
        }
        let (size, count) = name.split_once('_').ok_or(UnknownDictionary)?;
        let side = (4..=7).find(|n| size == format!("{n}x{n}")).ok_or(UnknownDictionary)?;
        let count =
            [50, 100, 250, 1000].into_iter().find(|n| count == n.to_string()).ok_or(UnknownDictionary)?;
        Ok(Self::Aruco { side, count })
    }
}

impl fmt::Display for Dictionary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Aruco { side, count } => write!(f, "{side}x{side}_{count}"),
            Self::AprilTag36h11 => f.write_str("apriltag_36h11"),
        }
    }
}

/// The markers of a file in `markers/`: hexadecimal numbers, a line each.
fn parsed(text: &str) -> Vec<u64> {
    let codes = text.lines().filter(|line| !line.starts_with('#'));
    codes.filter_map(|line| u64::from_str_radix(line, 16).ok()).collect()
}

static ARUCO: LazyLock<[Vec<u64>; 4]> = LazyLock::new(|| {
    [
        include_str!("markers/aruco_4x4.txt"),
        include_str!("markers/aruco_5x5.txt"),
        include_str!("markers/aruco_6x6.txt"),
        include_str!("markers/aruco_7x7.txt"),
    ]
    .map(parsed)
});
static APRIL_TAGS: LazyLock<Vec<u64>> = LazyLock::new(|| parsed(include_str!("markers/apriltag_36h11.txt")));

impl Dictionary {
    /// Bits along a side.
    pub fn side(self) -> usize {
        match self {
            Self::Aruco { side, .. } => side,
            Self::AprilTag36h11 => 6,
        }
    }

    /// The bits of all markers, in the order of their identifiers: row by row from the upper left, the first bit the highest.
    pub fn codes(self) -> &'static [u64] {
        match self {
            Self::Aruco { side, count } => {
                let all = ARUCO.get(side.wrapping_sub(4)).map_or(&[][..], Vec::as_slice);
                &all[..count.min(all.len())]
            }
            Self::AprilTag36h11 => &APRIL_TAGS,
        }
    }

    /// The marker with an identifier.
    pub fn marker(self, id: usize) -> Option<Marker> {
        Some(Marker { side: self.side(), bits: *self.codes().get(id)? })
    }
}

/// A marker without its black border.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Marker {
    side: usize,
    bits: u64,
}

impl Marker {
    /// The marker with these bits, row by row from the upper left, the first bit the highest.
    pub fn new(side: usize, bits: u64) -> Self {
        Self { side, bits }
    }

    /// Bits along a side.
    pub fn side(self) -> usize {
        self.side
    }

    /// Its bits, as in [`Marker::new`].
    pub fn bits(self) -> u64 {
        self.bits
    }

    /// Whether a cell is white.
    pub fn is_white(self, column: usize, row: usize) -> bool {
        self.bits >> (self.side * self.side - 1 - row * self.side - column) & 1 == 1
    }

    /// The marker whose cell (column, row) is the cell `of(column, row)` of this one.
    fn rearranged(self, of: impl Fn(usize, usize) -> (usize, usize)) -> Self {
        let n = self.side;
        let bits = (0..n * n).fold(0, |bits, i| {
            let (column, row) = of(i % n, i / n);
            bits << 1 | u64::from(self.is_white(column, row))
        });
        Self { side: n, bits }
    }

    /// As it is read by who has turned by a quarter: its cell (column, row) is the cell that a quarter turn from x to y leads
    /// to from there.
    pub(super) fn read_after_quarter_turn(self) -> Self {
        let last = self.side - 1;
        self.rearranged(|column, row| (last - row, column))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dictionaries_are_whole_and_named() {
        for (name, side, count) in
            [("4x4_50", 4, 50), ("DICT_5X5_100", 5, 100), ("6x6_250", 6, 250), ("7x7_1000", 7, 1000)]
        {
            let dictionary: Dictionary = name.parse().unwrap();
            assert_eq!(dictionary, Dictionary::Aruco { side, count });
            assert_eq!(dictionary.codes().len(), count);
            assert!(dictionary.codes().iter().all(|c| c >> (side * side) == 0));
            assert_eq!(dictionary.to_string().parse(), Ok(dictionary));
        }
        assert_eq!("apriltag_36h11".parse(), Ok(Dictionary::AprilTag36h11));
        assert_eq!(Dictionary::AprilTag36h11.codes().len(), 587);
        for wrong in ["", "5x5", "8x8_50", "5x5_99", "apriltag_16h5"] {
            assert_eq!(wrong.parse::<Dictionary>(), Err(UnknownDictionary), "{wrong}");
        }
    }

    #[test]
    fn a_marker_comes_back_after_four_quarter_turns() {
        let marker = Dictionary::Aruco { side: 5, count: 50 }.marker(7).unwrap();
        let turned = marker.read_after_quarter_turn();
        // From x to y: what is at the upper right comes to be read at the upper left.
        assert_eq!(turned.is_white(0, 0), marker.is_white(4, 0));
        assert_eq!(turned.is_white(4, 0), marker.is_white(4, 4));
        let back = (0..3).fold(turned, |m, _| m.read_after_quarter_turn());
        assert_eq!(back, marker);
        assert_eq!(Dictionary::Aruco { side: 5, count: 50 }.marker(50), None);
    }
}
