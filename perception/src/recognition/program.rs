//! A cascade compiled for one [`Layout`] of integral images, and the kernels that evaluate it on the windows of
//! an image: 32 neighbouring windows at a time while several of them are still candidates, one by one when few
//! are left. Results equal those of [`Cascade::stages_passed`].

use super::cascade::{Branch, Cascade, Contrast, Features, HaarFeature, LbpFeature, Node, Split};
use super::integral::{Layout, Sum};
use crate::simd::{LANES, Lanes, Simd, kernel};

/// Maximum number of nodes plus leaves of a small tree; larger trees are evaluated window by window.
const SMALL_TREE: usize = 16;

/// Below this number of candidates windows are evaluated one by one.
const MIN_VECTOR_CANDIDATES: u32 = 4;

/// A decision of a compiled tree. A branch is the index of a node, or the number of nodes plus the index of a
/// leaf.
#[derive(Clone, Copy, Debug)]
struct Step<T> {
    test: T,
    left: u16,
    right: u16,
}

#[derive(Clone, Copy, Debug)]
struct Tree {
    /// Index of its first step.
    first: usize,
    /// Number of steps.
    count: u16,
    /// Index of its first value: one for each node (0, unused), then one for each leaf.
    values: usize,
}

#[derive(Clone, Copy, Debug)]
struct StageRange {
    trees: (usize, usize),
    min_sum: f64,
    /// The stage starts with the trees of the previous stage, so its sum continues from that stage's sum.
    continues: bool,
}

/// The compiled cascade; `T` is the type of its decision tests.
#[derive(Clone, Debug)]
pub(super) struct Program<T> {
    stages: Vec<StageRange>,
    trees: Vec<Tree>,
    steps: Vec<Step<T>>,
    values: Vec<f64>,
    /// Whether all trees are small; see [`SMALL_TREE`].
    small: bool,
}

/// A decision test on integral images.
pub(super) trait Test: Copy {
    /// The integral images.
    type Planes<'a>: Copy;
    /// Values computed once for 32 windows.
    type Tile;

    /// Prepares the 32 windows from entry `at` on: shared values, and a bit mask of the windows with enough
    /// contrast.
    fn tile(planes: Self::Planes<'_>, at: usize) -> (Self::Tile, u32);
    /// 255 for those of the first `N` windows that go left.
    fn lanes<S: Simd, const N: usize>(
        &self,
        simd: S,
        planes: Self::Planes<'_>,
        tile: &Self::Tile,
        at: usize,
    ) -> S::Bytes;
    /// Whether window `lane` goes left.
    fn one(&self, planes: Self::Planes<'_>, tile: &Self::Tile, at: usize, lane: usize) -> bool;
}

/// The test of an LBP feature.
#[derive(Clone, Copy, Debug)]
pub(super) struct LbpTest<T> {
    set: Lanes,
    columns: [u32; 4],
    top: u32,
    down: u32,
    sum: std::marker::PhantomData<T>,
}

impl<T: Sum> LbpTest<T> {
    fn new(feature: &LbpFeature, split: &Split, layout: Layout) -> Self {
        let mut set = Lanes::ZERO;
        for code in (0..=255).filter(|&code| split.has(code)) {
            set.0[usize::from(code >> 3)] |= 1 << (code & 7);
        }
        let column = |i: u16| layout.index(usize::from(feature.x + i * feature.width), 0) as u32;
        Self {
            set,
            columns: [column(0), column(1), column(2), column(3)],
            top: layout.index(0, feature.y.into()) as u32,
            down: layout.index(0, feature.height.into()) as u32,
            sum: std::marker::PhantomData,
        }
    }

    /// Index of row `j` of the block corners.
    #[inline(always)]
    fn row(&self, at: usize, j: u32) -> usize {
        at + (self.top + j * self.down) as usize
    }
}

impl<T: Sum> Test for LbpTest<T> {
    type Planes<'a> = &'a [T];
    type Tile = ();

    #[inline(always)]
    fn tile(_: &[T], _: usize) -> ((), u32) {
        ((), u32::MAX)
    }

    #[inline(always)]
    fn lanes<S: Simd, const N: usize>(&self, simd: S, sums: &[T], (): &(), at: usize) -> S::Bytes {
        macro_rules! corners {
            ($j:expr) => {{
                let row = &sums[self.row(at, $j)..];
                [
                    &row[self.columns[0] as usize..][..N],
                    &row[self.columns[1] as usize..][..N],
                    &row[self.columns[2] as usize..][..N],
                    &row[self.columns[3] as usize..][..N],
                ]
            }};
        }
        let (a, b, c, d) = (corners!(0), corners!(1), corners!(2), corners!(3));
        let mut codes = Lanes::ZERO;
        for i in 0..N {
            // Differences along the four rows of corners, then between rows, give the nine block sums.
            let (a0, a1, a2) = (a[1][i].minus(a[0][i]), a[2][i].minus(a[1][i]), a[3][i].minus(a[2][i]));
            let (b0, b1, b2) = (b[1][i].minus(b[0][i]), b[2][i].minus(b[1][i]), b[3][i].minus(b[2][i]));
            let (c0, c1, c2) = (c[1][i].minus(c[0][i]), c[2][i].minus(c[1][i]), c[3][i].minus(c[2][i]));
            let (d0, d1, d2) = (d[1][i].minus(d[0][i]), d[2][i].minus(d[1][i]), d[3][i].minus(d[2][i]));
            let centre = c1.minus(b1);
            let mut code = T::default();
            code = code.plus(if b0.minus(a0) >= centre { T::of(128) } else { T::default() });
            code = code.plus(if b1.minus(a1) >= centre { T::of(64) } else { T::default() });
            code = code.plus(if b2.minus(a2) >= centre { T::of(32) } else { T::default() });
            code = code.plus(if c2.minus(b2) >= centre { T::of(16) } else { T::default() });
            code = code.plus(if d2.minus(c2) >= centre { T::of(8) } else { T::default() });
            code = code.plus(if d1.minus(c1) >= centre { T::of(4) } else { T::default() });
            code = code.plus(if d0.minus(c0) >= centre { T::of(2) } else { T::default() });
            code = code.plus(if c0.minus(b0) >= centre { T::of(1) } else { T::default() });
            codes.0[i] = code.byte();
        }
        simd.contains(&self.set, simd.load(&codes))
    }

    #[inline(always)]
    fn one(&self, sums: &[T], (): &(), at: usize, lane: usize) -> bool {
        let mut corners = [[T::default(); 4]; 4];
        for (j, corners) in corners.iter_mut().enumerate() {
            let row = &sums[self.row(at + lane, j as u32)..];
            for (corner, &column) in corners.iter_mut().zip(&self.columns) {
                *corner = row[column as usize];
            }
        }
        let block = |i: usize, j: usize| {
            let (upper, lower) = (&corners[j], &corners[j + 1]);
            lower[i + 1].minus(lower[i]).minus(upper[i + 1].minus(upper[i]))
        };
        let centre = block(1, 1);
        let code = u8::from(block(0, 0) >= centre) << 7
            | u8::from(block(1, 0) >= centre) << 6
            | u8::from(block(2, 0) >= centre) << 5
            | u8::from(block(2, 1) >= centre) << 4
            | u8::from(block(2, 2) >= centre) << 3
            | u8::from(block(1, 2) >= centre) << 2
            | u8::from(block(0, 2) >= centre) << 1
            | u8::from(block(0, 1) >= centre);
        self.set.0[usize::from(code >> 3)] >> (code & 7) & 1 == 1
    }
}

/// The integral images of a Haar cascade.
#[derive(Clone, Copy, Debug)]
pub(super) struct HaarPlanes<'a> {
    /// Sums.
    pub sums: &'a [u32],
    /// Sums of squares.
    pub squares: &'a [u32],
    /// Tilted sums; empty if no feature is tilted.
    pub tilted: &'a [u32],
    /// Corners of the rectangle over which the contrast is measured.
    pub inner: [u32; 4],
    /// Its area.
    pub area: f64,
}

/// The test of a Haar feature.
#[derive(Clone, Copy, Debug)]
pub(super) struct HaarTest {
    corners: [[u32; 4]; 3],
    weights: [f32; 3],
    tilted: bool,
    threshold: f32,
}

impl HaarTest {
    fn new(feature: &HaarFeature, split: &Split, layout: Layout) -> Self {
        let corners = feature.rects.map(|r| {
            let (x, y, w, h) =
                (usize::from(r.x), usize::from(r.y), usize::from(r.width), usize::from(r.height));
            let at = |x, y| layout.index(x, y) as u32;
            if r.weight == 0.0 {
                [0; 4]
            } else if feature.tilted {
                [at(x, y), at(x - h, y + h), at(x + w, y + w), at(x + w - h, y + w + h)]
            } else {
                [at(x, y), at(x + w, y), at(x, y + h), at(x + w, y + h)]
            }
        });
        let threshold = match *split {
            Split::Threshold(threshold) => threshold,
            Split::Subset(_) => f32::NEG_INFINITY,
        };
        Self { corners, weights: feature.rects.map(|r| r.weight), tilted: feature.tilted, threshold }
    }

    #[inline(always)]
    fn plane<'a>(&self, planes: &HaarPlanes<'a>) -> &'a [u32] {
        if self.tilted { planes.tilted } else { planes.sums }
    }
}

/// Corners of the rectangle over which the contrast of a window is measured.
pub(super) fn inner_corners(width: u16, height: u16, layout: Layout) -> [u32; 4] {
    let (right, bottom) = (usize::from(width) - 1, usize::from(height) - 1);
    [(1, 1), (right, 1), (1, bottom), (right, bottom)].map(|(x, y)| layout.index(x, y) as u32)
}

#[inline(always)]
fn four(table: &[u32], at: usize, corners: &[u32; 4]) -> u32 {
    table[at + corners[0] as usize]
        .wrapping_sub(table[at + corners[1] as usize])
        .wrapping_sub(table[at + corners[2] as usize])
        .wrapping_add(table[at + corners[3] as usize])
}

macro_rules! four_lanes {
    ($table:expr, $at:expr, $corners:expr, $count:expr) => {{
        let table = &$table[$at..];
        [
            &table[$corners[0] as usize..][..$count],
            &table[$corners[1] as usize..][..$count],
            &table[$corners[2] as usize..][..$count],
            &table[$corners[3] as usize..][..$count],
        ]
    }};
}

impl Test for HaarTest {
    type Planes<'a> = HaarPlanes<'a>;
    /// [`Contrast::inverse`] of each window.
    type Tile = [f32; LANES];

    #[inline(always)]
    fn tile(planes: HaarPlanes<'_>, at: usize) -> ([f32; LANES], u32) {
        let s = four_lanes!(planes.sums, at, planes.inner, LANES);
        let q = four_lanes!(planes.squares, at, planes.inner, LANES);
        let (mut inverse, mut sound) = ([0.0; LANES], 0);
        for i in 0..LANES {
            let sum = s[0][i].wrapping_sub(s[1][i]).wrapping_sub(s[2][i]).wrapping_add(s[3][i]);
            let squares = q[0][i].wrapping_sub(q[1][i]).wrapping_sub(q[2][i]).wrapping_add(q[3][i]);
            let contrast = Contrast::new(sum, squares, planes.area);
            inverse[i] = contrast.inverse;
            sound |= u32::from(contrast.sound) << i;
        }
        (inverse, sound)
    }

    #[inline(always)]
    fn lanes<S: Simd, const N: usize>(
        &self,
        simd: S,
        planes: HaarPlanes<'_>,
        inverse: &[f32; LANES],
        at: usize,
    ) -> S::Bytes {
        let table = self.plane(&planes);
        let a = four_lanes!(table, at, self.corners[0], N);
        let b = four_lanes!(table, at, self.corners[1], N);
        let mut value = [0.0_f32; N];
        for i in 0..N {
            let first = a[0][i].wrapping_sub(a[1][i]).wrapping_sub(a[2][i]).wrapping_add(a[3][i]);
            let second = b[0][i].wrapping_sub(b[1][i]).wrapping_sub(b[2][i]).wrapping_add(b[3][i]);
            value[i] = self.weights[0] * first as i32 as f32 + self.weights[1] * second as i32 as f32;
        }
        if self.weights[2] != 0.0 {
            let c = four_lanes!(table, at, self.corners[2], N);
            for i in 0..N {
                let third = c[0][i].wrapping_sub(c[1][i]).wrapping_sub(c[2][i]).wrapping_add(c[3][i]);
                value[i] += self.weights[2] * third as i32 as f32;
            }
        }
        let mut below = Lanes::ZERO;
        for i in 0..N {
            below.0[i] = if value[i] * inverse[i] < self.threshold { 255 } else { 0 };
        }
        simd.load(&below)
    }

    #[inline(always)]
    fn one(&self, planes: HaarPlanes<'_>, inverse: &[f32; LANES], at: usize, lane: usize) -> bool {
        let table = self.plane(&planes);
        let part = |i: usize| self.weights[i] * four(table, at + lane, &self.corners[i]) as i32 as f32;
        let mut value = part(0) + part(1);
        if self.weights[2] != 0.0 {
            value += part(2);
        }
        value * inverse[lane] < self.threshold
    }
}

impl<T> Program<T> {
    fn compile(cascade: &Cascade, mut test: impl FnMut(&Node) -> T) -> Self {
        let mut program = Self {
            stages: Vec::new(),
            trees: Vec::new(),
            steps: Vec::new(),
            values: Vec::new(),
            small: true,
        };
        let mut before: &[Vec<Node>] = &[];
        for stage in &cascade.stages {
            let first_tree = program.trees.len();
            // Trees of the previous stage are not evaluated again.
            let continues = !before.is_empty() && stage.trees.starts_with(before);
            for nodes in &stage.trees[if continues { before.len() } else { 0 }..] {
                program.trees.push(Tree {
                    first: program.steps.len(),
                    count: nodes.len() as u16,
                    values: program.values.len(),
                });
                program.values.extend(nodes.iter().map(|_| 0.0));
                let mut next = nodes.len() as u16;
                for node in nodes {
                    let mut branch = |branch: Branch| match branch {
                        Branch::Node(n) => n,
                        Branch::Leaf(value) => {
                            program.values.push(value.into());
                            next += 1;
                            next - 1
                        }
                    };
                    let (left, right) = (branch(node.left), branch(node.right));
                    program.steps.push(Step { test: test(node), left, right });
                }
                program.small &= usize::from(next) <= SMALL_TREE;
            }
            let min_sum = stage.min_sum();
            program.stages.push(StageRange { trees: (first_tree, program.trees.len()), min_sum, continues });
            before = &stage.trees;
        }
        // Padding: small trees always read sixteen values.
        program.values.extend([0.0; SMALL_TREE]);
        program
    }
}

impl<T: Sum> Program<LbpTest<T>> {
    /// Compiles an LBP cascade.
    pub fn lbp(cascade: &Cascade, features: &[LbpFeature], layout: Layout) -> Self {
        Self::compile(cascade, |node| LbpTest::new(&features[node.feature as usize], &node.split, layout))
    }
}

impl Program<HaarTest> {
    /// Compiles a Haar cascade.
    pub fn haar(cascade: &Cascade, features: &[HaarFeature], layout: Layout) -> Self {
        Self::compile(cascade, |node| HaarTest::new(&features[node.feature as usize], &node.split, layout))
    }
}

/// Whether a cascade has tilted Haar features.
pub(super) fn has_tilted(cascade: &Cascade) -> bool {
    matches!(&cascade.features, Features::Haar(features) if features.iter().any(|f| f.tilted))
}

/// The windows of a layout that are scanned.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// Windows in a row.
    pub columns: usize,
    /// Rows of windows.
    pub rows: usize,
    /// Entries from one row of windows to the next.
    pub down: usize,
    /// A window that fails the first stage also excludes its right neighbour (OpenCV's rule).
    pub skip: bool,
    /// Maximum number of hits.
    pub max_hits: usize,
}

/// Bit mask of those of the first `N` windows of a tile that pass a stage.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn stage_lanes<S: Simd, T: Test, const N: usize>(
    simd: S,
    program: &Program<T>,
    stage: &StageRange,
    planes: T::Planes<'_>,
    tile: &T::Tile,
    at: usize,
    sums: &mut [f64; LANES],
) -> u32 {
    let yes = simd.splat(255);
    if !stage.continues {
        *sums = [0.0; LANES];
    }
    for tree in &program.trees[stage.trees.0..stage.trees.1] {
        let steps = &program.steps[tree.first..][..usize::from(tree.count)];
        let mut place = simd.splat(0);
        for (i, step) in steps.iter().enumerate() {
            let goes_left = step.test.lanes::<S, N>(simd, planes, tile, at);
            let next =
                simd.select_equal(goes_left, yes, simd.splat(step.left as u8), simd.splat(step.right as u8));
            place = simd.select_equal(place, simd.splat(i as u8), next, place);
        }
        let mut places = Lanes::ZERO;
        simd.store(place, &mut places);
        let values = &program.values[tree.values..][..SMALL_TREE];
        for i in 0..N {
            sums[i] += values[usize::from(places.0[i]) % SMALL_TREE];
        }
    }
    let mut passed = 0;
    for i in 0..N {
        passed |= u32::from(sums[i] >= stage.min_sum) << i;
    }
    passed
}

/// The same for the first `count` windows; evaluates only half a tile if that is enough.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn stage<S: Simd, T: Test>(
    simd: S,
    program: &Program<T>,
    stage: &StageRange,
    planes: T::Planes<'_>,
    tile: &T::Tile,
    at: usize,
    count: usize,
    sums: &mut [f64; LANES],
) -> u32 {
    if count <= LANES / 2 {
        stage_lanes::<S, T, { LANES / 2 }>(simd, program, stage, planes, tile, at, sums)
    } else {
        stage_lanes::<S, T, LANES>(simd, program, stage, planes, tile, at, sums)
    }
}

/// Whether window `lane` of a tile passes a stage.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn stage_one<T: Test>(
    program: &Program<T>,
    stage: &StageRange,
    planes: T::Planes<'_>,
    tile: &T::Tile,
    at: usize,
    lane: usize,
    sum: &mut f64,
) -> bool {
    if !stage.continues {
        *sum = 0.0;
    }
    for tree in &program.trees[stage.trees.0..stage.trees.1] {
        let mut place = 0_u16;
        while place < tree.count {
            let step = &program.steps[tree.first + usize::from(place)];
            place = if step.test.one(planes, tile, at, lane) { step.left } else { step.right };
        }
        *sum += program.values[tree.values + usize::from(place)];
    }
    *sum >= stage.min_sum
}

/// Appends the grid position (column, row) of every window that passes all stages.
#[inline(always)]
fn scan<S: Simd, T: Test>(
    simd: S,
    program: &Program<T>,
    planes: T::Planes<'_>,
    grid: &Grid,
    hits: &mut Vec<(u32, u32)>,
) {
    for row in 0..grid.rows {
        // Number of windows to skip at the start of the tile (0 or 1).
        let mut skipped = 0;
        for column in (0..grid.columns).step_by(LANES) {
            let at = row * grid.down + column;
            let count = LANES.min(grid.columns - column);
            let (tile, sound) = T::tile(planes, at);
            let mut alive = 0_u32;
            let mut sums = [0.0_f64; LANES];
            let mut lane = skipped;
            if program.small {
                let passed = stage(simd, program, &program.stages[0], planes, &tile, at, count, &mut sums);
                let failed = if grid.skip { sound & !passed } else { 0 };
                while lane < count {
                    alive |= 1 << lane;
                    lane += 1 + (failed >> lane & 1) as usize;
                }
                alive &= passed & sound;
            } else {
                while lane < count {
                    let has_contrast = sound >> lane & 1 == 1;
                    let passed = has_contrast
                        && stage_one(program, &program.stages[0], planes, &tile, at, lane, &mut sums[lane]);
                    alive |= u32::from(passed) << lane;
                    lane += 1 + usize::from(has_contrast && !passed && grid.skip);
                }
            }
            skipped = lane - count;
            let mut rest = &program.stages[1..];
            while let [next, later @ ..] = rest
                && program.small
                && alive.count_ones() >= MIN_VECTOR_CANDIDATES
            {
                let last = LANES - alive.leading_zeros() as usize;
                alive &= stage(simd, program, next, planes, &tile, at, last, &mut sums);
                rest = later;
            }
            while alive != 0 {
                let lane = alive.trailing_zeros() as usize;
                alive &= alive - 1;
                if rest
                    .iter()
                    .all(|stage| stage_one(program, stage, planes, &tile, at, lane, &mut sums[lane]))
                {
                    if hits.len() >= grid.max_hits {
                        return;
                    }
                    hits.push(((column + lane) as u32, row as u32));
                }
            }
        }
    }
}

#[inline(always)]
fn narrow<S: Simd>(
    simd: S,
    program: &Program<LbpTest<u16>>,
    sums: &[u16],
    grid: &Grid,
    hits: &mut Vec<(u32, u32)>,
) {
    scan(simd, program, sums, grid, hits);
}

#[inline(always)]
fn wide<S: Simd>(
    simd: S,
    program: &Program<LbpTest<u32>>,
    sums: &[u32],
    grid: &Grid,
    hits: &mut Vec<(u32, u32)>,
) {
    scan(simd, program, sums, grid, hits);
}

#[inline(always)]
fn haar<S: Simd>(
    simd: S,
    program: &Program<HaarTest>,
    planes: HaarPlanes<'_>,
    grid: &Grid,
    hits: &mut Vec<(u32, u32)>,
) {
    scan(simd, program, planes, grid, hits);
}

kernel! {
    /// Scans with an LBP cascade whose block sums fit into 16 bits.
    pub(super) fn scan_narrow(
        program: &Program<LbpTest<u16>>, sums: &[u16], grid: &Grid, hits: &mut Vec<(u32, u32)>,
    ) = narrow
}
kernel! {
    /// Scans with an LBP cascade of any size.
    pub(super) fn scan_wide(
        program: &Program<LbpTest<u32>>, sums: &[u32], grid: &Grid, hits: &mut Vec<(u32, u32)>,
    ) = wide
}
kernel! {
    /// Scans with a Haar cascade.
    pub(super) fn scan_haar(
        program: &Program<HaarTest>, planes: HaarPlanes<'_>, grid: &Grid, hits: &mut Vec<(u32, u32)>,
    ) = haar
}
