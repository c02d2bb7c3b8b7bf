//! Calibration boards: what is printed on them, and where their corners are.
//!
//! Three patterns are known. A chessboard must be seen whole. The markers of a ChArUco board (a chessboard with a marker in each
//! white square) and of an AprilGrid (a grid of AprilTags of the family 36h11, with a small black square at each corner, as Kalibr
//! prints it) identify every corner, so that a part of the board is enough.

use super::dictionary::{Dictionary, Marker};
use nalgebra::Vector2;
use thiserror::Error;

/// What is printed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// Black and white squares, the first one black.
    Chessboard,
    /// A chessboard with a marker in each white square, numbered row by row.
    Charuco {
        /// Where the markers are from.
        dictionary: Dictionary,
        /// Side of a marker with its black border, over the side of a square.
        marker_share: f64,
        /// Boards of OpenCV before 4.6 with an even number of rows of squares begin with a white square.
        is_legacy: bool,
    },
    /// AprilTags 36h11, numbered row by row from the lower left.
    AprilGrid {
        /// Gap between tags over the side of a tag.
        spacing: f64,
        /// Width of a tag's black border, in cells: 2 as Kalibr prints it, 1 by the definition of the family.
        border_cells: usize,
    },
}

/// The printed pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    columns: usize,
    rows: usize,
    square_m: f64,
    pattern: Pattern,
}

/// Errors of describing a board.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum BoardError {
    /// The number of corners is out of range.
    #[error(
        "a board of {columns}x{rows} inner corners: the range is 3 to 50 along each side, with at least 4 along one"
    )]
    Corners {
        /// Along a row.
        columns: usize,
        /// Along a column.
        rows: usize,
    },
    /// The number of tags is out of range.
    #[error("a grid of {columns}x{rows} tags: the range is 2 to 24 along each side")]
    Tags {
        /// Along a row.
        columns: usize,
        /// Along a column.
        rows: usize,
    },
    /// The side of a square is out of range.
    #[error("squares of {square_m} m: give the measured side, 0.0005 to 2 m")]
    Square {
        /// In metres.
        square_m: f64,
    },
    /// The side of a marker is out of range.
    #[error("markers of {share:.2} of a square's side: the range is 0.3 to 0.8")]
    Marker {
        /// Side of a marker over that of a square.
        share: f64,
    },
    /// The gap between tags is out of range.
    #[error("a gap of {spacing} of a tag's side: the range is 0.1 to 1")]
    Spacing {
        /// Gap over side.
        spacing: f64,
    },
    /// The board needs more markers than there are.
    #[error(
        "the board has {needed} markers, its dictionary {held}: give the dictionary that it was printed from"
    )]
    TooFewMarkers {
        /// On the board.
        needed: usize,
        /// In the dictionary.
        held: usize,
    },
}

impl Board {
    /// A chessboard of `columns` × `rows` inner corners, where four squares meet, with squares of `square_m` metres.
    ///
    /// # Errors
    /// If a side has less than 3 or more than 50 corners, both have 3, or a square is not between half a
    /// millimetre and two metres.
    pub fn new(columns: usize, rows: usize, square_m: f64) -> Result<Self, BoardError> {
        Self { columns, rows, square_m, pattern: Pattern::Chessboard }.checked()
    }

    /// A ChArUco board of `columns` × `rows` inner corners, with squares of `square_m` metres and markers of `marker_m`.
    ///
    /// # Errors
    /// As [`Board::new`]; if a marker is smaller than 0.3 or larger than 0.8 of a square, or the dictionary is too small.
    pub fn charuco(
        (columns, rows): (usize, usize),
        square_m: f64,
        marker_m: f64,
        dictionary: Dictionary,
        is_legacy: bool,
    ) -> Result<Self, BoardError> {
        let pattern = Pattern::Charuco { dictionary, marker_share: marker_m / square_m, is_legacy };
        Self { columns, rows, square_m, pattern }.checked()
    }

    /// A grid of `columns` × `rows` AprilTags of `tag_m` metres with gaps of `spacing` times that.
    ///
    /// # Errors
    /// If a side has less than 2 or more than 24 tags, all are more than the family has, or a measure is out of range.
    pub fn april_grid(
        (columns, rows): (usize, usize),
        tag_m: f64,
        spacing: f64,
        border_cells: usize,
    ) -> Result<Self, BoardError> {
        let pattern = Pattern::AprilGrid { spacing, border_cells };
        if !(2..=24).contains(&columns) || !(2..=24).contains(&rows) {
            return Err(BoardError::Tags { columns, rows });
        }
        Self { columns: 2 * columns, rows: 2 * rows, square_m: tag_m, pattern }.checked()
    }

    fn checked(self) -> Result<Self, BoardError> {
        let Self { columns, rows, square_m, pattern } = self;
        let range = 3..=50;
        if !range.contains(&columns) || !range.contains(&rows) || columns.max(rows) < 4 {
            return Err(BoardError::Corners { columns, rows });
        }
        if !(0.0005..=2.0).contains(&square_m) {
            return Err(BoardError::Square { square_m });
        }
        match pattern {
            // A little more than it says: both sides are measured.
            Pattern::Charuco { marker_share, .. } if !(0.3..=0.805).contains(&marker_share) => {
                return Err(BoardError::Marker { share: marker_share });
            }
            Pattern::AprilGrid { spacing, .. } if !(0.1..=1.0).contains(&spacing) => {
                return Err(BoardError::Spacing { spacing });
            }
            _ => {}
        }
        if let Some(dictionary) = self.dictionary() {
            let (needed, held) = (self.markers().len(), dictionary.codes().len());
            if needed > held {
                return Err(BoardError::TooFewMarkers { needed, held });
            }
        }
        Ok(self)
    }

    /// What is printed.
    pub fn pattern(&self) -> Pattern {
        self.pattern
    }

    /// Corners along a row: inner corners of the squares, or corners of the tags.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Corners along a column.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Side of a square, or of a tag, in metres.
    pub fn square_m(&self) -> f64 {
        self.square_m
    }

    /// Number of corners.
    pub fn corners(&self) -> usize {
        self.columns * self.rows
    }

    /// Where the markers are from; `None` for a chessboard.
    pub fn dictionary(&self) -> Option<Dictionary> {
        match self.pattern {
            Pattern::Chessboard => None,
            Pattern::Charuco { dictionary, .. } => Some(dictionary),
            Pattern::AprilGrid { .. } => Some(Dictionary::AprilTag36h11),
        }
    }

    /// Number of lattice steps after which their lengths repeat: 2 where tags and gaps alternate.
    pub(super) fn period(&self) -> usize {
        if matches!(self.pattern, Pattern::AprilGrid { .. }) { 2 } else { 1 }
    }

    /// Whether the square whose upper left corner is the lattice corner (`column`, `row`) is black, apart from what a marker
    /// leaves white. The squares around the outermost corners have the coordinate −1.
    fn is_dark_square(&self, column: i64, row: i64) -> bool {
        let even = (column + row).rem_euclid(2) == 0;
        match self.pattern {
            Pattern::Charuco { is_legacy: true, .. } if self.rows % 2 == 1 => !even,
            // Of an AprilGrid both the tags and the small squares diagonally beside them.
            _ => even,
        }
    }

    /// The markers of the board: identifier, and column and row of the square that holds it, as in the lattice of corners.
    pub(super) fn markers(&self) -> Vec<(usize, (i64, i64))> {
        let (columns, rows) = (self.columns as i64, self.rows as i64);
        match self.pattern {
            Pattern::Chessboard => Vec::new(),
            Pattern::Charuco { .. } => {
                let squares = (-1..rows).flat_map(|row| (-1..columns).map(move |column| (column, row)));
                squares.filter(|&(column, row)| !self.is_dark_square(column, row)).enumerate().collect()
            }
            Pattern::AprilGrid { .. } => {
                let tags =
                    (0..rows / 2).rev().flat_map(|row| (0..columns / 2).map(move |c| (2 * c, 2 * row)));
                tags.enumerate().collect()
            }
        }
    }

    /// Cells of a marker's black border, and the side of the marker over that of its square.
    pub(super) fn marker_layout(&self) -> (usize, f64) {
        match self.pattern {
            Pattern::Charuco { marker_share, .. } => (1, marker_share),
            Pattern::AprilGrid { border_cells, .. } => (border_cells, 1.0),
            Pattern::Chessboard => (0, 0.0),
        }
    }

    /// Position along one side of lattice line `index`, in metres from the first one.
    fn line_m(&self, index: i64) -> f64 {
        match self.pattern {
            Pattern::AprilGrid { spacing, .. } => {
                let (tag, end) = (index.div_euclid(2) as f64, index.rem_euclid(2) as f64);
                (tag * (1.0 + spacing) + end) * self.square_m
            }
            _ => index as f64 * self.square_m,
        }
    }

    /// Position of the lattice point in metres from the centre of the board.
    pub(super) fn point_m(&self, column: i64, row: i64) -> Vector2<f64> {
        let centre = |count: usize| 0.5 * self.line_m(count as i64 - 1);
        Vector2::new(self.line_m(column) - centre(self.columns), self.line_m(row) - centre(self.rows))
    }

    /// The corners in board coordinates, row by row, in metres from the centre of the board.
    pub fn points_m(&self) -> Vec<Vector2<f64>> {
        (0..self.corners())
            .map(|i| self.point_m((i % self.columns) as i64, (i / self.columns) as i64))
            .collect()
    }

    /// Width and height of the print, in metres.
    pub fn size_m(&self) -> Vector2<f64> {
        2.0 * self.point_m(self.columns as i64, self.rows as i64)
    }

    /// Whether the print is black at a place, in metres from the centre of the board. What is around it is white.
    pub fn is_dark(&self, place_m: Vector2<f64>) -> bool {
        let half = self.size_m() * 0.5;
        if place_m.x.abs() >= half.x || place_m.y.abs() >= half.y {
            return false;
        }
        // The lattice line at or before the place, and the share of the way to the next one.
        let step = |at: f64, count: usize| -> (i64, f64) {
            let at = at + 0.5 * self.line_m(count as i64 - 1);
            let pitch = self.line_m(self.period() as i64);
            let first = (at / pitch).floor() as i64 * self.period() as i64;
            let index =
                (first..first + self.period() as i64).rev().find(|&i| self.line_m(i) <= at).unwrap_or(first);
            (index, (at - self.line_m(index)) / (self.line_m(index + 1) - self.line_m(index)))
        };
        let ((column, x), (row, y)) = (step(place_m.x, self.columns), step(place_m.y, self.rows));
        let marker = self.marker_at(column, row);
        let Some(marker) = marker else { return self.is_dark_square(column, row) };
        let (border, share) = self.marker_layout();
        let cells = marker.side() + 2 * border;
        let cell = |at: f64| (((at - 0.5) / share + 0.5) * cells as f64).floor();
        let (i, j) = (cell(x), cell(y));
        let inside = 0.0..cells as f64;
        if !inside.contains(&i) || !inside.contains(&j) {
            return false;
        }
        let (i, j) = (i as usize, j as usize);
        let bits = border..border + marker.side();
        let is_bit = bits.contains(&i) && bits.contains(&j);
        !is_bit || !marker.is_white(i - border, j - border)
    }

    /// The marker in the square at a lattice corner.
    fn marker_at(&self, column: i64, row: i64) -> Option<Marker> {
        self.dictionary()?;
        let id = match self.pattern {
            Pattern::AprilGrid { .. } => {
                let inside =
                    (0..self.columns as i64).contains(&column) && (0..self.rows as i64).contains(&row);
                if !inside || column % 2 != 0 || row % 2 != 0 {
                    return None;
                }
                let from_below = self.rows as i64 / 2 - 1 - row / 2;
                from_below * (self.columns as i64 / 2) + column / 2
            }
            _ if self.is_dark_square(column, row) => return None,
            _ => {
                let above: i64 = (-1..row).map(|r| self.white_in_row(r, self.columns as i64 + 1)).sum();
                above + self.white_in_row(row, column + 1)
            }
        };
        self.marker(usize::try_from(id).ok()?)
    }

    /// The marker with an identifier, upright on this board.
    pub(super) fn marker(&self, id: usize) -> Option<Marker> {
        let dictionary = self.dictionary()?;
        let marker = dictionary.marker(id)?;
        // OpenCV has the AprilTags of its dictionaries upside down against the family's definition.
        let is_turned =
            dictionary == Dictionary::AprilTag36h11 && matches!(self.pattern, Pattern::Charuco { .. });
        Some(if is_turned { marker.read_after_quarter_turn().read_after_quarter_turn() } else { marker })
    }

    /// White squares among the first `count` of a row.
    fn white_in_row(&self, row: i64, count: i64) -> i64 {
        let first = i64::from(!self.is_dark_square(-1, row));
        (count + first) / 2
    }

    /// The black areas of the print: x, y, width and height in metres from its upper left corner. Areas touch without gaps.
    pub fn dark_areas_m(&self) -> Vec<[f64; 4]> {
        let half = self.size_m() * 0.5;
        let mut areas = Vec::new();
        let mut add = |x0: f64, x1: f64, y0: f64, y1: f64| {
            if self.is_dark(Vector2::new(0.5 * (x0 + x1), 0.5 * (y0 + y1))) {
                areas.push([x0 + half.x, y0 + half.y, x1 - x0, y1 - y0]);
            }
        };
        let (border, share) = self.marker_layout();
        for row in -1..self.rows as i64 {
            for column in -1..self.columns as i64 {
                let (from, to) = (self.point_m(column, row), self.point_m(column + 1, row + 1));
                let Some(marker) = self.marker_at(column, row) else {
                    add(from.x, to.x, from.y, to.y);
                    continue;
                };
                let cells = marker.side() + 2 * border;
                let at = |from: f64, to: f64, cell: usize| {
                    0.5 * (from + to) + (to - from) * share * (cell as f64 / cells as f64 - 0.5)
                };
                for j in 0..cells {
                    for i in 0..cells {
                        let (x, y) = (|i| at(from.x, to.x, i), |j| at(from.y, to.y, j));
                        add(x(i), x(i + 1), y(j), y(j + 1));
                    }
                }
            }
        }
        areas
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHARUCO: Dictionary = Dictionary::Aruco { side: 5, count: 100 };

    #[test]
    fn markers_are_numbered_row_by_row() {
        for (columns, rows, is_legacy) in
            [(9, 6, false), (10, 7, false), (10, 6, false), (10, 7, true), (9, 7, true)]
        {
            let board = Board::charuco((columns, rows), 0.03, 0.022, CHARUCO, is_legacy).unwrap();
            for (id, (column, row)) in board.markers() {
                assert_eq!(board.marker_at(column, row), CHARUCO.marker(id), "{columns}x{rows} {id}");
            }
        }
        // The first square is black, in the old layout white if the number of rows of squares is even.
        let first = |rows, old| Board::charuco((9, rows), 0.03, 0.022, CHARUCO, old).unwrap().markers()[0].1;
        assert_eq!(
            [first(6, false), first(6, true), first(7, true), first(7, false)],
            [(0, -1), (0, -1), (-1, -1), (0, -1)]
        );
        let grid = Board::april_grid((6, 4), 0.05, 0.3, 2).unwrap();
        assert_eq!((grid.markers()[0], grid.markers()[23]), ((0, (0, 6)), (23, (10, 0))));
        for (id, (column, row)) in grid.markers() {
            assert_eq!(grid.marker_at(column, row), Dictionary::AprilTag36h11.marker(id));
        }
    }

    #[test]
    fn lattice_and_print_agree() {
        let grid = Board::april_grid((6, 4), 0.05, 0.3, 2).unwrap();
        let points = grid.points_m();
        assert!(
            ((points[1] - points[0]).x - 0.05).abs() < 1e-12
                && ((points[2] - points[1]).x - 0.015).abs() < 1e-12
        );
        assert!((points[0] + points[points.len() - 1]).norm() < 1e-12);
        for board in [
            grid,
            Board::new(9, 6, 0.03).unwrap(),
            Board::charuco((9, 6), 0.03, 0.02, CHARUCO, false).unwrap(),
        ] {
            // At every corner two black areas touch diagonally.
            for p in board.points_m() {
                let dark = |x: f64, y: f64| board.is_dark(p + Vector2::new(x, y) * 1e-4);
                assert_eq!(dark(1.0, 1.0), dark(-1.0, -1.0), "{board:?}");
                assert_eq!(dark(1.0, -1.0), dark(-1.0, 1.0), "{board:?}");
                assert_ne!(dark(1.0, 1.0), dark(1.0, -1.0), "{board:?}");
            }
            let area: f64 = board.dark_areas_m().iter().map(|a| a[2] * a[3]).sum();
            let (n, size) = (400, board.size_m());
            let dark = (0..n * n).filter(|i| {
                let at = |i: usize| (i as f64 + 0.5) / n as f64 - 0.5;
                board.is_dark(Vector2::new(at(i % n) * size.x, at(i / n) * size.y))
            });
            let share = dark.count() as f64 / (n * n) as f64;
            assert!((area / (size.x * size.y) - share).abs() < 0.01, "{board:?}: {area} {share}");
        }
    }

    #[test]
    fn impossible_boards_are_refused() {
        assert!(matches!(Board::new(3, 3, 0.03), Err(BoardError::Corners { .. })));
        assert!(matches!(Board::new(9, 6, 0.0), Err(BoardError::Square { .. })));
        assert!(matches!(Board::charuco((9, 6), 0.03, 0.03, CHARUCO, false), Err(BoardError::Marker { .. })));
        let error = Board::charuco((20, 14), 0.03, 0.02, CHARUCO, false).unwrap_err();
        assert_eq!(error, BoardError::TooFewMarkers { needed: 157, held: 100 });
        assert!(matches!(Board::april_grid((1, 6), 0.05, 0.3, 2), Err(BoardError::Tags { .. })));
        assert!(matches!(Board::april_grid((6, 6), 0.05, 3.0, 2), Err(BoardError::Spacing { .. })));
    }
}
