//! Where a lattice of corners lies on a board, by the markers in its squares.

use super::board::Board;
use super::grid::{Lattice, Places};
use super::homography;
use super::marker::{Reader, Reading};
use super::plane::Plane;
use nalgebra::Vector2;
use std::collections::BTreeMap;

/// Markers that must agree: one alone may be a chance pattern.
const MIN_MARKERS: usize = 2;
/// Share of the markers read that must agree, in percent. Fewer: the lattice has lost a line in between.
const MIN_PERCENT: usize = 80;

/// The corners of a square from its first one, in the order in which they are read.
const SQUARE: [(i64, i64); 4] = [(0, 0), (1, 0), (1, 1), (0, 1)];

/// A quarter-turn and a shift from board coordinates to lattice coordinates, in steps.
type Placement = (usize, (i64, i64));

/// A vector after quarter turns from x to y.
fn turned((x, y): (i64, i64), quarter_turns: usize) -> (i64, i64) {
    (0..quarter_turns % 4).fold((x, y), |(x, y), _| (-y, x))
}

/// The shift that follows from a marker in the square at a lattice corner.
fn placed(corner: (i32, i32), reading: Reading) -> Placement {
    // Twice the centres of the squares, so that they are whole numbers.
    let twice = |at: i64| 2 * at + 1;
    let on_board = turned((twice(reading.square.0), twice(reading.square.1)), reading.quarter_turns);
    let shift = |lattice: i32, board: i64| (twice(i64::from(lattice)) - board) / 2;
    (reading.quarter_turns, (shift(corner.0, on_board.0), shift(corner.1, on_board.1)))
}

/// A lattice corner whose square was read, and what was read.
type Read = ((i32, i32), Reading);

/// Reads the markers in the squares of a lattice.
fn readings(lattice: &Lattice, plane: &Plane, reader: &Reader) -> Vec<Read> {
    let place = |(i, j): (i32, i32)| lattice.cells.get(&(i, j)).copied();
    let square = |(i, j): (i32, i32)| {
        Some([place((i, j))?, place((i + 1, j))?, place((i + 1, j + 1))?, place((i, j + 1))?])
    };
    let read = |&corner: &(i32, i32)| Some((corner, reader.read(plane, &square(corner)?)?));
    lattice.cells.keys().filter_map(read).collect()
}

/// The placement on which the markers of a lattice agree.
fn agreed(readings: &[Read]) -> Option<Placement> {
    let mut votes: BTreeMap<Placement, usize> = BTreeMap::new();
    for &(corner, reading) in readings {
        *votes.entry(placed(corner, reading)).or_default() += 1;
    }
    let (placement, most) = votes.into_iter().max_by_key(|(_, count)| *count)?;
    (most >= MIN_MARKERS && 100 * most >= MIN_PERCENT * readings.len()).then_some(placement)
}

/// The index of a corner of the board.
fn index(board: &Board, (column, row): (i64, i64)) -> Option<usize> {
    let inside = |at: i64, count: usize| usize::try_from(at).ok().filter(|at| *at < count);
    Some(inside(row, board.rows())? * board.columns() + inside(column, board.columns())?)
}

/// The corners of the board that the lattices show, row by row: those around markers that were read, since a lattice may have
/// strayed into the markers themselves. `plane` is the image in whose pixels the lattices are.
pub(super) fn corners(lattices: &[Lattice], plane: &Plane, reader: &Reader, board: &Board) -> Places {
    let mut places: Places = vec![None; board.corners()];
    for lattice in lattices {
        let readings = readings(lattice, plane, reader);
        let Some(placement) = agreed(&readings) else { continue };
        let (quarter_turns, shift) = placement;
        for (corner, _) in readings.into_iter().filter(|&(corner, read)| placed(corner, read) == placement) {
            for (di, dj) in SQUARE {
                let (i, j) = (corner.0 + di as i32, corner.1 + dj as i32);
                let on_board = (i64::from(i) - shift.0, i64::from(j) - shift.1);
                if let Some(k) = index(board, turned(on_board, 4 - quarter_turns)) {
                    // The largest lattice comes first.
                    places[k] = places[k].or_else(|| lattice.cells.get(&(i, j)).copied());
                }
            }
        }
    }
    spread(&mut places, plane, reader, board);
    places
}

/// Adds corners around further markers, which are read where the known corners predict them.
fn spread(places: &mut Places, plane: &Plane, reader: &Reader, board: &Board) {
    let points = board.points_m();
    let mut open = reader.squares();
    loop {
        let before = open.len();
        open.retain(|&(column, row)| {
            let corners = SQUARE.map(|(i, j)| board.point_m(column + i, row + j));
            let indices = SQUARE.map(|(i, j)| index(board, (column + i, row + j)));
            if indices.iter().flatten().all(|&k| places[k].is_some()) {
                return false;
            }
            // Far from known corners a prediction is worth nothing.
            let reach = 2.0 * (corners[2] - corners[0]).norm();
            let is_near = |p: &Vector2<f64>| (p - corners[0]).norm() < reach;
            let near = points.iter().zip(&*places).filter(|(p, place)| place.is_some() && is_near(p));
            let (near, known): (Vec<_>, Places) = near.map(|(p, place)| (*p, *place)).unzip();
            if near.len() < 4 {
                return true;
            }
            let predicted = corners.map(|p| homography::predict(&near, &known, &p));
            let [Some(a), Some(b), Some(c), Some(d)] = predicted else { return true };
            if reader.read(plane, &[a, b, c, d]) != Some(Reading { square: (column, row), quarter_turns: 0 })
            {
                return true;
            }
            for (k, place) in indices.into_iter().zip([a, b, c, d]) {
                if let Some(k) = k {
                    places[k].get_or_insert(place);
                }
            }
            false
        });
        if open.len() == before {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_marker_tells_where_the_lattice_lies() {
        // The square of a marker at column 3, row 1 is the one at lattice corner (−2, 5), read after each turn.
        for quarter_turns in 0..4 {
            let reading = Reading { square: (3, 1), quarter_turns };
            let (turns, shift) = placed((-2, 5), reading);
            let to_lattice = |board: (i64, i64)| {
                let (x, y) = turned(board, turns);
                (x + shift.0, y + shift.1)
            };
            // Its four corners are those of the square in the lattice, in whatever order.
            let mut found = [(3, 1), (4, 1), (3, 2), (4, 2)].map(to_lattice);
            found.sort_unstable();
            assert_eq!(found, [(-2, 5), (-2, 6), (-1, 5), (-1, 6)]);
        }
    }
}
