//! The reference implementation: scalar Rust that defines the arithmetic of all levels.

use super::kernel_set::{CostConstants, CostRow, LANES, Lanes, Packing, RemapTile, Simd};

/// The plain Rust level.
#[derive(Clone, Copy, Debug)]
pub struct Plain;

#[inline(always)]
fn zip(a: Lanes, b: Lanes, f: impl Fn(u8, u8) -> u8) -> Lanes {
    Lanes(std::array::from_fn(|i| f(a.0[i], b.0[i])))
}

impl Simd for Plain {
    type Bytes = Lanes;
    const PACKING: Packing = Packing::Pairs;

    #[inline(always)]
    fn splat(self, value: u8) -> Lanes {
        Lanes::splat(value)
    }

    #[inline(always)]
    fn load(self, from: &Lanes) -> Lanes {
        *from
    }

    #[inline(always)]
    fn store(self, value: Lanes, to: &mut Lanes) {
        *to = value;
    }

    #[inline(always)]
    unsafe fn stream(self, value: Lanes, to: &mut Lanes) {
        *to = value;
    }

    #[inline(always)]
    fn store_fence(self) {}

    #[inline(always)]
    fn prefetch(self, _: &[Lanes]) {}

    #[inline(always)]
    fn min(self, a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, u8::min)
    }

    #[inline(always)]
    fn max(self, a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, u8::max)
    }

    #[inline(always)]
    fn add(self, a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, u8::saturating_add)
    }

    #[inline(always)]
    fn sub(self, a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, u8::saturating_sub)
    }

    #[inline(always)]
    fn mean(self, a: Lanes, b: Lanes) -> Lanes {
        zip(a, b, |a, b| ((u16::from(a) + u16::from(b) + 1) >> 1) as u8)
    }

    #[inline(always)]
    fn select_equal(self, a: Lanes, b: Lanes, yes: Lanes, no: Lanes) -> Lanes {
        Lanes(std::array::from_fn(|i| if a.0[i] == b.0[i] { yes.0[i] } else { no.0[i] }))
    }

    #[inline(always)]
    fn select_less(self, a: Lanes, b: Lanes, yes: Lanes, no: Lanes) -> Lanes {
        Lanes(std::array::from_fn(|i| if a.0[i] < b.0[i] { yes.0[i] } else { no.0[i] }))
    }

    #[inline(always)]
    fn contains(self, set: &Lanes, values: Lanes) -> Lanes {
        let mut found = Lanes::ZERO;
        for (found, &value) in found.0.iter_mut().zip(&values.0) {
            *found = 0_u8.wrapping_sub(set.0[usize::from(value >> 3)] >> (value & 7) & 1);
        }
        found
    }

    #[inline(always)]
    fn shift_right(self, own: Lanes, left: Lanes) -> Lanes {
        Lanes(std::array::from_fn(|i| if i == 0 { left.0[LANES - 1] } else { own.0[i - 1] }))
    }

    #[inline(always)]
    fn shift_left(self, own: Lanes, right: Lanes) -> Lanes {
        Lanes(std::array::from_fn(|i| if i + 1 == LANES { right.0[0] } else { own.0[i + 1] }))
    }

    #[inline(always)]
    fn transpose(self, block: &mut [Lanes], stride: usize) {
        for i in 0..LANES {
            for j in 0..i {
                let (a, b) = (block[i * stride].0[j], block[j * stride].0[i]);
                block[i * stride].0[j] = b;
                block[j * stride].0[i] = a;
            }
        }
    }

    #[inline(always)]
    fn score(
        self,
        constants: &CostConstants,
        left: &CostRow<'_>,
        right: &CostRow<'_>,
        at: usize,
        low: usize,
        out: &mut [Lanes],
    ) {
        score_pairs(constants, left, right, at, low, out);
    }

    #[inline(always)]
    fn remap(self, source: &[u8], stride: usize, tile: &RemapTile, out: &mut Lanes) {
        remap_pixels(source, stride, tile, out);
    }
}

/// [`Simd::remap`] pixel by pixel.
#[inline(always)]
pub fn remap_pixels(source: &[u8], stride: usize, tile: &RemapTile, out: &mut Lanes) {
    for i in 0..LANES {
        let [x, y] = tile.windows[i / 8].map(usize::from);
        let [left, right] = tile.pairs[i];
        if left == u8::MAX {
            out.0[i] = 0;
            continue;
        }
        let start = (y + usize::from(tile.down[i] >> 7)) * stride + x;
        let (fx, fy) = (i32::from(tile.across[i]), i32::from(tile.down[i] & 31));
        let at = |k: u8| i32::from(source[start + usize::from(k)]);
        let below = |k: u8| i32::from(source[start + stride + usize::from(k)]);
        let upper = at(left) * (32 - fx) + at(right) * fx;
        let lower = below(left) * (32 - fx) + below(right) * fx;
        out.0[i] = ((upper * (32 - fy) + lower * fy + 512) >> 10) as u8;
    }
}

/// [`Simd::score`] for [`Packing::Pairs`], pixel by pixel.
#[inline(always)]
fn score_pairs(
    constants: &CostConstants,
    left: &CostRow<'_>,
    right: &CostRow<'_>,
    at: usize,
    low: usize,
    out: &mut [Lanes],
) {
    const COLUMNS: usize = LANES + 4;
    let left_words = left.words.map(|w| &w[..COLUMNS]);
    let left_scale = &left.scale[..LANES];
    let left_mean = &left.mean[..LANES];
    let left_gradient = &left.gradient[..LANES];
    let pair = |word: u32| (i32::from(word as u16 as i16), i32::from((word >> 16) as u16 as i16));
    for (k, cost) in out.iter_mut().enumerate() {
        let x = at - low - k;
        let mut columns = [0_i32; COLUMNS];
        for (l, r) in left_words.iter().zip(right.words) {
            let r = &r[x..x + COLUMNS];
            for i in 0..COLUMNS {
                let ((l0, l1), (r0, r1)) = (pair(l[i]), pair(r[i]));
                columns[i] += l0 * r0 + l1 * r1;
            }
        }
        let right_scale = &right.scale[x..x + LANES];
        let right_mean = &right.mean[x..x + LANES];
        let right_gradient = &right.gradient[x..x + LANES];
        for i in 0..LANES {
            let sum = columns[i] + columns[i + 1] + columns[i + 2] + columns[i + 3] + columns[i + 4];
            let product = (sum + constants.bias) as f32 * left_scale[i] * right_scale[i];
            let similarity = product - left_mean[i] * right_mean[i];
            let structure = (constants.middle - similarity) as i32 as u8;
            let step = left_gradient[i].abs_diff(right_gradient[i]).min(constants.gradient_limit);
            cost.0[i] = structure.saturating_add(step.saturating_mul(2));
        }
    }
}
