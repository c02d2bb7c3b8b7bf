//! The vector type and the operations that every instruction-set level implements for it.

/// Pixels that one vector holds.
pub const LANES: usize = 32;

/// One byte for each of [`LANES`] neighbouring pixels or rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C, align(32))]
pub struct Lanes(pub [u8; LANES]);

impl Lanes {
    /// Zero in every lane.
    pub const ZERO: Lanes = Lanes([0; LANES]);
    /// 255 in every lane: energies of nodes that do not exist.
    pub const FULL: Lanes = Lanes([u8::MAX; LANES]);

    /// `value` in every lane.
    pub const fn splat(value: u8) -> Self {
        Lanes([value; LANES])
    }
}

/// The statistics of one image that the cost needs, pixel by pixel along a row: see
/// [`crate::stereo::cost`].
#[derive(Clone, Copy, Debug)]
pub struct CostRow<'a> {
    /// Window rows, packed as [`Packing`] says, one word per column: those from the first, the third
    /// and the fifth row on.
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
}

/// What does not change within an image, for [`Simd::score`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostConstants {
    /// Added to each window's sum of products.
    pub bias: i32,
    /// The cost of no similarity, and half a unit to round.
    pub middle: f32,
    /// Gradient differences above this all cost the same; a grey level costs two.
    pub gradient_limit: u8,
}

/// Where the [`LANES`] pixels of a remapped tile come from, in groups of eight: see
/// [`crate::rectify`].
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub struct RemapTile {
    /// The two columns of a pixel in the 16 of its group's window; 255 is black.
    pub pairs: [[u8; 2]; LANES],
    /// Share of the second column, in 1/32.
    pub across: [u8; LANES],
    /// Share of the lower row, in 1/32; with 128 added, of the window's second and third row.
    pub down: [u8; LANES],
    /// First column and row of each group's window of 16 × 3 pixels.
    pub windows: [[u16; 2]; LANES / 8],
}

impl RemapTile {
    /// A tile that shows nothing.
    pub const BLACK: RemapTile = RemapTile {
        pairs: [[255; 2]; LANES],
        across: [0; LANES],
        down: [0; LANES],
        windows: [[0; 2]; LANES / 8],
    };
}

/// One level's way of doing the operations that the kernels are made of.
///
/// Implementations are zero-sized tokens. Those that need a CPU feature are created only inside
/// functions compiled for it, which [`Level`] calls only after it was found at run time.
pub trait Simd: Copy {
    /// [`LANES`] bytes in registers.
    type Bytes: Copy;

    /// How this level wants window rows.
    const PACKING: Packing;

    /// `value` in every lane.
    fn splat(self, value: u8) -> Self::Bytes;
    /// Reads a vector.
    fn load(self, from: &Lanes) -> Self::Bytes;
    /// Writes a vector.
    fn store(self, value: Self::Bytes, to: &mut Lanes);
    /// Writes a vector that will not be read soon: past the caches, where there is a way.
    fn stream(self, value: Self::Bytes, to: &mut Lanes);
    /// Makes streamed vectors visible to other threads before what is written later.
    fn settle(self);
    /// Says that `vectors` will be read soon.
    fn expect(self, vectors: &[Lanes]);
    /// The smaller of both, lane by lane.
    fn min(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The larger of both, lane by lane.
    fn max(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The sum, at most 255.
    fn add(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The difference, at least 0.
    fn sub(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The mean, a half rounded up.
    fn mean(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// `yes` where `a` = `b`, `no` elsewhere.
    fn select_equal(self, a: Self::Bytes, b: Self::Bytes, yes: Self::Bytes, no: Self::Bytes) -> Self::Bytes;
    /// `yes` where `a` < `b`, `no` elsewhere.
    fn select_less(self, a: Self::Bytes, b: Self::Bytes, yes: Self::Bytes, no: Self::Bytes) -> Self::Bytes;
    /// 255 where `set` has the lane's value, 0 elsewhere: value c is bit c & 7 of byte c >> 3.
    fn contains(self, set: &Lanes, values: Self::Bytes) -> Self::Bytes;
    /// Lane i is lane i − 1 of `own`, lane 0 the last of `left`.
    fn shift_right(self, own: Self::Bytes, left: Self::Bytes) -> Self::Bytes;
    /// Lane i is lane i + 1 of `own`, the last lane the first of `right`.
    fn shift_left(self, own: Self::Bytes, right: Self::Bytes) -> Self::Bytes;
    /// Turns the 32 × 32 block of the vectors 0, `stride`, 2·`stride`… of `block`, in place.
    fn transpose(self, block: &mut [Lanes], stride: usize);

    /// Matching costs of the [`LANES`] pixels of a tile for the disparities `out.len()` ones from
    /// `low` on. `left` starts two columns before the tile (the statistics at the tile), `right`
    /// is whole, `at` is the tile's first column in it (two columns later for the words).
    fn score(
        self,
        constants: &CostConstants,
        left: &CostRow<'_>,
        right: &CostRow<'_>,
        at: usize,
        low: usize,
        out: &mut [Lanes],
    );

    /// A tile of a remapped picture. All windows lie in `source`, whose rows are `stride` bytes apart;
    /// a tile that is black throughout may stand in any picture.
    fn remap(self, source: &[u8], stride: usize, tile: &RemapTile, out: &mut Lanes);
}
