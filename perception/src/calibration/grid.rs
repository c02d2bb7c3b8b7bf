//! Joins saddle points to the lattice of a board's corners.

use super::saddle::Saddle;
use nalgebra::Vector2;
use std::collections::HashMap;

/// Maximum angle between the edges of neighbours, in radians.
const EDGE_TOLERANCE: f64 = 0.38;
/// Half the opening angle of the cone in which a first neighbour is searched, in radians.
const SEARCH_CONE: f64 = 0.3;
/// Maximum distance of a corner from its predicted position, in steps of the lattice.
const MAX_DEVIATION: f64 = 0.3;
/// Minimum share of a board's corners that must be found, in percent.
const MIN_PERCENT: usize = 85;
/// Maximum number of seeds in an image. Markers have saddle points of their own, so their boards need more.
pub(super) const MAX_SEEDS: usize = 80;

/// Corners with coordinates in a lattice of unknown size and origin. The orientation from the first to the
/// second coordinate is that from x to y.
#[derive(Clone, Debug, Default)]
pub struct Lattice {
    /// Image position in pixels for each lattice coordinate.
    pub cells: HashMap<(i32, i32), Vector2<f64>>,
}

/// Positions of a board's corners, row by row, as far as they are known.
pub type Places = Vec<Option<Vector2<f64>>>;

/// Result of matching a lattice to a board.
#[derive(Clone, Debug, PartialEq)]
pub enum Match {
    /// All corners, row by row; corners without a saddle point are `None`.
    Board(Places),
    /// A lattice of another size: corners along its sides, the longer side first.
    Other(usize, usize),
}

/// Lattices among saddle points (given in order of strength), those with most corners first. The lengths of the steps repeat
/// after `period` of them; at most `max_seeds` places are tried.
pub fn grow(saddles: &[Saddle], period: usize, max_seeds: usize) -> Vec<Lattice> {
    let index = Index::new(saddles);
    let mut used = vec![false; saddles.len()];
    let mut found: Vec<Lattice> = Vec::new();
    let mut seeds = 0;
    for seed in 0..saddles.len() {
        if used[seed] {
            continue;
        }
        if seeds == max_seeds {
            break;
        }
        let Some(grown) = Growth::from_seed(saddles, &index, &used, seed, period) else { continue };
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

/// Spatial index of saddle points.
struct Index {
    /// Positions, in the order of the saddle points.
    places: Vec<[f32; 2]>,
    /// Indices of the saddle points in each square of the image, squares row by row.
    squares: Vec<Vec<u32>>,
    /// Number of squares in a row.
    columns: usize,
}

impl Index {
    /// Side of a square, in pixels.
    const SIDE: f64 = 16.0;

    fn new(saddles: &[Saddle]) -> Self {
        let far = saddles.iter().fold(Vector2::zeros(), |far: Vector2<f64>, s| far.sup(&s.position));
        let (columns, rows) = (Self::square(far.x) + 1, Self::square(far.y) + 1);
        let mut squares = vec![Vec::new(); columns * rows];
        for (i, s) in saddles.iter().enumerate() {
            squares[Self::square(s.position.y) * columns + Self::square(s.position.x)].push(i as u32);
        }
        let places = saddles.iter().map(|s| [s.position.x as f32, s.position.y as f32]).collect();
        Self { places, squares, columns }
    }

    fn square(at: f64) -> usize {
        (at / Self::SIDE) as usize
    }

    /// The saddle points in all squares within `reach` pixels of a position.
    fn around(&self, place: Vector2<f64>, reach: f64) -> impl Iterator<Item = usize> {
        let rows = self.squares.len() / self.columns;
        let span = |at: f64, count: usize| {
            Self::square(at - reach)..(Self::square((at + reach).max(0.0)) + 1).min(count)
        };
        let columns = span(place.x, self.columns);
        span(place.y, rows)
            .flat_map(move |y| columns.clone().map(move |x| y * self.columns + x))
            .flat_map(|square| self.squares[square].iter().map(|&i| i as usize))
    }
}

/// The closest compatible saddle points in both directions of both edges of `seed`, in the order of
/// [`SIDES`].
fn first_neighbours(saddles: &[Saddle], index: &Index, used: &[bool], seed: usize) -> [Option<usize>; 4] {
    let saddle = &saddles[seed];
    let direction = |angle: f64| Vector2::new(angle.cos() as f32, angle.sin() as f32);
    let (i, mut j) = (direction(saddle.rising), direction(saddle.falling));
    if i.perp(&j) < 0.0 {
        j = -j;
    }
    let [x, y] = index.places[seed];
    let narrow = (SEARCH_CONE.cos() as f32).powi(2);
    let mut best = [None; 4];
    let mut least = [f32::INFINITY; 4];
    // This loop runs for every seed and saddle point: cheap tests first.
    for (k, place) in index.places.iter().enumerate() {
        let way = Vector2::new(place[0] - x, place[1] - y);
        let length = way.norm_squared();
        for (axis, towards) in [i, j].into_iter().enumerate() {
            let along = way.dot(&towards);
            let side = 2 * axis + usize::from(along < 0.0);
            if along * along > narrow * length
                && length >= 9.0
                && length < least[side]
                && !used[k]
                && saddle.fits_beside(&saddles[k], EDGE_TOLERANCE)
            {
                (best[side], least[side]) = (Some(k), length);
            }
        }
    }
    best
}

struct Growth<'a> {
    saddles: &'a [Saddle],
    index: &'a Index,
    taken: Vec<bool>,
    cells: HashMap<(i32, i32), usize>,
    /// Number of steps after which their lengths repeat.
    period: i32,
}

const SIDES: [(i32, i32); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];

impl<'a> Growth<'a> {
    fn from_seed(
        saddles: &'a [Saddle],
        index: &'a Index,
        used: &[bool],
        seed: usize,
        period: usize,
    ) -> Option<Self> {
        let beside = first_neighbours(saddles, index, used, seed);
        if beside[0].or(beside[1]).is_none() || beside[2].or(beside[3]).is_none() {
            return None;
        }
        let cells = HashMap::from([((0, 0), seed)]);
        let mut growth = Self { saddles, index, taken: used.to_vec(), cells, period: period as i32 };
        growth.taken[seed] = true;
        for (side, next) in SIDES.into_iter().zip(beside) {
            if let Some(next) = next.filter(|&next| !growth.taken[next]) {
                growth.taken[next] = true;
                growth.cells.insert(side, next);
            }
        }
        growth.spread();
        Some(growth)
    }

    fn place(&self, cell: (i32, i32)) -> Option<Vector2<f64>> {
        self.cells.get(&cell).map(|&i| self.saddles[i].position)
    }

    /// The expected step from a cell to a side: the previous step of its length in that direction, or else a parallel step
    /// nearby.
    fn expected(&self, (i, j): (i32, i32), (di, dj): (i32, i32)) -> Option<Vector2<f64>> {
        let back = |steps: i32| self.place((i - steps * di, j - steps * dj));
        if let (Some(from), Some(to)) = (back(self.period), back(self.period - 1)) {
            return Some(to - from);
        }
        // Parallel lines, and one period before or after there; near lines first.
        for far in 1..=3 {
            for (si, sj) in [(dj * far, di * far), (-dj * far, -di * far)] {
                for shift in [0, -self.period, self.period] {
                    let from = (i + si + shift * di, j + sj + shift * dj);
                    if let (Some(a), Some(b)) = (self.place(from), self.place((from.0 + di, from.1 + dj))) {
                        return Some(b - a);
                    }
                }
            }
        }
        None
    }

    /// Adds neighbours at expected positions until no more are found.
    fn spread(&mut self) {
        let mut all = Vec::new();
        loop {
            // Check all cells again at the end: a new cell may predict its neighbours better.
            if all.len() == self.cells.len() {
                return;
            }
            all = self.cells.keys().copied().collect();
            let mut fresh = all.clone();
            while !fresh.is_empty() {
                fresh = self.beside(fresh);
            }
        }
    }

    /// Adds the neighbours of some cells; returns the added cells.
    fn beside(&mut self, mut cells: Vec<(i32, i32)>) -> Vec<(i32, i32)> {
        // The iteration order of a `HashMap` is random; the result must not depend on it.
        cells.sort_unstable();
        let mut added = Vec::new();
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
                let (target, most) = (here.position + step, MAX_DEVIATION * step.norm());
                let mut best = None;
                let mut least = most;
                for i in self.index.around(target, most) {
                    let other = &self.saddles[i];
                    let distance = (other.position - target).norm();
                    if distance < least && !self.taken[i] && here.fits_beside(other, EDGE_TOLERANCE) {
                        (best, least) = (Some(i), distance);
                    }
                }
                if let Some(i) = best {
                    self.taken[i] = true;
                    self.cells.insert(next, i);
                    added.push(next);
                }
            }
        }
        added
    }
}

impl Lattice {
    /// Number of corners in the lattice line `at` of the first or the second coordinate, within the given span of
    /// the other coordinate.
    fn filled(&self, first: bool, at: i32, span: (i32, i32)) -> usize {
        (span.0..=span.1).filter(|&k| self.cells.contains_key(&if first { (at, k) } else { (k, at) })).count()
    }

    /// Coordinate ranges of the lattice without mostly empty outer lines.
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

    /// Matches the lattice to a board of `columns` × `rows` inner corners. Of the board's possible orientations
    /// (two, or four for a square board) the one whose rows run most to the right is returned.
    pub fn matched(&self, columns: usize, rows: usize) -> Match {
        let (i, j) = self.extent();
        let (wide, high) = ((i.1 - i.0 + 1) as usize, (j.1 - j.0 + 1) as usize);
        let mut best: Option<(usize, f64, Places)> = None;
        // Skip all positions of the board if the lattice has too few corners.
        let enough = |count: usize| 100 * count >= MIN_PERCENT * columns * rows;
        for turned in [false, true].into_iter().filter(|_| enough(self.cells.len())) {
            let (n, m) = if turned { (rows, columns) } else { (columns, rows) };
            if wide > n || high > m {
                continue;
            }
            // Outer lines may be missing: try all positions of the board around the lattice.
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
            // Every line of the board must have at least half of its corners.
            Some((count, _, corners)) if enough(count) && lines_hold(&corners, columns) => {
                Match::Board(corners)
            }
            _ => Match::Other(wide.max(high), wide.min(high)),
        }
    }

    /// The corners of a board that starts at `from` and spans (n, m) cells, row by row.
    fn read(&self, from: (i32, i32), (n, m): (usize, usize), turned: bool, half_turn: bool) -> Places {
        let mut corners = Vec::with_capacity(n * m);
        let (columns, rows) = if turned { (m, n) } else { (n, m) };
        for row in 0..rows {
            for column in 0..columns {
                // A quarter turn keeps the orientation: rows run along j, columns against i.
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

/// Total extent of the rows to the right: sum over neighbours, in pixels.
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

    /// Saddle points of a board of 5 × 4 corners under shear and slight perspective, rotated by `turn`.
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
    fn a_board_is_joined_in_any_orientation() {
        for step in 0..24 {
            let turn = f64::from(step) * 0.26;
            let mut saddles = board(turn);
            fastrand::Rng::with_seed(step as u64).shuffle(&mut saddles);
            let lattices = grow(&saddles, 1, MAX_SEEDS);
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
        let lattice = &grow(&saddles, 1, MAX_SEEDS)[0];
        let Match::Board(corners) = lattice.matched(5, 4) else { panic!("{lattice:?}") };
        assert_eq!(corners.iter().flatten().count(), 18);
        assert!(corners[0].is_none() && corners[7].is_none());
        saddles.truncate(12);
        assert!(matches!(grow(&saddles, 1, MAX_SEEDS)[0].matched(5, 4), Match::Other(..)));
        // Saddle points without alternating contrast fit nowhere.
        let mut same = board(0.1);
        for s in &mut same {
            (s.rising, s.falling) = (0.1, 1.6);
        }
        assert!(grow(&same, 1, MAX_SEEDS).is_empty());
    }
}
