//! Corners, and where their surroundings are found in the other image, to a fraction of a pixel.

use crate::image::GreyView;

/// Radius of a patch.
pub const HALF: usize = 4;
const SIDE: usize = 2 * HALF + 1;
/// Columns on both sides of the expected one in which a patch is searched.
pub const ASIDE: usize = 4;
/// Pixels by which the refinement may leave the best integer position, and the pixel that interpolation reads beside it.
const REFINED: usize = 2;
/// Largest mean squared difference of a patch to its match: a share of the patch's contrast, for what neighbouring
/// pixels of an inclined surface do, plus twice the variance of a camera's noise of 2 grey levels. With 0.08 and 3
/// instead, three of four corners of kitti2015 were left out, and the error of the offset was twice as large.
const MAX_RESIDUAL: (f32, f32) = (0.15, 8.0);

/// A patch around a pixel with its derivatives.
pub struct Patch {
    grey: [f32; SIDE * SIDE],
    dx: [f32; SIDE * SIDE],
    dy: [f32; SIDE * SIDE],
    /// Structure tensor: sums of dx², dx·dy, dy².
    structure: [f32; 3],
}

impl Patch {
    /// The patch around a pixel that is at least [`HALF`] + 1 px from the borders.
    pub fn new(image: GreyView<'_>, x: usize, y: usize) -> Self {
        let mut patch = Self {
            grey: [0.0; SIDE * SIDE],
            dx: [0.0; SIDE * SIDE],
            dy: [0.0; SIDE * SIDE],
            structure: [0.0; 3],
        };
        for j in 0..SIDE {
            let v = y + j - HALF;
            let (above, row, below) = (image.row(v - 1), image.row(v), image.row(v + 1));
            for i in 0..SIDE {
                let u = x + i - HALF;
                let k = j * SIDE + i;
                patch.grey[k] = f32::from(row[u]);
                let (dx, dy) = (
                    0.5 * (f32::from(row[u + 1]) - f32::from(row[u - 1])),
                    0.5 * (f32::from(below[u]) - f32::from(above[u])),
                );
                (patch.dx[k], patch.dy[k]) = (dx, dy);
                patch.structure[0] += dx * dx;
                patch.structure[1] += dx * dy;
                patch.structure[2] += dy * dy;
            }
        }
        patch
    }

    /// Zero-mean sum of squared differences to a patch of another image, over every other row.
    pub fn difference(&self, image: GreyView<'_>, x: usize, y: usize) -> f32 {
        let mut sums = [0.0_f32; SIDE];
        let mut squares = [0.0_f32; SIDE];
        for j in (0..SIDE).step_by(2) {
            let row = &image.row(y + j - HALF)[x - HALF..x + HALF + 1];
            let own = &self.grey[j * SIDE..(j + 1) * SIDE];
            for i in 0..SIDE {
                let d = own[i] - f32::from(row[i]);
                sums[i] += d;
                squares[i] += d * d;
            }
        }
        let (sum, squares) = (sums.iter().sum::<f32>(), squares.iter().sum::<f32>());
        squares - sum * sum / (SIDE * SIDE.div_ceil(2)) as f32
    }

    /// Sum of squared differences from the mean over the pixels that [`Self::difference`] compares.
    pub fn contrast(&self) -> f32 {
        let (mut sum, mut squares) = (0.0, 0.0);
        for j in (0..SIDE).step_by(2) {
            for grey in &self.grey[j * SIDE..(j + 1) * SIDE] {
                sum += grey;
                squares += grey * grey;
            }
        }
        squares - sum * sum / (SIDE * SIDE.div_ceil(2)) as f32
    }

    /// Where the patch of (x, y) is in the right image: column and row in pixels. It is searched within [`ASIDE`]
    /// columns of `x − disparity` and `reach` rows of `y`; `None`, too, if these reach out of the image with their
    /// surroundings.
    pub fn found(
        &self,
        right: GreyView<'_>,
        (x, y): (usize, usize),
        disparity: f32,
        reach: usize,
    ) -> Option<(f32, f32)> {
        let middle = (x as f32 - disparity).round() as usize;
        let inside = |at: usize, around: usize, length: usize| {
            at >= around + HALF + REFINED && at + around + HALF + REFINED < length
        };
        if !inside(middle, ASIDE, right.width()) || !inside(y, reach, right.height()) {
            return None;
        }
        // The best integer position; disparities are wrong as well where rows do not match.
        let (mut least, mut at) = (f32::INFINITY, (0, 0));
        for v in y - reach..=y + reach {
            for u in middle - ASIDE..=middle + ASIDE {
                let difference = self.difference(right, u, v);
                if difference < least {
                    (least, at) = (difference, (u, v));
                }
            }
        }
        if at.0.abs_diff(middle) == ASIDE || at.1.abs_diff(y) == reach {
            return None;
        }
        self.refined(right, at)
    }

    /// Gauss–Newton refinement from a pixel of the right image, invariant to brightness.
    fn refined(&self, right: GreyView<'_>, at: (usize, usize)) -> Option<(f32, f32)> {
        let (mut u, mut v) = (at.0 as f32, at.1 as f32);
        let n = (SIDE * SIDE) as f32;
        let [a, b, c] = self.structure;
        let (mx, my) = (self.dx.iter().sum::<f32>() / n, self.dy.iter().sum::<f32>() / n);
        let (a, b, c) = (a - n * mx * mx, b - n * mx * my, c - n * my * my);
        let determinant = a * c - b * b;
        if determinant < 1.0 {
            return None;
        }
        let mut residual = 0.0;
        for _ in 0..6 {
            let (u0, v0) = (u.floor(), v.floor());
            let (fu, fv) = (u - u0, v - v0);
            let (left_edge, top_edge) = (u0 as usize - HALF, v0 as usize - HALF);
            let (mut gx, mut gy, mut sum, mut squares) = (0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32);
            for j in 0..SIDE {
                let (upper, lower) = (right.row(top_edge + j), right.row(top_edge + j + 1));
                for i in 0..SIDE {
                    let mix = |row: &[u8]| {
                        let (p, q) = (f32::from(row[left_edge + i]), f32::from(row[left_edge + i + 1]));
                        p + fu * (q - p)
                    };
                    let (p, q) = (mix(upper), mix(lower));
                    let k = j * SIDE + i;
                    let d = self.grey[k] - (p + fv * (q - p));
                    gx += (self.dx[k] - mx) * d;
                    gy += (self.dy[k] - my) * d;
                    sum += d;
                    squares += d * d;
                }
            }
            residual = (squares - sum * sum / n) / n;
            let (du, dv) = ((c * gx - b * gy) / determinant, (a * gy - b * gx) / determinant);
            u += du;
            v += dv;
            let lost = (u - at.0 as f32).abs() > 1.5 || (v - at.1 as f32).abs() > 1.5;
            if lost || !u.is_finite() || !v.is_finite() {
                return None;
            }
            if du.abs().max(dv.abs()) < 0.01 {
                break;
            }
        }
        (residual < MAX_RESIDUAL.0 * (a + c) / n + MAX_RESIDUAL.1).then_some((u, v))
    }
}

/// Corner response (Shi–Tomasi): the smaller eigenvalue of the patch's structure tensor per pixel, from every
/// other pixel of every other row.
pub fn corner(image: GreyView<'_>, x: usize, y: usize) -> f32 {
    const TAKEN: usize = HALF + 1;
    let (mut a, mut b, mut c) = (0_i32, 0_i32, 0_i32);
    for j in 0..TAKEN {
        let v = y + 2 * j - HALF;
        let span = x - HALF - 1..x + HALF + 2;
        let (above, row, below) =
            (&image.row(v - 1)[span.clone()], &image.row(v)[span.clone()], &image.row(v + 1)[span]);
        for i in 0..TAKEN {
            let at = 2 * i + 1;
            // Twice the derivatives.
            let dx = i32::from(row[at + 1]) - i32::from(row[at - 1]);
            let dy = i32::from(below[at]) - i32::from(above[at]);
            a += dx * dx;
            b += dx * dy;
            c += dy * dy;
        }
    }
    let [a, b, c] = [a, b, c].map(|sum| sum as f32 / 4.0);
    let root = ((a - c) * (a - c) + 4.0 * b * b).sqrt();
    0.5 * (a + c - root) / (TAKEN * TAKEN) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GreyImage;

    /// The disparity comes from shared memory, where another process may have changed it since the corner was chosen.
    #[test]
    fn a_disparity_that_leads_out_of_the_image_finds_nothing() {
        let (width, height) = (64, 48);
        let mut random = fastrand::Rng::with_seed(7);
        let mut image = GreyImage::new(width, height);
        image.as_mut_slice().fill_with(|| random.u8(..));
        let patch = Patch::new(image.view(), 40, 24);
        let (u, v) = patch.found(image.view(), (40, 24), 0.3, 3).expect("the image itself");
        assert!((u - 40.0).abs() < 0.01 && (v - 24.0).abs() < 0.01, "{u} {v}");
        for disparity in [40.0, 60.0, 255.0, -30.0, f32::NAN] {
            assert_eq!(patch.found(image.view(), (40, 24), disparity, 3), None, "{disparity}");
        }
        for reach in [20, 24, 100] {
            assert_eq!(patch.found(image.view(), (40, 24), 0.0, reach), None, "{reach}");
        }
    }
}
