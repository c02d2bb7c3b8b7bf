//! One step of a Viterbi path with the total-variation edge cost (paper, sections 3.2 and 3.3).
//!
//! The energy of node `u` of pixel `p`, reached from the pixel before it on the path, is
//!
//! ```text
//! e(p, u) = C(p, u) + min( min_v { e(p−1, v) + w·|u − v| }, m + T ) − m,   m = min_v e(p−1, v)
//! ```
//!
//! with the data term C, the edge weight w ≥ 1 and the truncation T. The inner minimum over all v
//! is found exactly by two sweeps over the disparities (the paper's O(2m) recursion, with the
//! backward sweep that its printed form omits): F(u) = min(e(p−1, u), F(u−1) + w), then
//! B(u) = min(F(u), B(u+1) + w). Subtracting m keeps energies within C + T.

use super::volume::Lanes;

/// Advances [`super::volume::LANES`] independent paths by one pixel.
///
/// `previous` and `data` hold one entry per disparity; `weight` is w of each lane; the result
/// goes to `out`. A `previous` of zeros starts the paths afresh (`out` = `data`).
/// Energies saturate at 255; they stay exact while `data` ≤ 255 − `truncation`.
///
/// # Panics
/// When the slices differ in length or are empty.
#[inline]
pub fn step(previous: &[Lanes], data: &[Lanes], weight: Lanes, truncation: u8, out: &mut [Lanes]) {
    let disparities = previous.len();
    assert!(disparities > 0 && data.len() == disparities && out.len() == disparities);

    // Forward sweep: F goes to `out`, m is collected on the way.
    let mut forward = previous[0];
    let mut least = forward;
    out[0] = forward;
    for (before, target) in previous[1..].iter().zip(&mut out[1..]) {
        least = least.min(*before);
        forward = before.min(forward.saturating_add(weight));
        *target = forward;
    }

    // Backward sweep: B, truncated, plus the data term.
    let limit = Lanes::splat(truncation);
    let mut backward = out[disparities - 1];
    for (target, cost) in out.iter_mut().zip(data).rev() {
        backward = target.min(backward.saturating_add(weight));
        *target = cost.saturating_add(backward.saturating_sub(least).min(limit));
    }
}

/// The definition of [`step`] for one path, O(m²): the oracle of the tests.
pub fn step_brute_force(previous: &[u8], data: &[u8], weight: u8, truncation: u8) -> Vec<u8> {
    let least = i32::from(*previous.iter().min().expect("a path has nodes"));
    (0..data.len())
        .map(|u| {
            let best = previous
                .iter()
                .enumerate()
                .map(|(v, &e)| i32::from(e) + i32::from(weight) * (u.abs_diff(v) as i32))
                .min()
                .expect("a path has nodes");
            let jump = best.min(least + i32::from(truncation)) - least;
            (i32::from(data[u]) + jump).min(255) as u8
        })
        .collect()
}

/// The edge weight of each step in grey value: λ·max(floor, e^(−|ΔI|/g)), at least 1, rounded.
#[derive(Clone, Debug)]
pub struct EdgeWeight {
    table: [u8; 256],
}

impl EdgeWeight {
    /// A table for `lambda` (in units of the cost), the scale `g` in grey levels and the share of
    /// λ that stays at the strongest edge.
    pub fn new(lambda: f32, gradient_scale: f32, floor: f32) -> Self {
        let mut table = [1; 256];
        for (step, weight) in table.iter_mut().enumerate() {
            let kept = (-(step as f32) / gradient_scale).exp().max(floor);
            *weight = (lambda * kept).round().clamp(1.0, 255.0) as u8;
        }
        Self { table }
    }

    /// The weight between two neighbours on a path.
    #[inline(always)]
    pub fn between(&self, a: u8, b: u8) -> u8 {
        self.table[usize::from(a.abs_diff(b))]
    }
}

#[cfg(test)]
mod tests {
    use super::super::volume::LANES;
    use super::*;

    /// Runs a chain of pixels through `step` and compares each with the O(m²) definition.
    fn compare(disparities: usize, pixels: usize, weight_max: u8, truncation: u8, seed: u64) {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut lanes = |max: u8| {
            let mut l = Lanes::ZERO;
            l.0.iter_mut().for_each(|v| *v = random.u8(..=max));
            l
        };
        let mut previous = vec![Lanes::ZERO; disparities];
        for pixel in 0..pixels {
            let data: Vec<Lanes> = (0..disparities).map(|_| lanes(217)).collect();
            let weight = lanes(weight_max - 1).saturating_add(Lanes::splat(1));
            let mut out = vec![Lanes::ZERO; disparities];
            step(&previous, &data, weight, truncation, &mut out);
            for lane in 0..LANES {
                let column = |s: &[Lanes]| s.iter().map(|l| l.0[lane]).collect::<Vec<_>>();
                let expected =
                    step_brute_force(&column(&previous), &column(&data), weight.0[lane], truncation);
                assert_eq!(
                    column(&out),
                    expected,
                    "pixel {pixel}, lane {lane}, {disparities} disparities, T {truncation}, seed {seed}"
                );
            }
            previous = out;
        }
    }

    #[test]
    fn the_fast_recursion_equals_brute_force() {
        for (disparities, weight, truncation) in
            [(1, 1, 38), (2, 8, 38), (7, 3, 10), (16, 255, 38), (64, 8, 38), (128, 1, 255), (100, 40, 0)]
        {
            for seed in 0..3 {
                compare(disparities, 12, weight, truncation, seed);
            }
        }
    }

    #[test]
    fn a_fresh_path_takes_the_data_term() {
        let data: Vec<Lanes> = (0..9).map(Lanes::splat).collect();
        let mut out = vec![Lanes::ZERO; 9];
        step(&[Lanes::ZERO; 9], &data, Lanes::splat(4), 38, &mut out);
        assert_eq!(out, data);
    }

    #[test]
    fn weights_fall_with_the_gradient_but_never_vanish() {
        let weight = EdgeWeight::new(8.0, 40.0, 0.3);
        assert_eq!(weight.between(10, 10), 8);
        assert!(weight.between(0, 40) < weight.between(0, 10));
        assert_eq!(weight.between(0, 255), 2);
        assert_eq!(EdgeWeight::new(0.1, 40.0, 0.0).between(0, 255), 1);
    }
}
