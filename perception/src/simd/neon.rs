//! NEON: one vector is two registers of 128 bits. Every 64-bit ARM CPU has it. CPUs with `dotprod` (ARMv8.2: Cortex-A55,
//! -A75 and later) multiply four rows of a window at once.

use super::kernel_set::{CostConstants, CostRow, LANES, Lanes, Packing, RemapTile, Simd};
use std::arch::aarch64::*;

/// The NEON level, and with `DOT` that of CPUs with `dotprod`.
#[derive(Clone, Copy, Debug)]
pub struct Neon<const DOT: bool>(());

impl Neon<false> {
    /// Creates the token.
    pub(crate) fn new() -> Self {
        Self(())
    }
}

impl Neon<true> {
    /// Creates the token; callers are compiled for this feature.
    #[target_feature(enable = "dotprod")]
    #[inline]
    pub(crate) fn new() -> Self {
        Self(())
    }
}

type Halves = [uint8x16_t; 2];

/// Transposes a 16 × 16 block.
#[inline(always)]
fn transpose_half(mut v: [uint8x16_t; 16]) -> [uint8x16_t; 16] {
    for _ in 0..4 {
        let mut o = v;
        for i in 0..8 {
            // SAFETY: every AArch64 CPU that runs this has NEON.
            unsafe {
                o[2 * i] = vzip1q_u8(v[i], v[i + 8]);
                o[2 * i + 1] = vzip2q_u8(v[i], v[i + 8]);
            }
        }
        v = o;
    }
    v
}

/// Columns of words that are used for a vector of pixels: nine vectors of four.
const COLUMNS: usize = LANES + 4;
/// Four columns of words.
type Words = int32x4_t;
/// Pixels of half a vector, and the words for their windows, in registers of four.
const HALF: usize = LANES / 2;
const HALF_COLUMNS: usize = HALF / 4 + 1;

/// Adds the products of the four bytes of each word.
///
/// # Safety
/// The CPU has `dotprod`.
#[inline(always)]
unsafe fn add_products(mut sums: Words, left: Words, right: Words) -> Words {
    // SAFETY: the caller guarantees the feature. The intrinsic is not stable yet (stdarch_neon_dotprod).
    unsafe {
        std::arch::asm!(
            ".arch_extension dotprod",
            "udot {sums:v}.4s, {left:v}.16b, {right:v}.16b",
            sums = inout(vreg) sums,
            left = in(vreg) left,
            right = in(vreg) right,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    sums
}

impl<const DOT: bool> Neon<DOT> {
    /// Sums of products of the rows of a window, for four columns.
    ///
    /// # Safety
    /// The CPU has `dotprod`.
    #[inline(always)]
    unsafe fn column(left: [Words; 2], right: [Words; 2]) -> Words {
        // SAFETY: the caller guarantees the feature; every AArch64 CPU that runs this has NEON.
        unsafe { add_products(add_products(vdupq_n_s32(0), left[0], right[0]), left[1], right[1]) }
    }

    /// Sums of five neighbouring columns, plus `added`.
    #[inline(always)]
    fn windows(columns: [Words; HALF_COLUMNS], added: [Words; HALF / 4]) -> [Words; HALF / 4] {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe {
            let mut two = columns;
            for v in 0..HALF_COLUMNS {
                // Of the last vector only the first three columns count.
                let next = columns[(v + 1).min(HALF_COLUMNS - 1)];
                two[v] = vaddq_s32(columns[v], vextq_s32::<1>(columns[v], next));
            }
            let mut sums = added;
            for v in 0..HALF / 4 {
                let four = vaddq_s32(two[v], vextq_s32::<2>(two[v], two[v + 1]));
                sums[v] = vaddq_s32(four, vaddq_s32(columns[v + 1], added[v]));
            }
            sums
        }
    }

    /// [`Simd::score`] for 16 pixels from `first` on, by `dotprod`. What belongs to the left image stays in registers for all
    /// disparities.
    ///
    /// # Safety
    /// The CPU has `dotprod`.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    unsafe fn score_half(
        constants: &CostConstants,
        left: &CostRow<'_>,
        right: &CostRow<'_>,
        at: usize,
        low: usize,
        first: usize,
        out: &mut [Lanes],
    ) {
        // SAFETY: the caller guarantees the feature. All addresses lie inside the slices: x is at most
        // `at - low + first` and at least `first`, and the assertions of `score` check the lengths for both.
        unsafe {
            let floats = |row: &[f32], at: usize| vld1q_f32(row.as_ptr().add(at));
            let of = |row: &CostRow<'_>, at: usize| {
                [row.words[0], row.words[2]].map(|words| vld1q_s32(words.as_ptr().add(at).cast()))
            };
            let l: [[Words; 2]; HALF_COLUMNS] = std::array::from_fn(|v| of(left, first + 4 * v));
            // The right image's bytes are without their offset: what it would take from each product.
            let ones = [vdupq_n_s32(0x0101_0101); 2];
            let sums = Self::windows(l.map(|l| Self::column(l, ones)), [vdupq_n_s32(0); HALF / 4]);
            let offset = vdupq_n_s32(constants.right_offset);
            let added = sums.map(|sum| vmlsq_s32(vdupq_n_s32(constants.bias), sum, offset));
            let left_scale: [_; HALF / 4] = std::array::from_fn(|v| floats(left.scale, first + 4 * v));
            let left_mean: [_; HALF / 4] = std::array::from_fn(|v| floats(left.mean, first + 4 * v));
            let left_gradient = vld1q_u8(left.gradient.as_ptr().add(first));
            let middle = vdupq_n_f32(constants.middle);
            let limit = vdupq_n_u8(constants.gradient_limit);
            for (k, cost) in out.iter_mut().enumerate() {
                let x = at - low - k + first;
                let columns = std::array::from_fn(|v| Self::column(l[v], of(right, x + 4 * v)));
                let sums = Self::windows(columns, added);
                let structure: [_; HALF / 4] = std::array::from_fn(|v| {
                    let product = vmulq_f32(vcvtq_f32_s32(sums[v]), left_scale[v]);
                    let product = vmulq_f32(product, floats(right.scale, x + 4 * v));
                    let means = vmulq_f32(left_mean[v], floats(right.mean, x + 4 * v));
                    vreinterpretq_u16_s32(vcvtq_s32_f32(vsubq_f32(middle, vsubq_f32(product, means))))
                });
                // The lowest byte of each word.
                let pairs = [vuzp1q_u16(structure[0], structure[1]), vuzp1q_u16(structure[2], structure[3])];
                let [a, b] = pairs.map(|pair| vreinterpretq_u8_u16(pair));
                let step = vminq_u8(vabdq_u8(left_gradient, vld1q_u8(right.gradient.as_ptr().add(x))), limit);
                let total = vqaddq_u8(vuzp1q_u8(a, b), vqaddq_u8(step, step));
                vst1q_u8(cost.0.as_mut_ptr().add(first), total);
            }
        }
    }

    /// [`Simd::score`] with the rows of a window in pairs. The left image is read again for each disparity: with all of it in
    /// registers, 26 of 32, those that are left do not suffice.
    #[inline(always)]
    fn score_pairs(
        self,
        constants: &CostConstants,
        left: &CostRow<'_>,
        right: &CostRow<'_>,
        at: usize,
        low: usize,
        out: &mut [Lanes],
    ) {
        // SAFETY: every AArch64 CPU that runs this has NEON. All addresses lie inside the slices: x is at most
        // `at - low` and at least 0, and the assertions of `score` check the lengths for both.
        unsafe {
            let pairs =
                |row: &[u32], at: usize| vreinterpretq_s16_s32(vld1q_s32(row.as_ptr().add(at).cast()));
            let floats = |row: &[f32], at: usize| vld1q_f32(row.as_ptr().add(at));
            let bias = vdupq_n_s32(constants.bias);
            let middle = vdupq_n_f32(constants.middle);
            let limit = vdupq_n_u8(constants.gradient_limit);
            for (k, cost) in out.iter_mut().enumerate() {
                let x = at - low - k;
                let mut column = [bias; COLUMNS / 4];
                for (v, column) in column.iter_mut().enumerate() {
                    let (l, r) = (pairs(left.words[0], 4 * v), pairs(right.words[0], x + 4 * v));
                    let mut even = vmull_s16(vget_low_s16(l), vget_low_s16(r));
                    let mut odd = vmull_high_s16(l, r);
                    for row in 1..3 {
                        let (l, r) = (pairs(left.words[row], 4 * v), pairs(right.words[row], x + 4 * v));
                        even = vmlal_s16(even, vget_low_s16(l), vget_low_s16(r));
                        odd = vmlal_high_s16(odd, l, r);
                    }
                    // The products of a word's two rows are adjacent.
                    *column = vpaddq_s32(even, odd);
                }
                // Sums of two, then five columns; of the last vector only the first three count.
                let mut two = column;
                for v in 0..COLUMNS / 4 {
                    let next = column[(v + 1).min(COLUMNS / 4 - 1)];
                    two[v] = vaddq_s32(column[v], vextq_s32::<1>(column[v], next));
                }
                let mut structure = [vdup_n_u16(0); LANES / 4];
                for (v, structure) in structure.iter_mut().enumerate() {
                    let four = vaddq_s32(two[v], vextq_s32::<2>(two[v], two[v + 1]));
                    let sum = vaddq_s32(four, vaddq_s32(column[v + 1], bias));
                    let product = vmulq_f32(vcvtq_f32_s32(sum), floats(left.scale, 4 * v));
                    let product = vmulq_f32(product, floats(right.scale, x + 4 * v));
                    let means = vmulq_f32(floats(left.mean, 4 * v), floats(right.mean, x + 4 * v));
                    let cost = vcvtq_s32_f32(vsubq_f32(middle, vsubq_f32(product, means)));
                    *structure = vmovn_u32(vreinterpretq_u32_s32(cost));
                }
                let half = |v: usize| {
                    let low = vmovn_u16(vcombine_u16(structure[v], structure[v + 1]));
                    vcombine_u8(low, vmovn_u16(vcombine_u16(structure[v + 2], structure[v + 3])))
                };
                let step = |i: usize| {
                    let l = vld1q_u8(left.gradient.as_ptr().add(i));
                    let r = vld1q_u8(right.gradient.as_ptr().add(x + i));
                    let step = vminq_u8(vabdq_u8(l, r), limit);
                    vqaddq_u8(step, step)
                };
                self.store([vqaddq_u8(half(0), step(0)), vqaddq_u8(half(4), step(16))], cost);
            }
        }
    }
}

impl<const DOT: bool> Simd for Neon<DOT> {
    type Bytes = Halves;
    const PACKING: Packing = if DOT { Packing::PlainQuads } else { Packing::Pairs };

    #[inline(always)]
    fn splat(self, value: u8) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe { [vdupq_n_u8(value); 2] }
    }

    #[inline(always)]
    fn load(self, from: &Lanes) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON; both halves lie inside the 32 bytes of `Lanes`.
        unsafe { [vld1q_u8(from.0.as_ptr()), vld1q_u8(from.0.as_ptr().add(16))] }
    }

    #[inline(always)]
    fn store(self, value: Halves, to: &mut Lanes) {
        // SAFETY: every AArch64 CPU that runs this has NEON; both halves lie inside the 32 bytes of `Lanes`.
        unsafe {
            vst1q_u8(to.0.as_mut_ptr(), value[0]);
            vst1q_u8(to.0.as_mut_ptr().add(16), value[1]);
        }
    }

    #[inline(always)]
    unsafe fn stream(self, value: Halves, to: &mut Lanes) {
        self.store(value, to);
    }

    #[inline(always)]
    fn store_fence(self) {}

    #[inline(always)]
    fn prefetch(self, _: &[Lanes]) {}

    #[inline(always)]
    fn min(self, a: Halves, b: Halves) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe { [vminq_u8(a[0], b[0]), vminq_u8(a[1], b[1])] }
    }

    #[inline(always)]
    fn max(self, a: Halves, b: Halves) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe { [vmaxq_u8(a[0], b[0]), vmaxq_u8(a[1], b[1])] }
    }

    #[inline(always)]
    fn add(self, a: Halves, b: Halves) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe { [vqaddq_u8(a[0], b[0]), vqaddq_u8(a[1], b[1])] }
    }

    #[inline(always)]
    fn sub(self, a: Halves, b: Halves) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe { [vqsubq_u8(a[0], b[0]), vqsubq_u8(a[1], b[1])] }
    }

    #[inline(always)]
    fn mean(self, a: Halves, b: Halves) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe { [vrhaddq_u8(a[0], b[0]), vrhaddq_u8(a[1], b[1])] }
    }

    #[inline(always)]
    fn select_equal(self, a: Halves, b: Halves, yes: Halves, no: Halves) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe {
            [vbslq_u8(vceqq_u8(a[0], b[0]), yes[0], no[0]), vbslq_u8(vceqq_u8(a[1], b[1]), yes[1], no[1])]
        }
    }

    #[inline(always)]
    fn select_less(self, a: Halves, b: Halves, yes: Halves, no: Halves) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe {
            [vbslq_u8(vcltq_u8(a[0], b[0]), yes[0], no[0]), vbslq_u8(vcltq_u8(a[1], b[1]), yes[1], no[1])]
        }
    }

    #[inline(always)]
    fn contains(self, set: &Lanes, values: Halves) -> Halves {
        let set = self.load(set);
        let mut found = values;
        for found in &mut found {
            // SAFETY: every AArch64 CPU that runs this has NEON.
            unsafe {
                let word = vqtbl2q_u8(uint8x16x2_t(set[0], set[1]), vshrq_n_u8::<3>(*found));
                let place = vreinterpretq_s8_u8(vandq_u8(*found, vdupq_n_u8(7)));
                *found = vtstq_u8(word, vshlq_u8(vdupq_n_u8(1), place));
            }
        }
        found
    }

    #[inline(always)]
    fn shift_right(self, own: Halves, left: Halves) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe { [vextq_u8::<15>(left[1], own[0]), vextq_u8::<15>(own[0], own[1])] }
    }

    #[inline(always)]
    fn shift_left(self, own: Halves, right: Halves) -> Halves {
        // SAFETY: every AArch64 CPU that runs this has NEON.
        unsafe { [vextq_u8::<1>(own[0], own[1]), vextq_u8::<1>(own[1], right[0])] }
    }

    #[inline(always)]
    fn transpose(self, block: &mut [Lanes], stride: usize) {
        let zero = self.splat(0)[0];
        // Upper left, upper right, lower left, lower right.
        let mut corners = [[zero; 16]; 4];
        for i in 0..16 {
            [corners[0][i], corners[1][i]] = self.load(&block[i * stride]);
            [corners[2][i], corners[3][i]] = self.load(&block[(i + 16) * stride]);
        }
        for corner in &mut corners {
            *corner = transpose_half(*corner);
        }
        for i in 0..16 {
            self.store([corners[0][i], corners[2][i]], &mut block[i * stride]);
            self.store([corners[1][i], corners[3][i]], &mut block[(i + 16) * stride]);
        }
    }

    #[inline(always)]
    fn interleave(self, rows: [&[u8]; 4], offset: u8, words: &mut [u32]) {
        const AT_ONCE: usize = 16;
        let columns = rows.iter().map(|row| row.len()).fold(words.len(), usize::min);
        let whole = columns / AT_ONCE * AT_ONCE;
        for x in (0..whole).step_by(AT_ONCE) {
            // SAFETY: every AArch64 CPU that runs this has NEON. 16 bytes of each row and 16 words from x on lie before
            // `columns`, which is no longer than any of them.
            unsafe {
                let [a, b, c, d] =
                    rows.map(|row| vsubq_u8(vld1q_u8(row.as_ptr().add(x)), vdupq_n_u8(offset)));
                vst4q_u8(words.as_mut_ptr().add(x).cast(), uint8x16x4_t(a, b, c, d));
            }
        }
        for x in whole..columns {
            words[x] = u32::from_le_bytes(rows.map(|row| row[x].wrapping_sub(offset)));
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
        let Some(last) = out.len().checked_sub(1) else { return };
        assert!(low.checked_add(last).is_some_and(|high| at >= high));
        for (l, r) in left.words.into_iter().zip(right.words) {
            assert!(l.len() >= COLUMNS && r.len() >= at - low + COLUMNS);
        }
        for (l, r) in [(left.scale, right.scale), (left.mean, right.mean)] {
            assert!(l.len() >= LANES && r.len() >= at - low + LANES);
        }
        assert!(left.gradient.len() >= LANES && right.gradient.len() >= at - low + LANES);
        if !DOT {
            return self.score_pairs(constants, left, right, at, low, out);
        }
        for first in [0, HALF] {
            // SAFETY: a `Neon<true>` is created only where the CPU has `dotprod`; the assertions above hold.
            unsafe { Self::score_half(constants, left, right, at, low, first, out) };
        }
    }

    #[inline(always)]
    fn remap(self, source: &[u8], stride: usize, tile: &RemapTile, out: &mut Lanes) {
        let Some(starts) = tile.window_starts(source.len(), stride) else {
            // The image is smaller than a window.
            super::plain::remap_pixels(source, stride, tile, out);
            return;
        };
        for (group, start) in starts.into_iter().enumerate() {
            let at = 8 * group;
            // SAFETY: every AArch64 CPU that runs this has NEON. `window_starts` has checked that the 16 bytes of all
            // three rows of every window lie in `source`. A group's eight pixels lie inside the 32 of the tile's arrays
            // (16 bytes of `pairs`, 8 of the others) and of `out`. Table lookups take any index.
            unsafe {
                let columns = vld2_u8(tile.pairs.as_ptr().add(at).cast());
                let across = vld1_u8(tile.across.as_ptr().add(at));
                let rest = vsub_u8(vdup_n_u8(32), across);
                // Columns outside the window, used for black pixels, give 0.
                let row = |r: usize| {
                    let pixels = vld1q_u8(source.as_ptr().add(start + r * stride));
                    let (left, right) = (vqtbl1_u8(pixels, columns.0), vqtbl1_u8(pixels, columns.1));
                    vmlal_u8(vmull_u8(left, rest), right, across)
                };
                let rows = [row(0), row(1), row(2)];
                let down = vld1_u8(tile.down.as_ptr().add(at));
                let share = vmovl_u8(vand_u8(down, vdup_n_u8(31)));
                // All bits of a pixel are set where the highest bit of its byte is set.
                let sign = vshr_n_s8::<7>(vreinterpret_s8_u8(down));
                let lower = vreinterpretq_u16_s16(vmovl_s8(sign));
                let top = vbslq_u16(lower, rows[1], rows[0]);
                let bottom = vbslq_u16(lower, rows[2], rows[1]);
                // 255 · 32 · 32 needs more than 16 bits.
                let left_over = vsubq_u16(vdupq_n_u16(32), share);
                let low = vmull_u16(vget_low_u16(top), vget_low_u16(left_over));
                let low = vmlal_u16(low, vget_low_u16(bottom), vget_low_u16(share));
                let high = vmull_high_u16(top, left_over);
                let high = vmlal_high_u16(high, bottom, share);
                let means = vrshrn_high_n_u32::<10>(vrshrn_n_u32::<10>(low), high);
                vst1_u8(out.0.as_mut_ptr().add(at), vmovn_u16(means));
            }
        }
    }
}
