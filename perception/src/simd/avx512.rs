//! AVX-512 with BW, VL and VNNI: byte operations in registers of 256 bits as with AVX2 (one instruction where
//! that needs two), matching costs in registers of 512 bits.

use super::avx2::Avx2;
use super::kernel_set::{CostConstants, CostRow, LANES, Lanes, Packing, RemapTile, Simd};
use std::arch::x86_64::*;

/// The AVX-512 level.
#[derive(Clone, Copy, Debug)]
pub struct Avx512(Avx2);

impl Avx512 {
    /// Creates the token; callers are compiled for these features.
    #[target_feature(enable = "avx2,avx512f,avx512bw,avx512vl,avx512vnni")]
    #[inline]
    pub(crate) fn new() -> Self {
        Avx512(Avx2::new())
    }
}

impl Simd for Avx512 {
    type Bytes = __m256i;
    const PACKING: Packing = Packing::Quads;

    #[inline(always)]
    fn splat(self, value: u8) -> __m256i {
        self.0.splat(value)
    }

    #[inline(always)]
    fn load(self, from: &Lanes) -> __m256i {
        self.0.load(from)
    }

    #[inline(always)]
    fn store(self, value: __m256i, to: &mut Lanes) {
        self.0.store(value, to);
    }

    #[inline(always)]
    unsafe fn stream(self, value: __m256i, to: &mut Lanes) {
        // SAFETY: guaranteed by the caller.
        unsafe { self.0.stream(value, to) }
    }

    #[inline(always)]
    fn store_fence(self) {
        self.0.store_fence();
    }

    #[inline(always)]
    fn prefetch(self, vectors: &[Lanes]) {
        self.0.prefetch(vectors);
    }

    #[inline(always)]
    fn min(self, a: __m256i, b: __m256i) -> __m256i {
        self.0.min(a, b)
    }

    #[inline(always)]
    fn max(self, a: __m256i, b: __m256i) -> __m256i {
        self.0.max(a, b)
    }

    #[inline(always)]
    fn add(self, a: __m256i, b: __m256i) -> __m256i {
        self.0.add(a, b)
    }

    #[inline(always)]
    fn sub(self, a: __m256i, b: __m256i) -> __m256i {
        self.0.sub(a, b)
    }

    #[inline(always)]
    fn mean(self, a: __m256i, b: __m256i) -> __m256i {
        self.0.mean(a, b)
    }

    #[inline(always)]
    fn select_equal(self, a: __m256i, b: __m256i, yes: __m256i, no: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX-512 BW and VL.
        unsafe { _mm256_mask_blend_epi8(_mm256_cmpeq_epu8_mask(a, b), no, yes) }
    }

    #[inline(always)]
    fn select_less(self, a: __m256i, b: __m256i, yes: __m256i, no: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX-512 BW and VL.
        unsafe { _mm256_mask_blend_epi8(_mm256_cmplt_epu8_mask(a, b), no, yes) }
    }

    #[inline(always)]
    fn contains(self, set: &Lanes, values: __m256i) -> __m256i {
        self.0.contains(set, values)
    }

    #[inline(always)]
    fn shift_right(self, own: __m256i, left: __m256i) -> __m256i {
        self.0.shift_right(own, left)
    }

    #[inline(always)]
    fn shift_left(self, own: __m256i, right: __m256i) -> __m256i {
        self.0.shift_left(own, right)
    }

    #[inline(always)]
    fn transpose(self, block: &mut [Lanes], stride: usize) {
        self.0.transpose(block, stride);
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
        // 36 columns are used; two vectors of sixteen and one of four cover them.
        const COLUMNS: usize = LANES + 4;
        let Some(last) = out.len().checked_sub(1) else { return };
        assert!(low.checked_add(last).is_some_and(|high| at >= high));
        assert!(at - low <= right.gradient.len());
        for (l, r) in [(left.words[0], right.words[0]), (left.words[2], right.words[2])] {
            assert!(l.len() >= COLUMNS && r.len() >= at - low + COLUMNS);
        }
        for (l, r) in [(left.scale, right.scale), (left.mean, right.mean)] {
            assert!(l.len() >= LANES && r.len() >= at - low + LANES);
        }
        assert!(left.gradient.len() >= LANES && right.gradient.len() >= at - low + LANES);
        // SAFETY: the token exists, so the CPU has these features. All addresses lie inside the slices:
        // x is at most `at - low` and at least 0, and the assertions above check the lengths for both.
        unsafe {
            // Rows 0 to 3 of the window, then row 4.
            let first = words(left.words[0], 0);
            let second = words(left.words[2], 0);
            let left_scale = floats(left.scale, 0);
            let left_mean = floats(left.mean, 0);
            let left_gradient = _mm256_loadu_si256(left.gradient.as_ptr().cast());
            let bias = _mm512_set1_epi32(constants.bias);
            let middle = _mm512_set1_ps(constants.middle);
            let limit = _mm256_set1_epi8(constants.gradient_limit as i8);
            let none = _mm512_setzero_si512();
            for (k, cost) in out.iter_mut().enumerate() {
                let x = at - low - k;
                let (upper, fifth) = (words(right.words[0], x), words(right.words[2], x));
                let mut column = [none; 3];
                for v in 0..2 {
                    let sum = _mm512_dpbusd_epi32(none, first.0[v], upper.0[v]);
                    column[v] = _mm512_dpbusd_epi32(sum, second.0[v], fifth.0[v]);
                }
                let few = _mm_dpbusd_epi32(_mm_setzero_si128(), first.1, upper.1);
                let few = _mm_dpbusd_epi32(few, second.1, fifth.1);
                column[2] = _mm512_castsi128_si512(few);
                // Sums of two, then four, then five columns.
                let mut two = [none; 3];
                for v in 0..2 {
                    let next = _mm512_alignr_epi32::<1>(column[v + 1], column[v]);
                    two[v] = _mm512_add_epi32(column[v], next);
                }
                two[2] = _mm512_castsi128_si512(_mm_add_epi32(few, _mm_srli_si128::<4>(few)));
                let right_scale = floats(right.scale, x);
                let right_mean = floats(right.mean, x);
                let mut scored = [_mm_setzero_si128(); 2];
                for v in 0..2 {
                    let next = _mm512_alignr_epi32::<2>(two[v + 1], two[v]);
                    let last = _mm512_alignr_epi32::<4>(column[v + 1], column[v]);
                    let four = _mm512_add_epi32(two[v], next);
                    let sum = _mm512_add_epi32(four, _mm512_add_epi32(last, bias));
                    let product = _mm512_mul_ps(_mm512_cvtepi32_ps(sum), left_scale[v]);
                    let product = _mm512_mul_ps(product, right_scale[v]);
                    let means = _mm512_mul_ps(left_mean[v], right_mean[v]);
                    let cost = _mm512_sub_ps(middle, _mm512_sub_ps(product, means));
                    scored[v] = _mm512_cvtepi32_epi8(_mm512_cvttps_epi32(cost));
                }
                let structure = _mm256_set_m128i(scored[1], scored[0]);
                let r = _mm256_loadu_si256(right.gradient.as_ptr().add(x).cast());
                let step =
                    _mm256_or_si256(_mm256_subs_epu8(left_gradient, r), _mm256_subs_epu8(r, left_gradient));
                let step = _mm256_min_epu8(step, limit);
                let step = _mm256_adds_epu8(step, step);
                self.store(_mm256_adds_epu8(structure, step), cost);
            }
        }
    }

    #[inline(always)]
    fn remap(self, source: &[u8], stride: usize, tile: &RemapTile, out: &mut Lanes) {
        // SAFETY: the token exists, so the CPU has AVX2 as well.
        self.store(unsafe { super::avx2::remap(source, stride, tile) }, out);
    }
}

/// Loads 36 words from `at` on.
///
/// # Safety
/// The CPU has AVX-512 F and `row` has at least 36 values from `at` on.
#[inline(always)]
unsafe fn words(row: &[u32], at: usize) -> ([__m512i; 2], __m128i) {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let row = row.as_ptr().add(at);
        (
            [_mm512_loadu_si512(row.cast()), _mm512_loadu_si512(row.add(16).cast())],
            _mm_loadu_si128(row.add(32).cast()),
        )
    }
}

/// Loads two vectors of floats from `at` on.
///
/// # Safety
/// The CPU has AVX-512 F and `row` has at least 32 values from `at` on.
#[inline(always)]
unsafe fn floats(row: &[f32], at: usize) -> [__m512; 2] {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let row = row.as_ptr().add(at);
        [_mm512_loadu_ps(row), _mm512_loadu_ps(row.add(16))]
    }
}
