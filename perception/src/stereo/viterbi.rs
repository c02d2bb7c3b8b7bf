//! One step of the Viterbi paths with the total-variation edge cost (paper, sections 3.2 and 3.3).
//!
//! The energy of node `u` of pixel `p`, reached from the pixel before it on the path, is
//!
//! ```text
//! e(p, u) = C(p, u) + min( min_v { e(p−1, v) + w·|u − v − s| }, m + T ) − m,   m = min_v e(p−1, v)
//! ```
//!
//! with the data term C, the edge weight w ≥ 1, the truncation T and the slope step s of the
//! expected surface (−1, 0 or 1). The inner minimum over all v is computed exactly by two sweeps over the disparities (the paper's O(2m) recursion, with the backward sweep that its
//! printed form omits): F(u) = min(e(p−1, u), F(u−1) + w), then B(u) = min(F(u), B(u+1) + w).
//! Subtracting m keeps energies within C + T.
//!
//! Two neighbours on a path may have different search windows. Nodes of the previous pixel that lie
//! outside the window of the next are its *virtual nodes* (paper, section 3.4): both sweeps start
//! at them, so every node of the window is reached at the correct cost, but they have no data cost.
//! Nodes that do not exist have the energy 255.

use crate::simd::{Lanes, Simd, Streaming, kernel};

/// Padding of a state on either side by nodes that do not exist, so that a slope step needs no bounds test.
pub const PAD: usize = 2;

/// Windows of more nodes than this are prefetched node by node, and their winners' neighbours are searched only
/// near the winners; narrower windows are prefetched block by block.
pub(super) const NEAR: usize = 48;

/// Nodes that a step visits, as indices into a padded state: disparity + [`PAD`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// The first node that is read.
    pub from: usize,
    /// One after the last node that is read.
    pub to: usize,
    /// The window's first node.
    pub low: usize,
    /// One after the window's last node.
    pub high: usize,
}

impl Span {
    /// The span of a window of disparities [`low`, `high`) that is entered from window `before`. `slack` is
    /// 1 with a slope step, so that all nodes are still reached, and 0 without.
    pub fn new((low, high): (usize, usize), before: (usize, usize), slack: usize) -> Self {
        Self {
            from: PAD + low.min(before.0) - slack,
            to: PAD + high.max(before.1) + slack,
            low: PAD + low,
            high: PAD + high,
        }
    }

    /// Skips virtual nodes more than `reach` disparities away from the window.
    pub fn within(self, reach: usize) -> Self {
        Self {
            from: self.from.max(self.low.saturating_sub(reach)),
            to: self.to.min(self.high + reach),
            ..self
        }
    }

    /// The part of a padded state that is read with slope step `step`.
    #[inline(always)]
    fn read<'a>(&self, state: &'a [Lanes], step: i8) -> &'a [Lanes] {
        let start = self.from.wrapping_add_signed(-isize::from(step));
        &state[start..start + self.to - self.from]
    }

    /// The window within a padded state.
    #[inline(always)]
    fn window<'a>(&self, state: &'a mut [Lanes]) -> &'a mut [Lanes] {
        &mut state[self.low..self.high]
    }
}

/// What a horizontal step writes to its output besides its state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Merge {
    /// The energies of the window.
    First,
    /// The minimum of those and the previous output.
    Min,
    /// The mean of those and the previous output.
    Mean,
}

/// Advances [`crate::simd::LANES`] independent paths by one pixel: from `before` (padded energies of the
/// previous pixel; `least` is their minimum in each lane) to the window in `after`. Returns the minimum of
/// the new energies. `out` receives the window, merged with its previous content by `merge`, which is given both.
/// `half` is scratch memory of at least the window's length.
///
/// A single sweep would be bound by the latency of its own sum, so both sweeps run at the same time from
/// the two ends: F and B need only the old energies, and after they have passed each other each combines
/// with the stored half of the other.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
pub(super) fn single_step<S: Simd>(
    s: S,
    before: &[Lanes],
    least: Lanes,
    after: &mut [Lanes],
    data: &[Lanes],
    out: &mut [Lanes],
    weight: &Lanes,
    truncation: u8,
    slope: i8,
    span: Span,
    merge: impl Fn(S::Bytes, &Lanes) -> S::Bytes + Copy,
    half: &mut [Lanes],
) -> Lanes {
    let n = span.high - span.low;
    let (data, out, half) = (&data[..n], &mut out[..n], &mut half[..n]);
    let (below, rest) = span.read(before, slope).split_at(span.low - span.from);
    let (inside, above) = rest.split_at(n);
    let after = &mut span.window(after)[..n];
    let weight = s.load(weight);
    let limit = s.splat(truncation);
    let none = s.splat(u8::MAX);
    let least = s.load(&least);

    let (mut up, mut down) = (none, none);
    for node in below {
        up = s.min(s.load(node), s.add(up, weight));
    }
    for node in above.iter().rev() {
        down = s.min(s.load(node), s.add(down, weight));
    }
    let middle = n / 2;
    for i in 0..middle {
        let j = n - 1 - i;
        up = s.min(s.load(&inside[i]), s.add(up, weight));
        down = s.min(s.load(&inside[j]), s.add(down, weight));
        s.store(up, &mut half[i]);
        s.store(down, &mut half[j]);
    }
    let mut lowest = none;
    macro_rules! finish {
        ($i:expr, $energy:expr) => {
            let jump = s.min(s.sub($energy, least), limit);
            let total = s.add(s.load(&data[$i]), jump);
            lowest = s.min(lowest, total);
            s.store(total, &mut after[$i]);
            s.store(merge(total, &out[$i]), &mut out[$i]);
        };
    }
    if n % 2 == 1 {
        up = s.min(s.load(&inside[middle]), s.add(up, weight));
        down = s.min(s.load(&inside[middle]), s.add(down, weight));
        finish!(middle, s.min(up, down));
    }
    for k in 0..middle {
        let (i, j) = (n - middle + k, middle - 1 - k);
        up = s.min(s.load(&inside[i]), s.add(up, weight));
        down = s.min(s.load(&inside[j]), s.add(down, weight));
        finish!(i, s.min(up, s.load(&half[i])));
        finish!(j, s.min(down, s.load(&half[j])));
    }
    let mut result = Lanes::ZERO;
    s.store(lowest, &mut result);
    result
}

/// [`single_step`] for [`kernel!`], whose functions have no return value.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn single_alone<S: Simd>(
    s: S,
    before: &[Lanes],
    least: &mut Lanes,
    after: &mut [Lanes],
    data: &[Lanes],
    out: &mut [Lanes],
    weight: &Lanes,
    truncation: u8,
    slope: i8,
    span: Span,
    merge: Merge,
    half: &mut [Lanes],
) {
    // A step for each way of merging: a choice within the step costs a tenth of it.
    macro_rules! step {
        ($merge:expr) => {
            single_step(s, before, *least, after, data, out, weight, truncation, slope, span, $merge, half)
        };
    }
    *least = match merge {
        Merge::First => step!(|total, _| total),
        Merge::Min => step!(|total, kept| s.min(total, s.load(kept))),
        Merge::Mean => step!(|total, kept| s.mean(total, s.load(kept))),
    };
}

/// The padded energies of the three paths through a tile.
#[derive(Debug)]
pub struct Energies<'a> {
    /// Vertical paths: on entry the energies of the previous row, on return those of this row.
    pub straight: &'a mut [Lanes],
    /// Paths that come from the right: as `straight`.
    pub right: &'a mut [Lanes],
    /// Paths that come from the right, previous row, of the tile on the right.
    pub right_beside: &'a [Lanes],
    /// Paths that come from the left, previous row, of this tile and of the tile on the left. The latter is
    /// read after this tile has been written, so these paths have two buffers.
    pub left: [&'a [Lanes]; 2],
    /// Receives the energies of this row of the paths that come from the left.
    pub left_after: &'a mut [Lanes],
}

/// Destination of the sum of the three paths' jump costs.
#[derive(Debug)]
pub enum Sum<'a> {
    /// Stored for the other sweep.
    Keep(&'a mut [Lanes]),
    /// Stored for the other sweep by non-temporal stores.
    Stream(&'a mut [Lanes]),
    /// The same, and the data term is stored as well.
    StreamBoth {
        /// Receives the sum.
        sum: &'a mut [Lanes],
        /// Receives the data term.
        data: &'a mut [Lanes],
    },
    /// Added to the sum of the other sweep and to the data term: the final energy.
    Finish {
        /// Sum of the other sweep.
        other: &'a [Lanes],
        /// Receives the final energies.
        total: &'a mut [Lanes],
    },
}

/// Advances the vertical and both diagonal paths of a tile by one row and sums up their jump costs. Weights and
/// slope steps are in the order vertical, from the left, from the right.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
pub(super) fn triple_step<S: Simd>(
    s: S,
    streaming: &Streaming<S>,
    energies: &mut Energies<'_>,
    weights: [&Lanes; 3],
    slopes: [i8; 3],
    data: &[Lanes],
    sum: &mut Sum<'_>,
    truncation: u8,
    span: Span,
    forward: &mut [[Lanes; 3]],
) {
    let n = span.high - span.low;
    let (data, forward) = (&data[..n], &mut forward[..n]);
    let limit = s.splat(truncation);
    let none = s.splat(u8::MAX);
    let weight = [s.load(weights[0]), s.load(weights[1]), s.load(weights[2])];
    let mut least = [none; 3];
    let mut energy = [none; 3];
    {
        let all = span.to - span.from;
        let a = &span.read(energies.straight, slopes[0])[..all];
        let b = &span.read(energies.left[0], slopes[1])[..all];
        let b_beside = &span.read(energies.left[1], slopes[1])[..all];
        let c = &span.read(energies.right, slopes[2])[..all];
        let c_beside = &span.read(energies.right_beside, slopes[2])[..all];
        // A macro instead of a closure, which would spill vectors from registers.
        macro_rules! read {
            ($i:expr) => {
                [
                    s.load(&a[$i]),
                    s.shift_right(s.load(&b[$i]), s.load(&b_beside[$i])),
                    s.shift_left(s.load(&c[$i]), s.load(&c_beside[$i])),
                ]
            };
        }
        let start = span.low - span.from;
        for i in 0..start {
            let node = read!(i);
            for p in 0..3 {
                least[p] = s.min(least[p], node[p]);
                energy[p] = s.min(node[p], s.add(energy[p], weight[p]));
            }
        }
        macro_rules! advance {
            ($i:expr) => {
                let node = read!(start + $i);
                for p in 0..3 {
                    least[p] = s.min(least[p], node[p]);
                    energy[p] = s.min(node[p], s.add(energy[p], weight[p]));
                    s.store(energy[p], &mut forward[$i][p]);
                }
            };
        }
        if n > NEAR {
            for i in 0..n {
                advance!(i);
                s.prefetch(std::slice::from_ref(&data[n - 1 - i]));
                match sum {
                    Sum::Keep(out) => s.prefetch(std::slice::from_ref(&out[n - 1 - i])),
                    Sum::Stream(_) | Sum::StreamBoth { .. } => {}
                    Sum::Finish { other, .. } => s.prefetch(std::slice::from_ref(&other[n - 1 - i])),
                }
            }
        } else {
            for i in 0..n {
                advance!(i);
            }
        }
        energy = [none; 3];
        for i in (start + n..all).rev() {
            let node = read!(i);
            for p in 0..3 {
                least[p] = s.min(least[p], node[p]);
                energy[p] = s.min(node[p], s.add(energy[p], weight[p]));
            }
        }
    }
    let a = span.window(energies.straight);
    let b = span.window(energies.left_after);
    let c = span.window(energies.right);
    let (a, b, c) = (&mut a[..n], &mut b[..n], &mut c[..n]);
    macro_rules! finish {
        ($i:expr) => {{
            let cost = s.load(&data[$i]);
            let forward = &forward[$i];
            let node = [s.load(&forward[0]), s.load(&forward[1]), s.load(&forward[2])];
            let mut jump = [none; 3];
            for p in 0..3 {
                energy[p] = s.min(node[p], s.add(energy[p], weight[p]));
                jump[p] = s.min(s.sub(energy[p], least[p]), limit);
            }
            s.store(s.add(cost, jump[0]), &mut a[$i]);
            s.store(s.add(cost, jump[1]), &mut b[$i]);
            s.store(s.add(cost, jump[2]), &mut c[$i]);
            (s.add(s.add(jump[0], jump[1]), jump[2]), cost)
        }};
    }
    match sum {
        Sum::Keep(out) => {
            let out = &mut out[..n];
            for i in (0..n).rev() {
                let (sum, _) = finish!(i);
                s.store(sum, &mut out[i]);
            }
        }
        Sum::Stream(out) => {
            let out = &mut out[..n];
            for i in (0..n).rev() {
                let (sum, _) = finish!(i);
                streaming.store(sum, &mut out[i]);
            }
        }
        Sum::StreamBoth { sum, data: kept } => {
            let (sums, kept) = (&mut sum[..n], &mut kept[..n]);
            for i in (0..n).rev() {
                let (sum, cost) = finish!(i);
                streaming.store(sum, &mut sums[i]);
                streaming.store(cost, &mut kept[i]);
            }
        }
        Sum::Finish { other, total } => {
            let (other, total) = (&other[..n], &mut total[..n]);
            for i in (0..n).rev() {
                let (sum, cost) = finish!(i);
                s.store(s.add(s.add(sum, s.load(&other[i])), cost), &mut total[i]);
            }
        }
    }
}

kernel! {
    /// Advances horizontal paths of 32 rows by one column.
    pub fn single(
        before: &[Lanes],
        least: &mut Lanes,
        after: &mut [Lanes],
        data: &[Lanes],
        out: &mut [Lanes],
        weight: &Lanes,
        truncation: u8,
        slope: i8,
        span: Span,
        merge: Merge,
        half: &mut [Lanes],
    ) = single_alone
}

/// [`triple_step`], with a store fence for each tile.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn fenced_triple_step<S: Simd>(
    s: S,
    energies: &mut Energies<'_>,
    weights: [&Lanes; 3],
    slopes: [i8; 3],
    data: &[Lanes],
    sum: &mut Sum<'_>,
    truncation: u8,
    span: Span,
    forward: &mut [[Lanes; 3]],
) {
    let streaming = Streaming::new(s);
    triple_step(s, &streaming, energies, weights, slopes, data, sum, truncation, span, forward);
}

kernel! {
    /// Advances the vertical and both diagonal paths of a tile by one row.
    pub fn triple(
        energies: &mut Energies<'_>,
        weights: [&Lanes; 3],
        slopes: [i8; 3],
        data: &[Lanes],
        sum: &mut Sum<'_>,
        truncation: u8,
        span: Span,
        forward: &mut [[Lanes; 3]],
    ) = fenced_triple_step
}

/// Reference implementation of a step of one path, O(m²). `before` and `data` are (disparity, energy) pairs of
/// two windows.
#[cfg(test)]
pub(super) fn reference_step(
    before: &[(usize, u8)],
    data: &[(usize, u8)],
    weight: u8,
    truncation: u8,
    slope: i8,
) -> Vec<u8> {
    let least = before.iter().map(|&(_, e)| i32::from(e)).min().unwrap_or(0);
    data.iter()
        .map(|&(u, cost)| {
            let best = before
                .iter()
                .map(|&(v, e)| {
                    let way = (u as i32 - v as i32 - i32::from(slope)).abs();
                    // Energies saturate at 255.
                    (i32::from(e) + i32::from(weight) * way).min(255)
                })
                .min()
                .unwrap_or(255);
            let jump = (best - least).min(i32::from(truncation));
            (i32::from(cost) + jump).min(255) as u8
        })
        .collect()
}

#[cfg(test)]
mod tests;
