//! The model of a boosted cascade, and the reference implementation of its evaluation on one window.
//!
//! `program` holds the same cascade in a faster memory layout; tests assert that both give the same results.

use super::integral::Integral;
pub use super::window::{Contrast, WeightedRect};

/// A multi-block LBP feature: 3 × 3 equal blocks, the first one at (`x`, `y`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LbpFeature {
    /// Left column of the first block.
    pub x: u16,
    /// Top row of the first block.
    pub y: u16,
    /// Width of one block.
    pub width: u16,
    /// Height of one block.
    pub height: u16,
}

impl LbpFeature {
    /// The LBP code of the feature in the window at (`x`, `y`): one bit for each outer block, set if its sum
    /// is not less than the centre's; clockwise from the upper left, highest bit first.
    #[inline]
    pub fn code(&self, integral: &Integral, x: usize, y: usize) -> u8 {
        let (w, h) = (usize::from(self.width), usize::from(self.height));
        let (x, y) = (x + usize::from(self.x), y + usize::from(self.y));
        let mut corners = [[0_u32; 4]; 4];
        for (j, row) in corners.iter_mut().enumerate() {
            for (i, corner) in row.iter_mut().enumerate() {
                *corner = integral.sum_at(x + i * w, y + j * h);
            }
        }
        let block = |i: usize, j: usize| {
            corners[j + 1][i + 1]
                .wrapping_sub(corners[j + 1][i])
                .wrapping_sub(corners[j][i + 1])
                .wrapping_add(corners[j][i])
        };
        let centre = block(1, 1);
        let around = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)];
        around.iter().fold(0, |code, &(i, j)| code << 1 | u8::from(block(i, j) >= centre))
    }
}

/// A Haar feature: up to three weighted rectangles, upright or rotated by 45°. Unused rectangles have
/// weight 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HaarFeature {
    /// The rectangles.
    pub rects: [WeightedRect; 3],
    /// Whether the rectangles are rotated by 45°.
    pub tilted: bool,
}

impl HaarFeature {
    /// The value of the feature in the window at (`x`, `y`), in single precision and in OpenCV's order of
    /// operations; `inverse` is [`Contrast::inverse`].
    #[inline]
    pub fn value(&self, integral: &Integral, x: usize, y: usize, inverse: f32) -> f32 {
        let sum = |r: &WeightedRect| {
            let sum = if self.tilted { integral.tilted_sum(r, x, y) } else { integral.rect_sum(r, x, y) };
            r.weight * sum as i32 as f32
        };
        let mut value = sum(&self.rects[0]) + sum(&self.rects[1]);
        if self.rects[2].weight != 0.0 {
            value += sum(&self.rects[2]);
        }
        value * inverse
    }

    /// The rectangles in use.
    pub fn rects(&self) -> impl Iterator<Item = &WeightedRect> {
        self.rects.iter().filter(|r| r.weight != 0.0)
    }
}

/// The features that nodes refer to, all of one kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Features {
    /// Multi-block local binary patterns.
    Lbp(Vec<LbpFeature>),
    /// Haar features.
    Haar(Vec<HaarFeature>),
}

impl Features {
    /// Number of features.
    pub fn len(&self) -> usize {
        match self {
            Self::Lbp(features) => features.len(),
            Self::Haar(features) => features.len(),
        }
    }

    /// Whether there are no features.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The successor of a decision node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Branch {
    /// Another node of the tree, with a greater index than this one.
    Node(u16),
    /// A leaf with this value.
    Leaf(f32),
}

/// The test of a decision node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Split {
    /// LBP: code c goes left if bit c & 31 of word c >> 5 is set.
    Subset([u32; 8]),
    /// Haar: values below this go left.
    Threshold(f32),
}

impl Split {
    /// Whether LBP code `code` goes left; false for Haar.
    pub fn has(&self, code: u8) -> bool {
        match self {
            Self::Subset(words) => words[usize::from(code >> 5)] >> (code & 31) & 1 == 1,
            Self::Threshold(_) => false,
        }
    }
}

/// A decision node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Index of the feature.
    pub feature: u32,
    /// The test, of the same kind as the feature.
    pub split: Split,
    /// Successor if the test is true.
    pub left: Branch,
    /// Successor if the test is false.
    pub right: Branch,
}

/// A stage: trees whose leaf values are summed, and the threshold of the sum.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// The minimum sum, before OpenCV's tolerance of 1e-5 is subtracted.
    pub threshold: f32,
    /// The trees: lists of nodes, the root first.
    pub trees: Vec<Vec<Node>>,
}

impl Stage {
    /// The minimum sum: the threshold minus OpenCV's tolerance, in single precision.
    pub fn min_sum(&self) -> f64 {
        f64::from(self.threshold - 1e-5)
    }
}

/// A cascade of stages for windows of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Cascade {
    /// Width of the training window, in pixels.
    pub width: u16,
    /// Height of the training window, in pixels.
    pub height: u16,
    /// The features that nodes refer to.
    pub features: Features,
    /// The stages, in order of evaluation.
    pub stages: Vec<Stage>,
}

impl Cascade {
    /// Number of stages that the window at (`x`, `y`) passes; it is a hit if it passes all. `None` if the
    /// contrast of the window is too low for a Haar cascade. The window must lie within the image of
    /// `integral`.
    pub fn stages_passed(&self, integral: &Integral, x: usize, y: usize) -> Option<usize> {
        let inverse = match &self.features {
            Features::Lbp(_) => 1.0,
            Features::Haar(_) => {
                let contrast = integral.contrast(self.width, self.height, x, y);
                if !contrast.sound {
                    return None;
                }
                contrast.inverse
            }
        };
        let goes_left = |node: &Node| match (&self.features, node.split) {
            (Features::Haar(features), Split::Threshold(threshold)) => {
                features[node.feature as usize].value(integral, x, y, inverse) < threshold
            }
            (Features::Lbp(features), split) => {
                split.has(features[node.feature as usize].code(integral, x, y))
            }
            (Features::Haar(_), Split::Subset(_)) => false,
        };
        for (i, stage) in self.stages.iter().enumerate() {
            let mut sum = 0.0_f64;
            for tree in &stage.trees {
                let mut node = &tree[0];
                sum += loop {
                    match if goes_left(node) { node.left } else { node.right } {
                        Branch::Leaf(value) => break f64::from(value),
                        Branch::Node(next) => node = &tree[usize::from(next)],
                    }
                };
            }
            if sum < stage.min_sum() {
                return Some(i);
            }
        }
        Some(self.stages.len())
    }

    /// Number of trees of all stages.
    pub fn trees(&self) -> usize {
        self.stages.iter().map(|s| s.trees.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_compare_blocks_clockwise_from_the_upper_left() {
        // Blocks of 2×2; the upper left and the right middle one are brighter than the centre.
        let (width, height) = (8, 7);
        let mut pixels = vec![10_u8; width * height];
        let mut paint = |i: usize, j: usize, v: u8| {
            for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                pixels[(1 + 2 * j + dy) * width + 1 + 2 * i + dx] = v;
            }
        };
        paint(1, 1, 50);
        paint(0, 0, 60);
        paint(2, 1, 50);
        let integral = Integral::of(&pixels, width);
        let feature = LbpFeature { x: 1, y: 0, width: 2, height: 2 };
        assert_eq!(feature.code(&integral, 0, 1), 128 | 16);
        // A flat patch: equal blocks set every bit.
        let flat = Integral::of(&[7; 49], 7);
        assert_eq!(LbpFeature { x: 0, y: 0, width: 2, height: 2 }.code(&flat, 0, 0), 255);
    }

    #[test]
    fn trees_are_evaluated_and_summed() {
        let feature = LbpFeature { x: 0, y: 0, width: 1, height: 1 };
        let all = [u32::MAX; 8];
        let node = |subset, left, right| Node { feature: 0, split: Split::Subset(subset), left, right };
        let tree = vec![
            node(all, Branch::Node(1), Branch::Leaf(-9.0)),
            node([0; 8], Branch::Leaf(5.0), Branch::Leaf(0.25)),
        ];
        let stage = |threshold| Stage { threshold, trees: vec![tree.clone(), tree.clone()] };
        let mut cascade = Cascade {
            width: 3,
            height: 3,
            features: Features::Lbp(vec![feature]),
            stages: vec![stage(0.5), stage(0.6)],
        };
        let integral = Integral::of(&[1; 9], 3);
        assert_eq!(cascade.stages_passed(&integral, 0, 0), Some(1));
        cascade.stages.pop();
        assert_eq!(cascade.stages_passed(&integral, 0, 0), Some(1));
    }

    #[test]
    fn haar_values_are_weighted_sums_over_the_contrast() {
        // Left half 0, right half 200; the second rectangle covers the right half.
        let pixels: Vec<u8> = (0..64).map(|i| if i % 8 < 4 { 0 } else { 200 }).collect();
        let integral = Integral::of(&pixels, 8);
        let rect = |x, width, weight| WeightedRect { x, y: 0, width, height: 8, weight };
        let feature = HaarFeature {
            rects: [rect(0, 8, -1.0), rect(4, 4, 2.0), WeightedRect::default()],
            tilted: false,
        };
        let contrast = integral.contrast(8, 8, 0, 0);
        // Inner 36 pixels, half of them 200: a standard deviation of 100.
        assert!(contrast.sound);
        assert!((1.0 / contrast.inverse - 36.0 * 100.0).abs() < 0.01);
        let value = feature.value(&integral, 0, 0, contrast.inverse);
        assert!((value - (2.0 * 6400.0 - 6400.0) / 3600.0).abs() < 1e-5, "{value}");
        assert!(!Integral::of(&[9; 64], 8).contrast(8, 8, 0, 0).sound);
    }
}
