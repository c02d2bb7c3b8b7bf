//! Where the road ends to the left and to the right: kerbs, verges, and whatever else steps up beside it.
//!
//! A kerb of 10 cm is within the noise of a row of the map. But it goes on along the road: so the heights of
//! all pixels are averaged in cells, some metres long and a hand wide, and over some frames; there a step of
//! 5 cm is plain. Outwards from the vehicle, the first one is the road's edge.

use super::heights::{BATCH, Pixels};
use super::surface::Surface;
use crate::depth::DepthView;
use crate::rig::Rig;
use crate::simd::rounding::truncate_f64;
use crate::simd::{Level, Simd, kernel};

/// Stretches that have an edge of their own.
pub const STRETCHES: usize = 8;
/// Where they begin and end, in metres ahead.
const ENDS_M: [f64; STRETCHES + 1] = [5.0, 6.5, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.5];
/// Width of a cell in metres, and cells to either side of the camera.
const CELL_M: f64 = 0.2;
const CELLS: usize = 40;
/// Rows and columns between the pixels that are looked at.
const STEP: usize = 2;
/// What is farther from the road's height is neither it nor its edge, in metres.
const MAX_M: f64 = 0.5;
/// Share of the heights of a frame that counts in the next.
const MEMORY: f32 = 0.8;
/// Pixels of a row that are looked at together.
const GROUP: usize = 16;
/// Pixels that a cell must have seen.
const MIN_PIXELS: f32 = 6.0;
/// Nothing nearer to the camera's axis is an edge, in cells: the vehicle is there.
const INNERMOST: usize = 4;
/// Cells that are compared on the inner and the outer side of an edge.
const INNER: usize = 5;
const OUTER: usize = 3;
/// The least step, and how much lower than all of the outer side all of the inner side is, in metres.
const MIN_STEP_M: f32 = 0.05;
const CLEAR_M: f32 = 0.02;
/// Metres by which the edges of neighbouring stretches may differ: one alone is no edge.
const AGREE_M: f32 = 0.6;

/// The road's edge on one side of a stretch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Edge {
    /// Metres to the right of the camera.
    pub lateral_m: f32,
    /// How much higher it is outside, in metres.
    pub step_m: f32,
    /// Metres ahead: the stretch's middle.
    pub distance_m: f32,
    /// Where that is in the left image, on the road.
    pub x_px: f32,
    /// Its row.
    pub y_px: f32,
}

/// The edges to the left and to the right, where they are seen, of each stretch, the nearest first.
pub type Edges = [[Option<Edge>; 2]; STRETCHES];

/// Heights beside the road, with memory allocated once.
#[derive(Debug)]
pub struct EdgeFinder {
    /// Sum of heights and number of pixels, by stretch, side and cell from the inside.
    cells: Vec<[f32; 2]>,
    edges: Edges,
    level: Level,
}

impl Default for EdgeFinder {
    fn default() -> Self {
        let cells = vec![[0.0; 2]; STRETCHES * 2 * CELLS];
        Self { cells, edges: Edges::default(), level: Level::best() }
    }
}

impl EdgeFinder {
    /// Without a road there are no edges, and what was known of it is forgotten.
    pub fn clear(&mut self) {
        self.cells.fill([0.0; 2]);
        self.edges = Edges::default();
    }

    /// The edges of the last frame.
    pub fn edges(&self) -> &Edges {
        &self.edges
    }

    /// Takes a frame: a map with the road that was found in it, from row `top` on.
    pub fn take(
        &mut self,
        depth: DepthView<'_>,
        surface: &Surface,
        rig: &Rig,
        top: usize,
        min_confidence: u8,
    ) {
        for [sum, count] in &mut self.cells {
            *sum *= MEMORY;
            *count *= MEMORY;
        }
        let ends_px = ENDS_M.map(|z| (256.0 * rig.disparity_px(z)).min(65_535.0) as u16);
        let mut pixels = Pixels::default();
        for y in (top..depth.height()).step_by(STEP) {
            let row = depth.disparity(y).chunks(STEP * GROUP).zip(depth.confidence(y).chunks(STEP * GROUP));
            for (group, (row, confidence)) in row.enumerate() {
                for (i, (d, confidence)) in row.iter().zip(confidence).enumerate().step_by(STEP) {
                    let there = (*d < ends_px[0]) & (*d > ends_px[STRETCHES]);
                    let x = STEP * GROUP * group + i;
                    pixels.push(x as f32, y as f32, *d, there & (*confidence >= min_confidence));
                }
                if pixels.count() + GROUP > BATCH {
                    self.add(&mut pixels, surface, rig, &ends_px);
                }
            }
        }
        self.add(&mut pixels, surface, rig, &ends_px);
        self.edges = std::array::from_fn(|stretch| [0, 1].map(|side| self.find(stretch, side, surface, rig)));
        let all = self.edges;
        for (stretch, edges) in self.edges.iter_mut().enumerate() {
            for (side, edge) in edges.iter_mut().enumerate() {
                let beside = |other: usize| all.get(other).and_then(|edges| edges[side]);
                *edge = edge.filter(|edge| {
                    let near = [beside(stretch.wrapping_sub(1)), beside(stretch + 1)];
                    near.iter().flatten().any(|other| (other.lateral_m - edge.lateral_m).abs() <= AGREE_M)
                });
            }
        }
    }

    /// Adds the heights of some pixels to their cells.
    fn add(&mut self, pixels: &mut Pixels, surface: &Surface, rig: &Rig, ends_px: &[u16; STRETCHES + 1]) {
        let mut heights_m = [0.0; BATCH];
        let mut places = [0; BATCH];
        surface.heights_m(pixels, &mut heights_m);
        place(self.level, pixels, *rig, ends_px, &mut places);
        for (&height_m, &place) in heights_m.iter().zip(&places).take(pixels.count()) {
            // Written so that NaN is left out.
            if height_m.abs() < MAX_M
                && let Some(cell) = self.cells.get_mut(usize::from(place))
            {
                cell[0] += height_m as f32;
                cell[1] += 1.0;
            }
        }
        pixels.clear();
    }

    /// The first step from the inside out.
    fn find(&self, stretch: usize, side: usize, surface: &Surface, rig: &Rig) -> Option<Edge> {
        let cells = &self.cells[(2 * stretch + side) * CELLS..][..CELLS];
        let height = |i: usize| (cells[i][1] >= MIN_PIXELS).then(|| cells[i][0] / cells[i][1]);
        // Height inside, and how much higher it is outside, of cell i on.
        let step = |i: usize| {
            let (mut inside, mut known, mut highest) = (0.0, 0, f32::NEG_INFINITY);
            for value in (i.saturating_sub(INNER)..i).filter_map(height) {
                inside += value;
                known += 1;
                highest = highest.max(value);
            }
            let (mut outside, mut lowest) = (0.0, f32::INFINITY);
            for i in i..i + OUTER {
                let value = height(i)?;
                outside += value / OUTER as f32;
                lowest = lowest.min(value);
            }
            let inside = inside / known.max(1) as f32;
            (known + 1 >= i.min(INNER) && outside - inside >= MIN_STEP_M && lowest - highest > CLEAR_M)
                .then_some((inside, outside - inside))
        };
        let first = (INNERMOST..=CELLS - OUTER).find(|&i| step(i).is_some())?;
        let mut best = (first, step(first)?);
        // A step that is spread over some cells is seen in full a little later.
        for i in first + 1..(first + OUTER).min(CELLS - OUTER + 1) {
            if let Some((_, higher)) = step(i)
                && higher > best.1.1
            {
                best.1.1 = higher;
            }
        }
        let (inside, step_m) = best.1;
        // Where half of it is reached, between the middles of two cells.
        let half = inside + 0.5 * step_m;
        let outer = (first..CELLS).find(|&i| height(i).is_none_or(|value| value >= half))?;
        let (below, above) = (height(outer - 1)?, height(outer)?);
        let share = if above > below { ((half - below) / (above - below)).clamp(0.0, 1.0) } else { 0.5 };
        let cells_out = (outer - 1) as f32 + 0.5 + share;
        let lateral_m = cells_out * CELL_M as f32 * if side == 0 { -1.0 } else { 1.0 };
        let distance_m = 0.5 * (ENDS_M[stretch] + ENDS_M[stretch + 1]);
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

kernel! {
    /// The cell of each pixel, by where stretches begin and end in 1/256 px; the greatest number where it lies
    /// in none.
    fn place(
        pixels: &Pixels,
        rig: Rig,
        ends_px: &[u16; STRETCHES + 1],
        out: &mut [u16; BATCH],
    ) = place_each
}

#[inline(always)]
fn place_each<S: Simd>(
    _: S,
    pixels: &Pixels,
    rig: Rig,
    ends_px: &[u16; STRETCHES + 1],
    out: &mut [u16; BATCH],
) {
    for i in 0..BATCH {
        let d = pixels.disparity[i];
        let distance_m = rig.distance_m(f64::from(d) / 256.0);
        let across = rig.lateral_m(f64::from(pixels.x_px[i]), distance_m) / CELL_M;
        let beyond = ends_px[1..STRETCHES].iter().fold(0, |n, &end| n + u16::from(d <= end));
        let side = u16::from(across >= 0.0);
        // Written so that NaN is in none.
        let cell = truncate_f64(if across.abs() < CELLS as f64 { across.abs() } else { CELLS as f64 }) as u16;
        let place = (2 * beyond + side) * CELLS as u16 + cell;
        out[i] = if cell < CELLS as u16 { place } else { u16::MAX };
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

    /// A flat road between two kerbs, whose distance to the camera's axis grows by `bend` per metre ahead.
    fn map(kerbs: [f64; 2], step_m: f64, bend: f64, seed: u64) -> Vec<u16> {
        let mut random = fastrand::Rng::with_seed(seed);
        let plane = |y: usize, height: f64| RIG.baseline_m / height * (y as f64 - RIG.cy_px);
        let mut out = vec![0; SIZE.0 * SIZE.1];
        for (i, out) in out.iter_mut().enumerate() {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            // Columns off the road's middle line; lateral places are those over disparity.
            let across = x as f64 - RIG.cx_px - bend * RIG.focal_px;
            let kerb = kerbs[usize::from(across >= 0.0)];
            let (low, high) = (plane(y, CAMERA_HEIGHT_M), plane(y, CAMERA_HEIGHT_M - step_m));
            if low <= 0.0 {
                continue;
            }
            // A ray meets the pavement where that lies outside the kerb, the road where it lies inside, and the
            // kerb's face in between.
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
            let sure = vec![255; map.len()];
            let view = DisparityView::new(&map, SIZE.0, SIZE.1).unwrap();
            edges = *detector.detect(DepthView::new(view, &sure).unwrap()).edges;
        }
        edges
    }

    #[test]
    fn kerbs_of_ten_centimetres_are_found_on_both_sides() {
        let seen = edges((0..5).map(|seed| map([-3.0, 2.5], 0.1, 0.0, seed)));
        for (stretch, sides) in seen.iter().enumerate().skip(3) {
            for (edge, truth) in sides.iter().zip([-3.0, 2.5]) {
                let edge = edge.unwrap_or_else(|| panic!("stretch {stretch}: {seen:?}"));
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
    fn what_was_known_is_forgotten_with_the_road() {
        let empty = vec![0; SIZE.0 * SIZE.1];
        let kerbs = (0..5).map(|seed| map([-3.0, 3.0], 0.12, 0.0, seed));
        assert_eq!(edges(kerbs.chain([empty])), Edges::default());
    }

    #[test]
    fn all_levels_place_pixels_in_the_cells_that_dividing_gives() {
        let mut random = fastrand::Rng::with_seed(1);
        let ends_px = ENDS_M.map(|z| (256.0 * RIG.disparity_px(z)) as u16);
        let mut pixels = Pixels::default();
        for _ in 0..BATCH - 1 {
            let d = random.u16(ends_px[STRETCHES] + 1..ends_px[0]);
            pixels.push(f32::from(random.u16(..640)), 300.0, d, true);
        }
        for level in Level::available() {
            let mut places = [0; BATCH];
            place(level, &pixels, RIG, &ends_px, &mut places);
            for (i, place) in places.iter().enumerate().take(pixels.count()) {
                let distance_m = RIG.distance_m(f64::from(pixels.disparity[i]) / 256.0);
                let across = RIG.lateral_m(f64::from(pixels.x_px[i]), distance_m) / CELL_M;
                let stretch = ends_px[1..STRETCHES].iter().filter(|end| pixels.disparity[i] <= **end).count();
                let cell = (2 * stretch + usize::from(across >= 0.0)) * CELLS + across.abs() as usize;
                let expected = if across.abs() < CELLS as f64 { cell as u16 } else { u16::MAX };
                assert_eq!(*place, expected, "{} {i}", level.name());
            }
        }
    }
}
