//! Multi-Path-Viterbi of one scale: computes the energies of all nodes of the search windows from a pair
//! (paper, section 3.2).
//!
//! Layer 1 is horizontal. Strips of 32 rows are transposed so that one vector holds the same column of
//! all rows. Rightward and leftward paths are merged to their minimum H, which preserves depth edges.
//! Layer 2 takes H as its data term and runs the vertical and both diagonal paths together, downwards
//! and then upwards, with 32 columns in a vector. The final energy is H plus the jump costs of the six
//! paths. H counts once, not once per path, so a path that agrees with H adds nothing.
//! This takes one horizontal and two vertical sweeps over two volumes of one byte per node.

use super::blocks::{Block, Blocks};
use super::cost::{CostParameters, STRIP};
use super::crew::both;
use super::energy::{EnergyRow, Volumes};
use super::scale::{PathParameters, Scale};
use super::worker::{Sums, Worker, advance_row_at, horizontal_layer_at};
use crate::image::GreyView;
use crate::simd::{Lanes, Level};
use std::ops::Range;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Mutex, PoisonError};

/// The solver of one scale with its workspace, without the volumes.
#[derive(Debug)]
pub struct Solver {
    /// The scale that is solved.
    pub scale: Scale,
    /// One worker for each thread.
    workers: Vec<Worker>,
}

impl Solver {
    /// A solver for `width` × `height` pixels and all disparities below `disparities`, on `threads`
    /// threads.
    pub fn new(
        cost: CostParameters,
        parameters: PathParameters,
        level: Level,
        width: usize,
        height: usize,
        disparities: usize,
        threads: usize,
    ) -> Self {
        let scale = Scale::new(parameters, level, width, height, disparities);
        let tiles = scale.blocks.tiles();
        let workers =
            (0..threads.max(1)).map(|_| Worker::new(cost, level, width, tiles, disparities)).collect();
        Self { scale, workers }
    }

    /// Reduces cache traffic for volumes that exceed the caches: each thread keeps the costs of a strip in
    /// memory of its own, and the first vertical sweep writes its sums by non-temporal stores.
    /// The windows must not change afterwards.
    pub fn spare_caches(&mut self) {
        let strips = (0..self.scale.blocks.strips())
            .map(|strip| self.scale.blocks.strip(strip).iter().map(Block::vectors).sum());
        let most = strips.max().unwrap_or(0);
        self.workers.iter_mut().for_each(|worker| worker.costs = vec![Lanes::ZERO; most]);
        // With helpers, layer 1 comes before the first sweep.
        if self.workers.len() <= 2 {
            self.workers.iter_mut().for_each(|worker| worker.merged = vec![Lanes::ZERO; most]);
        }
    }

    /// Bytes of memory that the workspace holds, without the volumes.
    pub fn bytes(&self) -> usize {
        self.workers.iter().map(Worker::bytes).sum::<usize>() + self.scale.bytes()
    }

    /// Computes the final energies. `receive` is given a row and returns two receivers: that of the rows above it, from
    /// the last to the first, and that of the others, in either direction. `go_on` is called repeatedly; once it
    /// returns false, the scale is abandoned and false is returned; three threads and more do not ask during layer 1. With several threads, the calling thread belongs to their
    /// [`Crew`](super::crew::Crew).
    ///
    /// One thread runs both layers strip by strip on the way down, and completes the sums on the way up. Of two, one
    /// starts at the top and one at the bottom; where they meet they exchange their paths, and each completes the sums that it
    /// has started. Further threads help with layer 1 only, which then comes first. The sums are the same for any
    /// number of threads.
    ///
    /// # Panics
    /// If the images have another size than the workspace, or the volumes are smaller than
    /// [`Blocks::vectors`](super::blocks::Blocks::vectors).
    pub fn solve<U: FnMut(EnergyRow<'_>) + Send, L: FnMut(EnergyRow<'_>) + Send>(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        volumes: &mut Volumes,
        go_on: &mut (dyn FnMut() -> bool + Send),
        receive: impl FnOnce(usize) -> (U, L),
    ) -> bool {
        for image in [&left, &right] {
            assert_eq!((image.width(), image.height()), (self.scale.width, self.scale.height));
        }
        assert!(volumes.vectors() >= self.scale.blocks.vectors());
        self.scale.take_guide(left);
        let Self { scale, workers } = self;
        match &mut workers[..] {
            [] => false,
            [worker] => scale.solve_alone(worker, (left, right), volumes, go_on, receive),
            crew => scale.solve_together(crew, (left, right), volumes, go_on, receive),
        }
    }
}

/// Direction of a sweep of layer 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sweep {
    Down,
    Up,
}

impl Sweep {
    /// `range` in the order of the sweep.
    fn order(self, range: Range<usize>) -> impl Iterator<Item = usize> {
        let (first, last) = (range.start, range.end);
        (0..range.len()).map(move |i| if self == Self::Down { first + i } else { last - 1 - i })
    }

    /// The row from which the paths come to row `y`.
    fn before(self, y: usize, height: usize) -> Option<usize> {
        match self {
            Self::Down => y.checked_sub(1),
            Self::Up => Some(y + 1).filter(|&row| row < height),
        }
    }
}

/// Some strips, with their part of the volumes, which starts at vector `base`.
#[derive(Debug, Default)]
struct Part<'a> {
    strips: Range<usize>,
    base: usize,
    merged: &'a mut [Lanes],
    energies: &'a mut [Lanes],
}

impl<'a> Part<'a> {
    /// The strips before `strip`, and the others.
    fn split(self, blocks: &Blocks, strip: usize) -> (Self, Self) {
        let Self { strips, base, merged, energies } = self;
        let at = blocks.start(strip);
        let (merged, merged_below) = merged.split_at_mut(at - base);
        let (energies, energies_below) = energies.split_at_mut(at - base);
        (
            Part { strips: strips.start..strip, base, merged, energies },
            Part { strips: strip..strips.end, base: at, merged: merged_below, energies: energies_below },
        )
    }
}

/// The strips that no thread has taken yet. A thread that comes late, because its core is busy, leaves more of them to the
/// other.
struct Untaken<'a> {
    blocks: &'a Blocks,
    /// The first strip that is meant for the sweep upwards.
    middle: usize,
    part: Mutex<Part<'a>>,
}

/// A thread that has done its share takes another strip if the other thread has left at least this many: with fewer, that
/// would not end earlier.
const MIN_LEFT: usize = 2;

impl<'a> Untaken<'a> {
    /// All strips, of which those below `middle` are meant for the sweep upwards.
    fn new(blocks: &'a Blocks, volumes: &'a mut Volumes, middle: usize) -> Self {
        let Volumes { merged, energies } = volumes;
        let part = Part { strips: 0..blocks.strips(), base: 0, merged, energies };
        Self { blocks, middle, part: Mutex::new(part) }
    }

    /// The first strip, or the last for a sweep upwards; `None` if the other sweep does the rest.
    fn take(&self, sweep: Sweep) -> Option<Part<'a>> {
        // A panic of the other thread ends the frame; here it changes nothing.
        let mut untaken = self.part.lock().unwrap_or_else(PoisonError::into_inner);
        let Range { start, end } = untaken.strips;
        let is_own = if sweep == Sweep::Down { start < self.middle } else { end > self.middle };
        if end - start < if is_own { 1 } else { MIN_LEFT } {
            return None;
        }
        let part = std::mem::take(&mut *untaken);
        let taken;
        (taken, *untaken) = match sweep {
            Sweep::Down => part.split(self.blocks, start + 1),
            Sweep::Up => {
                let (others, last) = part.split(self.blocks, end - 1);
                (last, others)
            }
        };
        Some(taken)
    }
}

impl Scale {
    /// The rows of some strips.
    fn rows(&self, strips: Range<usize>) -> Range<usize> {
        strips.start * STRIP..(strips.end * STRIP).min(self.height)
    }

    /// First sweep of layer 2 over the strips that this thread takes: stores its sums. Computes layer 1 of each strip just
    /// before, if it is given the pair. Returns the number of strips; `None` if the scale is abandoned.
    fn start(
        &self,
        worker: &mut Worker,
        sweep: Sweep,
        pair: Option<(GreyView<'_>, GreyView<'_>)>,
        untaken: &Untaken<'_>,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Option<usize> {
        worker.start_paths(self.edge);
        let mut taken = 0;
        while let Some(Part { strips, base, merged, energies }) = untaken.take(sweep) {
            if !go_on() {
                return None;
            }
            let (strip, rows) = (strips.start, sweep.order(self.rows(strips)));
            let mut own = std::mem::take(&mut worker.merged);
            let is_own = pair.is_some() && !own.is_empty();
            if let Some(pair) = pair {
                let merged = if is_own { &mut own } else { &mut *merged };
                self.first_layer(worker, strip, pair, merged, energies);
            }
            let mut sums;
            let data: &[Lanes] = if is_own {
                sums = Sums::StreamBoth { sums: energies, data: merged };
                &own
            } else {
                sums = worker.sums(energies);
                merged
            };
            for y in rows {
                let from = sweep.before(y, self.height);
                advance_row_at(self.level, self, worker, from, y, data, base, &mut sums, base);
            }
            worker.merged = own;
            taken += 1;
        }
        Some(taken)
    }

    /// Last sweep of layer 2 over some strips: completes the sums of the first, which start at vector `base` of their
    /// volume, row by row. Returns false if the scale is abandoned.
    fn complete(
        &self,
        worker: &mut Worker,
        sweep: Sweep,
        strips: Range<usize>,
        (merged, energies, base): (&[Lanes], &[Lanes], usize),
        go_on: &mut dyn FnMut() -> bool,
        mut take: impl FnMut(EnergyRow<'_>),
    ) -> bool {
        let mut sums = Sums::Finish(energies);
        for strip in sweep.order(strips) {
            if !go_on() {
                return false;
            }
            for y in sweep.order(self.rows(strip..strip + 1)) {
                let from = sweep.before(y, self.height);
                advance_row_at(self.level, self, worker, from, y, merged, 0, &mut sums, base);
                take(EnergyRow::new(y, self.blocks.strip(strip), &worker.finished, merged));
            }
        }
        true
    }

    /// Layer 1 of a strip; both volumes start at the strip.
    fn first_layer(
        &self,
        worker: &mut Worker,
        strip: usize,
        pair: (GreyView<'_>, GreyView<'_>),
        merged: &mut [Lanes],
        energies: &mut [Lanes],
    ) {
        worker.cost.start(pair.0, pair.1, strip * STRIP);
        let mut own = std::mem::take(&mut worker.costs);
        let costs = if own.is_empty() { energies } else { &mut own };
        horizontal_layer_at(self.level, self, worker, strip, merged, self.blocks.start(strip), costs);
        worker.costs = own;
    }

    /// Layer 1 of all strips on all threads.
    fn first_layers(&self, crew: &mut [Worker], pair: (GreyView<'_>, GreyView<'_>), untaken: &Untaken<'_>) {
        match crew {
            [] => {}
            [worker] => {
                while let Some(Part { strips, merged, energies, .. }) = untaken.take(Sweep::Down) {
                    self.first_layer(worker, strips.start, pair, merged, energies);
                }
            }
            several => {
                let (first, second) = several.split_at_mut(several.len() / 2);
                both(|| self.first_layers(first, pair, untaken), || self.first_layers(second, pair, untaken));
            }
        }
    }

    fn solve_alone<U, L: FnMut(EnergyRow<'_>)>(
        &self,
        worker: &mut Worker,
        pair: (GreyView<'_>, GreyView<'_>),
        volumes: &mut Volumes,
        go_on: &mut dyn FnMut() -> bool,
        receive: impl FnOnce(usize) -> (U, L),
    ) -> bool {
        let untaken = Untaken::new(&self.blocks, volumes, self.blocks.strips());
        if self.start(worker, Sweep::Down, Some(pair), &untaken, go_on).is_none() {
            return false;
        }
        worker.start_paths(self.edge);
        let (strips, volumes) = (0..self.blocks.strips(), (&volumes.merged[..], &volumes.energies[..], 0));
        let (_, receiver) = receive(0);
        self.complete(worker, Sweep::Up, strips, volumes, go_on, receiver)
    }

    fn solve_together<U: FnMut(EnergyRow<'_>) + Send, L: FnMut(EnergyRow<'_>) + Send>(
        &self,
        crew: &mut [Worker],
        pair: (GreyView<'_>, GreyView<'_>),
        volumes: &mut Volumes,
        go_on: &mut (dyn FnMut() -> bool + Send),
        receive: impl FnOnce(usize) -> (U, L),
    ) -> bool {
        // At least once: this thread may take no strip, if it comes late.
        if !go_on() {
            return false;
        }
        let has_helpers = crew.len() > 2;
        if has_helpers {
            self.first_layers(crew, pair, &Untaken::new(&self.blocks, volumes, self.blocks.strips()));
        }
        let pair = Some(pair).filter(|_| !has_helpers);
        let [down, up, ..] = crew else { return false };
        // One thread asks, both stop.
        let stopped = AtomicBool::new(false);
        let mut ask = || {
            let stop = !go_on();
            stopped.fetch_or(stop, Relaxed);
            !stop
        };
        let mut heed = || !stopped.load(Relaxed);
        let untaken = Untaken::new(&self.blocks, volumes, self.blocks.middle());
        let taken = both(
            || self.start(down, Sweep::Down, pair, &untaken, &mut ask),
            || self.start(up, Sweep::Up, pair, &untaken, &mut heed),
        );
        let (Some(above), Some(below)) = taken else { return false };
        // The threads keep their strips and exchange the paths: a core reads the volumes that it has written, which are
        // near to it. With the strips exchanged, both sweeps took up to 1.4 times as long.
        let (middle, cut) = (self.rows(0..above).end, self.blocks.start(above));
        let (merged, (sums_above, sums_below)) = (&volumes.merged[..], volumes.energies.split_at(cut));
        let (upper, lower) = receive(middle);
        let (above, below) = (0..above, above..above + below);
        let done = both(
            || self.complete(up, Sweep::Up, above, (merged, sums_above, 0), &mut ask, upper),
            || self.complete(down, Sweep::Down, below, (merged, sums_below, cut), &mut heed, lower),
        );
        done == (true, true)
    }
}

#[cfg(test)]
mod tests;
