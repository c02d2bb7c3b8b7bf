//! The solver against a reference implementation: every path by exhaustive search, node by node.

use super::super::blocks::Block;
use super::super::cost::CostStrip;
use super::super::scale::EdgeWeight;
use super::super::viterbi::reference_step;
use super::super::worker::slope_step;
use super::*;
use crate::image::GreyImage;
use crate::simd::LANES;
use crate::stereo::Crew;

/// Energies of one pixel's window: (disparity, energy).
type Nodes = Vec<(usize, u8)>;

/// One path through the image: the pixels from `start` on in steps of (dx, dy).
#[allow(clippy::too_many_arguments)]
fn follow(
    scale: &Scale,
    left: &GreyImage,
    data: &[Nodes],
    out: &mut [Vec<u8>],
    start: (i64, i64),
    (dx, dy): (i64, i64),
    weight: EdgeWeight,
    truncation: u8,
) {
    let (width, height) = (scale.width as i64, scale.height as i64);
    let (mut x, mut y) = start;
    let mut before: Option<Nodes> = None;
    while (0..width).contains(&x) && (0..height).contains(&y) {
        let at = (y * width + x) as usize;
        let energies = match &before {
            None => data[at].iter().map(|&(_, e)| e).collect(),
            Some(before) => {
                let grey = |x, y| left.view().at(x as usize, y as usize);
                let edge = grey(x, y).abs_diff(grey(x - dx, y - dy)) >= weight.levels;
                let w = if edge { weight.edge } else { weight.smooth };
                let block = scale.blocks.strip(y as usize / STRIP)[x as usize / LANES];
                // Horizontal paths step by columns, all others by rows.
                let slope = if dy == 0 {
                    slope_step(block.slope_x, (x - dx) as usize, x as usize)
                } else {
                    let slope = block.slope_y + (dx * dy) as i32 * block.slope_x;
                    slope_step(slope, (y - dy) as usize, y as usize)
                };
                reference_step(before, &data[at], w, truncation, slope)
            }
        };
        before = Some(data[at].iter().zip(&energies).map(|(&(d, _), &e)| (d, e)).collect());
        out[at] = energies;
        (x, y) = (x + dx, y + dy);
    }
}

/// All paths of one direction, which start at the border of the image.
fn direction(
    scale: &Scale,
    left: &GreyImage,
    data: &[Nodes],
    step: (i64, i64),
    weight: EdgeWeight,
    truncation: u8,
) -> Vec<Vec<u8>> {
    let mut out = vec![Vec::new(); data.len()];
    let (width, height) = (scale.width as i64, scale.height as i64);
    for y in 0..height {
        for x in 0..width {
            let (px, py) = (x - step.0, y - step.1);
            if !((0..width).contains(&px) && (0..height).contains(&py)) {
                follow(scale, left, data, &mut out, (x, y), step, weight, truncation);
            }
        }
    }
    out
}

fn reference(scale: &Scale, left: &GreyImage, right: &GreyImage) -> Vec<Nodes> {
    let (width, height) = (scale.width, scale.height);
    let mut cost = CostStrip::new(CostParameters::default(), Level::PLAIN, width, scale.blocks.disparities());
    let mut costs: Vec<Nodes> = vec![Vec::new(); width * height];
    for strip in 0..scale.blocks.strips() {
        cost.start(left.view(), right.view(), strip * STRIP);
        for (tile, block) in scale.blocks.strip(strip).iter().enumerate() {
            let n = block.span();
            let mut out = vec![Lanes::ZERO; STRIP * n];
            cost.tile(tile * LANES, block.low, n, n, &mut out);
            for row in 0..STRIP.min(height - strip * STRIP) {
                for lane in 0..LANES.min(width - tile * LANES) {
                    costs[(strip * STRIP + row) * width + tile * LANES + lane] =
                        (0..n).map(|d| (block.low + d, out[row * n + d].0[lane])).collect();
                }
            }
        }
    }
    let p = &scale.parameters;
    let run =
        |data: &[Nodes], step, weight, truncation| direction(scale, left, data, step, weight, truncation);
    let rightward = run(&costs, (1, 0), scale.horizontal, p.truncation_horizontal);
    let leftward = run(&costs, (-1, 0), scale.horizontal, p.truncation_horizontal);
    let merged: Vec<Nodes> = costs
        .iter()
        .zip(rightward.iter().zip(&leftward))
        .map(|(nodes, (a, b))| {
            nodes.iter().zip(a.iter().zip(b)).map(|(&(d, _), (a, b))| (d, *a.min(b))).collect()
        })
        .collect();
    let mut total: Vec<Vec<u32>> =
        merged.iter().map(|nodes| nodes.iter().map(|&(_, e)| u32::from(e)).collect()).collect();
    for (dx, weight) in [(0, scale.others[0]), (1, scale.others[1]), (-1, scale.others[2])] {
        for dy in [1, -1] {
            let paths = run(&merged, (dx, dy), weight, p.truncation_other);
            for ((total, path), nodes) in total.iter_mut().zip(&paths).zip(&merged) {
                for ((total, e), (_, merged)) in total.iter_mut().zip(path).zip(nodes) {
                    *total += u32::from(*e) - u32::from(*merged);
                }
            }
        }
    }
    merged
        .iter()
        .zip(&total)
        .map(|(nodes, total)| nodes.iter().zip(total).map(|(&(d, _), &e)| (d, e.min(255) as u8)).collect())
        .collect()
}

#[test]
fn final_energies_equal_the_reference_at_every_level() {
    let mut random = fastrand::Rng::with_seed(4);
    let sizes = [(70, 40, 9), (31, 33, 20), (8, 70, 5), (40, 8, 40), (97, 65, 12)];
    for (round, (width, height, disparities)) in sizes.into_iter().enumerate() {
        let image = |random: &mut fastrand::Rng| {
            let mut image = GreyImage::new(width, height);
            image.as_mut_slice().iter_mut().for_each(|v| *v = random.u8(80..130));
            image
        };
        let (left, right) = (image(&mut random), image(&mut random));
        let parameters =
            PathParameters { truncation_other: 40, edge_percent: 60, ..PathParameters::default() };
        let cost = CostParameters::default();
        let mut expected: Option<Vec<Nodes>> = None;
        let seed = random.u64(..);
        let levels = Level::available().into_iter();
        let ways = [(1, false), (1, true), (2, false), (2, true), (3, true)];
        for (level, (threads, spare)) in levels.flat_map(|level| ways.map(|way| (level, way))) {
            let mut solver = Solver::new(cost, parameters, level, width, height, disparities, threads);
            if round > 0 {
                // Random windows and slopes, the same for all levels.
                let mut random = fastrand::Rng::with_seed(seed);
                solver.scale.blocks.set_all(|block: &mut Block| {
                    block.low = random.usize(0..disparities);
                    block.high = random.usize(block.low + 1..=disparities);
                    block.slope_x = random.i32(-128..=128);
                    block.slope_y = random.i32(-128..=128);
                });
            }
            if spare {
                solver.spare_caches();
            }
            let mut volumes = Volumes::new(solver.scale.blocks.vectors());
            let mut got: Vec<Nodes> = vec![Vec::new(); width * height];
            // Twice: the first run must leave no state behind.
            for _ in 0..2 {
                let got_rows = std::sync::Mutex::new(&mut got);
                let take = |row: EnergyRow<'_>| {
                    let mut got = got_rows.lock().unwrap();
                    for x in 0..width {
                        let low = row.blocks[x / LANES].low;
                        let nodes = row.nodes(x / LANES).iter().enumerate();
                        got[row.y * width + x] = nodes.map(|(d, e)| (low + d, e.0[x % LANES])).collect();
                    }
                };
                let (l, r) = (left.view(), right.view());
                let crew = Crew::new(threads, |_| ()).unwrap();
                assert!(crew.lead(|| solver.solve(l, r, &mut volumes, &mut || true, |_| (take, take))));
                let expected = expected.get_or_insert_with(|| reference(&solver.scale, &left, &right));
                for (i, (got, expected)) in got.iter().zip(expected.iter()).enumerate() {
                    assert_eq!(
                        got,
                        expected,
                        "pixel {i} of {width}x{height}, {} on {threads}, {spare}",
                        level.name()
                    );
                }
            }
        }
    }
}

#[test]
fn a_thread_takes_strips_of_the_other_only_if_that_is_far_behind() {
    let blocks = Blocks::new(64, 6 * STRIP, 8);
    let mut volumes = Volumes::new(blocks.vectors());
    let strip = |part: Part<'_>| {
        assert_eq!((part.strips.len(), part.base), (1, blocks.start(part.strips.start)));
        assert_eq!(part.merged.len(), blocks.start(part.strips.end) - part.base);
        part.strips.start
    };
    let untaken = Untaken::new(&blocks, &mut volumes, 2);
    let mut take = |sweep| untaken.take(sweep).map(strip);
    // Two strips are meant for the sweep downwards; the other has only begun.
    assert_eq!([Sweep::Down, Sweep::Up, Sweep::Down].map(&mut take), [Some(0), Some(5), Some(1)]);
    assert_eq!([Sweep::Down, Sweep::Down].map(&mut take), [Some(2), Some(3)]);
    assert_eq!([Sweep::Down, Sweep::Up, Sweep::Up].map(&mut take), [None, Some(4), None]);
}
