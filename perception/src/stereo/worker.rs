//! The two layers of a scale, strip by strip and row by row, with the workspace of one thread.

use super::blocks::pitch;
use super::cost::{CostParameters, CostStrip, STRIP};
use super::scale::{EdgeWeight, Scale};
use super::viterbi::{Energies, Merge, NEAR, PAD, Span, Sum, single_step, triple_step};
use crate::simd::{LANES, Lanes, Level, Simd, Streaming, kernel};

/// The workspace of one thread.
#[derive(Debug)]
pub(super) struct Worker {
    pub(super) cost: CostStrip,
    /// Padded energies of the previous row for each tile: of vertical paths, of paths from the right, and of
    /// paths from the left (previous row and current row).
    straight: Vec<Lanes>,
    right: Vec<Lanes>,
    left: [Vec<Lanes>; 2],
    /// The costs of a strip; empty if costs are stored in the volume.
    pub(super) costs: Vec<Lanes>,
    /// H of a strip; empty if H is stored in the volume.
    pub(super) merged: Vec<Lanes>,
    /// Final energies of a row, tile by tile.
    pub(super) finished: Vec<Lanes>,
    /// Padded energies of the previous and the current column.
    columns: [Vec<Lanes>; 2],
    half: Vec<Lanes>,
    forward: Vec<[Lanes; 3]>,
    steps: Vec<Step>,
    weights: [Vec<Lanes>; 3],
    column_weights: Vec<Lanes>,
}

/// Span and slope steps of the layer-2 paths for a row of a tile.
#[derive(Clone, Copy, Debug)]
struct Step {
    span: Span,
    /// Slope steps of the vertical paths, of those from the left and of those from the right.
    slopes: [i8; 3],
}

/// Destination of the sums of a layer-2 sweep.
#[derive(Debug)]
pub(super) enum Sums<'a> {
    /// First sweep: stored for the last.
    Keep(&'a mut [Lanes]),
    /// The same, by non-temporal stores.
    Stream(&'a mut [Lanes]),
    /// The same, and the data term is stored as well.
    StreamBoth { sums: &'a mut [Lanes], data: &'a mut [Lanes] },
    /// Last sweep: its sums are added to the stored ones and to the data term.
    Finish(&'a [Lanes]),
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
            straight: vec![Lanes::FULL; tiles * padded],
            right: vec![Lanes::FULL; tiles * padded],
            left: std::array::from_fn(|_| vec![Lanes::FULL; tiles * padded]),
            costs: Vec::new(),
            merged: Vec::new(),
            finished: vec![Lanes::ZERO; tiles * pitch(disparities)],
            columns: std::array::from_fn(|_| vec![Lanes::FULL; padded]),
            half: vec![Lanes::ZERO; disparities],
            forward: vec![[Lanes::ZERO; 3]; disparities],
            steps: vec![Step { span: Span { from: 0, to: 0, low: 0, high: 0 }, slopes: [0; 3] }; tiles],
            weights: std::array::from_fn(|_| vec![Lanes::ZERO; tiles]),
            column_weights: vec![Lanes::ZERO; tiles * LANES],
        }
    }

    pub(super) fn bytes(&self) -> usize {
        let single = [&self.straight, &self.right, &self.costs, &self.finished, &self.half];
        let lanes = single
            .into_iter()
            .chain([&self.merged, &self.column_weights])
            .chain(&self.left)
            .chain(&self.columns)
            .chain(&self.weights);
        let vectors = lanes.map(Vec::len).sum::<usize>() + 3 * self.forward.len();
        vectors * LANES + self.cost.bytes() + self.steps.len() * size_of::<Step>()
    }

    /// Destination of the first layer-2 sweep's sums.
    pub(super) fn sums<'a>(&self, volume: &'a mut [Lanes]) -> Sums<'a> {
        if self.costs.is_empty() { Sums::Keep(volume) } else { Sums::Stream(volume) }
    }

    /// Resets all layer-2 paths to their start; `edge` is the padding of the last tile ([`Scale::edge`]).
    pub(super) fn start_paths(&mut self, edge: Lanes) {
        let padded = self.columns[0].len();
        for state in [&mut self.straight, &mut self.right].into_iter().chain(&mut self.left) {
            for tile in state.chunks_exact_mut(padded) {
                tile[..PAD].fill(Lanes::FULL);
                tile[PAD..padded - PAD].fill(Lanes::ZERO);
                tile[padded - PAD..].fill(Lanes::FULL);
            }
        }
        let last = self.right.len() - padded;
        let last = &mut self.right[last..];
        last[..PAD].fill(edge);
        last[padded - PAD..].fill(edge);
    }
}

/// Change of the integer disparity of a slope from position `from` to `to`.
pub(super) fn slope_step(slope: i32, from: usize, to: usize) -> i8 {
    let at = |position: usize| (slope * position as i32 + 128) >> 8;
    (at(to) - at(from)).clamp(-1, 1) as i8
}

/// Sets the nodes of the old window outside the new one to `none`.
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

/// Layer 1 of a strip: computes `costs`, runs rightward and leftward paths and writes their minimum to
/// `merged`. `merged` starts at vector `base` of the volume, `costs` at the strip.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn horizontal_layer<S: Simd>(
    s: S,
    scale: &Scale,
    worker: &mut Worker,
    strip: usize,
    merged: &mut [Lanes],
    base: usize,
    costs: &mut [Lanes],
) {
    let tiles = scale.blocks.tiles();
    let first = scale.blocks.strip(strip)[0].at;
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
    // From further away even the cheapest transition costs as much as the truncation.
    let reach = 1 + usize::from(truncation.div_ceil(scale.horizontal.edge.min(scale.horizontal.smooth)));
    let [mut old, mut new] = worker.columns.each_mut().map(|column| &mut column[..]);
    // Rightwards.
    let mut before = (0, disparities);
    let mut least = Lanes::ZERO;
    old[PAD..PAD + disparities].fill(Lanes::ZERO);
    for tile in 0..tiles {
        let block = scale.blocks.strip(strip)[tile];
        let (n, pitch) = (block.span(), block.pitch());
        let nodes = block.at - base..block.at - base + block.vectors();
        let costs = &mut costs[block.at - first..block.at - first + block.vectors()];
        worker.cost.tile(tile * LANES, block.low, n, pitch, costs);
        turn_blocks(s, costs, n, pitch);
        let merged = &mut merged[nodes];
        for i in 0..LANES {
            let x = tile * LANES + i;
            let slope = if x == 0 { 0 } else { slope_step(block.slope_x, x - 1, x) };
            if n > NEAR && i + 1 < LANES {
                s.prefetch(&merged[(i + 1) * pitch..(i + 1) * pitch + n]);
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
                Span::new(block.window(), before, usize::from(slope != 0)).within(reach),
                |total, _| total,
                &mut worker.half,
            );
            if before != block.window() {
                leave(old, before, block.window(), Lanes::FULL);
                leave(new, before, block.window(), Lanes::FULL);
                before = block.window();
            }
            std::mem::swap(&mut old, &mut new);
        }
    }
    match scale.parameters.merging {
        Merge::First => leftwards(s, scale, worker, strip, merged, base, costs, reach, |total, _| total),
        Merge::Min => {
            leftwards(s, scale, worker, strip, merged, base, costs, reach, |t, kept| s.min(t, s.load(kept)));
        }
        Merge::Mean => {
            leftwards(s, scale, worker, strip, merged, base, costs, reach, |t, kept| s.mean(t, s.load(kept)));
        }
    }
}

/// The leftward paths of layer 1, from the last column of the image. `merge` merges them with what is there.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn leftwards<S: Simd>(
    s: S,
    scale: &Scale,
    worker: &mut Worker,
    strip: usize,
    merged: &mut [Lanes],
    base: usize,
    costs: &[Lanes],
    reach: usize,
    merge: impl Fn(S::Bytes, &Lanes) -> S::Bytes + Copy,
) {
    let tiles = scale.blocks.tiles();
    let first = scale.blocks.strip(strip)[0].at;
    let disparities = scale.blocks.disparities();
    let truncation = scale.parameters.truncation_horizontal;
    let [mut old, mut new] = worker.columns.each_mut().map(|column| &mut column[..]);
    let mut before = (0, disparities);
    let mut least = Lanes::ZERO;
    old[PAD..PAD + disparities].fill(Lanes::ZERO);
    for tile in (0..tiles).rev() {
        let block = scale.blocks.strip(strip)[tile];
        let (n, pitch) = (block.span(), block.pitch());
        let nodes = block.at - base..block.at - base + block.vectors();
        let costs = &costs[block.at - first..block.at - first + block.vectors()];
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
                Span::new(block.window(), before, usize::from(slope != 0)).within(reach),
                merge,
                &mut worker.half,
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

/// Computes span and slope steps of all layer-2 paths from row `from` (`None`: path start) to `y`.
fn plan_row(scale: &Scale, steps: &mut [Step], from: Option<usize>, y: usize) {
    let strip = scale.blocks.strip(y / STRIP);
    let last = strip.len() - 1;
    let before = |tile: usize| match from {
        None => (0, scale.blocks.disparities()),
        Some(from) => scale.blocks.strip(from / STRIP)[tile].window(),
    };
    for (tile, (step, block)) in steps.iter_mut().zip(strip).enumerate() {
        step.slopes = [0, -1, 1].map(|sideways| match from {
            None => 0,
            // A path from the left moves right, whether it runs down or up.
            Some(from) if from < y => slope_step(block.slope_y - sideways * block.slope_x, from, y),
            Some(from) => slope_step(block.slope_y + sideways * block.slope_x, from, y),
        });
        let mut old = before(tile);
        for beside in [tile.saturating_sub(1), (tile + 1).min(last)] {
            let beside = before(beside);
            old = (old.0.min(beside.0), old.1.max(beside.1));
        }
        step.span = Span::new(block.window(), old, usize::from(step.slopes != [0; 3]));
    }
}

/// Layer 2: advances all vertical and diagonal paths from row `from` (`None`: path start) to `y`.
/// The slices of `sums` start at vector `base` of the volume, the data term `merged` at `merged_base`.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn advance_row<S: Simd>(
    s: S,
    scale: &Scale,
    worker: &mut Worker,
    from: Option<usize>,
    y: usize,
    merged: &[Lanes],
    merged_base: usize,
    sums: &mut Sums<'_>,
    base: usize,
) {
    let tiles = scale.blocks.tiles();
    let padded = scale.fresh.len();
    for ((weights, sideways), weight) in worker.weights.iter_mut().zip([0, -1, 1]).zip(scale.others) {
        let there = scale.guide_row(from.unwrap_or(y), sideways);
        edge_row(s, scale.guide_row(y, 0), there, weight, weights);
    }
    plan_row(scale, &mut worker.steps, from, y);

    let strip = scale.blocks.strip(y / STRIP);
    // Whether a previous row lies in another strip.
    let other_strip = |row: Option<usize>| row.is_none_or(|row| row / STRIP != y / STRIP);
    let enters = other_strip(from);
    // The buffer of the paths from the left that this row overwrites is two rows old.
    let two_before = match from {
        None => None,
        Some(from) if from < y => from.checked_sub(1),
        Some(from) => Some(from + 1).filter(|&row| row < scale.height),
    };
    let enters_late = other_strip(two_before);
    let window_at = |row: Option<usize>, tile: usize| match row {
        None => (0, scale.blocks.disparities()),
        Some(row) => scale.blocks.strip(row / STRIP)[tile].window(),
    };
    let Worker { straight, right, left: [left, left_after], finished, steps, weights, forward, .. } = worker;
    // Its drop at the end of the row executes the store fence.
    let streaming = Streaming::new(s);
    let mut done = 0;
    for (tile, (block, step)) in strip.iter().zip(&*steps).enumerate() {
        let place = tile * padded..(tile + 1) * padded;
        let (right_here, right_next) = right[place.start..].split_at_mut(padded);
        if let Some(next) = strip.get(tile + 4).filter(|next| next.span() <= NEAR) {
            // Rows of neighbouring blocks are far apart, so the hardware prefetcher misses the next one.
            let at = next.at + y % STRIP * next.pitch();
            s.prefetch(&merged[at - merged_base..at - merged_base + next.span()]);
            if let Sums::Finish(sums) = &sums {
                s.prefetch(&sums[at - base..at - base + next.span()]);
            }
        }
        let at = block.at + y % STRIP * block.pitch();
        let row = at - base..at - base + block.span();
        let mut sum = match sums {
            Sums::Keep(sums) => Sum::Keep(&mut sums[row]),
            Sums::Stream(sums) => Sum::Stream(&mut sums[row]),
            Sums::StreamBoth { sums, data } => {
                Sum::StreamBoth { sum: &mut sums[row.clone()], data: &mut data[row] }
            }
            Sums::Finish(sums) => {
                Sum::Finish { other: &sums[row], total: &mut finished[done..done + block.span()] }
            }
        };
        let mut energies = Energies {
            straight: &mut straight[place.clone()],
            right: right_here,
            right_beside: if tile + 1 < tiles { &right_next[..padded] } else { &scale.fresh },
            left: [
                &left[place.clone()],
                if tile == 0 { &scale.fresh } else { &left[place.start - padded..place.start] },
            ],
            left_after: &mut left_after[place],
        };
        triple_step(
            s,
            &streaming,
            &mut energies,
            [&weights[0][tile], &weights[1][tile], &weights[2][tile]],
            step.slopes,
            &merged[at - merged_base..at - merged_base + block.span()],
            &mut sum,
            scale.parameters.truncation_other,
            step.span,
            forward,
        );
        done += block.pitch();
        let beyond = scale.width - tile * LANES;
        if beyond < LANES {
            // Lanes beyond the image are path starts of leftward paths.
            let window = PAD + block.low..PAD + block.high;
            energies.right[window].iter_mut().for_each(|lanes| lanes.0[beyond..].fill(0));
        }
        if enters {
            let old = window_at(from, tile);
            let none = if tile + 1 == tiles { scale.edge } else { Lanes::FULL };
            leave(energies.straight, old, block.window(), Lanes::FULL);
            leave(energies.right, old, block.window(), none);
        }
        if enters_late {
            leave(energies.left_after, window_at(two_before, tile), block.window(), Lanes::FULL);
        }
    }
    std::mem::swap(left, left_after);
}

kernel! {
    pub(super) fn horizontal_layer_at(
        scale: &Scale,
        worker: &mut Worker,
        strip: usize,
        merged: &mut [Lanes],
        base: usize,
        costs: &mut [Lanes],
    ) = horizontal_layer
}
kernel! {
    pub(super) fn advance_row_at(
        scale: &Scale,
        worker: &mut Worker,
        from: Option<usize>,
        y: usize,
        merged: &[Lanes],
        merged_base: usize,
        sums: &mut Sums<'_>,
        base: usize,
    ) = advance_row
}
