//! Weighted least-squares fit of a straight line.

/// Sums over the points.
#[derive(Clone, Copy, Debug, Default)]
pub struct LineFit {
    s: f64,
    sx: f64,
    sy: f64,
    sxx: f64,
    sxy: f64,
}

impl LineFit {
    /// Adds a point with a weight (0 or more).
    pub fn add(&mut self, x: f64, y: f64, weight: f64) {
        self.s += weight;
        self.sx += weight * x;
        self.sy += weight * y;
        self.sxx += weight * x * x;
        self.sxy += weight * x * y;
    }

    /// Slope of the line and its value at x = 0; `None` if the points do not determine a line.
    pub fn line(&self) -> Option<(f64, f64)> {
        let determinant = self.s * self.sxx - self.sx * self.sx;
        let slope = (self.s * self.sxy - self.sx * self.sy) / determinant;
        let at_zero = (self.sy * self.sxx - self.sx * self.sxy) / determinant;
        (determinant > 1e-9).then_some((slope, at_zero))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fit_is_exact_for_two_points_and_respects_weights() {
        let mut fit = LineFit::default();
        assert_eq!(fit.line(), None);
        fit.add(1.0, 5.0, 2.0);
        assert_eq!(fit.line(), None, "one point does not determine a slope");
        fit.add(3.0, 9.0, 1.0);
        let (slope, at_zero) = fit.line().unwrap();
        assert!((slope - 2.0).abs() < 1e-12 && (at_zero - 3.0).abs() < 1e-12);
        fit.add(3.0, 12.0, 2.0);
        // The two points at x = 3 have the combined effect of one point at y = 11.
        let (slope, at_zero) = fit.line().unwrap();
        assert!((slope - 3.0).abs() < 1e-12 && (at_zero - 2.0).abs() < 1e-12);
    }
}
