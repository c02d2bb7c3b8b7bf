//! The Multi-Path-Viterbi of one scale: from a pair to the energies of all nodes of its windows
//! (paper, section 3.2).
//!
//! Layer 1 is horizontal. Strips of 32 rows are turned so that one vector holds the same column of
//! all rows; rightward and leftward paths meet in their minimum H, which keeps edges sharp. Layer 2
//! takes H as its data term and runs the vertical and both diagonal paths together, downwards and
//! then upwards, 32 columns to a vector. The final energy is H plus what the six paths' jumps cost:
//! H counts once, not once per path, so that a path that agrees with H adds nothing.
//! That is one horizontal and two vertical sweeps over two volumes of one byte a node.

use super::blocks::{Block, Blocks};
use super::cost::{CostParameters, CostStrip, STRIP};
use super::viterbi::{NEAR, PAD, Paths, Span, single_step, triple_step};
use crate::image::GreyView;
use crate::simd::{LANES, Lanes, Level, Simd, kernel};

/// What shapes the paths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathParameters {
    /// λ of horizontal paths, in units of the cost (0 to about 100).
    pub lambda_horizontal: u8,
    /// λ of vertical paths.
    pub lambda_vertical: u8,
    /// λ of diagonal paths.
    pub lambda_diagonal: u8,
    /// A jump of a horizontal path never costs more than this.
    pub truncation_horizontal: u8,
    /// A jump of another path never costs more than this; at most 75.
    pub truncation_other: u8,
    /// From this many grey levels on, a step on a path is an edge.
    pub edge_levels: u8,
    /// λ at an edge, in percent.
    pub edge_percent: u8,
}

impl Default for PathParameters {
    fn default() -> Self {
        Self {
            lambda_horizontal: 6,
            lambda_vertical: 8,
            lambda_diagonal: 20,
            truncation_horizontal: 12,
            truncation_other: 60,
            edge_levels: 20,
            edge_percent: 85,
        }
    }
}

/// The weight of a step by how much the grey value changes: λ·e^(−|G|) of the paper in two steps.
#[derive(Clone, Copy, Debug)]
pub struct EdgeWeight {
    smooth: u8,
    edge: u8,
    levels: u8,
}

impl EdgeWeight {
    fn new(lambda: u8, parameters: &PathParameters) -> Self {
        let edge = (u32::from(lambda) * u32::from(parameters.edge_percent.min(100)) + 50) / 100;
        Self { smooth: lambda.max(1), edge: (edge as u8).max(1), levels: parameters.edge_levels }
    }
}

#[inline(always)]
fn edge_row<S: Simd>(_: S, here: &[u8], there: &[u8], weight: EdgeWeight, out: &mut [Lanes]) {
    for ((out, here), there) in out.iter_mut().zip(here.chunks_exact(LANES)).zip(there.chunks_exact(LANES)) {
        for i in 0..LANES {
            let smooth = here[i].abs_diff(there[i]) < weight.levels;
            out.0[i] = if smooth { weight.smooth } else { weight.edge };
        }
    }
}

#[inline(always)]
fn turn_blocks<S: Simd>(s: S, block: &mut [Lanes], disparities: usize, pitch: usize) {
    for d in 0..disparities {
        s.transpose(&mut block[d..], pitch);
    }
}

/// The two volumes of an image, one byte a node each; shared by the scales of a pyramid.
#[derive(Debug, Default)]
pub struct Volumes {
    /// H, the energies of the horizontal layer.
    merged: Vec<Lanes>,
    /// The costs, then the jumps of the downward paths, then the final energies.
    energies: Vec<Lanes>,
}

impl Volumes {
    /// Room for `vectors` vectors of nodes.
    pub fn new(vectors: usize) -> Self {
        Self { merged: vec![Lanes::ZERO; vectors], energies: vec![Lanes::ZERO; vectors] }
    }

    /// Vectors of nodes that there is room for.
    pub fn vectors(&self) -> usize {
        self.merged.len()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        (self.merged.len() + self.energies.len()) * LANES
    }
}

/// Change of a slope's whole disparities from position `from` to `to`.
fn slope_step(slope: i32, from: usize, to: usize) -> i8 {
    let at = |position: usize| (slope * position as i32 + 128) >> 8;
    (at(to) - at(from)).clamp(-1, 1) as i8
}

/// Marks the nodes of an old window that the new one leaves as not there: `none`.
fn leave(state: &mut [Lanes], old: (usize, usize), new: (usize, usize), none: Lanes) {
    state[PAD + old.0..PAD + old.1.min(new.0).max(old.0)].fill(none);
    state[PAD + old.0.max(new.1).min(old.1)..PAD + old.1].fill(none);
}

/// The solver of one scale with its workspace, the volumes apart.
#[derive(Debug)]
pub struct Scale {
    parameters: PathParameters,
    horizontal: EdgeWeight,
    /// Of straight, rightward and leftward paths.
    others: [EdgeWeight; 3],
    level: Level,
    width: usize,
    height: usize,
    /// Which disparities are searched where.
    pub blocks: Blocks,
    cost: CostStrip,
    /// The left image with a vector of border on both sides.
    guide: Vec<u8>,
    /// Energies of the row before for each direction and tile, padded.
    states: [Vec<Lanes>; 3],
    /// The rightward diagonal's energies of a tile and the one before, before they are replaced.
    carry: [Vec<Lanes>; 2],
    /// Energies of the column before and of this one, padded.
    columns: [Vec<Lanes>; 2],
    /// Zero: where a path starts.
    fresh: Vec<Lanes>,
    /// No node, but where a lane lies beyond the image: there a leftward path starts.
    edge: Lanes,
    forward: Vec<Lanes>,
    spans: Vec<Span>,
    weights: [Vec<Lanes>; 3],
    column_weights: Vec<Lanes>,
}

impl Scale {
    /// A solver for `width` × `height` pixels and all disparities below `disparities`.
    pub fn new(
        cost: CostParameters,
        parameters: PathParameters,
        level: Level,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Self {
        // Three jumps of a sweep add up in one byte.
        let parameters = PathParameters {
            truncation_horizontal: parameters.truncation_horizontal.min(75),
            truncation_other: parameters.truncation_other.min(75),
            ..parameters
        };
        let blocks = Blocks::new(width, height, disparities);
        let tiles = blocks.tiles();
        let padded = disparities + 2 * PAD;
        Self {
            horizontal: EdgeWeight::new(parameters.lambda_horizontal, &parameters),
            others: [parameters.lambda_vertical, parameters.lambda_diagonal, parameters.lambda_diagonal]
                .map(|lambda| EdgeWeight::new(lambda, &parameters)),
            level,
            width,
            height,
            cost: CostStrip::new(cost, level, width, disparities),
            guide: vec![0; (tiles + 2) * LANES * height],
            states: std::array::from_fn(|_| vec![Lanes::FULL; tiles * padded]),
            carry: std::array::from_fn(|_| vec![Lanes::FULL; padded]),
            columns: std::array::from_fn(|_| vec![Lanes::FULL; padded]),
            fresh: vec![Lanes::ZERO; padded],
            edge: Lanes(std::array::from_fn(
                |lane| {
                    if (tiles - 1) * LANES + lane < width { u8::MAX } else { 0 }
                },
            )),
            forward: vec![Lanes::ZERO; 3 * disparities],
            spans: vec![Span { from: 0, to: 0, low: 0, high: 0 }; tiles],
            weights: std::array::from_fn(|_| vec![Lanes::ZERO; tiles]),
            column_weights: vec![Lanes::ZERO; tiles * LANES],
            blocks,
            parameters,
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Bytes that the workspace holds, the volumes apart.
    pub fn bytes(&self) -> usize {
        let vectors = self.states.iter().chain(&self.carry).chain(&self.weights).map(Vec::len).sum::<usize>()
            + 2 * self.columns[0].len()
            + self.fresh.len()
            + self.forward.len()
            + self.column_weights.len();
        vectors * LANES
            + self.cost.bytes()
            + self.guide.len()
            + self.spans.len() * size_of::<Span>()
            + self.blocks.bytes()
    }

    /// Computes the final energies; `row` gets them row by row, from the last to the first: the row,
    /// the blocks it lies in, which of their rows it is, and all energies (of block b its row r
    /// starts at `b.at + r·b.pitch()`). `go_on` is asked now and then; once it says no, the scale is
    /// given up and false returned.
    ///
    /// # Panics
    /// When the images have another size than the workspace, or the volumes are smaller than
    /// [`Blocks::vectors`].
    pub fn solve(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        volumes: &mut Volumes,
        go_on: &mut dyn FnMut() -> bool,
        mut row: impl FnMut(usize, &[Block], usize, &[Lanes]),
    ) -> bool {
        for image in [&left, &right] {
            assert_eq!((image.width(), image.height()), (self.width, self.height));
        }
        assert!(volumes.vectors() >= self.blocks.vectors());
        self.take_guide(left);
        self.start_paths();
        for strip in 0..self.blocks.strips() {
            if !go_on() {
                return false;
            }
            self.cost.start(left, right, strip * STRIP);
            horizontal_layer_at(self.level, self, strip, volumes);
            for y in strip * STRIP..((strip + 1) * STRIP).min(self.height) {
                advance_row_at(self.level, self, y.checked_sub(1), y, false, volumes);
            }
        }
        self.start_paths();
        for y in (0..self.height).rev() {
            if y % STRIP == 0 && !go_on() {
                return false;
            }
            let from = (y + 1 < self.height).then_some(y + 1);
            advance_row_at(self.level, self, from, y, true, volumes);
            row(y, self.blocks.strip(y / STRIP), y % STRIP, &volumes.energies);
        }
        true
    }

    /// Copies the left image, its border repeated sideways.
    fn take_guide(&mut self, left: GreyView<'_>) {
        let stride = self.guide.len() / self.height;
        for (y, row) in self.guide.chunks_exact_mut(stride).enumerate() {
            let source = left.row(y);
            row[..LANES].fill(source[0]);
            row[LANES..LANES + source.len()].copy_from_slice(source);
            row[LANES + source.len()..].fill(source[source.len() - 1]);
        }
    }

    /// A row of the guide, moved `sideways` pixels.
    fn guide_row(&self, y: usize, sideways: isize) -> &[u8] {
        let stride = self.guide.len() / self.height;
        let start = (y * stride + LANES).wrapping_add_signed(sideways);
        &self.guide[start..start + self.blocks.tiles() * LANES]
    }

    /// Makes every path of layer 2 start afresh.
    fn start_paths(&mut self) {
        let padded = self.fresh.len();
        for state in &mut self.states {
            for tile in state.chunks_exact_mut(padded) {
                tile[..PAD].fill(Lanes::FULL);
                tile[PAD..padded - PAD].fill(Lanes::ZERO);
                tile[padded - PAD..].fill(Lanes::FULL);
            }
        }
        let last = self.states[2].len() - padded;
        let last = &mut self.states[2][last..];
        last[..PAD].fill(self.edge);
        last[padded - PAD..].fill(self.edge);
    }
}

/// Layer 1 of a strip: costs, rightward and leftward paths, their minimum to `merged`.
#[inline(always)]
fn horizontal_layer<S: Simd>(s: S, scale: &mut Scale, strip: usize, volumes: &mut Volumes) {
    let tiles = scale.blocks.tiles();
    let top = strip * STRIP;
    // Edge weights between column x − 1 and x, for all rows.
    for row in 0..STRIP {
        let y = (top + row).min(scale.height - 1);
        let mut weights = std::mem::take(&mut scale.weights[0]);
        let (here, there) = (scale.guide_row(y, 0), scale.guide_row(y, -1));
        edge_row(s, here, there, scale.horizontal, &mut weights);
        for (tile, weights) in weights.iter().enumerate() {
            scale.column_weights[tile * LANES + row] = *weights;
        }
        scale.weights[0] = weights;
    }
    for block in scale.column_weights.chunks_exact_mut(LANES) {
        turn_blocks(s, block, 1, 1);
    }

    let disparities = scale.blocks.disparities();
    let truncation = scale.parameters.truncation_horizontal;
    let [mut old, mut new] = scale.columns.each_mut().map(|column| &mut column[..]);
    // Rightwards.
    let mut before = (0, disparities);
    let mut least = Lanes::ZERO;
    old[PAD..PAD + disparities].fill(Lanes::ZERO);
    for tile in 0..tiles {
        let block = scale.blocks.strip(strip)[tile];
        let (n, pitch) = (block.span(), block.pitch());
        let nodes = block.at..block.at + block.vectors();
        let costs = &mut volumes.energies[nodes.clone()];
        scale.cost.tile(tile * LANES, block.low, n, pitch, costs);
        turn_blocks(s, costs, n, pitch);
        let merged = &mut volumes.merged[nodes];
        for i in 0..LANES {
            let x = tile * LANES + i;
            let slope = if x == 0 { 0 } else { slope_step(block.slope_x, x - 1, x) };
            if n > NEAR && i + 1 < LANES {
                s.expect(&merged[(i + 1) * pitch..(i + 1) * pitch + n]);
            }
            least = single_step(
                s,
                old,
                least,
                new,
                &costs[i * pitch..i * pitch + n],
                &mut merged[i * pitch..i * pitch + n],
                &scale.column_weights[x],
                truncation,
                slope,
                Span::new(block.window(), before, usize::from(slope != 0)),
                false,
                &mut scale.forward,
            );
            if before != block.window() {
                leave(old, before, block.window(), Lanes::FULL);
                leave(new, before, block.window(), Lanes::FULL);
                before = block.window();
            }
            std::mem::swap(&mut old, &mut new);
        }
    }
    // Leftwards, from the last column of the image.
    before = (0, disparities);
    least = Lanes::ZERO;
    old[PAD..PAD + disparities].fill(Lanes::ZERO);
    for tile in (0..tiles).rev() {
        let block = scale.blocks.strip(strip)[tile];
        let (n, pitch) = (block.span(), block.pitch());
        let nodes = block.at..block.at + block.vectors();
        let costs = &volumes.energies[nodes.clone()];
        let merged = &mut volumes.merged[nodes];
        let inside = LANES.min(scale.width - tile * LANES);
        for i in (0..inside).rev() {
            let x = tile * LANES + i;
            let first = x + 1 == scale.width;
            let slope = if first { 0 } else { slope_step(block.slope_x, x + 1, x) };
            least = single_step(
                s,
                old,
                least,
                new,
                &costs[i * pitch..i * pitch + n],
                &mut merged[i * pitch..i * pitch + n],
                &scale.column_weights[if first { x } else { x + 1 }],
                truncation,
                slope,
                Span::new(block.window(), before, usize::from(slope != 0)),
                true,
                &mut scale.forward,
            );
            if before != block.window() {
                leave(old, before, block.window(), Lanes::FULL);
                leave(new, before, block.window(), Lanes::FULL);
                before = block.window();
            }
            std::mem::swap(&mut old, &mut new);
        }
        turn_blocks(s, merged, n, pitch);
    }
}

/// Layer 2: advances all vertical and diagonal paths from row `from` (None: the start) to `y`.
#[inline(always)]
fn advance_row<S: Simd>(
    s: S,
    scale: &mut Scale,
    from: Option<usize>,
    y: usize,
    last: bool,
    volumes: &mut Volumes,
) {
    let tiles = scale.blocks.tiles();
    let disparities = scale.blocks.disparities();
    let padded = scale.fresh.len();
    let mut weights = std::mem::take(&mut scale.weights);
    for ((weights, sideways), weight) in weights.iter_mut().zip([0, -1, 1]).zip(scale.others) {
        let there = scale.guide_row(from.unwrap_or(y), sideways);
        edge_row(s, scale.guide_row(y, 0), there, weight, weights);
    }
    scale.weights = weights;

    let strip = scale.blocks.strip(y / STRIP);
    let enters = from.is_none_or(|from| from / STRIP != y / STRIP);
    let before = |tile: usize| match from {
        None => (0, disparities),
        Some(from) => scale.blocks.strip(from / STRIP)[tile].window(),
    };
    // Slope steps of a tile's straight, rightward and leftward paths.
    let steps = |block: &Block| {
        [0, -1, 1].map(|sideways| match from {
            None => 0,
            // Down from the left a path goes right, up from the left as well.
            Some(from) if from < y => slope_step(block.slope_y - sideways * block.slope_x, from, y),
            Some(from) => slope_step(block.slope_y + sideways * block.slope_x, from, y),
        })
    };
    for tile in 0..tiles {
        let mut old = before(tile);
        for beside in [tile.saturating_sub(1), (tile + 1).min(tiles - 1)] {
            let beside = before(beside);
            old = (old.0.min(beside.0), old.1.max(beside.1));
        }
        let slack = usize::from(steps(&strip[tile]) != [0; 3]);
        scale.spans[tile] = Span::new(strip[tile].window(), old, slack);
    }

    let edge = scale.edge;
    let [straight, left, right] = &mut scale.states;
    let [earlier, now] = &mut scale.carry;
    for tile in 0..tiles {
        let block = &strip[tile];
        let span = scale.spans[tile];
        let place = tile * padded..(tile + 1) * padded;
        // What the next tile will read of this one's rightward paths.
        if let Some(next) = scale.spans.get(tile + 1) {
            let read = next.from - 1..next.to + 1;
            now[read.clone()].copy_from_slice(&left[place.clone()][read]);
        }
        let (right_here, right_next) = right[place.start..].split_at_mut(padded);
        let slopes = steps(block);
        if let Some(next) = strip.get(tile + 4).filter(|next| next.span() <= NEAR) {
            // Rows of neighbouring blocks lie far apart: the hardware does not foresee the next.
            let at = next.at + y % STRIP * next.pitch();
            s.expect(&volumes.merged[at..at + next.span()]);
            if last {
                s.expect(&volumes.energies[at..at + next.span()]);
            }
        }
        let mut paths = [
            Paths {
                state: &mut straight[place.clone()],
                beside: &scale.fresh,
                weight: scale.weights[0][tile],
                slope: slopes[0],
            },
            Paths {
                state: &mut left[place.clone()],
                beside: if tile == 0 { &scale.fresh } else { earlier },
                weight: scale.weights[1][tile],
                slope: slopes[1],
            },
            Paths {
                state: right_here,
                beside: if tile + 1 < tiles { &right_next[..padded] } else { &scale.fresh },
                weight: scale.weights[2][tile],
                slope: slopes[2],
            },
        ];
        let at = block.at + y % STRIP * block.pitch();
        let nodes = at..at + block.span();
        triple_step(
            s,
            &mut paths,
            &volumes.merged[nodes.clone()],
            &mut volumes.energies[nodes],
            scale.parameters.truncation_other,
            span,
            last,
            &mut scale.forward,
        );
        let beyond = scale.width - tile * LANES;
        if beyond < LANES {
            // Lanes beyond the image must not feed a leftward path.
            let window = PAD + block.low..PAD + block.high;
            paths[2].state[window].iter_mut().for_each(|lanes| lanes.0[beyond..].fill(0));
        }
        if enters {
            let old = match from {
                None => (0, disparities),
                Some(from) => scale.blocks.strip(from / STRIP)[tile].window(),
            };
            for (path, sideways) in paths.iter_mut().zip([0, -1, 1]) {
                let none = if sideways == 1 && tile + 1 == tiles { edge } else { Lanes::FULL };
                leave(path.state, old, block.window(), none);
            }
        }
        std::mem::swap(earlier, now);
    }
}

kernel! {
    fn horizontal_layer_at(scale: &mut Scale, strip: usize, volumes: &mut Volumes) = horizontal_layer
}
kernel! {
    fn advance_row_at(scale: &mut Scale, from: Option<usize>, y: usize, last: bool, volumes: &mut Volumes)
        = advance_row
}

#[cfg(test)]
mod tests;
