//! Sub-pixel corner refinement to a few hundredths of a pixel: fits a blurred crossing of two edges to the grey
//! levels.

use super::plane::Plane;
use nalgebra::{SMatrix, SVector, Vector2};

/// Parameters of the fit: position (2), directions of both edges, logarithm of the blur, mean, contrast,
/// brightness gradient (2).
const PARAMETERS: usize = 9;
/// Maximum number of iterations.
const ROUNDS: usize = 25;

/// A refined corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Position in pixels; integers are pixel centres.
    pub position: Vector2<f64>,
    /// Standard deviation of the position, in pixels, estimated from the residuals of the fit.
    pub sigma_px: f64,
    /// Blur of the edges: standard deviation of a Gaussian, in pixels.
    pub blur_px: f64,
    /// Half the difference between bright and dark, in grey levels; the sign identifies the bright sectors.
    pub contrast: f64,
}

/// The error function and its derivative, accurate to 1.5·10⁻⁷ (Abramowitz and Stegun, 7.1.26).
fn erf(x: f64) -> (f64, f64) {
    let bell = (-x * x).exp();
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs());
    let series = t
        * (0.254_829_592
            + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    ((1.0 - series * bell).copysign(x), std::f64::consts::FRAC_2_SQRT_PI * bell)
}

/// Fits a crossing to the pixels around `start`. `along` and `down` are the steps to the next corners in pixels.
/// Pixels within the fraction `reach` of those steps and at most `max_px` away are used, but none that is farther than
/// `clear` of a step from both edges: there markers begin. `None` if the fit leaves the window or is not a crossing.
pub fn refine(
    plane: &Plane,
    start: Vector2<f64>,
    along: Vector2<f64>,
    down: Vector2<f64>,
    reach: f64,
    clear: f64,
    max_px: f64,
) -> Option<Corner> {
    let determinant = along.x * down.y - along.y * down.x;
    if determinant.abs() < 1e-6 {
        return None;
    }
    // Board coordinates, in squares, of a displacement in pixels.
    let squares = |d: Vector2<f64>| {
        Vector2::new(down.y * d.x - down.x * d.y, along.x * d.y - along.y * d.x) / determinant
    };
    let mut centre = start;
    let mut theta = [along.y.atan2(along.x), down.y.atan2(down.x)];
    let mut log_blur = 0.0_f64;
    let mut result = None;
    // Repeat once with the window centred on the refined corner.
    for _ in 0..2 {
        let radius = max_px.min(reach * along.norm().max(down.norm())).ceil();
        let (low, high) = (centre.add_scalar(-radius), centre.add_scalar(radius));
        if low.x < 0.0
            || low.y < 0.0
            || high.x > (plane.width() - 1) as f64
            || high.y > (plane.height() - 1) as f64
        {
            return None;
        }
        let middle = Vector2::new(centre.x.round(), centre.y.round());
        let mut pixels = Vec::with_capacity(256);
        for y in low.y.ceil() as usize..=high.y as usize {
            for x in low.x.ceil() as usize..=high.x as usize {
                let d = Vector2::new(x as f64, y as f64) - centre;
                let s = squares(d);
                let is_clear = s.x.abs().min(s.y.abs()) <= clear;
                if is_clear && d.norm() <= max_px && s.x.abs() <= reach && s.y.abs() <= reach {
                    let d = Vector2::new(x as f64, y as f64) - middle;
                    pixels.push((d, f64::from(plane.at(x, y)), s.x * s.y));
                }
            }
        }
        if pixels.len() < 2 * PARAMETERS {
            return None;
        }
        let mean = pixels.iter().map(|p| p.1).sum::<f64>() / pixels.len() as f64;
        // Which sectors are bright: correlation with the product of the signs of both sides.
        let lean = pixels.iter().map(|p| (p.1 - mean) * p.2.signum()).sum::<f64>() / pixels.len() as f64;
        let offset = centre - middle;
        let turn = if determinant > 0.0 { -1.0 } else { 1.0 };
        let fit = Fit {
            values: SVector::from([
                offset.x,
                offset.y,
                theta[0],
                theta[1],
                log_blur,
                mean,
                1.2 * lean * turn,
                0.0,
                0.0,
            ]),
        };
        let (fit, sigma_px) = fit.improved(&pixels)?;
        let v = &fit.values;
        centre = middle + Vector2::new(v[0], v[1]);
        theta = [v[2], v[3]];
        log_blur = v[4];
        let moved = squares(centre - start);
        if moved.x.abs() > 0.3 || moved.y.abs() > 0.3 || (v[6] > 0.0) != (lean * turn > 0.0) {
            return None;
        }
        result = Some(Corner { position: centre, sigma_px, blur_px: v[4].exp(), contrast: -v[6] });
    }
    result
}

/// Position, grey level, and the product of the board coordinates (unused by the fit).
type Pixel = (Vector2<f64>, f64, f64);

#[derive(Clone, Copy)]
struct Fit {
    values: SVector<f64, PARAMETERS>,
}

impl Fit {
    /// The modelled grey level at a position, and its derivatives.
    fn at(&self, d: Vector2<f64>) -> (f64, SVector<f64, PARAMETERS>) {
        let v = &self.values;
        let (px, py) = (d.x - v[0], d.y - v[1]);
        let k = std::f64::consts::FRAC_1_SQRT_2 * (-v[4]).exp();
        let ((s1, c1), (s2, c2)) = (v[2].sin_cos(), v[3].sin_cos());
        // Distances from both edges.
        let (d1, d2) = (py * c1 - px * s1, py * c2 - px * s2);
        let ((e1, g1), (e2, g2)) = (erf(k * d1), erf(k * d2));
        let (g1, g2) = (g1 * k, g2 * k);
        let c = v[6];
        let value = v[5] + c * e1 * e2 + v[7] * d.x + v[8] * d.y;
        let (by1, by2) = (c * g1 * e2, c * e1 * g2);
        let slope = SVector::from([
            by1 * s1 + by2 * s2,
            -by1 * c1 - by2 * c2,
            by1 * (-py * s1 - px * c1),
            by2 * (-py * s2 - px * c2),
            -by1 * d1 - by2 * d2,
            1.0,
            e1 * e2,
            d.x,
            d.y,
        ]);
        (value, slope)
    }

    fn normal(
        &self,
        pixels: &[Pixel],
    ) -> (SMatrix<f64, PARAMETERS, PARAMETERS>, SVector<f64, PARAMETERS>, f64) {
        let mut a = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
        let (mut b, mut cost) = (SVector::zeros(), 0.0);
        for (d, grey, _) in pixels {
            let (value, slope) = self.at(*d);
            let r = grey - value;
            a.syger(1.0, &slope, &slope, 1.0);
            b += slope * r;
            cost += r * r;
        }
        a.fill_upper_triangle_with_lower_triangle();
        (a, b, cost)
    }

    /// Levenberg–Marquardt until convergence; also returns the standard deviation of the position.
    fn improved(mut self, pixels: &[Pixel]) -> Option<(Self, f64)> {
        let (mut a, mut b, mut cost) = self.normal(pixels);
        let mut damping = 1e-3;
        for _ in 0..ROUNDS {
            let mut damped = a;
            for i in 0..PARAMETERS {
                damped[(i, i)] += damping * a[(i, i)] + 1e-9;
            }
            let step = damped.cholesky()?.solve(&b);
            let mut next = self;
            next.values += step;
            next.values[4] = next.values[4].clamp(-1.2, 1.8);
            let (next_a, next_b, next_cost) = next.normal(pixels);
            if next_cost.is_finite() && next_cost <= cost {
                self = next;
                (a, b, cost) = (next_a, next_b, next_cost);
                damping = (damping * 0.2).max(1e-9);
                if step[0].hypot(step[1]) < 1e-4 {
                    break;
                }
            } else {
                damping *= 8.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        for i in 0..PARAMETERS {
            a[(i, i)] += 1e-9;
        }
        let noise = cost / (pixels.len() - PARAMETERS) as f64;
        let inverse = a.cholesky()?.inverse();
        let sigma_px = (noise * 0.5 * (inverse[(0, 0)] + inverse[(1, 1)])).sqrt();
        sigma_px.is_finite().then_some((self, sigma_px))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GreyImage;

    #[test]
    fn the_error_function_and_its_derivative_are_accurate() {
        for (x, expected) in
            [(0.0, 0.0), (0.5, 0.520_499_877_8), (-1.0, -0.842_700_792_9), (3.0, 0.999_977_909_5)]
        {
            assert!((erf(x).0 - expected).abs() < 2e-7, "{x}");
            let slope = (erf(x + 1e-3).0 - erf(x - 1e-3).0) / 2e-3;
            assert!((erf(x).1 - slope).abs() < 3e-4, "{x}");
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let fit = Fit { values: SVector::from([0.2, -0.3, 0.1, 1.4, 0.2, 100.0, -60.0, 0.5, -0.4]) };
        for d in [Vector2::new(2.0, 1.0), Vector2::new(-1.0, 0.5), Vector2::new(0.0, -3.0)] {
            let exact = fit.at(d).1;
            for i in 0..PARAMETERS {
                let at = |step: f64| {
                    let mut f = fit;
                    f.values[i] += step;
                    f.at(d).0
                };
                let slope = (at(1e-3) - at(-1e-3)) / 2e-3;
                assert!((slope - exact[i]).abs() < 2e-2 * (1.0 + slope.abs()), "{i}: {slope} {}", exact[i]);
            }
        }
    }

    #[test]
    fn blurred_noisy_slanted_corners_are_found_to_hundredths() {
        let mut random = fastrand::Rng::with_seed(7);
        let (mut sum, mut stated, mut count) = (0.0, 0.0, 0);
        for round in 0..60 {
            let centre = Vector2::new(20.0 + random.f64(), 20.0 + random.f64());
            let (a, b) = (0.5 * random.f64(), 1.4 + 0.6 * random.f64());
            let blur = 0.6 + 1.2 * random.f64();
            let values = SVector::from([centre.x, centre.y, a, b, f64::ln(blur), 110.0, 70.0, 0.6, -0.5]);
            let truth = Fit { values };
            let mut image = GreyImage::new(41, 41);
            for (i, v) in image.as_mut_slice().iter_mut().enumerate() {
                let noise = 2.0 * (random.f64() + random.f64() + random.f64() - 1.5) * 2.0;
                let d = Vector2::new((i % 41) as f64, (i / 41) as f64);
                *v = (truth.at(d).0 + noise).round().clamp(0.0, 255.0) as u8;
            }
            let plane = Plane::from_view(image.view());
            let start = centre + Vector2::new(random.f64() - 0.5, random.f64() - 0.5) * 2.0;
            let (along, down) =
                (16.0 * Vector2::new(a.cos(), a.sin()), 16.0 * Vector2::new(b.cos(), b.sin()));
            let corner = refine(&plane, start, along, down, 0.45, f64::INFINITY, 8.0)
                .unwrap_or_else(|| panic!("round {round}"));
            assert!((corner.blur_px / blur - 1.0).abs() < 0.25, "{corner:?} {blur}");
            sum += (corner.position - centre).norm_squared() / 2.0;
            stated += corner.sigma_px.powi(2);
            count += 1;
        }
        let (rms, stated) = ((sum / f64::from(count)).sqrt(), (stated / f64::from(count)).sqrt());
        assert!(rms < 0.025, "{rms}");
        assert!((0.6..1.6).contains(&(rms / stated)), "{rms} but {stated} was stated");
    }
}
