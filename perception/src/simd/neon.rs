//! NEON: one vector is two registers of 128 bits. Every 64-bit ARM has it.

use super::plain::score_pairs;
use super::{CostConstants, CostRow, Lanes, Packing, RemapTile, Simd};
use std::arch::aarch64::*;

/// The NEON level.
#[derive(Clone, Copy, Debug)]
pub struct Neon;

type Halves = [uint8x16_t; 2];

/// Turns a 16 × 16 block.
#[inline(always)]
fn transpose_half(mut v: [uint8x16_t; 16]) -> [uint8x16_t; 16] {
    for _ in 0..4 {
        let mut o = v;
        for i in 0..8 {
            // SAFETY: every AArch64 processor that runs this has NEON.
            unsafe {
                o[2 * i] = vzip1q_u8(v[i], v[i + 8]);
                o[2 * i + 1] = vzip2q_u8(v[i], v[i + 8]);
            }
        }
        v = o;
    }
    v
}

impl Simd for Neon {
    type Bytes = Halves;
    const PACKING: Packing = Packing::Pairs;

    #[inline(always)]
    fn splat(self, value: u8) -> Halves {
        // SAFETY: every AArch64 processor that runs this has NEON.
        unsafe { [vdupq_n_u8(value); 2] }
    }

    #[inline(always)]
    fn load(self, from: &Lanes) -> Halves {
        // SAFETY: NEON is there; both halves lie inside the 32 bytes of `Lanes`.
        unsafe { [vld1q_u8(from.0.as_ptr()), vld1q_u8(from.0.as_ptr().add(16))] }
    }

    #[inline(always)]
    fn store(self, value: Halves, to: &mut Lanes) {
        // SAFETY: NEON is there; both halves lie inside the 32 bytes of `Lanes`.
        unsafe {
            vst1q_u8(to.0.as_mut_ptr(), value[0]);
            vst1q_u8(to.0.as_mut_ptr().add(16), value[1]);
        }
    }

    #[inline(always)]
    fn stream(self, value: Halves, to: &mut Lanes) {
        self.store(value, to);
    }

    #[inline(always)]
    fn settle(self) {}

    #[inline(always)]
    fn expect(self, _: &[Lanes]) {}

    #[inline(always)]
    fn min(self, a: Halves, b: Halves) -> Halves {
        // SAFETY: every AArch64 processor that runs this has NEON.
        unsafe { [vminq_u8(a[0], b[0]), vminq_u8(a[1], b[1])] }
    }

    #[inline(always)]
    fn max(self, a: Halves, b: Halves) -> Halves {
        // SAFETY: every AArch64 processor that runs this has NEON.
        unsafe { [vmaxq_u8(a[0], b[0]), vmaxq_u8(a[1], b[1])] }
    }

    #[inline(always)]
    fn add(self, a: Halves, b: Halves) -> Halves {
        // SAFETY: every AArch64 processor that runs this has NEON.
        unsafe { [vqaddq_u8(a[0], b[0]), vqaddq_u8(a[1], b[1])] }
    }

    #[inline(always)]
    fn sub(self, a: Halves, b: Halves) -> Halves {
        // SAFETY: every AArch64 processor that runs this has NEON.
        unsafe { [vqsubq_u8(a[0], b[0]), vqsubq_u8(a[1], b[1])] }
    }

    #[inline(always)]
    fn mean(self, a: Halves, b: Halves) -> Halves {
        // SAFETY: every AArch64 processor that runs this has NEON.
        unsafe { [vrhaddq_u8(a[0], b[0]), vrhaddq_u8(a[1], b[1])] }
    }

    #[inline(always)]
    fn select_equal(self, a: Halves, b: Halves, yes: Halves, no: Halves) -> Halves {
        // SAFETY: every AArch64 processor that runs this has NEON.
        unsafe {
            [vbslq_u8(vceqq_u8(a[0], b[0]), yes[0], no[0]), vbslq_u8(vceqq_u8(a[1], b[1]), yes[1], no[1])]
        }
    }

    #[inline(always)]
    fn select_less(self, a: Halves, b: Halves, yes: Halves, no: Halves) -> Halves {
        // SAFETY: every AArch64 processor that runs this has NEON.
        unsafe {
            [vbslq_u8(vcltq_u8(a[0], b[0]), yes[0], no[0]), vbslq_u8(vcltq_u8(a[1], b[1]), yes[1], no[1])]
        }
    }

    #[inline(always)]
    fn contains(self, set: &Lanes, values: Halves) -> Halves {
        let set = self.load(set);
        let mut found = values;
        for found in &mut found {
            // SAFETY: every AArch64 processor that runs this has NEON.
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
        // SAFETY: every AArch64 processor that runs this has NEON.
        unsafe { [vextq_u8::<15>(left[1], own[0]), vextq_u8::<15>(own[0], own[1])] }
    }

    #[inline(always)]
    fn shift_left(self, own: Halves, right: Halves) -> Halves {
        // SAFETY: every AArch64 processor that runs this has NEON.
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
        super::plain::remap_pixels(source, stride, tile, out);
    }
}
