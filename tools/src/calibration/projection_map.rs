//! The uncertainty of projection over both images and with the distance, as a picture and as a table.

use crate::reporting::picture::{Colour, Picture};
use nalgebra::Vector2;
use perception::calibration::StereoCalibration;
use std::fmt::Write;

const GROUND: Colour = [24, 26, 30];
const INK: Colour = [240, 240, 240];

/// Cells of the map, along a row and down a column.
const CELLS: (usize, usize) = (10, 8);

/// Uncertainty from which a cell is red, in pixels.
const RED_PX: f64 = 0.5;

const SIDES: [&str; 2] = ["left", "right"];

/// The distances of the map, in metres: that of the boards, 10 m, far away.
fn distances_m(c: &StereoCalibration) -> [f64; 3] {
    [c.projection.board_distance_m(), 10.0, f64::INFINITY]
}

/// The middle of a cell, in pixels.
fn middle(cell: usize, (width, height): (usize, usize)) -> Vector2<f64> {
    let at = |cell: usize, cells: usize, size: usize| (cell as f64 + 0.5) / cells as f64 * size as f64 - 0.5;
    Vector2::new(at(cell % CELLS.0, CELLS.0, width), at(cell / CELLS.0, CELLS.1, height))
}

/// The maps of the left camera above those of the right one; in each cell the standard deviation in px, in the worst direction.
pub fn picture(c: &StereoCalibration) -> Picture {
    const CELL: (usize, usize) = (40, 26);
    const GAP: usize = 26;
    let (wide, high) = (CELLS.0 * CELL.0 + GAP, CELLS.1 * CELL.1 + GAP);
    let mut picture = Picture::new(3 * wide, 2 * high, GROUND);
    for (side, name) in SIDES.into_iter().enumerate() {
        for (k, distance_m) in distances_m(c).into_iter().enumerate() {
            let (x0, y0) = ((k * wide) as i32, (side * high) as i32);
            let place =
                if distance_m.is_finite() { format!("{distance_m:.1} m") } else { "far away".to_owned() };
            picture.text(&format!("{name}, {place}"), x0 + 2, y0 + 6, INK);
            for cell in 0..CELLS.0 * CELLS.1 {
                let (column, row) = (cell % CELLS.0, cell / CELLS.0);
                let (x, y) = (x0 + (column * CELL.0) as i32, y0 + (GAP + row * CELL.1) as i32);
                let pixel = middle(cell, c.rectification.size);
                let Some(sigma_px) = c.projection.sigma_px(side, pixel, distance_m) else { continue };
                let share = (sigma_px / RED_PX).min(1.0);
                let colour =
                    [(30.0 + 190.0 * share) as u8, (110.0 - 60.0 * share) as u8, (90.0 - 50.0 * share) as u8];
                picture.fill([x, y, CELL.0 as i32 - 1, CELL.1 as i32 - 1], colour);
                let digits = if sigma_px < 9.95 { 2 } else { 0 };
                picture.text(&format!("{sigma_px:.digits$}"), x + 3, y + 8, INK);
            }
        }
    }
    picture
}

/// The same as comma-separated values: camera, column and row of the pixel in px, distance in metres (`inf` far away), standard deviation in px, and
/// what it would be if the errors of all corners were independent, in px. The first line has the standard deviation of a corner, in px.
pub fn table(c: &StereoCalibration) -> String {
    let mut text = format!(
        "# corners: {:.4} px\ncamera,x_px,y_px,distance_m,sigma_px,independent_px\n",
        c.corner_sigma_px
    );
    for (side, name) in SIDES.into_iter().enumerate() {
        for distance_m in distances_m(c) {
            for cell in 0..CELLS.0 * CELLS.1 {
                let pixel = middle(cell, c.rectification.size);
                let sigma = c.projection.sigma_px(side, pixel, distance_m);
                let independent = c.independent.sigma_px(side, pixel, distance_m);
                if let (Some(sigma_px), Some(independent_px)) = (sigma, independent) {
                    let (x, y) = (pixel.x, pixel.y);
                    let _ =
                        writeln!(text, "{name},{x},{y},{distance_m:.4},{sigma_px:.4},{independent_px:.4}");
                }
            }
        }
    }
    text
}
