//! AVX2: one vector is one register of 256 bits.

use super::kernel_set::{CostConstants, CostRow, LANES, Lanes, Packing, RemapTile, Simd};
use std::arch::x86_64::*;

/// The AVX2 level.
#[derive(Clone, Copy, Debug)]
pub struct Avx2(());

impl Avx2 {
    /// Creates the token; callers are compiled for AVX2.
    #[target_feature(enable = "avx2")]
    #[inline]
    pub(crate) fn new() -> Self {
        Avx2(())
    }
}

/// Transposes the two 16 × 16 blocks in sixteen rows of two 16-byte halves.
#[inline(always)]
fn transpose_halves(mut v: [__m256i; 16]) -> [__m256i; 16] {
    for _ in 0..4 {
        let mut o = v;
        for i in 0..8 {
            // SAFETY: callers hold an `Avx2` or `Avx512` token, so the CPU has AVX2.
            unsafe {
                o[2 * i] = _mm256_unpacklo_epi8(v[i], v[i + 8]);
                o[2 * i + 1] = _mm256_unpackhi_epi8(v[i], v[i + 8]);
            }
        }
        v = o;
    }
    v
}

impl Simd for Avx2 {
    type Bytes = __m256i;
    const PACKING: Packing = Packing::Pairs;

    #[inline(always)]
    fn splat(self, value: u8) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2.
        unsafe { _mm256_set1_epi8(value as i8) }
    }

    #[inline(always)]
    fn load(self, from: &Lanes) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2; `Lanes` is 32 bytes, aligned to 32.
        unsafe { _mm256_load_si256(std::ptr::from_ref(from).cast()) }
    }

    #[inline(always)]
    fn store(self, value: __m256i, to: &mut Lanes) {
        // SAFETY: the token exists, so the CPU has AVX2; `Lanes` is 32 bytes, aligned to 32.
        unsafe { _mm256_store_si256(std::ptr::from_mut(to).cast(), value) }
    }

    #[inline(always)]
    unsafe fn stream(self, value: __m256i, to: &mut Lanes) {
        // SAFETY: the token exists, so the CPU has AVX; `Lanes` is 32 bytes, aligned to 32. The caller executes the
        // fence before the vector is accessed otherwise.
        unsafe { _mm256_stream_si256(std::ptr::from_mut(to).cast(), value) }
    }

    #[inline(always)]
    fn store_fence(self) {
        // SAFETY: every x86-64 CPU has SSE; a fence accesses no memory.
        unsafe { _mm_sfence() }
    }

    #[inline(always)]
    fn prefetch(self, vectors: &[Lanes]) {
        // One prefetch for each cache line of 64 bytes.
        for vector in vectors.iter().step_by(2) {
            // SAFETY: every x86-64 CPU has SSE; a prefetch has no effect on memory.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(vector).cast()) }
        }
    }

    #[inline(always)]
    fn min(self, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2.
        unsafe { _mm256_min_epu8(a, b) }
    }

    #[inline(always)]
    fn max(self, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2.
        unsafe { _mm256_max_epu8(a, b) }
    }

    #[inline(always)]
    fn add(self, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2.
        unsafe { _mm256_adds_epu8(a, b) }
    }

    #[inline(always)]
    fn sub(self, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2.
        unsafe { _mm256_subs_epu8(a, b) }
    }

    #[inline(always)]
    fn mean(self, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2.
        unsafe { _mm256_avg_epu8(a, b) }
    }

    #[inline(always)]
    fn select_equal(self, a: __m256i, b: __m256i, yes: __m256i, no: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2.
        unsafe { _mm256_blendv_epi8(no, yes, _mm256_cmpeq_epi8(a, b)) }
    }

    #[inline(always)]
    fn select_less(self, a: __m256i, b: __m256i, yes: __m256i, no: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2.
        unsafe {
            let not_less = _mm256_cmpeq_epi8(_mm256_max_epu8(a, b), a);
            _mm256_blendv_epi8(yes, no, not_less)
        }
    }

    #[inline(always)]
    fn contains(self, set: &Lanes, values: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2; `Lanes` is two times 16 bytes.
        unsafe {
            let halves: *const __m128i = std::ptr::from_ref(set).cast();
            let low = _mm256_broadcastsi128_si256(_mm_load_si128(halves));
            let high = _mm256_broadcastsi128_si256(_mm_load_si128(halves.add(1)));
            // The top bit of a value selects the half of the set that holds its byte.
            let byte = _mm256_and_si256(_mm256_srli_epi16::<3>(values), _mm256_set1_epi8(15));
            let word =
                _mm256_blendv_epi8(_mm256_shuffle_epi8(low, byte), _mm256_shuffle_epi8(high, byte), values);
            let powers = _mm256_set1_epi64x(0x8040_2010_0804_0201_u64 as i64);
            let bit = _mm256_shuffle_epi8(powers, _mm256_and_si256(values, _mm256_set1_epi8(7)));
            _mm256_cmpeq_epi8(_mm256_and_si256(word, bit), bit)
        }
    }

    #[inline(always)]
    fn shift_right(self, own: __m256i, left: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2.
        unsafe { _mm256_alignr_epi8::<15>(own, _mm256_permute2x128_si256::<0x03>(own, left)) }
    }

    #[inline(always)]
    fn shift_left(self, own: __m256i, right: __m256i) -> __m256i {
        // SAFETY: the token exists, so the CPU has AVX2.
        unsafe { _mm256_alignr_epi8::<1>(_mm256_permute2x128_si256::<0x21>(own, right), own) }
    }

    #[inline(always)]
    fn transpose(self, block: &mut [Lanes], stride: usize) {
        let (mut upper, mut lower) = ([self.splat(0); 16], [self.splat(0); 16]);
        for i in 0..16 {
            upper[i] = self.load(&block[i * stride]);
        }
        upper = transpose_halves(upper);
        for i in 0..16 {
            lower[i] = self.load(&block[(i + 16) * stride]);
        }
        lower = transpose_halves(lower);
        for i in 0..16 {
            // SAFETY: the token exists, so the CPU has AVX2.
            let (first, second) = unsafe {
                (
                    _mm256_permute2x128_si256::<0x20>(upper[i], lower[i]),
                    _mm256_permute2x128_si256::<0x31>(upper[i], lower[i]),
                )
            };
            self.store(first, &mut block[i * stride]);
            self.store(second, &mut block[(i + 16) * stride]);
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
        // 36 columns are used; five vectors of eight cover them.
        const VECTORS: usize = LANES / 8 + 1;
        const COLUMNS: usize = 8 * VECTORS;
        let Some(last) = out.len().checked_sub(1) else { return };
        assert!(low.checked_add(last).is_some_and(|high| at >= high));
        assert!(at - low <= right.gradient.len());
        for (l, r) in left.words.iter().zip(right.words) {
            assert!(l.len() >= COLUMNS && r.len() >= at - low + COLUMNS);
        }
        for (l, r) in [(left.scale, right.scale), (left.mean, right.mean)] {
            assert!(l.len() >= LANES && r.len() >= at - low + LANES);
        }
        assert!(left.gradient.len() >= LANES && right.gradient.len() >= at - low + LANES);
        for (k, cost) in out.iter_mut().enumerate() {
            let x = at - low - k;
            // SAFETY: the token exists, so the CPU has AVX2. All addresses lie inside the slices: x is
            // at most `at - low` and at least 0, and the assertions above check the lengths for both.
            unsafe {
                let mut columns = [_mm256_setzero_si256(); VECTORS];
                for (v, column) in columns.iter_mut().enumerate() {
                    let mut sum = _mm256_setzero_si256();
                    for n in 0..3 {
                        let l = words(left.words[n], 8 * v);
                        let r = words(right.words[n], x + 8 * v);
                        sum = _mm256_add_epi32(sum, _mm256_madd_epi16(l, r));
                    }
                    *column = sum;
                }
                let bias = _mm256_set1_epi32(constants.bias);
                let middle = _mm256_set1_ps(constants.middle);
                let mut eights = [bias; 4];
                for (v, eight) in eights.iter_mut().enumerate() {
                    // The columns from each of eight on, by 1, 2, 3 and 4: in registers, since a load of what two
                    // stores have just written waits for both.
                    let by_0 = columns[v];
                    let by_4 = _mm256_permute2x128_si256::<0x21>(by_0, columns[v + 1]);
                    let by_1 = _mm256_alignr_epi8::<4>(by_4, by_0);
                    let by_2 = _mm256_alignr_epi8::<8>(by_4, by_0);
                    let by_3 = _mm256_alignr_epi8::<12>(by_4, by_0);
                    let sides = _mm256_add_epi32(_mm256_add_epi32(by_0, by_4), _mm256_add_epi32(by_1, by_3));
                    let sum = _mm256_add_epi32(bias, _mm256_add_epi32(by_2, sides));
                    let product = _mm256_mul_ps(_mm256_cvtepi32_ps(sum), floats(left.scale, 8 * v));
                    let product = _mm256_mul_ps(product, floats(right.scale, x + 8 * v));
                    let means = _mm256_mul_ps(floats(left.mean, 8 * v), floats(right.mean, x + 8 * v));
                    let similarity = _mm256_sub_ps(product, means);
                    *eight = _mm256_cvttps_epi32(_mm256_sub_ps(middle, similarity));
                }
                // Packing works within 128-bit halves; the permutation restores the order of the groups of four.
                let low_half = _mm256_packs_epi32(eights[0], eights[1]);
                let high_half = _mm256_packs_epi32(eights[2], eights[3]);
                let packed = _mm256_packus_epi16(low_half, high_half);
                let order = _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7);
                let structure = _mm256_permutevar8x32_epi32(packed, order);
                let l = _mm256_loadu_si256(left.gradient.as_ptr().cast());
                let r = _mm256_loadu_si256(right.gradient.as_ptr().add(x).cast());
                let step = _mm256_or_si256(_mm256_subs_epu8(l, r), _mm256_subs_epu8(r, l));
                let step = _mm256_min_epu8(step, _mm256_set1_epi8(constants.gradient_limit as i8));
                let step = _mm256_adds_epu8(step, step);
                self.store(_mm256_adds_epu8(structure, step), cost);
            }
        }
    }

    #[inline(always)]
    fn remap(self, source: &[u8], stride: usize, tile: &RemapTile, out: &mut Lanes) {
        // SAFETY: the token exists, so the CPU has AVX2.
        self.store(unsafe { remap(source, stride, tile) }, out);
    }
}

/// [`Simd::remap`].
///
/// # Safety
/// The CPU has AVX2.
#[inline(always)]
pub(super) unsafe fn remap(source: &[u8], stride: usize, tile: &RemapTile) -> __m256i {
    let Some(starts) = tile.window_starts(source.len(), stride) else {
        // The image is smaller than a window.
        let mut lanes = Lanes::ZERO;
        super::plain::remap_pixels(source, stride, tile, &mut lanes);
        // SAFETY: the caller guarantees AVX2; `Lanes` is 32 bytes aligned to 32.
        return unsafe { _mm256_load_si256(std::ptr::from_ref(&lanes).cast()) };
    };
    // SAFETY: the caller guarantees AVX2. `window_starts` has checked that the 16 bytes of all three rows of every
    // window lie in `source`. The tile's arrays are read completely, in halves; shuffles take any index.
    unsafe {
        let mut halves = [_mm256_setzero_si256(); 2];
        for (h, half) in halves.iter_mut().enumerate() {
            let (first, second) = (starts[2 * h], starts[2 * h + 1]);
            let columns = _mm256_load_si256(tile.pairs.as_ptr().add(16 * h).cast());
            let across = _mm_loadu_si128(tile.across.as_ptr().add(16 * h).cast());
            let down = _mm_loadu_si128(tile.down.as_ptr().add(16 * h).cast());
            // 32 − f in the low byte, f in the high one.
            let across = _mm256_cvtepu8_epi16(across);
            let thirty_two = _mm256_set1_epi16(32);
            let weights =
                _mm256_or_si256(_mm256_slli_epi16::<8>(across), _mm256_sub_epi16(thirty_two, across));
            let mut rows = [_mm256_setzero_si256(); 3];
            for (r, row) in rows.iter_mut().enumerate() {
                let low = _mm_loadu_si128(source.as_ptr().add(first + r * stride).cast());
                let high = _mm_loadu_si128(source.as_ptr().add(second + r * stride).cast());
                let pixels = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(low), high);
                *row = _mm256_maddubs_epi16(_mm256_shuffle_epi8(pixels, columns), weights);
            }
            let down = _mm256_cvtepu8_epi16(down);
            let lower = _mm256_cmpgt_epi16(down, _mm256_set1_epi16(127));
            let share = _mm256_slli_epi16::<10>(_mm256_and_si256(down, _mm256_set1_epi16(31)));
            let top = _mm256_blendv_epi8(rows[0], rows[1], lower);
            let bottom = _mm256_blendv_epi8(rows[1], rows[2], lower);
            // Rounding down twice equals rounding down once: all intermediate values fit into 16 bits.
            let step = _mm256_sub_epi16(bottom, top);
            let step = _mm256_mulhi_epi16(_mm256_add_epi16(step, step), share);
            let sum = _mm256_add_epi16(_mm256_add_epi16(top, step), _mm256_set1_epi16(16));
            *half = _mm256_srli_epi16::<5>(sum);
        }
        // Packing works within 128-bit halves; the permutation restores the order of the groups of eight.
        _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packus_epi16(halves[0], halves[1]))
    }
}

/// Loads eight words from `at` on.
///
/// # Safety
/// The CPU has AVX2 and `row` has at least 8 values from `at` on.
#[inline(always)]
unsafe fn words(row: &[u32], at: usize) -> __m256i {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm256_loadu_si256(row.as_ptr().add(at).cast()) }
}

/// Loads eight floats from `at` on.
///
/// # Safety
/// The CPU has AVX2 and `row` has at least 8 values from `at` on.
#[inline(always)]
unsafe fn floats(row: &[f32], at: usize) -> __m256 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm256_loadu_ps(row.as_ptr().add(at)) }
}
