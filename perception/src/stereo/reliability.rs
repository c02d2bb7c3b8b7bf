//! Reliability of disparities: how likely an estimate is right.
//!
//! The confidence of a map belongs to one pixel (mean over 5 × 5). A wrong surface is larger than that, so the score, the mean of a
//! pixel's own confidence and that of the 15 × 15 pixels around it, ranks estimates better
//! (Hu and Mordohai, "A Quantitative Evaluation of Confidence Measures for Stereo Vision", 2012). Probabilities follow from the score by
//! a table, the shares of right estimates on the even pairs of KITTI 2015; docs/results.md has the reliability diagram of the others.

/// Radius of the window: 15 × 15 pixels.
const RADIUS: usize = 7;
const SIZE: usize = 2 * RADIUS + 1;
/// Confidence of what was filled in: no estimate supports it.
const FILLED: u8 = 1;
/// Width of the classes of scores in the table.
const CLASS: usize = 16;

/// Probability that an estimate is right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reliability {
    /// Within 1 px.
    pub within_1px: f32,
    /// Within 3 px.
    pub within_3px: f32,
}

/// Shares within 1 and 3 px in the middles of the classes of scores: `evaluate stereo kitti2015 --pairs even --json`, mean of both
/// methods, made monotonic.
const SHARES: [[f32; 2]; 256 / CLASS] = [
    [0.375, 0.765],
    [0.375, 0.765],
    [0.375, 0.765],
    [0.375, 0.765],
    [0.375, 0.765],
    [0.375, 0.765],
    [0.375, 0.765],
    [0.400, 0.780],
    [0.445, 0.813],
    [0.485, 0.844],
    [0.529, 0.877],
    [0.583, 0.905],
    [0.635, 0.935],
    [0.693, 0.959],
    [0.773, 0.981],
    [0.880, 0.994],
];

impl Reliability {
    /// Of an estimate with this score.
    pub fn of(score: u8) -> Self {
        let at = (f32::from(score) / CLASS as f32 - 0.5).clamp(0.0, (SHARES.len() - 1) as f32);
        let (low, part) = (at as usize, at.fract());
        let high = (low + 1).min(SHARES.len() - 1);
        let [within_1px, within_3px] =
            [0, 1].map(|k| SHARES[low][k] + part * (SHARES[high][k] - SHARES[low][k]));
        Self { within_1px, within_3px }
    }
}

/// The score of each pixel of a map, from its confidences, row by row: mean of its own and that of 15 × 15 pixels, at least 1; 0 where
/// there is no estimate. Pixels without an estimate and pixels outside the map count as 0; what was filled in has the score 1.
pub fn scores(confidence: &[u8], width: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(confidence.len());
    let rows: Vec<&[u8]> = confidence.chunks_exact(width.max(1)).collect();
    let mut columns = vec![0_u16; width];
    for y in 0..rows.len() + RADIUS {
        if let Some(row) = rows.get(y) {
            columns.iter_mut().zip(*row).for_each(|(sum, &c)| *sum += u16::from(c));
        }
        if let Some(row) = y.checked_sub(SIZE).and_then(|y| rows.get(y)) {
            columns.iter_mut().zip(*row).for_each(|(sum, &c)| *sum -= u16::from(c));
        }
        let Some(row) = y.checked_sub(RADIUS).and_then(|y| rows.get(y)) else { continue };
        let mut sum: u32 = columns.iter().take(RADIUS).map(|&c| u32::from(c)).sum();
        for (x, &own) in row.iter().enumerate() {
            sum += columns.get(x + RADIUS).map_or(0, |&c| u32::from(c));
            sum -= x.checked_sub(RADIUS + 1).map_or(0, |x| u32::from(columns[x]));
            let score = (u32::from(own) + sum / (SIZE * SIZE) as u32) / 2;
            out.push(if own <= FILLED { own } else { score.clamp(1, 255) as u8 });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_are_means_of_the_window() {
        let mut random = fastrand::Rng::with_seed(4);
        for (width, height) in [(1, 1), (5, 30), (40, 3), (33, 21)] {
            let map: Vec<u8> = (0..width * height).map(|_| random.u8(..).saturating_sub(60)).collect();
            let at = |x: i64, y: i64| {
                let inside = x >= 0 && y >= 0 && x < width as i64 && y < height as i64;
                if inside { u32::from(map[y as usize * width + x as usize]) } else { 0 }
            };
            let got = scores(&map, width);
            assert_eq!(got.len(), map.len());
            for (i, (&score, &own)) in got.iter().zip(&map).enumerate() {
                let (x, y) = ((i % width) as i64, (i / width) as i64);
                let total: u32 = (-7..=7)
                    .flat_map(|dy| (-7..=7).map(move |dx| (dx, dy)))
                    .map(|(dx, dy)| at(x + dx, y + dy))
                    .sum();
                let expected = if own <= 1 { own } else { ((u32::from(own) + total / 225) / 2) as u8 };
                assert_eq!(score, expected, "{width}x{height} {x} {y}");
            }
        }
        assert!(scores(&[], 0).is_empty());
    }

    #[test]
    fn probabilities_grow_with_the_score() {
        let all: Vec<Reliability> = (0..=255).map(Reliability::of).collect();
        for pair in all.windows(2) {
            assert!(pair[0].within_1px <= pair[1].within_1px && pair[0].within_3px <= pair[1].within_3px);
        }
        assert!(all.iter().all(|r| 0.0 < r.within_1px && r.within_1px < r.within_3px && r.within_3px < 1.0));
        // In the middle of a class its share.
        assert_eq!(Reliability::of(8 + 16 * 9), Reliability { within_1px: 0.485, within_3px: 0.844 });
    }
}
