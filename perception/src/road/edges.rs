//! Detects the left and right edges of the road: kerbs, verges and anything else that rises beside it.
//!
//! A kerb of 10 cm is within the noise of one row of the disparity map, but it continues along the road.
//! Heights above the road are therefore averaged in cells that are some metres long and 0.2 m wide, and over
//! several frames. In these averages a step of 5 cm stands out. The first step outwards from the vehicle is
//! the edge of the road.
//!
//! Input: a disparity map and the road surface ([`RoadSurface`]). Output: one [`Edge`] for each side and
//! longitudinal segment, in metres and in pixels of the left image.

use super::heights::{BATCH, PixelBatch};
use super::surface::RoadSurface;
use crate::depth::DepthView;
use crate::rig::Rig;
use crate::simd::rounding::truncate_f64;
use crate::simd::{Level, Simd, kernel};

/// Longitudinal segments, each with its own pair of edges.
pub const SEGMENTS: usize = 8;
/// Bounds of the segments, in metres ahead of the camera.
const SEGMENT_BOUNDS_M: [f64; SEGMENTS + 1] = [5.0, 6.5, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.5];
/// Width of a cell in metres, and number of cells on each side of the camera.
const CELL_M: f64 = 0.2;
const CELLS_PER_SIDE: usize = 40;
/// Sampling step in rows and columns, in px.
const STEP: usize = 2;
/// Pixels farther than this from the road height, in metres, belong neither to the road nor to its edge.
const MAX_HEIGHT_M: f64 = 0.5;
/// Exponential forgetting: the weight of the accumulated heights decays by this factor per frame.
const DECAY_PER_FRAME: f32 = 0.8;
/// Columns of a row that are processed as one group.
const GROUP_PIXELS: usize = 16;
/// Fewest pixels for a valid cell.
const MIN_PIXELS: f32 = 6.0;
/// Cells closer to the camera axis than this cannot be an edge: the vehicle drives there.
const MIN_EDGE_CELL: usize = 4;
/// Cells compared on the inner and on the outer side of an edge.
const INNER_CELLS: usize = 5;
const OUTER_CELLS: usize = 3;
/// What lies behind more cells than this of which nothing is known, outwards of the road, is not the road's edge: a parked
/// car hides the ground between. 0.4 m.
const MAX_HIDDEN_CELLS: usize = 2;
/// Smallest mean step of an edge, and smallest distance between the lowest outer and the highest inner cell,
/// in metres.
const MIN_STEP_M: f32 = 0.05;
const MIN_SEPARATION_M: f32 = 0.02;
/// Largest lateral difference to the edge of a neighbouring segment, in metres; an edge without such a
/// neighbour is dropped.
const MAX_NEIGHBOUR_DIFFERENCE_M: f32 = 0.6;

/// Largest distance by which the road becomes wider on one side from one segment to the next, in metres. Behind the low parts of
/// a parked car the next step outwards is something else.
const MAX_WIDENING_M: f32 = 1.0;

/// The edge of the road on one side of a segment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Edge {
    /// Lateral position, in metres right of the camera axis.
    pub lateral_m: f32,
    /// Height of the outside above the inside, in metres.
    pub step_m: f32,
    /// Distance of the centre of the segment, in metres ahead.
    pub distance_m: f32,
    /// Column of the edge in the left image, at the height of the road.
    pub x_px: f32,
    /// Row of the edge in the left image.
    pub y_px: f32,
}

/// Left and right edge of each segment, nearest segment first; `None` where no edge is visible.
pub type Edges = [[Option<Edge>; 2]; SEGMENTS];

/// Finds road edges from accumulated heights; memory is allocated once.
#[derive(Debug)]
pub struct EdgeFinder {
    /// Sum of heights and number of pixels, indexed by segment, side and cell (from the inside out).
    cells: Vec<[f32; 2]>,
    edges: Edges,
    level: Level,
}

impl Default for EdgeFinder {
    fn default() -> Self {
        let cells = vec![[0.0; 2]; SEGMENTS * 2 * CELLS_PER_SIDE];
        Self { cells, edges: Edges::default(), level: Level::best() }
    }
}

impl EdgeFinder {
    /// Drops all edges and the accumulated heights; called when no road is visible.
    pub fn clear(&mut self) {
        self.cells.fill([0.0; 2]);
        self.edges = Edges::default();
    }

    /// Edges of the last frame.
    pub fn edges(&self) -> &Edges {
        &self.edges
    }

    /// Adds the heights of one frame and finds the edges. `top` is the first row of the road in the map.
    pub fn update(
        &mut self,
        depth: DepthView<'_>,
        surface: &RoadSurface,
        rig: &Rig,
        top: usize,
        min_confidence: u8,
    ) {
        for [sum, count] in &mut self.cells {
            *sum *= DECAY_PER_FRAME;
            *count *= DECAY_PER_FRAME;
        }
        let bounds_px = SEGMENT_BOUNDS_M.map(|z| (256.0 * rig.disparity_px(z)).min(65_535.0) as u16);
        let mut pixels = PixelBatch::default();
        for y in (top..depth.height()).step_by(STEP) {
            let row = depth
                .disparity(y)
                .chunks(STEP * GROUP_PIXELS)
                .zip(depth.confidence(y).chunks(STEP * GROUP_PIXELS));
            for (group, (row, confidence)) in row.enumerate() {
                for (i, (d, confidence)) in row.iter().zip(confidence).enumerate().step_by(STEP) {
                    let in_range = (*d < bounds_px[0]) & (*d > bounds_px[SEGMENTS]);
                    let x = STEP * GROUP_PIXELS * group + i;
                    pixels.push(x as f32, y as f32, *d, in_range & (*confidence >= min_confidence));
                }
                if pixels.count() + GROUP_PIXELS > BATCH {
                    self.accumulate(&mut pixels, surface, rig, &bounds_px);
                }
            }
        }
        self.accumulate(&mut pixels, surface, rig, &bounds_px);
        self.edges =
            std::array::from_fn(|segment| [0, 1].map(|side| self.find_edge(segment, side, surface, rig)));
        let all = self.edges;
        for (segment, edges) in self.edges.iter_mut().enumerate() {
            for (side, edge) in edges.iter_mut().enumerate() {
                let neighbour = |other: usize| all.get(other).and_then(|edges| edges[side]);
                *edge = edge.filter(|edge| {
                    let near = [neighbour(segment.wrapping_sub(1)), neighbour(segment + 1)];
                    near.iter()
                        .flatten()
                        .any(|other| (other.lateral_m - edge.lateral_m).abs() <= MAX_NEIGHBOUR_DIFFERENCE_M)
                });
            }
        }
        drop_folds(&mut self.edges);
    }

    /// Adds the heights of a batch of pixels to their cells.
    fn accumulate(
        &mut self,
        pixels: &mut PixelBatch,
        surface: &RoadSurface,
        rig: &Rig,
        bounds_px: &[u16; SEGMENTS + 1],
    ) {
        let mut heights_m = [0.0; BATCH];
        let mut cell_indices = [0; BATCH];
        surface.heights_m(pixels, &mut heights_m);
        assign_cells(self.level, pixels, *rig, bounds_px, &mut cell_indices);
        for (&height_m, &index) in heights_m.iter().zip(&cell_indices).take(pixels.count()) {
            // This form of the comparison rejects NaN.
            if height_m.abs() < MAX_HEIGHT_M
                && let Some(cell) = self.cells.get_mut(usize::from(index))
            {
                cell[0] += height_m as f32;
                cell[1] += 1.0;
            }
        }
        pixels.clear();
    }

    /// Finds the first step from the inside out.
    fn find_edge(&self, segment: usize, side: usize, surface: &RoadSurface, rig: &Rig) -> Option<Edge> {
        let cells = &self.cells[(2 * segment + side) * CELLS_PER_SIDE..][..CELLS_PER_SIDE];
        let height = |i: usize| is_known(&cells[i]).then(|| cells[i][0] / cells[i][1]);
        // Mean height of the inner cells, and the step to the outer cells that begin at cell i.
        let step = |i: usize| {
            let (mut inside, mut known, mut highest) = (0.0, 0, f32::NEG_INFINITY);
            for value in (i.saturating_sub(INNER_CELLS)..i).filter_map(height) {
                inside += value;
                known += 1;
                highest = highest.max(value);
            }
            let (mut outside, mut lowest) = (0.0, f32::INFINITY);
            for i in i..i + OUTER_CELLS {
                let value = height(i)?;
                outside += value / OUTER_CELLS as f32;
                lowest = lowest.min(value);
            }
            let inside = inside / known.max(1) as f32;
            (known + 1 >= i.min(INNER_CELLS)
                && outside - inside >= MIN_STEP_M
                && lowest - highest > MIN_SEPARATION_M)
                .then_some((inside, outside - inside))
        };
        let hidden = hidden_from(cells);
        let first = (MIN_EDGE_CELL..=CELLS_PER_SIDE - OUTER_CELLS)
            .take_while(|&i| i < hidden)
            .find(|&i| step(i).is_some())?;
        let mut best = (first, step(first)?);
        // A step that spans several cells reaches its full height a few cells farther out.
        for i in first + 1..(first + OUTER_CELLS).min(CELLS_PER_SIDE - OUTER_CELLS + 1) {
            if let Some((_, higher)) = step(i)
                && higher > best.1.1
            {
                best.1.1 = higher;
            }
        }
        let (inside, step_m) = best.1;
        // The edge lies where half of the step is reached, interpolated between two cell centres.
        let half = inside + 0.5 * step_m;
        let outer = (first..CELLS_PER_SIDE).find(|&i| height(i).is_none_or(|value| value >= half))?;
        let (below, above) = (height(outer - 1)?, height(outer)?);
        let share = if above > below { ((half - below) / (above - below)).clamp(0.0, 1.0) } else { 0.5 };
        let cells_out = (outer - 1) as f32 + 0.5 + share;
        let lateral_m = cells_out * CELL_M as f32 * if side == 0 { -1.0 } else { 1.0 };
        let distance_m = 0.5 * (SEGMENT_BOUNDS_M[segment] + SEGMENT_BOUNDS_M[segment + 1]);
        let x_px = rig.cx_px + f64::from(lateral_m) * rig.focal_px / distance_m;
        let y_px = surface.row_at(x_px, rig.disparity_px(distance_m));
        y_px.is_finite().then_some(Edge {
            lateral_m,
            step_m,
            distance_m: distance_m as f32,
            x_px: x_px as f32,
            y_px,
        })
    }
}

/// Drops edges that lie farther out than that of the segment before them by more than [`MAX_WIDENING_M`].
fn drop_folds(edges: &mut Edges) {
    for side in [0, 1] {
        let mut nearer: Option<Edge> = None;
        for edges in edges.iter_mut() {
            let edge = &mut edges[side];
            let out_m = |edge: &Edge| edge.lateral_m.abs();
            *edge =
                edge.filter(|edge| nearer.is_none_or(|near| out_m(edge) - out_m(&near) <= MAX_WIDENING_M));
            nearer = *edge;
        }
    }
}

/// Whether enough is seen in a cell.
fn is_known(cell: &[f32; 2]) -> bool {
    cell[1] >= MIN_PIXELS
}

/// The first of the cells, from the inside out, of which nothing is known behind the road: something stands before them. Their
/// number if there are none.
fn hidden_from(cells: &[[f32; 2]]) -> usize {
    let road = cells.iter().position(is_known).unwrap_or(cells.len());
    let mut hidden = 0;
    for (i, cell) in cells.iter().enumerate().skip(road) {
        hidden = if is_known(cell) { 0 } else { hidden + 1 };
        if hidden > MAX_HIDDEN_CELLS {
            return i + 1 - hidden;
        }
    }
    cells.len()
}

kernel! {
    /// Computes the cell index of each pixel from the segment bounds in 1/256 px; `u16::MAX` if the pixel
    /// lies in no cell.
    fn assign_cells(
        pixels: &PixelBatch,
        rig: Rig,
        bounds_px: &[u16; SEGMENTS + 1],
        out: &mut [u16; BATCH],
    ) = assign_cells_each
}

#[inline(always)]
fn assign_cells_each<S: Simd>(
    _: S,
    pixels: &PixelBatch,
    rig: Rig,
    bounds_px: &[u16; SEGMENTS + 1],
    out: &mut [u16; BATCH],
) {
    for i in 0..BATCH {
        let d = pixels.disparity[i];
        let distance_m = rig.distance_m(f64::from(d) / 256.0);
        let across = rig.lateral_m(f64::from(pixels.x_px[i]), distance_m) / CELL_M;
        let segment = bounds_px[1..SEGMENTS].iter().fold(0, |n, &end| n + u16::from(d <= end));
        let side = u16::from(across >= 0.0);
        // This form of the comparison maps NaN to "no cell".
        let cell = truncate_f64(if across.abs() < CELLS_PER_SIDE as f64 {
            across.abs()
        } else {
            CELLS_PER_SIDE as f64
        }) as u16;
        let index = (2 * segment + side) * CELLS_PER_SIDE as u16 + cell;
        out[i] = if cell < CELLS_PER_SIDE as u16 { index } else { u16::MAX };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{SceneDetector, SceneParameters};
    use crate::stereo::DisparityView;

    const SIZE: (usize, usize) = (640, 480);
    const RIG: Rig = Rig { focal_px: 600.0, baseline_m: 0.2, cx_px: 320.0, cy_px: 200.0 };
    const CAMERA_HEIGHT_M: f64 = 1.3;

    /// Disparity map of a flat road between two kerbs; `bend` is the lateral shift of the road per metre
    /// ahead.
    fn map(kerbs: [f64; 2], step_m: f64, bend: f64, seed: u64) -> Vec<u16> {
        let mut random = fastrand::Rng::with_seed(seed);
        let plane = |y: usize, height: f64| RIG.baseline_m / height * (y as f64 - RIG.cy_px);
        let mut out = vec![0; SIZE.0 * SIZE.1];
        for (i, out) in out.iter_mut().enumerate() {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            // Columns relative to the centre line of the road; the lateral position is this × baseline /
            // disparity.
            let across = x as f64 - RIG.cx_px - bend * RIG.focal_px;
            let kerb = kerbs[usize::from(across >= 0.0)];
            let (low, high) = (plane(y, CAMERA_HEIGHT_M), plane(y, CAMERA_HEIGHT_M - step_m));
            if low <= 0.0 {
                continue;
            }
            // A ray meets the pavement outside the kerb, the road inside the kerb, or the vertical face
            // between them.
            let face = RIG.baseline_m * across / kerb;
            let d = face.clamp(low, high) + 0.6 * random.f64() - 0.3;
            *out = (256.0 * d).max(0.0) as u16;
        }
        out
    }

    fn edges(frames: impl Iterator<Item = Vec<u16>>) -> Edges {
        let mut detector = SceneDetector::new(SceneParameters::default(), RIG, SIZE.0, SIZE.1, 128);
        let mut edges = Edges::default();
        for map in frames {
            let confidence = vec![255; map.len()];
            let view = DisparityView::new(&map, SIZE.0, SIZE.1).unwrap();
            edges = *detector.detect(DepthView::new(view, &confidence).unwrap()).edges;
        }
        edges
    }

    #[test]
    fn kerbs_of_ten_centimetres_are_detected_on_both_sides() {
        let seen = edges((0..5).map(|seed| map([-3.0, 2.5], 0.1, 0.0, seed)));
        for (segment, sides) in seen.iter().enumerate().skip(3) {
            for (edge, truth) in sides.iter().zip([-3.0, 2.5]) {
                let edge = edge.unwrap_or_else(|| panic!("segment {segment}: {seen:?}"));
                assert!((edge.lateral_m - truth).abs() < 0.15, "{edge:?}");
                assert!((edge.step_m - 0.1).abs() < 0.03, "{edge:?}");
                let x = RIG.cx_px + f64::from(truth) * RIG.focal_px / f64::from(edge.distance_m);
                assert!((f64::from(edge.x_px) - x).abs() < 12.0, "{edge:?}");
                let y = RIG.cy_px + CAMERA_HEIGHT_M * RIG.focal_px / f64::from(edge.distance_m);
                assert!((f64::from(edge.y_px) - y).abs() < 2.0, "{edge:?}");
            }
        }
    }

    #[test]
    fn a_kerb_that_is_seen_behind_a_parked_car_is_not_the_edge() {
        let with_car = |seed: u64, has_car: bool| {
            let mut map = map([-3.0, 6.2], 0.12, 0.0, seed);
            // Its rear: 7 m ahead, 2 to 2.5 m to the right, 1.4 m high.
            let (columns, rows) = (491..535, 192..311);
            for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))).filter(|_| has_car) {
                map[y * SIZE.0 + x] = (256.0 * RIG.disparity_px(7.0)) as u16;
            }
            map
        };
        let right = |has_car| {
            let seen = edges((0..5).map(|seed| with_car(seed, has_car)));
            seen.iter().filter_map(|sides| sides[1]).map(|edge| edge.lateral_m).collect::<Vec<f32>>()
        };
        let (open, hidden) = (right(false), right(true));
        let is_kerb = |lateral: &&f32| (**lateral - 6.2).abs() < 0.3;
        assert!(open.iter().filter(is_kerb).count() >= 2, "{open:?}");
        // Farther ahead the car's shadow ends beyond the kerb, or begins there.
        assert_eq!(hidden.iter().filter(is_kerb).count(), 0, "{hidden:?}");
    }

    #[test]
    fn an_edge_that_folds_back_is_dropped_and_one_that_bends_is_not() {
        let row = |left: [f32; SEGMENTS]| -> Edges {
            let edge = |lateral_m: f32| Edge { lateral_m, ..Edge::default() };
            left.map(|lateral_m| [(lateral_m < 0.0).then(|| edge(lateral_m)), Some(edge(3.0))])
        };
        let mut folded = row([-2.2, -4.4, -3.9, 0.0, -2.3, -2.4, -2.6, -4.0]);
        drop_folds(&mut folded);
        assert_eq!(folded, row([-2.2, 0.0, -3.9, 0.0, -2.3, -2.4, -2.6, 0.0]));
        let bend = row([-2.2, -2.5, -2.9, -3.5, -4.3, -5.2, -4.0, -3.0]);
        let mut same = bend;
        drop_folds(&mut same);
        assert_eq!(same, bend);
    }

    #[test]
    fn a_kerb_is_followed_through_a_bend() {
        let seen = edges((0..5).map(|seed| map([-3.0, 3.0], 0.12, -0.05, seed)));
        for edge in seen.iter().skip(3).flatten().flatten() {
            let truth = 3.0_f32.copysign(edge.lateral_m) - 0.05 * edge.distance_m;
            assert!((edge.lateral_m - truth).abs() < 0.25, "{edge:?}");
        }
        assert!(seen.iter().skip(3).flatten().flatten().count() >= 8, "{seen:?}");
    }

    #[test]
    fn a_flat_road_has_no_edge() {
        let seen = edges((0..6).map(|seed| map([-9.0, 9.0], 0.0, 0.0, seed)));
        assert_eq!(seen, Edges::default());
    }

    #[test]
    fn edges_are_cleared_when_the_road_is_lost() {
        let empty = vec![0; SIZE.0 * SIZE.1];
        let kerbs = (0..5).map(|seed| map([-3.0, 3.0], 0.12, 0.0, seed));
        assert_eq!(edges(kerbs.chain([empty])), Edges::default());
    }

    #[test]
    fn all_levels_assign_pixels_to_the_cells_of_the_reference() {
        let mut random = fastrand::Rng::with_seed(1);
        let bounds_px = SEGMENT_BOUNDS_M.map(|z| (256.0 * RIG.disparity_px(z)) as u16);
        let mut pixels = PixelBatch::default();
        for _ in 0..BATCH - 1 {
            let d = random.u16(bounds_px[SEGMENTS] + 1..bounds_px[0]);
            pixels.push(f32::from(random.u16(..640)), 300.0, d, true);
        }
        for level in Level::available() {
            let mut cell_indices = [0; BATCH];
            assign_cells(level, &pixels, RIG, &bounds_px, &mut cell_indices);
            for (i, place) in cell_indices.iter().enumerate().take(pixels.count()) {
                let distance_m = RIG.distance_m(f64::from(pixels.disparity[i]) / 256.0);
                let across = RIG.lateral_m(f64::from(pixels.x_px[i]), distance_m) / CELL_M;
                let segment =
                    bounds_px[1..SEGMENTS].iter().filter(|end| pixels.disparity[i] <= **end).count();
                let cell =
                    (2 * segment + usize::from(across >= 0.0)) * CELLS_PER_SIDE + across.abs() as usize;
                let expected = if across.abs() < CELLS_PER_SIDE as f64 { cell as u16 } else { u16::MAX };
                assert_eq!(*place, expected, "{} {i}", level.name());
            }
        }
    }
}
