//! Finds a calibration board in an image.

use super::board::{Board, Pattern};
use super::corner::{self, Corner};
use super::grid::{self, Match, Places};
use super::homography;
use super::marker::Reader;
use super::placement;
use super::plane::Plane;
use super::saddle;
use crate::image::GreyView;
use nalgebra::Vector2;
use thiserror::Error;

/// Maximum number of saddle points at one scale.
const MAX_SADDLES: usize = 2500;
/// The same, and the maximum number of seeds, for boards with markers, which have saddle points of their own.
const MARKED: (usize, usize) = (5000, 600);
/// Images with a longer side are searched at half, a quarter, … of their size.
const WIDEST: usize = 900;
/// The same for boards with markers, whose cells are small.
const WIDEST_MARKED: usize = 1600;
/// Distance from an edge up to which pixels are used, however near a marker is, in pixels.
const MIN_CLEAR_PX: f64 = 0.7;
/// Corners of a board with markers that an image must show.
pub const MIN_CORNERS: usize = 8;
/// A board with markers of which this share of the corners is found is not searched at another scale, in percent.
const ENOUGH_PERCENT: usize = 70;
/// Images whose longer side is at most this are searched at twice their size, too.
const NARROW: usize = 520;
/// Share of the distance to the next corner that is used for the fit.
const REACH: f64 = 0.42;
/// Maximum radius of the fit, in pixels.
const MAX_RADIUS_PX: f64 = 8.0;

/// A board found in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// The corners, row by row, in pixels; integers are pixel centres. Of a chessboard all, of a board with markers at least
    /// [`MIN_CORNERS`].
    pub corners: Places,
    /// Median of the corners' estimated standard deviations, in pixels.
    pub sigma_px: f64,
    /// Median blur of the edges, in pixels (standard deviation).
    pub blur_px: f64,
    /// Median of half the difference between bright and dark, in grey levels.
    pub contrast: f64,
}

/// Why no board was found in an image.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum NoBoard {
    /// No lattice of corners was found.
    #[error("no board found")]
    None,
    /// A lattice of another size.
    #[error("{columns}x{rows} corners found: the board is cut off or covered, or has another size")]
    Other {
        /// Corners along its longer side.
        columns: usize,
        /// Corners along the other.
        rows: usize,
    },
    /// Too few corners of a board with markers, or all in one line.
    #[error(
        "{corners} corners found beside markers of the board, {MIN_CORNERS} are needed: bring it nearer, show more of it, and check --board, --dictionary and --legacy"
    )]
    Part {
        /// Number of these corners.
        corners: usize,
    },
    /// The lattice was found, but some of its corners cannot be refined.
    #[error("{lost} of the board's corners are too blurred, too dark or at the border of the image")]
    Unclear {
        /// Number of these corners.
        lost: usize,
    },
}

/// Finds `board` in an image. The run time is bounded: about that of a few blurs of an image 900 pixels wide, 1600 for a board
/// with markers.
///
/// # Errors
/// If there is no board, too small a part of one (of a chessboard: less than all), or corners that cannot be refined.
pub fn find(image: GreyView<'_>, board: &Board) -> Result<Sighting, NoBoard> {
    // Scale 0 is the image, 1 half of its size, …; the search starts at the finest scale.
    let mut planes = vec![Plane::from_view(image)];
    while planes.len() < 8 {
        let Some(half) = planes.last().and_then(Plane::halved) else { break };
        planes.push(half);
    }
    match Reader::new(board) {
        Some(reader) => find_marked(&planes, board, &reader),
        None => find_whole(&planes, board),
    }
}

/// The first scale at which an image is at most `widest` pixels wide and high.
fn first_scale(planes: &[Plane], widest: usize) -> usize {
    planes.iter().position(|p| p.width().max(p.height()) <= widest).unwrap_or(planes.len() - 1)
}

/// Finds a board with markers: at the scale that shows most of it.
fn find_marked(planes: &[Plane], board: &Board, reader: &Reader) -> Result<Sighting, NoBoard> {
    let first = first_scale(planes, WIDEST_MARKED);
    let mut best: Places = Vec::new();
    let mut has_lattice = false;
    let count = |places: &Places| places.iter().flatten().count();
    let mut scale = first;
    for (at, plane) in planes.iter().enumerate().skip(first).take(3) {
        let saddles = saddle::find(&plane.blurred(saddle::SIGMA_PX), MARKED.0);
        let lattices = grid::grow(&saddles, board.period(), MARKED.1);
        has_lattice |= !lattices.is_empty();
        let places = placement::corners(&lattices, plane, reader, board);
        if count(&places) > count(&best) {
            (best, scale) = (places, at);
        }
        if 100 * count(&best) >= ENOUGH_PERCENT * board.corners() {
            break;
        }
    }
    if best.is_empty() {
        return Err(if has_lattice { NoBoard::Part { corners: 0 } } else { NoBoard::None });
    }
    let sighting = refined(best, &planes[..=scale], board).map_err(|lost| NoBoard::Unclear { lost })?;
    let corners = count(&sighting.corners);
    if corners < MIN_CORNERS || !spans_a_plane(&sighting.corners, board) {
        return Err(NoBoard::Part { corners });
    }
    Ok(sighting)
}

/// Whether the corners lie in two rows and two columns at least, with two in each of those.
fn spans_a_plane(corners: &Places, board: &Board) -> bool {
    let columns = board.columns();
    let seen = |k: usize| corners[k].is_some();
    let rows = (0..board.rows()).filter(|r| (0..columns).filter(|c| seen(r * columns + c)).count() >= 2);
    let lines = (0..columns).filter(|c| (0..board.rows()).filter(|r| seen(r * columns + c)).count() >= 2);
    rows.count() >= 2 && lines.count() >= 2
}

/// Finds a whole chessboard.
fn find_whole(planes: &[Plane], board: &Board) -> Result<Sighting, NoBoard> {
    let first = first_scale(planes, WIDEST);
    let mut failure = NoBoard::None;
    let mut seen = 0;
    let mut consider = |result: Result<Sighting, NoBoard>| match result {
        Ok(sighting) => Some(sighting),
        Err(error) => {
            let corners = match error {
                NoBoard::None | NoBoard::Part { .. } => 0,
                NoBoard::Other { columns, rows } => columns * rows,
                NoBoard::Unclear { .. } => usize::MAX,
            };
            if corners > seen {
                (seen, failure) = (corners, error);
            }
            None
        }
    };
    // Blurred boards are found at half the size, small ones at twice the size.
    for scale in [first, first + 1] {
        if let Some(plane) = planes.get(scale)
            && let Some(sighting) = consider(at_scale(plane, &planes[..=scale], board))
        {
            return Ok(sighting);
        }
    }
    if first == 0
        && planes[0].width().max(planes[0].height()) <= NARROW
        && let Some(sighting) = consider(at_scale(&planes[0].doubled(), &planes[..1], board))
    {
        return Ok(sighting);
    }
    Err(failure)
}

/// Finds the chessboard in `plane` and refines its corners in `planes`, from the last to the first.
fn at_scale(plane: &Plane, planes: &[Plane], board: &Board) -> Result<Sighting, NoBoard> {
    let saddles = saddle::find(&plane.blurred(saddle::SIGMA_PX), MAX_SADDLES);
    let (mut other, mut lost) = ((0, 0), None);
    for lattice in grid::grow(&saddles, 1, grid::MAX_SEEDS).iter().take(4) {
        match lattice.matched(board.columns(), board.rows()) {
            Match::Board(corners) => {
                let scale = plane.width() as f64 / planes[planes.len() - 1].width() as f64;
                // Doubling and halving preserve the outer edge of the pixel grid, not the first pixel centre.
                let places: Places = corners
                    .iter()
                    .map(|c| c.map(|c| if scale > 1.5 { c.map(|v| 0.5 * (v + 0.5) - 0.5) } else { c }))
                    .collect();
                let whole = completed(&places, board).ok_or(places.len());
                match whole.and_then(|places| refined(places, planes, board)) {
                    Ok(sighting) => return Ok(sighting),
                    Err(count) => lost = Some(count),
                }
            }
            Match::Other(columns, rows) => {
                if columns * rows > other.0 * other.1 {
                    other = (columns, rows);
                }
            }
        }
    }
    match (lost, other) {
        (Some(lost), _) => Err(NoBoard::Unclear { lost }),
        (None, (columns, rows)) if columns >= 3 && rows >= 2 => Err(NoBoard::Other { columns, rows }),
        _ => Err(NoBoard::None),
    }
}

/// Predicts missing corners of a chessboard from those around them: a wide-angle lens bends what is farther away.
fn completed(places: &Places, board: &Board) -> Option<Places> {
    let points = board.points_m();
    (0..places.len())
        .map(|k| places[k].or_else(|| homography::predict(&points, places, &points[k])).map(Some))
        .collect()
}

/// Steps along the rows and down the columns at a corner, in pixels: the shorter ones of the neighbouring steps, as the window of
/// the fit must not reach the next corner. Steps of different lengths on the board are scaled to the shortest. `None` without
/// neighbours in either direction.
fn steps(corners: &Places, board: &Board, points: &[Vector2<f64>], k: usize) -> Option<[Vector2<f64>; 2]> {
    let columns = board.columns();
    let here = corners[k]?;
    let step = |other: Option<usize>, axis: usize| -> Option<(Vector2<f64>, f64)> {
        let other = other?;
        let length_m = (points[other] - points[k])[axis];
        Some(((corners[other]? - here) * length_m.signum(), length_m.abs()))
    };
    let (c, r) = (k % columns, k / columns);
    let beside = [(c > 0).then(|| k - 1), (c + 1 < columns).then_some(k + 1)];
    let above = [(r > 0).then(|| k - columns), (r + 1 < board.rows()).then_some(k + columns)];
    let shortest_m = (points[1] - points[0]).norm().min((points[2] - points[1]).norm());
    let shorter = |neighbours: [Option<usize>; 2], axis: usize| {
        let scaled = neighbours.map(|n| step(n, axis).map(|(step, length_m)| step * (shortest_m / length_m)));
        match scaled {
            [Some(a), Some(b)] => Some((a + b) * (a.norm().min(b.norm()) / (a.norm() + b.norm()))),
            [a, b] => a.or(b),
        }
    };
    Some([shorter(beside, 0)?, shorter(above, 1)?])
}

/// Refines the corners to sub-pixel precision, from the coarsest to the finest plane. A chessboard needs all of them; the error
/// is the number of corners that could not be refined.
fn refined(mut corners: Places, planes: &[Plane], board: &Board) -> Result<Sighting, usize> {
    let is_whole = board.pattern() == Pattern::Chessboard;
    let (columns, points) = (board.columns(), board.points_m());
    // The markers begin so far from the edges of their squares, in squares.
    let clear = match board.pattern() {
        Pattern::Charuco { marker_share, .. } => 0.5 * (1.0 - marker_share),
        _ => f64::INFINITY,
    };
    let mut fits: Vec<Option<Corner>> = Vec::new();
    for (i, plane) in planes.iter().enumerate().rev() {
        fits = (0..corners.len())
            .map(|k| {
                let [along, down] = steps(&corners, board, &points, k)?;
                // Blur spreads them by about a pixel; some pixels beside each edge must be left.
                let step = along.norm().min(down.norm());
                let clear = (clear - 1.0 / step).max(MIN_CLEAR_PX / step);
                corner::refine(plane, corners[k]?, along, down, REACH, clear, MAX_RADIUS_PX)
            })
            .collect();
        let located = fits.iter().flatten().count();
        // Failures at coarser planes are allowed: those only provide start values.
        if i == 0 && is_whole && located < corners.len() {
            return Err(corners.len() - located);
        }
        for (corner, fit) in corners.iter_mut().zip(&fits) {
            if let Some(fit) = fit {
                *corner = Some(fit.position);
            }
            if i > 0 {
                *corner = corner.map(|c| c.map(|v| 2.0 * (v + 0.5) - 0.5));
            }
        }
    }
    // Neighbouring corners have opposite contrast; all others are false.
    let sign = |k: usize| if (k % columns + k / columns).is_multiple_of(2) { 1.0 } else { -1.0 };
    let seen = fits.iter().flatten().count();
    let turned =
        fits.iter().enumerate().filter(|(k, f)| f.is_some_and(|f| f.contrast * sign(*k) > 0.0)).count();
    if is_whole && turned != 0 && turned != seen {
        return Err(turned.min(seen - turned));
    }
    for (k, fit) in fits.iter_mut().enumerate() {
        let agrees = |f: &Corner| is_whole || (f.contrast * sign(k) > 0.0) == (2 * turned > seen);
        *fit = fit.filter(agrees);
    }
    let middle = |f: fn(&Corner) -> f64| {
        let mut values: Vec<f64> = fits.iter().flatten().map(f).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    };
    let mut sighting = Sighting {
        corners: fits.iter().map(|f| f.map(|f| f.position)).collect(),
        sigma_px: middle(|f| f.sigma_px),
        blur_px: middle(|f| f.blur_px),
        contrast: middle(|f| f.contrast.abs()),
    };
    // Chessboards with an odd and an even side are not symmetric to rotation by 180°: their first corner has a dark
    // square at its upper left.
    if is_whole && (columns + board.rows()) % 2 == 1 && fits[0].is_some_and(|f| f.contrast > 0.0) {
        sighting.corners.reverse();
    }
    Ok(sighting)
}

/// All corner orders that the symmetry of the board allows: one for boards with markers and those with an odd and an even side,
/// two for others, four for a square board.
pub fn orders(corners: &Places, board: &Board) -> Vec<Places> {
    let (columns, rows) = (board.columns(), board.rows());
    let mut all = vec![corners.clone()];
    if (columns + rows) % 2 == 1 || board.pattern() != Pattern::Chessboard {
        return all;
    }
    if columns == rows {
        let quarter = (0..corners.len())
            .map(|k| corners[(columns - 1 - k % columns) * columns + k / columns])
            .collect();
        all.push(quarter);
    }
    for i in 0..all.len() {
        let back = all[i].iter().rev().copied().collect();
        all.push(back);
    }
    all
}

/// The corners of the right image in the same order as those of the left image, for boards with rotational
/// symmetry: of all orders, the one with the smallest displacement relative to the left image.
pub fn ordered_alike(left: &Places, right: &Places, board: &Board) -> Places {
    let mean =
        |c: &Places| c.iter().flatten().sum::<Vector2<f64>>() / c.iter().flatten().count().max(1) as f64;
    let (l, r) = (mean(left), mean(right));
    let apart = |order: &Places| -> f64 {
        let both = order.iter().zip(left).filter_map(|(b, a)| Some(((*b)?, (*a)?)));
        both.map(|(b, a)| ((b - r) - (a - l)).norm_squared()).sum()
    };
    orders(right, board).into_iter().min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or_default()
}
