//! The vertical offset between both images of a pair over their area, as a plane.

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
