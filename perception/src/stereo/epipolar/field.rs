//! The vertical offset between both images of a pair over their area, as a plane.

use nalgebra::{Matrix3, Vector3};
use std::ops::{Add, Mul, Sub};

/// Row of a point in the right image minus its row in the left image, over the right image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RowField {
    /// Offset in the middle of the image, in pixels; positive is lower in the right image.
    pub offset_px: f64,
    /// Change from the middle to the right border, in pixels.
    pub across_px: f64,
    /// Change from the middle to the lower border, in pixels.
    pub down_px: f64,
}

impl RowField {
    /// No offset anywhere.
    pub const ZERO: Self = Self { offset_px: 0.0, across_px: 0.0, down_px: 0.0 };

    /// Offset at a position, each coordinate from −1 (left, upper border) to 1, in pixels.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        self.offset_px + self.across_px * x + self.down_px * y
    }

    /// Largest magnitude in the image, in pixels.
    pub fn largest_px(&self) -> f64 {
        self.offset_px.abs() + self.across_px.abs() + self.down_px.abs()
    }
}

impl RowField {
    /// The field that points have, robustly (Huber's loss with the threshold `huber_px`): each point is its place, from −1
    /// to 1, and its offset in px. `None` where the places do not determine it.
    pub fn fitted(points: &[[f64; 3]], huber_px: f64) -> Option<Self> {
        let mut offsets: Vec<f64> = points.iter().map(|p| p[2]).collect();
        offsets.sort_unstable_by(f64::total_cmp);
        let mut estimate = Vector3::new(*offsets.get(offsets.len() / 2)?, 0.0, 0.0);
        for _ in 0..FIT_STEPS {
            let (mut information, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for [x, y, offset] in points {
                let row = Vector3::new(1.0, *x, *y);
                let weight = (huber_px / (offset - row.dot(&estimate)).abs()).min(1.0);
                information += row * row.transpose() * weight;
                right += row * (weight * offset);
            }
            let scale = information.trace() / 3.0;
            if information.determinant() < MIN_DETERMINANT * scale.powi(3) {
                return None;
            }
            estimate = information.try_inverse()? * right;
        }
        let [offset_px, across_px, down_px] = estimate.into();
        [offset_px, across_px, down_px].iter().all(|v| v.is_finite()).then_some(Self {
            offset_px,
            across_px,
            down_px,
        })
    }
}

/// Determinant of the normal equations below which places count as lying on a line, relative to the cube of their mean diagonal.
const MIN_DETERMINANT: f64 = 1e-6;
/// Iterations of [`RowField::fitted`].
const FIT_STEPS: usize = 20;

impl Add for RowField {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            offset_px: self.offset_px + other.offset_px,
            across_px: self.across_px + other.across_px,
            down_px: self.down_px + other.down_px,
        }
    }
}

impl Sub for RowField {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + other * -1.0
    }
}

impl Mul<f64> for RowField {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self {
            offset_px: self.offset_px * factor,
            across_px: self.across_px * factor,
            down_px: self.down_px * factor,
        }
    }
}

/// Position of a pixel from −1 to 1 along a side of `length` pixels.
pub fn place(at: f64, length: usize) -> f64 {
    2.0 * at / (length.max(2) - 1) as f64 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_fitted_in_spite_of_wrong_points() {
        let mut random = fastrand::Rng::with_seed(3);
        let true_field = RowField { offset_px: 3.0, across_px: -2.0, down_px: 0.5 };
        let points: Vec<[f64; 3]> = (0..400)
            .map(|k| {
                let [x, y] = [0, 1].map(|_| 2.0 * random.f64() - 1.0);
                let wrong = if k % 6 == 0 { 20.0 * random.f64() - 10.0 } else { 0.0 };
                [x, y, true_field.at(x, y) + wrong + 0.4 * (random.f64() - 0.5)]
            })
            .collect();
        let found = RowField::fitted(&points, 0.5).unwrap();
        assert!((found - true_field).largest_px() < 0.15, "{found:?}");
        assert_eq!(RowField::fitted(&points[..2], 0.5), None);
        assert_eq!(RowField::fitted(&[], 0.5), None);
    }
}
