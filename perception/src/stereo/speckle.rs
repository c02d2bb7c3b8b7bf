//! Removes small islands of disparity: what is connected, but smaller than a real surface.

/// Which islands go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpeckleParameters {
    /// Islands of fewer pixels are removed; 0 keeps all.
    pub least_pixels: u32,
    /// Neighbours belong together when they differ by at most this, in 1/256 px.
    pub step: u16,
}

impl Default for SpeckleParameters {
    fn default() -> Self {
        Self { least_pixels: 100, step: 256 }
    }
}

/// Finds connected areas by union of row neighbours and column neighbours.
#[derive(Debug)]
pub struct SpeckleFilter {
    parameters: SpeckleParameters,
    width: usize,
    parent: Vec<u32>,
    pixels: Vec<u32>,
}

impl SpeckleFilter {
    /// A workspace for maps of `width` × `height`.
    pub fn new(parameters: SpeckleParameters, width: usize, height: usize) -> Self {
        let n = width * height;
        Self { parameters, width, parent: vec![0; n], pixels: vec![0; n] }
    }

    /// Bytes that the workspace holds.
    pub fn bytes(&self) -> usize {
        4 * (self.parent.len() + self.pixels.len())
    }

    fn root(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let grandparent = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = grandparent;
            i = grandparent;
        }
        i
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        if a != b {
            // The smaller index stays root, so the result does not depend on the order.
            let (low, high) = (a.min(b), a.max(b));
            self.parent[high as usize] = low;
            self.pixels[low as usize] += self.pixels[high as usize];
        }
    }

    /// Sets the pixels of small islands in `disparity` to 0 (unknown).
    pub fn apply(&mut self, disparity: &mut [u16]) {
        if self.parameters.least_pixels == 0 {
            return;
        }
        for (i, parent) in self.parent.iter_mut().enumerate() {
            *parent = i as u32;
        }
        self.pixels.fill(1);
        let step = self.parameters.step;
        let alike = |a: u16, b: u16| a > 0 && b > 0 && a.abs_diff(b) <= step;
        let width = self.width;
        for i in 0..disparity.len() {
            if i % width > 0 && alike(disparity[i], disparity[i - 1]) {
                self.join(i as u32, i as u32 - 1);
            }
            if i >= width && alike(disparity[i], disparity[i - width]) {
                self.join(i as u32, (i - width) as u32);
            }
        }
        for i in 0..disparity.len() {
            let root = self.root(i as u32);
            if self.pixels[root as usize] < self.parameters.least_pixels {
                disparity[i] = 0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn islands_go_and_slopes_stay() {
        let (width, height) = (20, 10);
        let mut map: Vec<u16> = (0..width * height).map(|i| 2560 + (i % width) as u16 * 200).collect();
        // An island of four pixels, and one unknown pixel.
        for i in [85, 86, 105, 106] {
            map[i] = 20_000;
        }
        map[3] = 0;
        let before = map.clone();
        let parameters = SpeckleParameters { least_pixels: 5, step: 256 };
        SpeckleFilter::new(parameters, width, height).apply(&mut map);
        for (i, (&after, &before)) in map.iter().zip(&before).enumerate() {
            let expected = if [85, 86, 105, 106].contains(&i) { 0 } else { before };
            assert_eq!(after, expected, "pixel {i}");
        }
        // Kept when islands of four are large enough.
        map.copy_from_slice(&before);
        let parameters = SpeckleParameters { least_pixels: 4, step: 256 };
        SpeckleFilter::new(parameters, width, height).apply(&mut map);
        assert_eq!(map, before);
    }
}
