//! The energy volume and its layout: `[row][tile][disparity][lane]`.

/// Pixels that one tile of a row holds, and paths that one step of the recursion advances.
pub const LANES: usize = 32;

/// One value for each of [`LANES`] neighbouring pixels or rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C, align(32))]
pub struct Lanes(pub [u8; LANES]);

impl Lanes {
    /// Zero in every lane.
    pub const ZERO: Lanes = Lanes([0; LANES]);

    /// `value` in every lane.
    pub const fn splat(value: u8) -> Self {
        Lanes([value; LANES])
    }

    /// Applies `f` lane by lane to `self` and `other`.
    #[inline(always)]
    pub fn zip(self, other: Lanes, f: impl Fn(u8, u8) -> u8) -> Lanes {
        let mut out = Lanes::ZERO;
        for i in 0..LANES {
            out.0[i] = f(self.0[i], other.0[i]);
        }
        out
    }

    /// The smaller of both, lane by lane.
    #[inline(always)]
    pub fn min(self, other: Lanes) -> Lanes {
        self.zip(other, u8::min)
    }

    /// The sum, at most 255, lane by lane.
    #[inline(always)]
    pub fn saturating_add(self, other: Lanes) -> Lanes {
        self.zip(other, u8::saturating_add)
    }

    /// The difference, at least 0, lane by lane.
    #[inline(always)]
    pub fn saturating_sub(self, other: Lanes) -> Lanes {
        self.zip(other, u8::saturating_sub)
    }

    /// The mean, a half rounded up, lane by lane.
    #[inline(always)]
    pub fn mean(self, other: Lanes) -> Lanes {
        self.zip(other, |a, b| ((u16::from(a) + u16::from(b) + 1) >> 1) as u8)
    }
}

/// Energies of all nodes of an image: one byte each, [`LANES`] pixels of a row side by side, so
/// that the recursion over disparities runs in one register per tile.
#[derive(Clone, Debug)]
pub struct Volume {
    data: Vec<Lanes>,
    width: usize,
    height: usize,
    tiles: usize,
    disparities: usize,
}

impl Volume {
    /// A volume of zeros for `width` × `height` pixels and `disparities` nodes each.
    pub fn new(width: usize, height: usize, disparities: usize) -> Self {
        let tiles = width.div_ceil(LANES);
        Self { data: vec![Lanes::ZERO; height * tiles * disparities], width, height, tiles, disparities }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Tiles of [`LANES`] pixels in a row; the last one may reach beyond the width.
    pub fn tiles(&self) -> usize {
        self.tiles
    }

    /// Nodes of a pixel: disparities 0 to this, exclusive.
    pub fn disparities(&self) -> usize {
        self.disparities
    }

    /// Row `y`: `tiles` × `disparities` lanes, disparities innermost.
    pub fn row(&self, y: usize) -> &[Lanes] {
        let n = self.tiles * self.disparities;
        &self.data[y * n..(y + 1) * n]
    }

    /// Row `y` to be written.
    pub fn row_mut(&mut self, y: usize) -> &mut [Lanes] {
        let n = self.tiles * self.disparities;
        &mut self.data[y * n..(y + 1) * n]
    }

    /// The energy of one node.
    pub fn at(&self, x: usize, y: usize, disparity: usize) -> u8 {
        self.row(y)[x / LANES * self.disparities + disparity].0[x % LANES]
    }

    /// Sets the energy of one node.
    pub fn set(&mut self, x: usize, y: usize, disparity: usize, energy: u8) {
        let disparities = self.disparities;
        self.row_mut(y)[x / LANES * disparities + disparity].0[x % LANES] = energy;
    }

    /// Bytes that the volume holds.
    pub fn bytes(&self) -> usize {
        self.data.len() * LANES
    }
}

/// Turns a block of [`LANES`] × [`LANES`] values: `out[i].0[j] = in_[j].0[i]`.
#[inline]
pub fn transpose(block: &[Lanes; LANES], out: &mut [Lanes; LANES]) {
    for i in 0..LANES {
        for j in 0..LANES {
            out[i].0[j] = block[j].0[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_keep_their_place() {
        let mut volume = Volume::new(70, 3, 5);
        assert_eq!(volume.tiles(), 3);
        volume.set(69, 2, 4, 7);
        assert_eq!(volume.at(69, 2, 4), 7);
        assert_eq!(volume.row(2)[2 * 5 + 4].0[5], 7);
        assert_eq!(volume.bytes(), 3 * 3 * 5 * 32);
    }

    #[test]
    fn a_transposed_block_is_turned() {
        let mut random = fastrand::Rng::with_seed(3);
        let mut block = [Lanes::ZERO; LANES];
        block.iter_mut().flat_map(|l| l.0.iter_mut()).for_each(|v| *v = random.u8(..));
        let mut turned = [Lanes::ZERO; LANES];
        transpose(&block, &mut turned);
        for i in 0..LANES {
            for j in 0..LANES {
                assert_eq!(turned[i].0[j], block[j].0[i]);
            }
        }
    }
}
