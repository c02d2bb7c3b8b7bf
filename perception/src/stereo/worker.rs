//! The two layers of a scale, strip by strip and row by row, with what one thread needs for them.

use super::blocks::Block;
use super::cost::{CostParameters, CostStrip, STRIP};
use super::scale::{EdgeWeight, Scale};
use super::viterbi::{NEAR, PAD, Paths, Span, single_step, triple_step};
use crate::simd::{LANES, Lanes, Level, Simd, kernel};

/// What one thread needs for itself.
#[derive(Debug)]
pub(super) struct Worker {
    pub(super) cost: CostStrip,
    /// Energies of the row before for each direction and tile, padded.
    states: [Vec<Lanes>; 3],
    /// The rightward diagonal's energies of a tile and the one before, before they are replaced.
    carry: [Vec<Lanes>; 2],
    /// Energies of the column before and of this one, padded.
    columns: [Vec<Lanes>; 2],
    forward: Vec<Lanes>,
    spans: Vec<Span>,
    weights: [Vec<Lanes>; 3],
    column_weights: Vec<Lanes>,
}

impl Worker {
    pub(super) fn new(
        cost: CostParameters,
        level: Level,
        width: usize,
        tiles: usize,
        disparities: usize,
    ) -> Self {
        let padded = disparities + 2 * PAD;
        Self {
            cost: CostStrip::new(cost, level, width, disparities),
            states: std::array::from_fn(|_| vec![Lanes::FULL; tiles * padded]),
            carry: std::array::from_fn(|_| vec![Lanes::FULL; padded]),
            columns: std::array::from_fn(|_| vec![Lanes::FULL; padded]),
            forward: vec![Lanes::ZERO; 3 * disparities],
            spans: vec![Span { from: 0, to: 0, low: 0, high: 0 }; tiles],
            weights: std::array::from_fn(|_| vec![Lanes::ZERO; tiles]),
            column_weights: vec![Lanes::ZERO; tiles * LANES],
        }
    }

    pub(super) fn bytes(&self) -> usize {
        let lanes = self.states.iter().chain(&self.carry).chain(&self.columns).chain(&self.weights);
        let vectors = lanes.map(Vec::len).sum::<usize>() + self.forward.len() + self.column_weights.len();
        vectors * LANES + self.cost.bytes() + self.spans.len() * size_of::<Span>()
    }

    /// Makes every path of layer 2 start afresh; `edge` is what lies beyond the last tile's lanes.
    pub(super) fn start_paths(&mut self, edge: Lanes) {
        let padded = self.carry[0].len();
        for state in &mut self.states {
            for tile in state.chunks_exact_mut(padded) {
                tile[..PAD].fill(Lanes::FULL);
                tile[PAD..padded - PAD].fill(Lanes::ZERO);
                tile[padded - PAD..].fill(Lanes::FULL);
            }
        }
        let last = self.states[2].len() - padded;
        let last = &mut self.states[2][last..];
        last[..PAD].fill(edge);
        last[padded - PAD..].fill(edge);
    }
}

/// Change of a slope's whole disparities from position `from` to `to`.
pub(super) fn slope_step(slope: i32, from: usize, to: usize) -> i8 {
    let at = |position: usize| (slope * position as i32 + 128) >> 8;
    (at(to) - at(from)).clamp(-1, 1) as i8
}

/// Marks the nodes of an old window that the new one leaves as not there: `none`.
fn leave(state: &mut [Lanes], old: (usize, usize), new: (usize, usize), none: Lanes) {
    state[PAD + old.0..PAD + old.1.min(new.0).max(old.0)].fill(none);
    state[PAD + old.0.max(new.1).min(old.1)..PAD + old.1].fill(none);
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

/// Layer 1 of a strip: costs, rightward and leftward paths, their minimum to `merged`.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn horizontal_layer<S: Simd>(
    s: S,
    scale: &Scale,
    worker: &mut Worker,
    strip: usize,
    merged: &mut [Lanes],
    energies: &mut [Lanes],
    base: usize,
) {
    let tiles = scale.blocks.tiles();
    let top = strip * STRIP;
    // Edge weights between column x − 1 and x, for all rows.
    for row in 0..STRIP {
        let y = (top + row).min(scale.height - 1);
        let mut weights = std::mem::take(&mut worker.weights[0]);
        let (here, there) = (scale.guide_row(y, 0), scale.guide_row(y, -1));
        edge_row(s, here, there, scale.horizontal, &mut weights);
        for (tile, weights) in weights.iter().enumerate() {
            worker.column_weights[tile * LANES + row] = *weights;
        }
        worker.weights[0] = weights;
    }
    for block in worker.column_weights.chunks_exact_mut(LANES) {
        turn_blocks(s, block, 1, 1);
    }

    let disparities = scale.blocks.disparities();
    let truncation = scale.parameters.truncation_horizontal;
    let [mut old, mut new] = worker.columns.each_mut().map(|column| &mut column[..]);
    // Rightwards.
    let mut before = (0, disparities);
    let mut least = Lanes::ZERO;
    old[PAD..PAD + disparities].fill(Lanes::ZERO);
    for tile in 0..tiles {
        let block = scale.blocks.strip(strip)[tile];
        let (n, pitch) = (block.span(), block.pitch());
        let nodes = block.at - base..block.at - base + block.vectors();
        let costs = &mut energies[nodes.clone()];
        worker.cost.tile(tile * LANES, block.low, n, pitch, costs);
        turn_blocks(s, costs, n, pitch);
        let merged = &mut merged[nodes];
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
                &worker.column_weights[x],
                truncation,
                slope,
                Span::new(block.window(), before, usize::from(slope != 0)),
                false,
                &mut worker.forward,
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
        let nodes = block.at - base..block.at - base + block.vectors();
        let costs = &energies[nodes.clone()];
        let merged = &mut merged[nodes];
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
                &worker.column_weights[if first { x } else { x + 1 }],
                truncation,
                slope,
                Span::new(block.window(), before, usize::from(slope != 0)),
                true,
                &mut worker.forward,
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
#[allow(clippy::too_many_arguments)]
fn advance_row<S: Simd>(
    s: S,
    scale: &Scale,
    worker: &mut Worker,
    from: Option<usize>,
    y: usize,
    last: bool,
    merged: &[Lanes],
    energies: &mut [Lanes],
    base: usize,
) {
    let tiles = scale.blocks.tiles();
    let disparities = scale.blocks.disparities();
    let padded = scale.fresh.len();
    let mut weights = std::mem::take(&mut worker.weights);
    for ((weights, sideways), weight) in weights.iter_mut().zip([0, -1, 1]).zip(scale.others) {
        let there = scale.guide_row(from.unwrap_or(y), sideways);
        edge_row(s, scale.guide_row(y, 0), there, weight, weights);
    }
    worker.weights = weights;

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
        worker.spans[tile] = Span::new(strip[tile].window(), old, slack);
    }

    let edge = scale.edge;
    let [straight, left, right] = &mut worker.states;
    let [earlier, now] = &mut worker.carry;
    for tile in 0..tiles {
        let block = &strip[tile];
        let span = worker.spans[tile];
        let place = tile * padded..(tile + 1) * padded;
        // What the next tile will read of this one's rightward paths.
        if let Some(next) = worker.spans.get(tile + 1) {
            let read = next.from - 1..next.to + 1;
            now[read.clone()].copy_from_slice(&left[place.clone()][read]);
        }
        let (right_here, right_next) = right[place.start..].split_at_mut(padded);
        let slopes = steps(block);
        if let Some(next) = strip.get(tile + 4).filter(|next| next.span() <= NEAR) {
            // Rows of neighbouring blocks lie far apart: the hardware does not foresee the next.
            let at = next.at + y % STRIP * next.pitch();
            s.expect(&merged[at..at + next.span()]);
            if last {
                s.expect(&energies[at - base..at - base + next.span()]);
            }
        }
        let mut paths = [
            Paths {
                state: &mut straight[place.clone()],
                beside: &scale.fresh,
                weight: worker.weights[0][tile],
                slope: slopes[0],
            },
            Paths {
                state: &mut left[place.clone()],
                beside: if tile == 0 { &scale.fresh } else { earlier },
                weight: worker.weights[1][tile],
                slope: slopes[1],
            },
            Paths {
                state: right_here,
                beside: if tile + 1 < tiles { &right_next[..padded] } else { &scale.fresh },
                weight: worker.weights[2][tile],
                slope: slopes[2],
            },
        ];
        let at = block.at + y % STRIP * block.pitch();
        triple_step(
            s,
            &mut paths,
            &merged[at..at + block.span()],
            &mut energies[at - base..at - base + block.span()],
            scale.parameters.truncation_other,
            span,
            last,
            &mut worker.forward,
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
    pub(super) fn horizontal_layer_at(
        scale: &Scale,
        worker: &mut Worker,
        strip: usize,
        merged: &mut [Lanes],
        energies: &mut [Lanes],
        base: usize,
    ) = horizontal_layer
}
kernel! {
    pub(super) fn advance_row_at(
        scale: &Scale,
        worker: &mut Worker,
        from: Option<usize>,
        y: usize,
        last: bool,
        merged: &[Lanes],
        energies: &mut [Lanes],
        base: usize,
    ) = advance_row
}
