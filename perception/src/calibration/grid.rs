//! Saddles joined to the lattice of a chessboard.

use super::saddle::{Saddle, between};
use nalgebra::Vector2;
use std::collections::HashMap;

/// Most that the edges of neighbours may differ, in radians.
const EDGE_TOLERANCE: f64 = 0.38;
/// Half the opening of the cone in which a first neighbour is sought, in radians.
const CONE: f64 = 0.3;
/// Most that a corner may lie off the place predicted for it, in steps.
const STRAY: f64 = 0.3;
/// Seeds tried in a picture.
const MOST_SEEDS: usize = 80;

/// Corners with their places in a lattice of unknown size and origin. Steps along the first
/// coordinate and then along the second turn as x turns to y.
#[derive(Clone, Debug, Default)]
pub struct Lattice {
    /// Place in the lattice to place in the picture, in pixels.
    pub cells: HashMap<(i32, i32), Vector2<f64>>,
}

/// Places of a board's corners, row after row, as far as they are known.
pub type Places = Vec<Option<Vector2<f64>>>;

/// A lattice as it matches a board.
#[derive(Clone, Debug, PartialEq)]
pub enum Match {
    /// All corners, row after row; those that no saddle gave are `None`.
    Board(Places),
    /// A lattice of another size: corners along and across, the longer side first.
    Other(usize, usize),
}

/// The largest lattices among saddles (the strongest first), the one with the most corners first.
pub fn grow(saddles: &[Saddle]) -> Vec<Lattice> {
    let mut used = vec![false; saddles.len()];
    let mut found: Vec<Lattice> = Vec::new();
    let mut seeds = 0;
    for seed in 0..saddles.len() {
        if used[seed] {
            continue;
        }
        if seeds == MOST_SEEDS {
            break;
        }
        let Some(grown) = Growth::from_seed(saddles, &used, seed) else { continue };
        seeds += 1;
        if grown.cells.len() < 6 {
            continue;
        }
        for &i in grown.cells.values() {
            used[i] = true;
        }
        let cells = grown.cells.iter().map(|(&cell, &i)| (cell, saddles[i].position)).collect();
        found.push(Lattice { cells });
    }
    found.sort_by_key(|l| std::cmp::Reverse(l.cells.len()));
    found
}

struct Growth<'a> {
    saddles: &'a [Saddle],
    taken: Vec<bool>,
    cells: HashMap<(i32, i32), usize>,
}

const SIDES: [(i32, i32); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

impl<'a> Growth<'a> {
    fn from_seed(saddles: &'a [Saddle], used: &[bool], seed: usize) -> Option<Self> {
        let mut growth = Self { saddles, taken: used.to_vec(), cells: HashMap::from([((0, 0), seed)]) };
        growth.taken[seed] = true;
        let saddle = saddles[seed];
        let direction = |angle: f64| Vector2::new(angle.cos(), angle.sin());
        let (i, mut j) = (direction(saddle.rising), direction(saddle.falling));
        if i.perp(&j) < 0.0 {
            j = -j;
        }
        let mut ways = [0; 2];
        for (side, towards) in [((1, 0), i), ((-1, 0), -i), ((0, 1), j), ((0, -1), -j)] {
            if let Some(next) = growth.first_neighbour(seed, towards) {
                growth.taken[next] = true;
                growth.cells.insert(side, next);
                ways[usize::from(side.0 == 0)] += 1;
            }
        }
        if ways[0] == 0 || ways[1] == 0 {
            return None;
        }
        while growth.spread() {}
        Some(growth)
    }

    fn place(&self, cell: (i32, i32)) -> Option<Vector2<f64>> {
        self.cells.get(&cell).map(|&i| self.saddles[i].position)
    }

    /// The nearest saddle that lies along an edge of `from` and fits beside it.
    fn first_neighbour(&self, from: usize, towards: Vector2<f64>) -> Option<usize> {
        let saddle = &self.saddles[from];
        let angle = towards.y.atan2(towards.x);
        let mut best = None;
        let mut least = f64::INFINITY;
        for (i, other) in self.saddles.iter().enumerate() {
            let way = other.position - saddle.position;
            let length = way.norm();
            if self.taken[i] || length < 3.0 || length >= least || way.dot(&towards) <= 0.0 {
                continue;
            }
            if between(way.y.atan2(way.x), angle) < CONE && saddle.fits_beside(other, EDGE_TOLERANCE) {
                (best, least) = (Some(i), length);
            }
        }
        best
    }

    /// The step expected from a cell to a side: as the last step there, else as beside it.
    fn expected(&self, (i, j): (i32, i32), (di, dj): (i32, i32)) -> Option<Vector2<f64>> {
        let here = self.place((i, j))?;
        if let Some(back) = self.place((i - di, j - dj)) {
            return Some(here - back);
        }
        // Beside, and one step before or after that, near lines first.
        for far in 1..=3 {
            for (si, sj) in [(dj * far, di * far), (-dj * far, -di * far)] {
                for shift in [0, -1, 1] {
                    let from = (i + si + shift * di, j + sj + shift * dj);
                    if let (Some(a), Some(b)) = (self.place(from), self.place((from.0 + di, from.1 + dj))) {
                        return Some(b - a);
                    }
                }
            }
        }
        None
    }

    /// Adds every neighbour that is where it is expected; whether there was any.
    fn spread(&mut self) -> bool {
        let mut cells: Vec<_> = self.cells.keys().copied().collect();
        // The order of a map changes from run to run; the result must not.
        cells.sort_unstable();
        let before = self.cells.len();
        for cell in cells {
            for side in SIDES {
                let next = (cell.0 + side.0, cell.1 + side.1);
                if self.cells.contains_key(&next) {
                    continue;
                }
                let (Some(step), Some(here)) = (self.expected(cell, side), self.cells.get(&cell)) else {
                    continue;
                };
                let here = &self.saddles[*here];
                let (target, most) = (here.position + step, STRAY * step.norm());
                let mut best = None;
                let mut least = most;
                for (i, other) in self.saddles.iter().enumerate() {
                    let d = other.position - target;
                    // A look at one coordinate first: this is the innermost loop.
                    if d.x.abs() >= least || self.taken[i] {
                        continue;
                    }
                    let distance = d.norm();
                    if distance < least && here.fits_beside(other, EDGE_TOLERANCE) {
                        (best, least) = (Some(i), distance);
                    }
                }
                if let Some(i) = best {
                    self.taken[i] = true;
                    self.cells.insert(next, i);
                }
            }
        }
        self.cells.len() > before
    }
}

impl Lattice {
    /// Corners of the lattice in the line `at` across the first or the second coordinate, within
    /// the given span of the other.
    fn filled(&self, first: bool, at: i32, span: (i32, i32)) -> usize {
        (span.0..=span.1).filter(|&k| self.cells.contains_key(&if first { (at, k) } else { (k, at) })).count()
    }

    /// First and last coordinates without the outer lines that are mostly empty.
    fn extent(&self) -> ((i32, i32), (i32, i32)) {
        let bounds = |f: fn(&(i32, i32)) -> i32| {
            let values = self.cells.keys().map(f);
            (values.clone().min().unwrap_or(0), values.max().unwrap_or(0))
        };
        let (mut i, mut j) = (bounds(|c| c.0), bounds(|c| c.1));
        loop {
            let before = (i, j);
            for (first, own, other) in [(true, &mut i, j), (false, &mut j, before.0)] {
                let enough = |at| 5 * self.filled(first, at, other) >= 2 * (other.1 - other.0 + 1) as usize;
                if own.0 < own.1 && !enough(own.0) {
                    own.0 += 1;
                }
                if own.0 < own.1 && !enough(own.1) {
                    own.1 -= 1;
                }
            }
            if (i, j) == before {
                return (i, j);
            }
        }
    }

    /// Matches the lattice to a board of `columns` × `rows` inner corners. Of the board's
    /// orientations the one is given whose rows run most to the right (of the two that keep the
    /// longer side, or four for a square).
    pub fn matched(&self, columns: usize, rows: usize) -> Match {
        let (i, j) = self.extent();
        let (wide, high) = ((i.1 - i.0 + 1) as usize, (j.1 - j.0 + 1) as usize);
        let mut best: Option<(usize, f64, Places)> = None;
        for turned in [false, true] {
            let (n, m) = if turned { (rows, columns) } else { (columns, rows) };
            if wide > n || high > m {
                continue;
            }
            // An outer line may have been lost: the board lies anywhere around what is left.
            for i0 in i.1 + 1 - n as i32..=i.0 {
                for j0 in j.1 + 1 - m as i32..=j.0 {
                    for half_turn in [false, true] {
                        let corners = self.read((i0, j0), (n, m), turned, half_turn);
                        let count = corners.iter().flatten().count();
                        let right = rightward(&corners, columns);
                        if best.as_ref().is_none_or(|b| (count, right) > (b.0, b.1)) {
                            best = Some((count, right, corners));
                        }
                    }
                }
            }
        }
        match best {
            // Every line of the board has most of its corners.
            Some((count, _, corners))
                if 100 * count >= 85 * columns * rows && lines_hold(&corners, columns) =>
            {
                Match::Board(corners)
            }
            _ => Match::Other(wide.max(high), wide.min(high)),
        }
    }

    /// The corners of a board that starts at `from` and spans (n, m) cells, row after row.
    fn read(&self, from: (i32, i32), (n, m): (usize, usize), turned: bool, half_turn: bool) -> Places {
        let mut corners = Vec::with_capacity(n * m);
        let (columns, rows) = if turned { (m, n) } else { (n, m) };
        for row in 0..rows {
            for column in 0..columns {
                // A quarter turn keeps the sense of rotation: rows run along j, columns against i.
                let (mut a, mut b) = if turned { (n - 1 - row, column) } else { (column, row) };
                if half_turn {
                    (a, b) = (n - 1 - a, m - 1 - b);
                }
                corners.push(self.cells.get(&(from.0 + a as i32, from.1 + b as i32)).copied());
            }
        }
        corners
    }
}

/// How far the rows lead to the right: sum over neighbours, in pixels.
fn rightward(corners: &[Option<Vector2<f64>>], columns: usize) -> f64 {
    let steps = corners.chunks_exact(columns).flat_map(|row| row.windows(2));
    steps.filter_map(|pair| Some(pair[1]?.x - pair[0]?.x)).sum()
}

/// Whether every row and column has at least half of its corners.
fn lines_hold(corners: &[Option<Vector2<f64>>], columns: usize) -> bool {
    let rows = corners.len() / columns;
    let row = |r: usize| (0..columns).filter(|c| corners[r * columns + c].is_some()).count();
    let column = |c: usize| (0..rows).filter(|r| corners[r * columns + c].is_some()).count();
    (0..rows).all(|r| 2 * row(r) >= columns) && (0..columns).all(|c| 2 * column(c) >= rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Saddles of a board of 5 × 4 corners under a shear and a little perspective, turned by `turn`.
    fn board(turn: f64) -> Vec<Saddle> {
        let place = |i: f64, j: f64| {
            let (x, y) = (i * 21.0 + j * 4.0, j * 17.0 + 0.02 * i * j * 17.0);
            Vector2::new(300.0 + x * turn.cos() - y * turn.sin(), 200.0 + x * turn.sin() + y * turn.cos())
        };
        let mut saddles = Vec::new();
        for j in 0..4 {
            for i in 0..5 {
                let (x, y) = (f64::from(i), f64::from(j));
                let angle = |d: Vector2<f64>| d.y.atan2(d.x).rem_euclid(std::f64::consts::PI);
                let (a, b) = (angle(place(x + 0.1, y) - place(x, y)), angle(place(x, y + 0.1) - place(x, y)));
                let (rising, falling) = if (i + j) % 2 == 0 { (a, b) } else { (b, a) };
                saddles.push(Saddle { position: place(x, y), strength: 10.0, rising, falling });
            }
        }
        saddles
    }

    #[test]
    fn a_board_is_joined_whichever_way_it_lies() {
        for step in 0..24 {
            let turn = f64::from(step) * 0.26;
            let mut saddles = board(turn);
            fastrand::Rng::with_seed(step as u64).shuffle(&mut saddles);
            let lattices = grow(&saddles);
            assert_eq!(lattices[0].cells.len(), 20, "turn {turn}");
            let Match::Board(corners) = lattices[0].matched(5, 4) else { panic!("turn {turn}") };
            let at = |c: usize, r: usize| corners[r * 5 + c].unwrap();
            assert!((at(1, 0) - at(0, 0)).perp(&(at(0, 1) - at(0, 0))) > 0.0, "mirrored at {turn}");
            assert!((at(4, 0) - at(0, 0)).norm() > 80.0, "turn {turn}: {corners:?}");
            assert_eq!(lattices[0].matched(4, 3), Match::Other(5, 4));
            assert_eq!(lattices[0].matched(9, 6), Match::Other(5, 4));
        }
    }

    #[test]
    fn a_few_missing_corners_are_left_open_and_many_are_no_board() {
        let mut saddles = board(0.1);
        saddles.remove(7);
        saddles.remove(0);
        let lattice = &grow(&saddles)[0];
        let Match::Board(corners) = lattice.matched(5, 4) else { panic!("{lattice:?}") };
        assert_eq!(corners.iter().flatten().count(), 18);
        assert!(corners[0].is_none() && corners[7].is_none());
        saddles.truncate(12);
        assert!(matches!(grow(&saddles)[0].matched(5, 4), Match::Other(..)));
        // The same saddles with bright and dark alike fit nowhere.
        let mut same = board(0.1);
        for s in &mut same {
            (s.rising, s.falling) = (0.1, 1.6);
        }
        assert!(grow(&same).is_empty());
    }
}
