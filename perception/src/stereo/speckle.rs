//! Speckle filter: removes connected regions of similar disparity that are smaller than a real surface.

use super::crew::both;
use crate::simd::{Level, Simd, kernel};

/// Parameters of the speckle filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpeckleParameters {
    /// Regions of fewer pixels are removed; 0 keeps all.
    pub min_pixels: u32,
    /// Maximum difference between neighbouring pixels of one region, in 1/256 px.
    pub step: u16,
}

impl Default for SpeckleParameters {
    fn default() -> Self {
        Self { min_pixels: 100, step: 256 }
    }
}

/// Consecutive pixels of a row that belong to one region.
#[derive(Clone, Copy, Debug)]
struct Run {
    start: u32,
    end: u32,
    parent: u32,
    pixels: u32,
}

/// Flags that are tested together.
const WORD: usize = 8;

/// Whether a pixel and the one before it belong to different runs, for all pixels of a row but the first.
#[inline(always)]
fn breaks_of<S: Simd>(_: S, row: &[u16], step: u16, breaks: &mut [u8]) {
    for ((breaks, &before), &here) in breaks.iter_mut().zip(row).zip(&row[1..]) {
        let differs = before.abs_diff(here) > step;
        *breaks = u8::from(differs | ((before == 0) != (here == 0)));
    }
}

kernel! { fn find_breaks(row: &[u16], step: u16, breaks: &mut [u8]) = breaks_of }

/// Places of the flags that are set in a word of flags.
fn set_bytes(flags: &[u8], word: usize) -> impl Iterator<Item = usize> {
    let mut bytes = [0; WORD];
    bytes.copy_from_slice(&flags[word * WORD..][..WORD]);
    let mut set = u64::from_le_bytes(bytes);
    std::iter::from_fn(move || {
        if set == 0 {
            return None;
        }
        let place = set.trailing_zeros() as usize / 8;
        // A flag is 0 or 1, so it is the lowest bit that is set.
        set &= set - 1;
        Some(word * WORD + place)
    })
}

/// The regions of some rows of a map, as runs that are united (union-find).
#[derive(Debug)]
struct Regions {
    level: Level,
    step: u16,
    width: usize,
    /// Whether a run ends before each pixel of a row and behind its last, in whole words.
    breaks: Vec<u8>,
    runs: Vec<Run>,
    /// Index of the first run of each row, and one after the last of all.
    rows: Vec<u32>,
}

impl Regions {
    /// Memory for the maximum number of runs, so that [`Self::find`] never allocates; untouched pages cost nothing.
    fn new(level: Level, step: u16, width: usize, height: usize) -> Self {
        let mut breaks = vec![0; (width + 1).next_multiple_of(WORD)];
        breaks[width] = 1;
        let (runs, rows) = (Vec::with_capacity(width * height), Vec::with_capacity(height + 1));
        Self { level, step, width, breaks, runs, rows }
    }

    fn bytes(&self) -> usize {
        self.runs.len() * size_of::<Run>() + 4 * self.rows.len() + self.breaks.len()
    }

    /// Finds the regions of a map.
    fn find(&mut self, disparity: &[u16]) {
        self.cut_rows(disparity);
        for y in 1..self.rows.len() - 1 {
            self.join_rows(disparity, y);
        }
    }

    fn cut_rows(&mut self, disparity: &[u16]) {
        let Self { level, step, width, breaks, runs, rows } = self;
        runs.clear();
        rows.clear();
        for row in disparity.chunks_exact(*width) {
            rows.push(runs.len() as u32);
            find_breaks(*level, row, *step, &mut breaks[1..*width]);
            let mut start = 0;
            for x in (0..breaks.len() / WORD).flat_map(|word| set_bytes(breaks, word)) {
                if x > start && row[start] > 0 {
                    let (start, end, parent) = (start as u32, x as u32, runs.len() as u32);
                    runs.push(Run { start, end, parent, pixels: end - start });
                }
                start = x;
                if x == *width {
                    break;
                }
            }
        }
        rows.push(runs.len() as u32);
    }

    /// Unites the runs of row `y` with those above that they touch.
    fn join_rows(&mut self, disparity: &[u16], y: usize) {
        let above = &disparity[(y - 1) * self.width..y * self.width];
        let here = &disparity[y * self.width..(y + 1) * self.width];
        let (mut a, mut b) = (self.rows[y - 1], self.rows[y]);
        let (a_end, b_end) = (self.rows[y], self.rows[y + 1]);
        while a < a_end && b < b_end {
            let (up, down) = (self.runs[a as usize], self.runs[b as usize]);
            let both = up.start.max(down.start) as usize..up.end.min(down.end) as usize;
            if both.start < both.end {
                let alike =
                    above[both.clone()].iter().zip(&here[both]).any(|(a, b)| a.abs_diff(*b) <= self.step);
                if alike {
                    self.join(a, b);
                }
            }
            if up.end <= down.end {
                a += 1;
            } else {
                b += 1;
            }
        }
    }

    /// Adds the regions of the rows below.
    fn append(&mut self, below: &Self) {
        let offset = self.runs.len() as u32;
        self.runs.extend(below.runs.iter().map(|run| Run { parent: run.parent + offset, ..*run }));
        self.rows.pop();
        self.rows.extend(below.rows.iter().map(|first| first + offset));
    }

    fn root(&mut self, mut i: u32) -> u32 {
        while self.runs[i as usize].parent != i {
            let grandparent = self.runs[self.runs[i as usize].parent as usize].parent;
            self.runs[i as usize].parent = grandparent;
            i = grandparent;
        }
        i
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        if a != b {
            // The smaller index stays root, so that the result does not depend on the order.
            let (low, high) = (a.min(b), a.max(b));
            self.runs[high as usize].parent = low;
            self.runs[low as usize].pixels += self.runs[high as usize].pixels;
        }
    }
}

/// Finds connected regions by run-length labelling: rows are cut into runs where neighbours differ, and runs
/// that touch in neighbouring rows are united.
#[derive(Debug)]
pub struct SpeckleFilter {
    min_pixels: u32,
    width: usize,
    regions: Regions,
    /// Regions of the lower half, which a second thread finds.
    lower: Option<Regions>,
}

impl SpeckleFilter {
    /// A workspace for maps of `width` × `height`. More than one thread needs a [`Crew`](super::crew::Crew).
    pub fn new(
        level: Level,
        parameters: SpeckleParameters,
        width: usize,
        height: usize,
        threads: usize,
    ) -> Self {
        let SpeckleParameters { min_pixels, step } = parameters;
        let regions = |height| Regions::new(level, step, width, height);
        let lower = (threads > 1).then(|| regions(height.div_ceil(2)));
        Self { min_pixels, width, regions: regions(height), lower }
    }

    /// Bytes of the workspace that maps have used so far.
    pub fn bytes(&self) -> usize {
        self.regions.bytes() + self.lower.as_ref().map_or(0, Regions::bytes)
    }

    /// Sets the pixels of small regions in `disparity` to 0 (unknown).
    pub fn apply(&mut self, disparity: &mut [u16]) {
        if self.min_pixels == 0 {
            return;
        }
        let Self { min_pixels, width, regions, lower } = self;
        match lower {
            None => regions.find(disparity),
            Some(lower) => {
                let cut = disparity.len() / *width / 2;
                let (above, below) = disparity.split_at(cut * *width);
                both(|| regions.find(above), || lower.find(below));
                regions.append(lower);
                if cut > 0 {
                    regions.join_rows(disparity, cut);
                }
            }
        }
        for y in 0..regions.rows.len() - 1 {
            for i in regions.rows[y]..regions.rows[y + 1] {
                let root = regions.root(i);
                if regions.runs[root as usize].pixels < *min_pixels {
                    let run = regions.runs[i as usize];
                    let row = &mut disparity[y * *width..(y + 1) * *width];
                    row[run.start as usize..run.end as usize].fill(0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::Crew;

    #[test]
    fn small_regions_are_removed_and_slopes_are_kept() {
        let (width, height) = (20, 10);
        let mut map: Vec<u16> = (0..width * height).map(|i| 2560 + (i % width) as u16 * 200).collect();
        // A region of four pixels, and one unknown pixel.
        for i in [85, 86, 105, 106] {
            map[i] = 20_000;
        }
        map[3] = 0;
        let before = map.clone();
        let parameters = SpeckleParameters { min_pixels: 5, step: 256 };
        SpeckleFilter::new(Level::best(), parameters, width, height, 1).apply(&mut map);
        for (i, (&after, &before)) in map.iter().zip(&before).enumerate() {
            let expected = if [85, 86, 105, 106].contains(&i) { 0 } else { before };
            assert_eq!(after, expected, "pixel {i}");
        }
        // Kept if four pixels are enough.
        map.copy_from_slice(&before);
        let parameters = SpeckleParameters { min_pixels: 4, step: 256 };
        SpeckleFilter::new(Level::best(), parameters, width, height, 1).apply(&mut map);
        assert_eq!(map, before);
    }

    #[test]
    fn runs_find_the_same_regions_as_flood_fill() {
        let mut random = fastrand::Rng::with_seed(11);
        for _ in 0..50 {
            let (width, height) = (random.usize(1..90), random.usize(1..20));
            let map: Vec<u16> = (0..width * height).map(|_| random.u16(0..4) * 200).collect();
            let parameters = SpeckleParameters { min_pixels: random.u32(1..12), step: 256 };
            let mut flooded = map.clone();
            let mut seen = vec![false; map.len()];
            for start in 0..map.len() {
                if map[start] == 0 || seen[start] {
                    continue;
                }
                let (mut area, mut open) = (Vec::new(), vec![start]);
                seen[start] = true;
                while let Some(i) = open.pop() {
                    area.push(i);
                    let (x, y) = (i % width, i / width);
                    let beside = [
                        (x > 0).then(|| i - 1),
                        (x + 1 < width).then_some(i + 1),
                        (y > 0).then(|| i.wrapping_sub(width)),
                        (y + 1 < height).then_some(i + width),
                    ];
                    for j in beside.into_iter().flatten() {
                        if map[j] > 0 && !seen[j] && map[j].abs_diff(map[i]) <= 256 {
                            seen[j] = true;
                            open.push(j);
                        }
                    }
                }
                if area.len() < parameters.min_pixels as usize {
                    area.iter().for_each(|&i| flooded[i] = 0);
                }
            }
            for (level, threads) in Level::available().into_iter().flat_map(|level| [(level, 1), (level, 2)])
            {
                let mut filtered = map.clone();
                let mut filter = SpeckleFilter::new(level, parameters, width, height, threads);
                let crew = Crew::new(threads, |_| ()).unwrap();
                crew.lead(|| filter.apply(&mut filtered));
                assert_eq!(filtered, flooded, "{width}x{height} {} on {threads}", level.name());
            }
        }
    }
}
