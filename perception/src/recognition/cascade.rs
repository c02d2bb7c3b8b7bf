//! A boosted cascade over multi-block local binary patterns: its model and its verdict on one
//! window.

/// A multi-block LBP feature: 3 × 3 equal blocks, the first one at (`x`, `y`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

/// Where a decision leads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Branch {
    /// To another decision of the tree, which lies behind this one.
    Node(u16),
    /// To a leaf with this value.
    Leaf(f32),
}

/// One decision: the feature's code is looked up in a set of 256 bits.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Index of the feature.
    pub feature: u16,
    /// Code c leads left when bit c & 31 of word c >> 5 is set.
    pub subset: [u32; 8],
    /// Taken when the bit is set.
    pub left: Branch,
    /// Taken when it is not.
    pub right: Branch,
}

/// Trees whose leaves are summed, and the sum that a window needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// The sum must reach this (less 1e-5).
    pub threshold: f32,
    /// Each a list of nodes, the root first.
    pub trees: Vec<Vec<Node>>,
}

/// A cascade of stages for windows of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Cascade {
    /// Width of the window that it was trained on, in pixels.
    pub width: u16,
    /// Height of that window.
    pub height: u16,
    /// The features that nodes name.
    pub features: Vec<LbpFeature>,
    /// Cheapest first.
    pub stages: Vec<Stage>,
}

/// Sums of all pixels above and left, for images that change in size.
#[derive(Clone, Debug)]
pub struct Integral {
    sums: Vec<u32>,
    stride: usize,
}

impl Integral {
    /// Memory for images of up to `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { sums: vec![0; (width + 1) * (height + 1)], stride: 0 }
    }

    /// Sums up `pixels`, rows of `width`.
    pub fn fill(&mut self, pixels: &[u8], width: usize) {
        self.stride = width + 1;
        self.sums[..self.stride].fill(0);
        for (y, row) in pixels.chunks_exact(width).enumerate() {
            let (above, here) = self.sums.split_at_mut((y + 1) * self.stride);
            let above = &above[y * self.stride..];
            let mut sum = 0_u32;
            here[0] = 0;
            for ((target, &before), &v) in here[1..].iter_mut().zip(&above[1..]).zip(row) {
                sum = sum.wrapping_add(u32::from(v));
                // Wraps in huge images; differences of sums stay right.
                *target = before.wrapping_add(sum);
            }
        }
    }

    /// The LBP code of a feature in the window at (`x`, `y`): one bit per outer block whose sum is
    /// not below the centre's, clockwise from the upper left, highest bit first.
    #[inline]
    fn code(&self, feature: &LbpFeature, x: usize, y: usize) -> u8 {
        let (w, h) = (usize::from(feature.width), usize::from(feature.height));
        let mut corners = [[0_u32; 4]; 4];
        let start = (y + usize::from(feature.y)) * self.stride + x + usize::from(feature.x);
        for (j, row) in corners.iter_mut().enumerate() {
            for (i, corner) in row.iter_mut().enumerate() {
                *corner = self.sums[start + j * h * self.stride + i * w];
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

impl Cascade {
    /// Number of stages that the window at (`x`, `y`) passes; it is a hit when it passes all.
    /// The window must lie within the image that `integral` was filled with.
    pub fn stages_passed(&self, integral: &Integral, x: usize, y: usize) -> usize {
        for (i, stage) in self.stages.iter().enumerate() {
            let mut sum = 0.0_f64;
            for tree in &stage.trees {
                let mut node = &tree[0];
                sum += loop {
                    let code = integral.code(&self.features[usize::from(node.feature)], x, y);
                    let bit = node.subset[usize::from(code >> 5)] >> (code & 31) & 1;
                    match if bit == 1 { node.left } else { node.right } {
                        Branch::Leaf(value) => break f64::from(value),
                        Branch::Node(next) => node = &tree[usize::from(next)],
                    }
                };
            }
            if sum < f64::from(stage.threshold - 1e-5) {
                return i;
            }
        }
        self.stages.len()
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
        let mut integral = Integral::new(width, height);
        integral.fill(&pixels, width);
        let feature = LbpFeature { x: 1, y: 0, width: 2, height: 2 };
        assert_eq!(integral.code(&feature, 0, 1), 128 | 16);
        // A flat patch: equal blocks set every bit.
        integral.fill(&[7; 49], 7);
        assert_eq!(integral.code(&LbpFeature { x: 0, y: 0, width: 2, height: 2 }, 0, 0), 255);
    }

    #[test]
    fn trees_are_walked_and_summed() {
        let feature = LbpFeature { x: 0, y: 0, width: 1, height: 1 };
        let all = [u32::MAX; 8];
        let node = |subset, left, right| Node { feature: 0, subset, left, right };
        let tree = vec![
            node(all, Branch::Node(1), Branch::Leaf(-9.0)),
            node([0; 8], Branch::Leaf(5.0), Branch::Leaf(0.25)),
        ];
        let stage = |threshold| Stage { threshold, trees: vec![tree.clone(), tree.clone()] };
        let mut cascade =
            Cascade { width: 3, height: 3, features: vec![feature], stages: vec![stage(0.5), stage(0.6)] };
        let mut integral = Integral::new(3, 3);
        integral.fill(&[1; 9], 3);
        assert_eq!(cascade.stages_passed(&integral, 0, 0), 1);
        cascade.stages.pop();
        assert_eq!(cascade.stages_passed(&integral, 0, 0), 1);
    }
}
