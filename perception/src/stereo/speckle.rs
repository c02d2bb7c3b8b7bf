//! Speckle filter: removes connected regions of similar disparity that are smaller than a real surface.

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

/// Finds connected regions by run-length labelling: rows are cut into runs where neighbours differ, and runs
/// that touch in neighbouring rows are united (union-find).
#[derive(Debug)]
pub struct SpeckleFilter {
    parameters: SpeckleParameters,
    width: usize,
    runs: Vec<Run>,
    /// Index of the first run of each row, and one after the last of all.
    rows: Vec<u32>,
}

impl SpeckleFilter {
    /// A workspace for maps of `width` × `height`.
    pub fn new(parameters: SpeckleParameters, width: usize, height: usize) -> Self {
        Self {
            parameters,
            width,
            // The maximum number of runs, so that `apply` never allocates; untouched pages cost nothing.
            runs: Vec::with_capacity(width * height),
            rows: Vec::with_capacity(height + 1),
        }
    }

    /// Bytes of the workspace that maps have used so far.
    pub fn bytes(&self) -> usize {
        self.runs.len() * size_of::<Run>() + 4 * self.rows.len()
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

    fn cut_rows(&mut self, disparity: &[u16]) {
        let step = self.parameters.step;
        self.runs.clear();
        self.rows.clear();
        for row in disparity.chunks_exact(self.width) {
            self.rows.push(self.runs.len() as u32);
            let mut x = 0;
            while x < row.len() {
                if row[x] == 0 {
                    x += 1;
                    continue;
                }
                let start = x;
                x += 1;
                // Most runs are long: 32 pixels are tested together.
                while let Some(next) = row.get(x - 1..x + 32) {
                    let breaks = next
                        .iter()
                        .zip(&next[1..])
                        .fold(false, |any, (&a, &b)| any | (b == 0) | (b.abs_diff(a) > step));
                    if breaks {
                        break;
                    }
                    x += 32;
                }
                while x < row.len() && row[x] > 0 && row[x].abs_diff(row[x - 1]) <= step {
                    x += 1;
                }
                self.runs.push(Run {
                    start: start as u32,
                    end: x as u32,
                    parent: self.runs.len() as u32,
                    pixels: (x - start) as u32,
                });
            }
        }
        self.rows.push(self.runs.len() as u32);
    }

    /// Sets the pixels of small regions in `disparity` to 0 (unknown).
    pub fn apply(&mut self, disparity: &mut [u16]) {
        if self.parameters.min_pixels == 0 {
            return;
        }
        self.cut_rows(disparity);
        let step = self.parameters.step;
        for y in 1..self.rows.len() - 1 {
            let above = &disparity[(y - 1) * self.width..y * self.width];
            let here = &disparity[y * self.width..(y + 1) * self.width];
            let (mut a, mut b) = (self.rows[y - 1], self.rows[y]);
            let (a_end, b_end) = (self.rows[y], self.rows[y + 1]);
            while a < a_end && b < b_end {
                let (up, down) = (self.runs[a as usize], self.runs[b as usize]);
                let both = up.start.max(down.start) as usize..up.end.min(down.end) as usize;
                if both.start < both.end {
                    let alike =
                        above[both.clone()].iter().zip(&here[both]).any(|(a, b)| a.abs_diff(*b) <= step);
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
        for y in 0..self.rows.len() - 1 {
            for i in self.rows[y]..self.rows[y + 1] {
                let root = self.root(i);
                if self.runs[root as usize].pixels < self.parameters.min_pixels {
                    let run = self.runs[i as usize];
                    let row = &mut disparity[y * self.width..(y + 1) * self.width];
                    row[run.start as usize..run.end as usize].fill(0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        SpeckleFilter::new(parameters, width, height).apply(&mut map);
        for (i, (&after, &before)) in map.iter().zip(&before).enumerate() {
            let expected = if [85, 86, 105, 106].contains(&i) { 0 } else { before };
            assert_eq!(after, expected, "pixel {i}");
        }
        // Kept if four pixels are enough.
        map.copy_from_slice(&before);
        let parameters = SpeckleParameters { min_pixels: 4, step: 256 };
        SpeckleFilter::new(parameters, width, height).apply(&mut map);
        assert_eq!(map, before);
    }

    #[test]
    fn runs_find_the_same_regions_as_flood_fill() {
        let mut random = fastrand::Rng::with_seed(11);
        for _ in 0..50 {
            let (width, height) = (random.usize(1..30), random.usize(1..20));
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
            let mut filtered = map.clone();
            SpeckleFilter::new(parameters, width, height).apply(&mut filtered);
            assert_eq!(filtered, flooded, "{width}x{height}");
        }
    }
}
