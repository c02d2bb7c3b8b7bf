//! Reads the markers of a board from an image.

use super::board::Board;
use super::dictionary::{Dictionary, Marker};
use super::homography;
use super::plane::Plane;
use nalgebra::Vector2;

/// Smallest difference between the brightest and the darkest cell of a marker, in grey levels.
const MIN_CONTRAST: f32 = 20.0;
/// Bits that are corrected at most, whatever the dictionary allows.
const MAX_ERRORS: u32 = 3;
/// Positions within a cell whose mean is its brightness, in cells from its centre.
const POINTS: [(f64, f64); 5] = [(0.0, 0.0), (0.2, 0.2), (-0.2, 0.2), (0.2, -0.2), (-0.2, -0.2)];

/// A marker of the board that was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Reading {
    /// Column and row of its square on the board.
    pub square: (i64, i64),
    /// Quarter turns from x to y that lead from a direction on the board to the same in the lattice.
    pub quarter_turns: usize,
}

/// Reads the markers of one board.
#[derive(Clone, Debug)]
pub(super) struct Reader {
    /// Bits and squares of the board's markers.
    markers: Vec<(u64, (i64, i64))>,
    side: usize,
    /// Cells of the border, and side of the marker over that of the square: layouts to be tried.
    layouts: Vec<(usize, f64)>,
    max_errors: u32,
}

impl Reader {
    /// `None` for a board without markers.
    pub fn new(board: &Board) -> Option<Self> {
        let dictionary = board.dictionary()?;
        let side = dictionary.side();
        let markers: Vec<_> = board
            .markers()
            .into_iter()
            .filter_map(|(id, square)| Some((board.marker(id)?.bits(), square)))
            .collect();
        // The smallest distance between two markers, or of one to itself turned.
        let mut least = u32::MAX;
        for (i, &(bits, _)) in markers.iter().enumerate() {
            let mut turned = Marker::new(side, bits);
            for turn in 0..4 {
                let from = if turn == 0 { i + 1 } else { i };
                for &(other, _) in &markers[from..] {
                    least = least.min((turned.bits() ^ other).count_ones());
                }
                turned = turned.read_after_quarter_turn();
            }
        }
        let (border, share) = board.marker_layout();
        let mut layouts = vec![(border, share)];
        if dictionary == Dictionary::AprilTag36h11 && share == 1.0 {
            // Both widths of the border are in use.
            layouts.push((3 - border.clamp(1, 2), share));
        }
        Some(Self { markers, side, layouts, max_errors: (least.saturating_sub(1) / 2).min(MAX_ERRORS) })
    }

    /// The squares of the board that hold a marker.
    pub fn squares(&self) -> Vec<(i64, i64)> {
        self.markers.iter().map(|&(_, square)| square).collect()
    }

    /// Reads the marker in a square, given the square's corners in the image: those of the lattice at (0, 0), (1, 0), (1, 1) and
    /// (0, 1).
    pub fn read(&self, plane: &Plane, corners: &[Vector2<f64>; 4]) -> Option<Reading> {
        let unit = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Vector2::from);
        let to_image = homography::fit(&unit, corners)?;
        self.layouts.iter().find_map(|&(border, share)| {
            let cells = self.side + 2 * border;
            let mut values = Vec::with_capacity(cells * cells);
            for i in 0..cells * cells {
                let mut sum = 0.0;
                for (dx, dy) in POINTS {
                    let at =
                        |cell: usize, d: f64| 0.5 + share * ((cell as f64 + 0.5 + d) / cells as f64 - 0.5);
                    let place = Vector2::new(at(i % cells, dx), at(i / cells, dy));
                    sum += plane.sample(homography::map(&to_image, &place))?;
                }
                values.push(sum / POINTS.len() as f32);
            }
            let (low, high) = values.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
            if high - low < MIN_CONTRAST {
                return None;
            }
            let middle = 0.5 * (low + high);
            let (mut bits, mut wrong) = (0_u64, 0);
            for (i, &value) in values.iter().enumerate() {
                let inside = border..border + self.side;
                let is_white = value > middle;
                if inside.contains(&(i % cells)) && inside.contains(&(i / cells)) {
                    bits = bits << 1 | u64::from(is_white);
                } else if is_white {
                    wrong += 1;
                }
            }
            (wrong <= self.max_errors).then(|| self.identified(bits)).flatten()
        })
    }

    /// The marker with these bits, read in the lattice's orientation.
    fn identified(&self, bits: u64) -> Option<Reading> {
        let mut turned = Marker::new(self.side, bits);
        for quarter_turns in 0..4 {
            let near = |m: &&(u64, (i64, i64))| (turned.bits() ^ m.0).count_ones() <= self.max_errors;
            if let Some(&(_, square)) = self.markers.iter().find(near) {
                return Some(Reading { square, quarter_turns });
            }
            turned = turned.read_after_quarter_turn();
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_bits_are_corrected_up_to_what_the_markers_allow() {
        let board = Board::april_grid((6, 6), 0.05, 0.3, 2).unwrap();
        let reader = Reader::new(&board).unwrap();
        assert_eq!(reader.max_errors, 3);
        let bits = Dictionary::AprilTag36h11.codes()[8];
        let square = board.markers()[8].1;
        assert_eq!(reader.identified(bits ^ 0b10_0100_0001), Some(Reading { square, quarter_turns: 0 }));
        assert_eq!(reader.identified(bits ^ 0b11_1100_0011), None);
        assert_eq!(Reader::new(&Board::new(9, 6, 0.03).unwrap()).map(|r| r.side), None);
    }
}
