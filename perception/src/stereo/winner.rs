//! From energies to a disparity: the winner, its sub-pixel place, the left-right check and the
//! confidence.

use super::volume::{LANES, Lanes};

/// How the winner of a pixel is chosen and trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WinnerParameters {
    /// Disparities of the left and the right view may differ by this many pixels.
    pub left_right_px: u8,
    /// A winner whose energy lies this far below the best other node has confidence 255.
    pub clear_margin: u8,
}

impl Default for WinnerParameters {
    fn default() -> Self {
        Self { left_right_px: 1, clear_margin: 40 }
    }
}

/// Picks winners row by row, with memory allocated once.
#[derive(Debug)]
pub struct Winner {
    parameters: WinnerParameters,
    width: usize,
    disparities: usize,
    best: Vec<u8>,
    best_disparity: Vec<u8>,
    second: Vec<u8>,
    /// The right view; `disparities` unused entries lead, so that x − d needs no test.
    right_best: Vec<u8>,
    right_disparity: Vec<u8>,
}

impl Winner {
    /// A workspace for rows of `width` pixels and `disparities` (at most 255) nodes.
    pub fn new(parameters: WinnerParameters, width: usize, disparities: usize) -> Self {
        let padded = width.div_ceil(LANES) * LANES;
        Self {
            parameters,
            width,
            disparities,
            best: vec![0; padded],
            best_disparity: vec![0; padded],
            second: vec![0; padded],
            right_best: vec![0; disparities + padded],
            right_disparity: vec![0; disparities + padded],
        }
    }

    /// Bytes that the workspace holds.
    pub fn bytes(&self) -> usize {
        3 * self.best.len() + 2 * self.right_best.len()
    }

    /// Takes one row of energies (`[tile][disparity][lane]`) and writes its disparities in
    /// 1/256 px (0 = unknown: left-right check failed, outside the right view, or at infinity)
    /// and confidences.
    pub fn row(&mut self, energy: &[Lanes], disparity: &mut [u16], confidence: &mut [u8]) {
        let disparities = self.disparities;
        self.right_best.fill(u8::MAX);
        self.right_disparity.fill(0);
        for (tile, nodes) in energy.chunks_exact(disparities).enumerate() {
            let x = tile * LANES;
            let mut best = nodes[0];
            let mut place = Lanes::ZERO;
            for (d, node) in nodes.iter().enumerate().skip(1) {
                for i in 0..LANES {
                    let better = node.0[i] < best.0[i];
                    best.0[i] = if better { node.0[i] } else { best.0[i] };
                    place.0[i] = if better { d as u8 } else { place.0[i] };
                }
            }
            let mut second = Lanes::splat(u8::MAX);
            for (d, node) in nodes.iter().enumerate() {
                for i in 0..LANES {
                    let rival = (d as u8).abs_diff(place.0[i]) > 1;
                    let energy = if rival { node.0[i] } else { u8::MAX };
                    second.0[i] = second.0[i].min(energy);
                }
            }
            self.best[x..x + LANES].copy_from_slice(&best.0);
            self.best_disparity[x..x + LANES].copy_from_slice(&place.0);
            self.second[x..x + LANES].copy_from_slice(&second.0);

            let inside = LANES.min(self.width - x);
            for (d, node) in nodes.iter().enumerate() {
                let at = x + disparities - d;
                let right_best = &mut self.right_best[at..at + inside];
                let right_place = &mut self.right_disparity[at..at + inside];
                for ((energy, best), place) in node.0.iter().zip(right_best).zip(right_place) {
                    // On a tie the nearer surface hides the farther one.
                    let better = *energy <= *best;
                    *best = if better { *energy } else { *best };
                    *place = if better { d as u8 } else { *place };
                }
            }
        }

        for x in 0..self.width {
            let d = self.best_disparity[x];
            let seen = usize::from(d) <= x
                && self.right_disparity[x + disparities - usize::from(d)].abs_diff(d)
                    <= self.parameters.left_right_px;
            if !seen {
                (disparity[x], confidence[x]) = (0, 0);
                continue;
            }
            let nodes = &energy[x / LANES * disparities..][..disparities];
            disparity[x] = sub_pixel(nodes, x % LANES, usize::from(d));
            let margin = u32::from(self.second[x].saturating_sub(self.best[x]));
            let clear = u32::from(self.parameters.clear_margin.max(1));
            confidence[x] = (margin * 255 / clear).clamp(1, 255) as u8;
        }
    }
}

/// The disparity in 1/256 px: the winner `d`, moved by where two lines of equal slope through it
/// and its neighbours meet (equiangular fit), at most half a pixel.
fn sub_pixel(nodes: &[Lanes], lane: usize, d: usize) -> u16 {
    let whole = (d * 256) as i32;
    if d == 0 || d + 1 == nodes.len() {
        return whole as u16;
    }
    let at = |d: usize| i32::from(nodes[d].0[lane]);
    let (before, here, after) = (at(d - 1), at(d), at(d + 1));
    let slope = (before - here).max(after - here);
    if slope <= 0 {
        return whole as u16;
    }
    (whole + 128 * (before - after) / slope) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row whose pixel x has its least energy at `truth[x]`.
    fn row_for(truth: &[usize], disparities: usize) -> Vec<Lanes> {
        let mut row = vec![Lanes::splat(200); truth.len().div_ceil(LANES) * disparities];
        for (x, &t) in truth.iter().enumerate() {
            for d in 0..disparities {
                row[x / LANES * disparities + d].0[x % LANES] = (20 * d.abs_diff(t)).min(100) as u8;
            }
        }
        row
    }

    #[test]
    fn a_constant_disparity_is_found_where_both_views_see_it() {
        let truth = [7; 50];
        let mut winner = Winner::new(WinnerParameters::default(), 50, 16);
        let (mut disparity, mut confidence) = ([1; 50], [1; 50]);
        winner.row(&row_for(&truth, 16), &mut disparity, &mut confidence);
        assert!(disparity[..7].iter().all(|&d| d == 0), "outside the right view");
        assert!(disparity[7..].iter().all(|&d| d == 7 * 256));
        assert!(confidence[7..].iter().all(|&c| c == 255));
        assert!(confidence[..7].iter().all(|&c| c == 0));
    }

    #[test]
    fn an_occluded_strip_fails_the_check() {
        // A near object from 30 on hides what lies right of its left edge in the right view.
        let truth: Vec<usize> = (0..64).map(|x| if x >= 30 { 12 } else { 2 }).collect();
        let mut winner = Winner::new(WinnerParameters::default(), 64, 16);
        let (mut disparity, mut confidence) = ([0; 64], [0; 64]);
        winner.row(&row_for(&truth, 16), &mut disparity, &mut confidence);
        assert!(disparity[20..30].iter().all(|&d| d == 0), "{disparity:?}");
        assert_eq!(disparity[19], 2 * 256);
        assert_eq!(disparity[40], 12 * 256);
    }

    #[test]
    fn the_sub_pixel_place_follows_the_lower_side() {
        let nodes = |e: [u8; 3]| e.map(Lanes::splat);
        assert_eq!(sub_pixel(&nodes([20, 10, 20]), 0, 1), 256);
        assert_eq!(sub_pixel(&nodes([30, 10, 10]), 0, 1), 256 + 128);
        assert_eq!(sub_pixel(&nodes([15, 10, 20]), 0, 1), 256 - 64);
        assert_eq!(sub_pixel(&nodes([10, 10, 10]), 0, 1), 256);
        assert_eq!(sub_pixel(&nodes([5, 10, 20]), 0, 0), 0);
    }
}
