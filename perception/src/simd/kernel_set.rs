//! The vector type and the operations that every instruction-set level implements for it.

/// Lanes of a vector: one byte for each of 32 pixels.
pub const LANES: usize = 32;

/// A vector in memory: one byte for each of [`LANES`] neighbouring pixels or rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C, align(32))]
pub struct Lanes(pub [u8; LANES]);

impl Lanes {
    /// Zero in every lane.
    pub const ZERO: Lanes = Lanes([0; LANES]);
    /// 255 in every lane: the energy of nodes that do not exist.
    pub const FULL: Lanes = Lanes([u8::MAX; LANES]);

    /// `value` in every lane.
    pub const fn splat(value: u8) -> Self {
        Lanes([value; LANES])
    }
}

/// The statistics of one image row that the matching cost needs, one value for each pixel: see
/// [`crate::stereo::cost`].
#[derive(Clone, Copy, Debug)]
pub struct CostRow<'a> {
    /// Window rows, packed as [`Packing`] says, one word for each column: those that start at the first,
    /// the third and the fifth row.
    pub words: [&'a [u32]; 3],
    /// Scale of the covariance.
    pub scale: &'a [f32],
    /// Window mean times the square root of its scale.
    pub mean: &'a [f32],
    /// Horizontal gradient.
    pub gradient: &'a [u8],
}

/// How the rows of a window are packed into words of 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// Two rows of 16 bits; the third word of the left image has one.
    Pairs,
    /// Four rows of 8 bits, the second word unused; the third word of the left image has one.
    Quads,
    /// The same without an offset.
    PlainQuads,
}

/// Constants of the matching cost for [`Simd::score`], the same for a whole image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostConstants {
    /// Added to each window's sum of products.
    pub bias: i32,
    /// The cost at similarity 0, plus half a unit for rounding.
    pub middle: f32,
    /// Subtracted from each grey value of the right image, but in the words of [`Packing::PlainQuads`].
    pub right_offset: i32,
    /// Truncation of the gradient difference, in grey levels; each level costs two units.
    pub gradient_limit: u8,
}

/// Source positions of the [`LANES`] pixels of a remapped tile, in groups of eight: see
/// [`crate::rectify`].
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub struct RemapTile {
    /// The two source columns of a pixel among the 16 of its group's window; 255 marks a black pixel.
    pub pairs: [[u8; 2]; LANES],
    /// Weight of the second column, in 1/32.
    pub across: [u8; LANES],
    /// Weight of the lower row, in 1/32. If 128 is added, the two rows are the window's second and third,
    /// otherwise its first and second.
    pub down: [u8; LANES],
    /// First column and row of each group's window of 16 × 3 pixels.
    pub windows: [[u16; 2]; LANES / 8],
}

impl RemapTile {
    /// A tile whose pixels are all black.
    pub const BLACK: RemapTile = RemapTile {
        pairs: [[255; 2]; LANES],
        across: [0; LANES],
        down: [0; LANES],
        windows: [[0; 2]; LANES / 8],
    };

    /// Index of the first byte of each group's window in an image of `bytes` bytes whose rows are `stride` bytes apart;
    /// `None` unless all 16 bytes of all three rows of every window lie in the image. The vectorised levels load them
    /// unchecked, so this holds for any tile, stride and image: nothing overflows.
    #[cfg_attr(not(any(target_arch = "x86_64", target_arch = "aarch64")), allow(dead_code))]
    #[inline(always)]
    pub(super) fn window_starts(&self, bytes: usize, stride: usize) -> Option<[usize; LANES / 8]> {
        let mut starts = [0; LANES / 8];
        for (start, [x, y]) in starts.iter_mut().zip(self.windows) {
            *start = usize::from(y).checked_mul(stride)?.checked_add(usize::from(x))?;
            let third_row = start.checked_add(stride.checked_mul(2)?)?;
            if third_row.checked_add(WINDOW_BYTES)? > bytes {
                return None;
            }
        }
        Some(starts)
    }
}

/// Bytes of a row of a group's window.
#[cfg_attr(not(any(target_arch = "x86_64", target_arch = "aarch64")), allow(dead_code))]
const WINDOW_BYTES: usize = 16;

/// The operations that kernels are made of, as one instruction-set level implements them.
///
/// Implementations are zero-sized tokens. A token that needs a CPU feature is created only inside
/// functions compiled for that feature, and [`Level`](super::Level) calls those only after the feature was
/// detected at run time.
pub trait Simd: Copy {
    /// [`LANES`] bytes in registers.
    type Bytes: Copy;

    /// How this level packs window rows.
    const PACKING: Packing;

    /// `value` in every lane.
    fn splat(self, value: u8) -> Self::Bytes;
    /// Loads a vector.
    fn load(self, from: &Lanes) -> Self::Bytes;
    /// Stores a vector.
    fn store(self, value: Self::Bytes, to: &mut Lanes);
    /// Stores a vector that is not read soon: a non-temporal store where the level has one. [`Streaming`] is the safe
    /// way to it.
    ///
    /// # Safety
    /// This thread executes [`Self::store_fence`] before the vector is accessed again by anything but this function,
    /// and before any store after which another thread may access it: neither the processor nor Rust's memory model
    /// orders a non-temporal store with other accesses.
    unsafe fn stream(self, value: Self::Bytes, to: &mut Lanes);
    /// Store fence: orders streamed vectors before all later stores, and so makes them visible to every thread that sees
    /// one of these.
    fn store_fence(self);
    /// Prefetches `vectors` into the caches.
    fn prefetch(self, vectors: &[Lanes]);
    /// Minimum, lane by lane.
    fn min(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// Maximum, lane by lane.
    fn max(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// Saturating sum: at most 255.
    fn add(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// Saturating difference: at least 0.
    fn sub(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// Rounded mean: halves are rounded up.
    fn mean(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// `yes` where `a` = `b`, `no` elsewhere.
    fn select_equal(self, a: Self::Bytes, b: Self::Bytes, yes: Self::Bytes, no: Self::Bytes) -> Self::Bytes;
    /// `yes` where `a` < `b`, `no` elsewhere.
    fn select_less(self, a: Self::Bytes, b: Self::Bytes, yes: Self::Bytes, no: Self::Bytes) -> Self::Bytes;
    /// 255 where `set` contains the lane's value, 0 elsewhere: value c is bit c & 7 of byte c >> 3.
    fn contains(self, set: &Lanes, values: Self::Bytes) -> Self::Bytes;
    /// Lane i of the result is lane i − 1 of `own`; lane 0 is the last lane of `left`.
    fn shift_right(self, own: Self::Bytes, left: Self::Bytes) -> Self::Bytes;
    /// Lane i of the result is lane i + 1 of `own`; the last lane is the first lane of `right`.
    fn shift_left(self, own: Self::Bytes, right: Self::Bytes) -> Self::Bytes;
    /// Transposes the 32 × 32 block of the vectors 0, `stride`, 2·`stride`… of `block`, in place.
    fn transpose(self, block: &mut [Lanes], stride: usize);

    /// Words of the bytes of four rows in each column, the first in the lowest bits, less `offset`. All are as long as
    /// `words`.
    #[inline(always)]
    fn interleave(self, rows: [&[u8]; 4], offset: u8, words: &mut [u32]) {
        let [a, b, c, d] = rows;
        for (word, (((&a, &b), &c), &d)) in words.iter_mut().zip(a.iter().zip(b).zip(c).zip(d)) {
            *word = u32::from_le_bytes([a, b, c, d].map(|v| v.wrapping_sub(offset)));
        }
    }

    /// Matching costs of the [`LANES`] pixels of a tile for `out.len()` disparities, the first of which is
    /// `low`. The words of `left` start two columns before the tile, its statistics at the tile. `right` is
    /// the whole row, and `at` is the tile's first column in it (two columns later for the words).
    fn score(
        self,
        constants: &CostConstants,
        left: &CostRow<'_>,
        right: &CostRow<'_>,
        at: usize,
        low: usize,
        out: &mut [Lanes],
    );

    /// Remaps one tile of an image, whose rows are `stride` bytes apart. A tile that is all black is valid for an
    /// image of any size; of any other, all windows lie in `source`.
    ///
    /// # Panics
    /// If a pixel that is not black lies outside `source`.
    fn remap(self, source: &[u8], stride: usize, tile: &RemapTile, out: &mut Lanes);
}

/// The right to stream vectors: its drop executes the store fence, also when a panic unwinds. Whoever holds it does not
/// read what it has streamed, and lends it to no other thread.
#[derive(Debug)]
pub struct Streaming<S: Simd>(S);

impl<S: Simd> Streaming<S> {
    /// From here to its drop, vectors may be streamed.
    #[inline(always)]
    pub fn new(s: S) -> Self {
        Self(s)
    }

    /// [`Simd::stream`].
    #[inline(always)]
    pub fn store(&self, value: S::Bytes, to: &mut Lanes) {
        // SAFETY: dropping `self` executes the fence on this thread. It lives in a kernel that only writes the
        // vectors that it streams, and that returns before they are handed to another thread: so nothing accesses them
        // before the fence.
        unsafe { self.0.stream(value, to) }
    }
}

impl<S: Simd> Drop for Streaming<S> {
    #[inline(always)]
    fn drop(&mut self) {
        self.0.store_fence();
    }
}
