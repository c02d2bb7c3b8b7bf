//! Finds a chessboard in an image.

use super::corner::{self, Corner};
use super::grid::{self, Match};
use super::homography;
use super::plane::Plane;
use super::saddle;
use crate::image::GreyView;
use nalgebra::Vector2;
use thiserror::Error;

/// Maximum number of saddle points at one scale.
const MAX_SADDLES: usize = 2500;
/// Images with a longer side are searched at half, a quarter, … of their size.
const WIDEST: usize = 900;
/// Images whose longer side is at most this are searched at twice their size, too.
const NARROW: usize = 520;
/// Share of the distance to the next corner that is used for the fit.
const REACH: f64 = 0.42;
/// Maximum radius of the fit, in pixels.
const MAX_RADIUS_PX: f64 = 8.0;

/// The printed pattern: inner corners, where four squares meet, and the side of a square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    columns: usize,
    rows: usize,
    square_m: f64,
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
    /// The side of a square is out of range.
    #[error("squares of {square_m} m: give the measured side, 0.0005 to 2 m")]
    Square {
        /// In metres.
        square_m: f64,
    },
}

impl Board {
    /// A board of `columns` × `rows` inner corners with squares of `square_m` metres.
    ///
    /// # Errors
    /// If a side has less than 3 or more than 50 corners, both have 3, or a square is not between half a
    /// millimetre and two metres.
    pub fn new(columns: usize, rows: usize, square_m: f64) -> Result<Self, BoardError> {
        let range = 3..=50;
        if !range.contains(&columns) || !range.contains(&rows) || columns.max(rows) < 4 {
            return Err(BoardError::Corners { columns, rows });
        }
        if !(0.0005..=2.0).contains(&square_m) {
            return Err(BoardError::Square { square_m });
        }
        Ok(Self { columns, rows, square_m })
    }

    /// Inner corners along a row.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Inner corners along a column.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Side of a square, in metres.
    pub fn square_m(&self) -> f64 {
        self.square_m
    }

    /// Number of inner corners.
    pub fn corners(&self) -> usize {
        self.columns * self.rows
    }

    /// The corners in board coordinates, row by row, in metres from the centre of the board.
    pub fn points_m(&self) -> Vec<Vector2<f64>> {
        let middle = Vector2::new((self.columns - 1) as f64, (self.rows - 1) as f64) * 0.5;
        (0..self.corners())
            .map(|i| {
                (Vector2::new((i % self.columns) as f64, (i / self.columns) as f64) - middle) * self.square_m
            })
            .collect()
    }
}

/// A board found in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// The corners, row by row, in pixels; integers are pixel centres.
    pub corners: Vec<Vector2<f64>>,
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
    #[error("no chessboard found")]
    None,
    /// A lattice of another size.
    #[error("{columns}x{rows} corners found: the board is cut off or covered, or has another size")]
    Other {
        /// Corners along its longer side.
        columns: usize,
        /// Corners along the other.
        rows: usize,
    },
    /// The lattice was found, but some of its corners cannot be refined.
    #[error("{lost} of the board's corners are too blurred, too dark or at the border of the image")]
    Unclear {
        /// Number of these corners.
        lost: usize,
    },
}

/// Finds `board` in an image. The run time is bounded: about that of a few blurs of an image 900 pixels wide.
///
/// # Errors
/// If there is no board, only a part of one, or corners that cannot be refined.
pub fn find(image: GreyView<'_>, board: &Board) -> Result<Sighting, NoBoard> {
    // Scale 0 is the image, 1 half of its size, …; the search starts at the finest scale.
    let mut planes = vec![Plane::from_view(image)];
    while planes.len() < 8 {
        let Some(half) = planes.last().and_then(Plane::halved) else { break };
        planes.push(half);
    }
    let first = planes.iter().position(|p| p.width().max(p.height()) <= WIDEST).unwrap_or(planes.len() - 1);
    let mut failure = NoBoard::None;
    let mut seen = 0;
    let mut consider = |result: Result<Sighting, NoBoard>| match result {
        Ok(sighting) => Some(sighting),
        Err(error) => {
            let corners = match error {
                NoBoard::None => 0,
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
        && image.width().max(image.height()) <= NARROW
        && let Some(sighting) = consider(at_scale(&planes[0].doubled(), &planes[..1], board))
    {
        return Ok(sighting);
    }
    Err(failure)
}

/// Finds the board in `plane` and refines its corners in `planes`, from the last to the first.
fn at_scale(plane: &Plane, planes: &[Plane], board: &Board) -> Result<Sighting, NoBoard> {
    let saddles = saddle::find(&plane.blurred(saddle::SIGMA_PX), MAX_SADDLES);
    let (mut other, mut lost) = ((0, 0), None);
    for lattice in grid::grow(&saddles).iter().take(4) {
        match lattice.matched(board.columns, board.rows) {
            Match::Board(corners) => {
                let scale = plane.width() as f64 / planes[planes.len() - 1].width() as f64;
                // Doubling and halving preserve the outer edge of the pixel grid, not the first pixel centre.
                let places = corners
                    .iter()
                    .map(|c| c.map(|c| if scale > 1.5 { c.map(|v| 0.5 * (v + 0.5) - 0.5) } else { c }))
                    .collect();
                match refined(places, planes, board) {
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

/// Predicts missing corners by a homography from the others.
fn completed(places: &[Option<Vector2<f64>>], board: &Board) -> Option<Vec<Vector2<f64>>> {
    let points = board.points_m();
    let (from, to): (Vec<_>, Vec<_>) =
        points.iter().zip(places).filter_map(|(p, c)| Some((*p, (*c)?))).unzip();
    let h = homography::fit(&from, &to)?;
    Some(points.iter().zip(places).map(|(p, c)| c.unwrap_or_else(|| homography::map(&h, p))).collect())
}

/// Refines the corners to sub-pixel precision, from the coarsest to the finest plane. The error is the number of
/// corners that could not be refined.
fn refined(places: Vec<Option<Vector2<f64>>>, planes: &[Plane], board: &Board) -> Result<Sighting, usize> {
    let Some(mut corners) = completed(&places, board) else { return Err(places.len()) };
    let (columns, rows) = (board.columns, board.rows);
    let mut fits: Vec<Option<Corner>> = Vec::new();
    for (i, plane) in planes.iter().enumerate().rev() {
        fits = (0..corners.len())
            .map(|k| {
                let (c, r) = (k % columns, k / columns);
                let (left, right) = (k - usize::from(c > 0), k + usize::from(c + 1 < columns));
                let above = k - if r > 0 { columns } else { 0 };
                let below = k + if r + 1 < rows { columns } else { 0 };
                // The shorter of both steps: the window must not reach the next corner.
                let shorter = |a: Vector2<f64>, b: Vector2<f64>| match (a.norm(), b.norm()) {
                    (0.0, _) => b,
                    (_, 0.0) => a,
                    (x, y) => (a + b) * (x.min(y) / (x + y)),
                };
                let along = shorter(corners[k] - corners[left], corners[right] - corners[k]);
                let down = shorter(corners[k] - corners[above], corners[below] - corners[k]);
                corner::refine(plane, corners[k], along, down, REACH, MAX_RADIUS_PX)
            })
            .collect();
        let located = fits.iter().flatten().count();
        // Failures at coarser planes are allowed: those only provide start values.
        if i == 0 && located < corners.len() {
            return Err(corners.len() - located);
        }
        for (corner, fit) in corners.iter_mut().zip(&fits) {
            if let Some(fit) = fit {
                *corner = fit.position;
            }
            if i > 0 {
                *corner = corner.map(|v| 2.0 * (v + 0.5) - 0.5);
            }
        }
    }
    let fits: Vec<Corner> = fits.into_iter().flatten().collect();
    // Neighbouring corners have opposite contrast; all others are false.
    let signs = |k: usize| if (k % columns + k / columns).is_multiple_of(2) { 1.0 } else { -1.0 };
    let same = fits.iter().enumerate().filter(|(k, f)| f.contrast * signs(*k) > 0.0).count();
    if same != 0 && same != fits.len() {
        return Err(same.min(fits.len() - same));
    }
    let middle = |f: fn(&Corner) -> f64| {
        let mut values: Vec<f64> = fits.iter().map(f).collect();
        values.sort_unstable_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let mut sighting = Sighting {
        corners: fits.iter().map(|f| f.position).collect(),
        sigma_px: middle(|f| f.sigma_px),
        blur_px: middle(|f| f.blur_px),
        contrast: middle(|f| f.contrast.abs()),
    };
    // Boards with an odd and an even side are not symmetric to rotation by 180°: their first corner has a dark
    // square at its upper left.
    if (columns + rows) % 2 == 1 && fits.first().is_some_and(|f| f.contrast > 0.0) {
        sighting.corners.reverse();
    }
    Ok(sighting)
}

/// All corner orders that the symmetry of the board allows: one for boards with an odd and an even side, two for
/// others, four for a square board.
pub fn orders(corners: &[Vector2<f64>], board: &Board) -> Vec<Vec<Vector2<f64>>> {
    let (columns, rows) = (board.columns, board.rows);
    let mut all = vec![corners.to_vec()];
    if (columns + rows) % 2 == 1 {
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
pub fn ordered_alike(left: &[Vector2<f64>], right: &[Vector2<f64>], board: &Board) -> Vec<Vector2<f64>> {
    let mean = |c: &[Vector2<f64>]| c.iter().sum::<Vector2<f64>>() / c.len() as f64;
    let (l, r) = (mean(left), mean(right));
    let apart = |order: &[Vector2<f64>]| -> f64 {
        order.iter().zip(left).map(|(b, a)| ((b - r) - (a - l)).norm_squared()).sum()
    };
    orders(right, board).into_iter().min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or_default()
}
