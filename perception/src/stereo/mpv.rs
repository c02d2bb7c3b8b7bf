//! Full-range Multi-Path-Viterbi (paper, section 3.2): four hierarchical layers of bidirectional
//! paths over all disparities.
//!
//! Each layer runs two opposite Viterbi paths over the image with the energies of the layer before
//! as its data term (the first with the matching cost), then merges the two: the horizontal layer
//! by their minimum, which keeps edges sharp, the vertical and the two diagonal ones by their mean,
//! which removes noise. The last layer's energies pick the winner.
//!
//! All four layers share [`viterbi::step`]: a vertical or diagonal path advances
//! [`LANES`] neighbouring pixels of a row at once, a horizontal one the same column
//! of [`LANES`] rows, which are transposed for it.

use super::speckle::{SpeckleFilter, SpeckleParameters};
use super::ssim::{CostParameters, MAX_COST, SsimCost};
use super::viterbi::{self, EdgeWeight};
use super::volume::{LANES, Lanes, Volume, transpose};
use super::winner::{Winner, WinnerParameters};
use super::{MatchError, MatchOutput, Matcher, MatcherError};
use crate::image::GreyView;

/// The least width and height of a pair.
pub const LEAST_SIZE: usize = 8;

/// The most nodes of an image, two bytes of workspace each: 4096 × 2048 pixels with 128
/// disparities.
pub const MOST_NODES: usize = 1 << 30;

/// Layers whose truncation adds up in the energies.
const LAYERS: u8 = 4;

/// What shapes the energy and the choice of the winner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MpvParameters {
    /// The matching cost.
    pub cost: CostParameters,
    /// λ of horizontal paths, in units of the cost (0 to 100).
    pub lambda_horizontal: f32,
    /// λ of vertical and diagonal paths.
    pub lambda_other: f32,
    /// A jump never costs more than this. At most 38, so that four layers fit a byte.
    pub truncation: u8,
    /// Grey levels after which an edge lowers λ to 1/e.
    pub gradient_scale: f32,
    /// Share of λ that the strongest edge leaves.
    pub gradient_floor: f32,
    /// How the winner is chosen and checked.
    pub winner: WinnerParameters,
    /// Which small islands are removed.
    pub speckle: SpeckleParameters,
}

impl Default for MpvParameters {
    fn default() -> Self {
        Self {
            cost: CostParameters::default(),
            lambda_horizontal: 5.0,
            lambda_other: 8.0,
            truncation: 38,
            gradient_scale: 80.0,
            gradient_floor: 0.5,
            winner: WinnerParameters::default(),
            speckle: SpeckleParameters::default(),
        }
    }
}

/// The full-range matcher with its workspace.
#[derive(Debug)]
pub struct FullMpv {
    parameters: MpvParameters,
    width: usize,
    height: usize,
    disparities: usize,
    horizontal: EdgeWeight,
    other: EdgeWeight,
    cost: SsimCost,
    /// Energies of the current layer.
    energy: Volume,
    /// Energies of the first of two opposite paths.
    first: Volume,
    /// Costs of [`LANES`] rows, transposed: `[column][disparity]`, a row per lane.
    strip: Vec<Lanes>,
    /// Energies of the rightward paths over the strip.
    strip_first: Vec<Lanes>,
    /// Two rows of path states that take turns.
    states: [Vec<Lanes>; 2],
    /// The state of the row before, moved one pixel sideways.
    shifted: Vec<Lanes>,
    /// Zero: where a path starts.
    fresh: Vec<Lanes>,
    /// One row of energies or costs.
    row: Vec<Lanes>,
    weights: Vec<Lanes>,
    winner: Winner,
    speckle: SpeckleFilter,
}

impl FullMpv {
    /// Checks whether a matcher can be made, without allocating its workspace.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn check(width: usize, height: usize, disparities: usize) -> Result<(), MatcherError> {
        if width < LEAST_SIZE || height < LEAST_SIZE {
            return Err(MatcherError::TooSmall { width, height, least: LEAST_SIZE });
        }
        if !(2..=255).contains(&disparities) {
            return Err(MatcherError::Disparities(disparities));
        }
        let padded = width.checked_next_multiple_of(LANES);
        let nodes = padded.and_then(|w| w.checked_mul(height)).and_then(|p| p.checked_mul(disparities));
        match nodes {
            Some(nodes) if nodes <= MOST_NODES => Ok(()),
            _ => Err(MatcherError::TooLarge { width, height, disparities }),
        }
    }

    /// A matcher for pairs of `width` × `height` pixels and disparities 0 to `disparities` − 1.
    ///
    /// # Errors
    /// When the image is smaller than [`LEAST_SIZE`], `disparities` is not 2 to 255, or there are
    /// more than [`MOST_NODES`] nodes.
    pub fn new(
        parameters: MpvParameters,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Result<Self, MatcherError> {
        Self::check(width, height, disparities)?;
        let parameters = MpvParameters {
            truncation: parameters.truncation.min((u8::MAX - MAX_COST) / LAYERS),
            ..parameters
        };
        let weight = |lambda| EdgeWeight::new(lambda, parameters.gradient_scale, parameters.gradient_floor);
        let energy = Volume::new(width, height, disparities);
        let tiles = energy.tiles();
        let row = vec![Lanes::ZERO; tiles * disparities];
        let strip = vec![Lanes::ZERO; tiles * LANES * disparities];
        Ok(Self {
            horizontal: weight(parameters.lambda_horizontal),
            other: weight(parameters.lambda_other),
            cost: SsimCost::new(parameters.cost, width, height, disparities),
            first: energy.clone(),
            energy,
            strip_first: strip.clone(),
            strip,
            states: [row.clone(), row.clone()],
            shifted: row.clone(),
            fresh: vec![Lanes::ZERO; disparities],
            row,
            weights: vec![Lanes::ZERO; tiles * LANES],
            winner: Winner::new(parameters.winner, width, disparities),
            speckle: SpeckleFilter::new(parameters.speckle, width, height),
            parameters,
            width,
            height,
            disparities,
        })
    }

    /// All layers; the energies of the last one are in `row` when `last` is called for each row.
    fn four_layers(&mut self, left: GreyView<'_>, right: GreyView<'_>, last: impl FnMut(&mut Self, usize)) {
        self.cost.start(left, right);
        self.horizontal_layer(left);
        // Vertical, then the diagonal from the upper left, then the one from the upper right.
        for sideways in [0, -1] {
            self.down(left, sideways);
            self.up(left, sideways, |this, y| this.energy.row_mut(y).copy_from_slice(&this.row));
        }
        self.down(left, 1);
        self.up(left, 1, last);
    }

    /// Layer 1: costs, rightward and leftward paths, their minimum to `energy`.
    fn horizontal_layer(&mut self, left: GreyView<'_>) {
        let disparities = self.disparities;
        let tiles = self.energy.tiles();
        for top in (0..self.height).step_by(LANES) {
            let rows = LANES.min(self.height - top);
            // Costs of the strip, one lane per row.
            for i in 0..rows {
                self.cost.next_row(self.energy.row_mut(top + i));
            }
            self.turn_strip(top, rows, true);

            // Edge weights between column x − 1 and x.
            for x in 1..self.width {
                for i in 0..rows {
                    let row = left.row(top + i);
                    self.weights[x].0[i] = self.horizontal.between(row[x - 1], row[x]);
                }
            }

            let truncation = self.parameters.truncation;
            let node = |x: usize| x * disparities..(x + 1) * disparities;
            self.strip_first[node(0)].copy_from_slice(&self.strip[node(0)]);
            for x in 1..self.width {
                let (done, rest) = self.strip_first.split_at_mut(x * disparities);
                viterbi::step(
                    &done[node(x - 1)],
                    &self.strip[node(x)],
                    self.weights[x],
                    truncation,
                    &mut rest[..disparities],
                );
            }
            let [mut state, mut next] = [0, 1];
            self.states[state][..disparities].copy_from_slice(&self.strip[node(self.width - 1)]);
            for x in (0..self.width).rev() {
                if x + 1 < self.width {
                    let (a, b) = self.states.split_at_mut(1);
                    let (from, to) = if state == 0 { (&a[0], &mut b[0]) } else { (&b[0], &mut a[0]) };
                    viterbi::step(
                        &from[..disparities],
                        &self.strip[node(x)],
                        self.weights[x + 1],
                        truncation,
                        &mut to[..disparities],
                    );
                    (state, next) = (next, state);
                }
                let leftward = &self.states[state][..disparities];
                let rightward = &self.strip_first[node(x)];
                for ((merged, a), b) in self.strip[node(x)].iter_mut().zip(rightward).zip(leftward) {
                    *merged = a.min(*b);
                }
            }
            debug_assert_eq!(self.strip.len(), tiles * LANES * disparities);
            self.turn_strip(top, rows, false);
        }
    }

    /// Copies `rows` rows of `energy` from `top` on to `strip`, transposed, or back.
    fn turn_strip(&mut self, top: usize, rows: usize, to_strip: bool) {
        let disparities = self.disparities;
        let mut block = [Lanes::ZERO; LANES];
        let mut turned = [Lanes::ZERO; LANES];
        for tile in 0..self.energy.tiles() {
            for d in 0..disparities {
                let in_strip = |lane: usize| (tile * LANES + lane) * disparities + d;
                let in_row = tile * disparities + d;
                if to_strip {
                    for (i, lanes) in block.iter_mut().enumerate().take(rows) {
                        *lanes = self.energy.row(top + i)[in_row];
                    }
                    transpose(&block, &mut turned);
                    for (lane, lanes) in turned.iter().enumerate() {
                        self.strip[in_strip(lane)] = *lanes;
                    }
                } else {
                    for (lane, lanes) in block.iter_mut().enumerate() {
                        *lanes = self.strip[in_strip(lane)];
                    }
                    transpose(&block, &mut turned);
                    for (i, lanes) in turned.iter().enumerate().take(rows) {
                        self.energy.row_mut(top + i)[in_row] = *lanes;
                    }
                }
            }
        }
    }

    /// Advances all paths of a layer by one row: from the state of row `from` (None: a fresh
    /// start), moved `sideways` pixels, to row `y`. The new state is `self.states[to]`.
    fn advance_row(&mut self, left: GreyView<'_>, from: Option<usize>, y: usize, sideways: isize, to: usize) {
        let disparities = self.disparities;
        let data = self.energy.row(y);
        let (a, b) = self.states.split_at_mut(1);
        let (old, new) = if to == 1 { (&a[0], &mut b[0]) } else { (&b[0], &mut a[0]) };
        let beyond = self.width % LANES;
        let clear_beyond = |state: &mut [Lanes]| {
            // Lanes beyond the image must not feed a leftward path.
            if beyond > 0 {
                let last_tile = state.len() - disparities;
                state[last_tile..].iter_mut().for_each(|lanes| lanes.0[beyond..].fill(0));
            }
        };
        let Some(from) = from else {
            new.copy_from_slice(data);
            clear_beyond(new);
            return;
        };
        let (here, before) = (left.row(y), left.row(from));
        let last = (self.width - 1) as isize;
        for tile in 0..self.energy.tiles() {
            let mut weight = Lanes::splat(1);
            for lane in 0..LANES.min(self.width - tile * LANES) {
                let x = tile * LANES + lane;
                // A path that comes from outside starts afresh: its state is zero, any weight does.
                let neighbour = (x as isize + sideways).clamp(0, last) as usize;
                weight.0[lane] = self.other.between(here[x], before[neighbour]);
            }
            let nodes = tile * disparities..(tile + 1) * disparities;
            let previous = if sideways == 0 {
                &old[nodes.clone()]
            } else {
                let neighbour = match sideways {
                    -1 if tile > 0 => &old[(tile - 1) * disparities..][..disparities],
                    1 if tile + 1 < self.energy.tiles() => &old[(tile + 1) * disparities..][..disparities],
                    _ => &self.fresh[..],
                };
                let target = &mut self.shifted[nodes.clone()];
                for ((t, o), n) in target.iter_mut().zip(&old[nodes.clone()]).zip(neighbour) {
                    if sideways < 0 {
                        t.0[1..].copy_from_slice(&o.0[..LANES - 1]);
                        t.0[0] = n.0[LANES - 1];
                    } else {
                        t.0[..LANES - 1].copy_from_slice(&o.0[1..]);
                        t.0[LANES - 1] = n.0[0];
                    }
                }
                &target[..]
            };
            viterbi::step(
                previous,
                &data[nodes.clone()],
                weight,
                self.parameters.truncation,
                &mut new[nodes],
            );
        }
        clear_beyond(new);
    }

    /// The first of two opposite paths: downwards, from `sideways` pixels aside, to `first`.
    fn down(&mut self, left: GreyView<'_>, sideways: isize) {
        for y in 0..self.height {
            self.advance_row(left, y.checked_sub(1), y, sideways, y % 2);
            self.first.row_mut(y).copy_from_slice(&self.states[y % 2]);
        }
    }

    /// The second: upwards, from the other side; the mean of both goes to `merged` row by row.
    fn up(&mut self, left: GreyView<'_>, sideways: isize, mut merged: impl FnMut(&mut Self, usize)) {
        for y in (0..self.height).rev() {
            let from = (y + 1 < self.height).then_some(y + 1);
            self.advance_row(left, from, y, -sideways, y % 2);
            let pairs = self.first.row(y).iter().zip(&self.states[y % 2]);
            for (target, (a, b)) in self.row.iter_mut().zip(pairs) {
                *target = a.mean(*b);
            }
            merged(self, y);
        }
    }
}

impl Matcher for FullMpv {
    fn compute(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
    ) -> Result<(), MatchError> {
        for (which, image) in [("left", &left), ("right", &right)] {
            if (image.width(), image.height()) != (self.width, self.height) {
                return Err(MatchError::Size {
                    which,
                    width: image.width(),
                    height: image.height(),
                    expected_width: self.width,
                    expected_height: self.height,
                });
            }
        }
        let needed = self.width * self.height;
        for given in [output.disparity.len(), output.confidence.len()] {
            if given != needed {
                return Err(MatchError::Output { given, needed });
            }
        }

        let MatchOutput { disparity, confidence } = output;
        let width = self.width;
        self.four_layers(left, right, |this, y| {
            let at = y * width..(y + 1) * width;
            this.winner.row(&this.row, &mut disparity[at.clone()], &mut confidence[at]);
        });
        self.speckle.apply(disparity);
        for (confidence, &disparity) in confidence.iter_mut().zip(disparity.iter()) {
            if disparity == 0 {
                *confidence = 0;
            }
        }
        Ok(())
    }

    fn workspace_bytes(&self) -> usize {
        let lanes = self.strip.len()
            + self.strip_first.len()
            + self.states[0].len()
            + self.states[1].len()
            + self.shifted.len()
            + self.fresh.len()
            + self.row.len()
            + self.weights.len();
        self.energy.bytes()
            + self.first.bytes()
            + lanes * LANES
            + self.cost.bytes()
            + self.winner.bytes()
            + self.speckle.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GreyImage;

    fn noise(width: usize, height: usize, seed: u64) -> GreyImage {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut image = GreyImage::new(width, height);
        image.as_mut_slice().iter_mut().for_each(|v| *v = random.u8(..));
        image
    }

    /// The four layers by their definition, pixel by pixel, with the O(m²) step.
    fn brute_force(left: &GreyImage, costs: Vec<Vec<u8>>, p: MpvParameters) -> Vec<Vec<u8>> {
        let (width, height) = (left.width() as isize, left.height() as isize);
        let mut energy = costs;
        for (layer, (dx, dy)) in [(1, 0), (0, 1), (1, 1), (-1, 1)].into_iter().enumerate() {
            let lambda = if layer == 0 { p.lambda_horizontal } else { p.lambda_other };
            let weight = EdgeWeight::new(lambda, p.gradient_scale, p.gradient_floor);
            let path = |dx: isize, dy: isize| {
                let mut out = energy.clone();
                let mut order: Vec<(isize, isize)> =
                    (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).collect();
                if dy < 0 || (dy == 0 && dx < 0) {
                    order.reverse();
                }
                for (x, y) in order {
                    let (px, py) = (x - dx, y - dy);
                    if px < 0 || px >= width || py < 0 || py >= height {
                        continue;
                    }
                    let (i, j) = ((y * width + x) as usize, (py * width + px) as usize);
                    let w = weight.between(left.as_slice()[i], left.as_slice()[j]);
                    out[i] = viterbi::step_brute_force(&out[j], &energy[i], w, p.truncation);
                }
                out
            };
            let (a, b) = (path(dx, dy), path(-dx, -dy));
            for (target, (a, b)) in energy.iter_mut().zip(a.iter().zip(&b)) {
                for (t, (&a, &b)) in target.iter_mut().zip(a.iter().zip(b)) {
                    let mean = (u16::from(a) + u16::from(b)).div_ceil(2);
                    *t = if layer == 0 { a.min(b) } else { mean as u8 };
                }
            }
        }
        energy
    }

    #[test]
    fn four_layers_equal_brute_force() {
        for (width, height, disparities, seed) in
            [(45, 37, 9, 1), (64, 33, 5, 2), (8, 8, 12, 3), (31, 70, 3, 4)]
        {
            let (left, right) = (noise(width, height, seed), noise(width, height, seed + 100));
            let parameters = MpvParameters::default();
            let mut cost = SsimCost::new(parameters.cost, width, height, disparities);
            cost.start(left.view(), right.view());
            let mut row = vec![Lanes::ZERO; width.div_ceil(LANES) * disparities];
            let mut costs = Vec::new();
            for _ in 0..height {
                cost.next_row(&mut row);
                for x in 0..width {
                    let nodes = &row[x / LANES * disparities..][..disparities];
                    costs.push(nodes.iter().map(|n| n.0[x % LANES]).collect());
                }
            }
            let expected = brute_force(&left, costs, parameters);
            let mut matcher = FullMpv::new(parameters, width, height, disparities).unwrap();
            matcher.four_layers(left.view(), right.view(), |this, y| {
                for x in 0..width {
                    let nodes = &this.row[x / LANES * disparities..][..disparities];
                    let got: Vec<u8> = nodes.iter().map(|n| n.0[x % LANES]).collect();
                    assert_eq!(got, expected[y * width + x], "({x}, {y}) of {width}x{height}, seed {seed}");
                }
            });
        }
    }

    #[test]
    fn a_shifted_picture_gives_its_shift_twice_the_same() {
        let (width, height, shift) = (96, 40, 11);
        let left = noise(width, height, 5);
        let mut right = noise(width, height, 6);
        for y in 0..height {
            for x in 0..width - shift {
                right.as_mut_slice()[y * width + x] = left.view().at(x + shift, y);
            }
        }
        let mut matcher = FullMpv::new(MpvParameters::default(), width, height, 32).unwrap();
        let mut run = || {
            let (mut disparity, mut confidence) = (vec![9; width * height], vec![9; width * height]);
            let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
            matcher.compute(left.view(), right.view(), output).unwrap();
            (disparity, confidence)
        };
        let (disparity, confidence) = run();
        for y in 0..height {
            for x in shift + 3..width - 3 {
                let got = f32::from(disparity[y * width + x]) / 256.0;
                assert!((got - shift as f32).abs() < 0.5, "({x}, {y}): {got}");
                assert!(confidence[y * width + x] > 0);
            }
            assert_eq!(disparity[y * width], 0, "column 0 has no partner");
        }
        // The workspace carries nothing over to the next pair.
        assert_eq!(run(), (disparity, confidence));
    }

    #[test]
    fn wrong_sizes_are_refused() {
        let p = MpvParameters::default();
        assert!(matches!(FullMpv::new(p, 1, 1, 16), Err(MatcherError::TooSmall { .. })));
        assert_eq!(FullMpv::new(p, 64, 64, 256).unwrap_err(), MatcherError::Disparities(256));
        assert!(matches!(FullMpv::new(p, 16_384, 16_384, 128), Err(MatcherError::TooLarge { .. })));
        assert!(matches!(FullMpv::new(p, usize::MAX, 8, 2), Err(MatcherError::TooLarge { .. })));
        let mut matcher = FullMpv::new(p, 16, 16, 8).unwrap();
        assert!(matcher.workspace_bytes() > 16 * 16 * 8);
        let (small, right) = (noise(15, 16, 1), noise(16, 16, 1));
        let (mut disparity, mut confidence) = (vec![0; 256], vec![0; 256]);
        let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
        let error = matcher.compute(small.view(), right.view(), output).unwrap_err();
        assert!(error.to_string().contains("left image is 15x16"), "{error}");
        let output = MatchOutput { disparity: &mut disparity[1..], confidence: &mut confidence };
        assert!(matches!(
            matcher.compute(right.view(), right.view(), output),
            Err(MatchError::Output { given: 255, needed: 256 })
        ));
    }
}
