//! Multi-Path-Viterbi of one scale: computes the energies of all nodes of the search windows from a pair
//! (paper, section 3.2).
//!
//! Layer 1 is horizontal. Strips of 32 rows are transposed so that one vector holds the same column of
//! all rows. Rightward and leftward paths are merged to their minimum H, which preserves depth edges.
//! Layer 2 takes H as its data term and runs the vertical and both diagonal paths together, downwards
//! and then upwards, with 32 columns in a vector. The final energy is H plus the jump costs of the six
//! paths. H counts once, not once per path, so a path that agrees with H adds nothing.
//! This takes one horizontal and two vertical sweeps over two volumes of one byte per node.

use super::blocks::Block;
use super::cost::{CostParameters, STRIP};
use super::energy::{EnergyRow, Volumes};
use super::scale::{PathParameters, Scale};
use super::worker::{Sums, Worker, advance_row_at, horizontal_layer_at};
use crate::image::GreyView;
use crate::simd::{Lanes, Level};

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
        if let [alone] = &mut self.workers[..] {
            alone.merged = vec![Lanes::ZERO; most];
        }
    }

    /// Bytes of memory that the workspace holds, without the volumes.
    pub fn bytes(&self) -> usize {
        self.workers.iter().map(Worker::bytes).sum::<usize>() + self.scale.bytes()
    }

    /// Computes the final energies. `upper` receives the rows above [`Scale::middle`], from the last to
    /// the first; `lower` receives the other rows, in either direction. `go_on` is called repeatedly; once
    /// it returns false, the scale is abandoned and false is returned.
    ///
    /// With several threads, each processes some strips of layer 1. In layer 2 one thread sweeps down and
    /// one sweeps up, each over the whole image; after they have passed each other, each completes the
    /// sums that the other has started. The sums are the same for any number of threads.
    ///
    /// # Panics
    /// If the images have another size than the workspace, or the volumes are smaller than
    /// [`Blocks::vectors`](super::blocks::Blocks::vectors).
    pub fn solve(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        volumes: &mut Volumes,
        go_on: &mut dyn FnMut() -> bool,
        upper: impl FnMut(EnergyRow<'_>) + Send,
        lower: impl FnMut(EnergyRow<'_>) + Send,
    ) -> bool {
        for image in [&left, &right] {
            assert_eq!((image.width(), image.height()), (self.scale.width, self.scale.height));
        }
        assert!(volumes.vectors() >= self.scale.blocks.vectors());
        self.scale.take_guide(left);
        let Self { scale, workers } = self;
        match &mut workers[..] {
            [] => false,
            [worker] => scale.solve_alone(worker, (left, right), volumes, go_on, upper, lower),
            crew => scale.solve_together(crew, (left, right), volumes, go_on, upper, lower),
        }
    }
}

impl Scale {
    fn solve_alone(
        &self,
        worker: &mut Worker,
        pair: (GreyView<'_>, GreyView<'_>),
        volumes: &mut Volumes,
        go_on: &mut dyn FnMut() -> bool,
        mut upper: impl FnMut(EnergyRow<'_>),
        mut lower: impl FnMut(EnergyRow<'_>),
    ) -> bool {
        let Volumes { merged, energies } = volumes;
        worker.start_paths(self.edge);
        for strip in 0..self.blocks.strips() {
            if !go_on() {
                return false;
            }
            worker.cost.start(pair.0, pair.1, strip * STRIP);
            let rows = strip * STRIP..((strip + 1) * STRIP).min(self.height);
            let start = self.blocks.strip(strip)[0].at;
            let mut own = std::mem::take(&mut worker.merged);
            if own.is_empty() {
                self.first_layer(worker, strip, merged, energies, 0);
                let mut sums = worker.sums(energies);
                for y in rows {
                    advance_row_at(self.level, self, worker, y.checked_sub(1), y, merged, 0, &mut sums, 0);
                }
            } else {
                self.first_layer(worker, strip, &mut own, energies, start);
                let mut sums = Sums::StreamBoth { sums: &mut *energies, data: &mut *merged };
                for y in rows {
                    advance_row_at(self.level, self, worker, y.checked_sub(1), y, &own, start, &mut sums, 0);
                }
            }
            worker.merged = own;
        }
        worker.start_paths(self.edge);
        let mut sums = Sums::Finish(energies);
        for y in (0..self.height).rev() {
            if y % STRIP == 0 && !go_on() {
                return false;
            }
            let from = (y + 1 < self.height).then_some(y + 1);
            advance_row_at(self.level, self, worker, from, y, merged, 0, &mut sums, 0);
            let row = EnergyRow::new(y, self.blocks.strip(y / STRIP), &worker.finished, merged);
            if y < self.middle() { upper(row) } else { lower(row) }
        }
        true
    }

    /// Layer 1 of a strip; both slices of the volumes start at vector `base`.
    fn first_layer(
        &self,
        worker: &mut Worker,
        strip: usize,
        merged: &mut [Lanes],
        energies: &mut [Lanes],
        base: usize,
    ) {
        let mut own = std::mem::take(&mut worker.costs);
        let costs =
            if own.is_empty() { &mut energies[self.blocks.strip(strip)[0].at - base..] } else { &mut own };
        horizontal_layer_at(self.level, self, worker, strip, merged, base, costs);
        worker.costs = own;
    }

    fn solve_together(
        &self,
        crew: &mut [Worker],
        pair: (GreyView<'_>, GreyView<'_>),
        volumes: &mut Volumes,
        go_on: &mut dyn FnMut() -> bool,
        mut upper: impl FnMut(EnergyRow<'_>) + Send,
        mut lower: impl FnMut(EnergyRow<'_>) + Send,
    ) -> bool {
        let strips = self.blocks.strips();
        // First vector of a strip in the volumes.
        let start = |strip: usize| {
            if strip < strips { self.blocks.strip(strip)[0].at } else { self.blocks.vectors() }
        };
        if !go_on() {
            return false;
        }
        let share = strips.div_ceil(crew.len());
        std::thread::scope(|scope| {
            let (mut merged, mut energies) = (&mut volumes.merged[..], &mut volumes.energies[..]);
            for (i, worker) in crew.iter_mut().enumerate() {
                let own = (i * share).min(strips)..((i + 1) * share).min(strips);
                let (base, end) = (start(own.start), start(own.end));
                let (merged_here, energies_here);
                (merged_here, merged) = std::mem::take(&mut merged).split_at_mut(end - base);
                (energies_here, energies) = std::mem::take(&mut energies).split_at_mut(end - base);
                scope.spawn(move || {
                    for strip in own {
                        worker.cost.start(pair.0, pair.1, strip * STRIP);
                        self.first_layer(worker, strip, merged_here, energies_here, base);
                    }
                });
            }
        });
        if !go_on() {
            return false;
        }
        let [down, up, ..] = crew else { return false };
        down.start_paths(self.edge);
        up.start_paths(self.edge);
        let (middle, cut) = (self.middle(), start(strips / 2));
        let merged = &volumes.merged[..];
        let (above, below) = volumes.energies.split_at_mut(cut);
        let descend = |worker: &mut Worker, y: usize, sums: &mut Sums<'_>, base| {
            advance_row_at(self.level, self, worker, y.checked_sub(1), y, merged, 0, sums, base);
        };
        let ascend = |worker: &mut Worker, y: usize, sums: &mut Sums<'_>, base| {
            let from = (y + 1 < self.height).then_some(y + 1);
            advance_row_at(self.level, self, worker, from, y, merged, 0, sums, base);
        };
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut sums = down.sums(above);
                (0..middle).for_each(|y| descend(down, y, &mut sums, 0));
            });
            let mut sums = up.sums(below);
            (middle..self.height).rev().for_each(|y| ascend(up, y, &mut sums, cut));
        });
        if !go_on() {
            return false;
        }
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut sums = Sums::Finish(below);
                for y in middle..self.height {
                    descend(down, y, &mut sums, cut);
                    lower(EnergyRow::new(y, self.blocks.strip(y / STRIP), &down.finished, merged));
                }
            });
            let mut sums = Sums::Finish(above);
            for y in (0..middle).rev() {
                ascend(up, y, &mut sums, 0);
                upper(EnergyRow::new(y, self.blocks.strip(y / STRIP), &up.finished, merged));
            }
        });
        true
    }
}

#[cfg(test)]
mod tests;
