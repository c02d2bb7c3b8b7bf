//! Integral images: the sum over any upright or tilted rectangle from four table entries.

use super::window::{Contrast, WeightedRect};

/// Sums, sums of squares and tilted sums of one image, rows without padding. Used for single windows, and as
/// the reference for the layouts of the scanner. All sums wrap, which does not affect differences.
#[derive(Clone, Debug, Default)]
pub struct Integral {
    sums: Vec<u32>,
    squares: Vec<u32>,
    tilted: Vec<u32>,
    stride: usize,
}

impl Integral {
    /// The integral images of `pixels` in rows of `width`.
    pub fn of(pixels: &[u8], width: usize) -> Self {
        let mut integral = Self::default();
        integral.fill(pixels, width);
        integral.fill_tilted(pixels, width);
        integral
    }

    /// Computes sums and sums of squares of `pixels` in rows of `width`, without tilted sums.
    pub fn fill(&mut self, pixels: &[u8], width: usize) {
        let rows = pixels.len() / width.max(1);
        self.stride = width + 1;
        self.sums.clear();
        self.sums.resize(self.stride * (rows + 1), 0);
        self.squares.clear();
        self.squares.resize(self.stride * (rows + 1), 0);
        for (y, row) in pixels.chunks_exact(width).enumerate() {
            let (mut sum, mut square) = (0_u32, 0_u32);
            for (x, &v) in row.iter().enumerate() {
                let v = u32::from(v);
                let at = (y + 1) * self.stride + x + 1;
                sum = sum.wrapping_add(v);
                square = square.wrapping_add(v * v);
                self.sums[at] = self.sums[at - self.stride].wrapping_add(sum);
                self.squares[at] = self.squares[at - self.stride].wrapping_add(square);
            }
        }
    }

    /// Computes tilted sums of `pixels` in rows of `width`.
    pub fn fill_tilted(&mut self, pixels: &[u8], width: usize) {
        let rows = pixels.len() / width.max(1);
        let stride = width + 1;
        self.tilted.clear();
        self.tilted.resize(stride * (rows + 1), 0);
        for y in 1..=rows {
            let (done, here) = self.tilted.split_at_mut(y * stride);
            let above = &done[(y - 1) * stride..];
            let (second, second_row) = match y.checked_sub(2) {
                Some(two) => (&done[two * stride..][..stride], &pixels[two * width..][..width]),
                None => (&[][..], &[][..]),
            };
            tilted_row(above, second, &pixels[(y - 1) * width..][..width], second_row, &mut here[..stride]);
        }
    }

    /// Columns and rows of the table of sums: one more each than the image.
    pub fn size(&self) -> (usize, usize) {
        (self.stride, self.sums.len() / self.stride.max(1))
    }

    /// Sum of all pixels above and left of (`x`, `y`).
    #[inline]
    pub fn sum_at(&self, x: usize, y: usize) -> u32 {
        self.sums[y * self.stride + x]
    }

    fn box_of(table: &[u32], stride: usize, x: usize, y: usize, width: usize, height: usize) -> u32 {
        let (top, bottom) = (y * stride + x, (y + height) * stride + x);
        table[top]
            .wrapping_sub(table[top + width])
            .wrapping_sub(table[bottom])
            .wrapping_add(table[bottom + width])
    }

    /// Sum over an upright rectangle of the window at (`x`, `y`).
    #[inline]
    pub fn rect_sum(&self, r: &WeightedRect, x: usize, y: usize) -> u32 {
        let (x, y) = (x + usize::from(r.x), y + usize::from(r.y));
        Self::box_of(&self.sums, self.stride, x, y, r.width.into(), r.height.into())
    }

    /// Sum over a tilted rectangle of the window at (`x`, `y`).
    #[inline]
    pub fn tilted_sum(&self, r: &WeightedRect, x: usize, y: usize) -> u32 {
        let (w, h) = (usize::from(r.width), usize::from(r.height));
        let (x, y) = (x + usize::from(r.x), y + usize::from(r.y));
        let at = |x: usize, y: usize| self.tilted[y * self.stride + x];
        at(x, y)
            .wrapping_sub(at(x - h, y + h))
            .wrapping_sub(at(x + w, y + w))
            .wrapping_add(at(x + w - h, y + w + h))
    }

    /// The contrast of the window of `width` × `height` pixels at (`x`, `y`).
    #[inline]
    pub fn contrast(&self, width: u16, height: u16, x: usize, y: usize) -> Contrast {
        let (w, h) = (usize::from(width) - 2, usize::from(height) - 2);
        let sum = Self::box_of(&self.sums, self.stride, x + 1, y + 1, w, h);
        let squares = Self::box_of(&self.squares, self.stride, x + 1, y + 1, w, h);
        Contrast::new(sum, squares, (w * h) as f64)
    }
}

/// One row of a tilted integral image: entry X of row Y is the sum of the pixels with y < Y and
/// |x − X + 1| < Y − y. Computed from the two rows above and the two pixel rows that are new.
fn tilted_row(above: &[u32], second: &[u32], row: &[u8], second_row: &[u8], out: &mut [u32]) {
    let width = row.len();
    out[0] = above[1];
    for x in 1..=width {
        let fresh = u32::from(row[x - 1]) + second_row.get(x - 1).map_or(0, |&v| u32::from(v));
        let right = if x < width { above[x + 1] } else { second.get(x).copied().unwrap_or(0) };
        let shared = second.get(x).copied().unwrap_or(0);
        out[x] = above[x - 1].wrapping_add(right).wrapping_sub(shared).wrapping_add(fresh);
    }
}

/// Memory layout of an integral image for the scanner: entries of windows `step` columns apart are adjacent, so
/// that one vector holds the same corner of neighbouring windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    step: usize,
    /// Number of entries for each residue of the column modulo the step.
    part: usize,
}

impl Layout {
    /// A layout for images of up to `width` columns with windows `step` columns apart.
    pub fn new(width: usize, step: usize) -> Self {
        Self { step, part: (width + 1).div_ceil(step) }
    }

    /// Number of entries of a row.
    pub fn stride(&self) -> usize {
        self.part * self.step
    }

    /// Index of the entry of column `x` and row `y`. For windows at multiples of the step,
    /// index(x + dx, y + dy) = index(x, y) + index(dx, dy).
    pub fn index(&self, x: usize, y: usize) -> usize {
        y * self.stride() + x % self.step * self.part + x / self.step
    }
}

/// Integer type of the sums; differences are exact as long as they fit into it.
pub(super) trait Sum: Copy + Default + Ord + 'static {
    /// The low bits of a wider sum.
    fn of(value: u32) -> Self;
    /// Wrapping sum.
    fn plus(self, other: Self) -> Self;
    /// Wrapping difference.
    fn minus(self, other: Self) -> Self;
    /// The low byte.
    fn byte(self) -> u8;
}

macro_rules! sum {
    ($type:ty) => {
        impl Sum for $type {
            #[inline(always)]
            fn of(value: u32) -> Self {
                value as $type
            }
            #[inline(always)]
            fn plus(self, other: Self) -> Self {
                self.wrapping_add(other)
            }
            #[inline(always)]
            fn minus(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }
            #[inline(always)]
            fn byte(self) -> u8 {
                self as u8
            }
        }
    };
}
sum!(u16);
sum!(u32);

/// A table of sums in a [`Layout`], for images of varying size, with memory allocated once.
#[derive(Clone, Debug)]
pub(super) struct Plane<T> {
    entries: Vec<T>,
    line: Vec<T>,
}

impl<T: Sum> Plane<T> {
    /// Memory for images of up to `width` × `height` pixels in any layout, padded by `beyond` entries for
    /// vectors that start at the last entry.
    pub fn new(width: usize, height: usize, beyond: usize) -> Self {
        Self {
            entries: vec![T::default(); (width + 2) * (height + 1) + beyond],
            line: vec![T::default(); width + 2],
        }
    }

    /// The table.
    pub fn entries(&self) -> &[T] {
        &self.entries
    }

    /// Computes the sums of `value(pixel)` over `pixels` in rows of `width`.
    #[inline(always)]
    pub fn fill(&mut self, layout: Layout, pixels: &[u8], width: usize, value: impl Fn(u8) -> u32) {
        let stride = layout.stride();
        self.entries[..stride].fill(T::default());
        for (y, row) in pixels.chunks_exact(width).enumerate() {
            let mut sum = T::default();
            for (entry, &v) in self.line[1..].iter_mut().zip(row) {
                sum = sum.plus(T::of(value(v)));
                *entry = sum;
            }
            let (above, here) = self.entries.split_at_mut((y + 1) * stride);
            let (above, here) = (&above[y * stride..], &mut here[..stride]);
            add_line(layout, &self.line[..width + 1], Some(above), here);
        }
    }
}

impl Plane<u32> {
    /// Computes tilted sums of `pixels` in rows of `width`.
    pub fn fill_tilted(&mut self, layout: Layout, pixels: &[u8], width: usize, rows: &mut TiltedRows) {
        let stride = layout.stride();
        self.entries[..stride].fill(0);
        for held in &mut rows.0 {
            held.fill(0);
        }
        let mut second_row: &[u8] = &[];
        for (y, row) in pixels.chunks_exact(width).enumerate() {
            // Oldest first: two rows above, the row above, this row.
            rows.0.rotate_left(1);
            let [second, above, here] = &mut rows.0;
            tilted_row(&above[..=width], &second[..=width], row, second_row, &mut here[..=width]);
            add_line(layout, &here[..=width], None, &mut self.entries[(y + 1) * stride..][..stride]);
            second_row = row;
        }
    }
}

/// Three rows of tilted sums.
#[derive(Clone, Debug)]
pub(super) struct TiltedRows([Vec<u32>; 3]);

impl TiltedRows {
    /// Rows for images of up to `width` columns.
    pub fn new(width: usize) -> Self {
        Self([vec![0; width + 1], vec![0; width + 1], vec![0; width + 1]])
    }
}

/// Writes a row in its layout; adds the row above if given.
#[inline(always)]
fn add_line<T: Sum>(layout: Layout, line: &[T], above: Option<&[T]>, here: &mut [T]) {
    if layout.step == 1 {
        match above {
            Some(above) => {
                for ((entry, &v), &a) in here.iter_mut().zip(line).zip(above) {
                    *entry = a.plus(v);
                }
            }
            None => here[..line.len()].copy_from_slice(line),
        }
        return;
    }
    let (even, odd) = here.split_at_mut(layout.part);
    match above {
        Some(above) => {
            let (above_even, above_odd) = above.split_at(layout.part);
            let pairs = line.chunks_exact(2);
            if let [last] = pairs.remainder() {
                let i = line.len() / 2;
                even[i] = above_even[i].plus(*last);
            }
            let above = above_even.iter().zip(above_odd);
            for (((e, o), pair), (&ae, &ao)) in even.iter_mut().zip(odd).zip(pairs).zip(above) {
                *e = ae.plus(pair[0]);
                *o = ao.plus(pair[1]);
            }
        }
        None => {
            for (i, &v) in line.iter().enumerate() {
                if i % 2 == 0 { even[i / 2] = v } else { odd[i / 2] = v }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(count: usize, seed: u64) -> Vec<u8> {
        let mut random = fastrand::Rng::with_seed(seed);
        (0..count).map(|_| random.u8(..)).collect()
    }

    #[test]
    fn sums_are_those_of_the_pixels() {
        let (width, height) = (13, 11);
        let pixels = noise(width * height, 1);
        let integral = Integral::of(&pixels, width);
        let r = WeightedRect { x: 2, y: 1, width: 5, height: 4, weight: 1.0 };
        let mut expected = 0;
        for y in 4..8 {
            for x in 3..8 {
                expected += u32::from(pixels[y * width + x]);
            }
        }
        assert_eq!(integral.rect_sum(&r, 1, 3), expected);
    }

    #[test]
    fn tilted_entries_are_sums_over_cones() {
        let (width, height) = (9, 8);
        let pixels = noise(width * height, 2);
        let integral = Integral::of(&pixels, width);
        for big_y in 0..=height {
            for big_x in 0..=width {
                let mut expected = 0;
                for y in 0..big_y {
                    for x in 0..width {
                        if (x as i64 - big_x as i64 + 1).abs() < big_y as i64 - y as i64 {
                            expected += u32::from(pixels[y * width + x]);
                        }
                    }
                }
                assert_eq!(integral.tilted[big_y * (width + 1) + big_x], expected, "{big_x} {big_y}");
            }
        }
    }

    #[test]
    fn layouts_hold_the_same_sums() {
        for (width, height) in [(1, 1), (7, 5), (8, 5), (40, 3)] {
            let pixels = noise(width * height, 3);
            let integral = Integral::of(&pixels, width);
            for step in [1, 2] {
                let layout = Layout::new(41, step);
                let (mut wide, mut narrow) = (Plane::<u32>::new(41, 6, 0), Plane::<u16>::new(41, 6, 0));
                let (mut squares, mut tilted) = (wide.clone(), wide.clone());
                wide.fill(layout, &pixels, width, u32::from);
                narrow.fill(layout, &pixels, width, u32::from);
                squares.fill(layout, &pixels, width, |v| u32::from(v).pow(2));
                tilted.fill_tilted(layout, &pixels, width, &mut TiltedRows::new(41));
                for y in 0..=height {
                    for x in 0..=width {
                        let (at, plain) = (layout.index(x, y), y * (width + 1) + x);
                        assert_eq!(wide.entries[at], integral.sums[plain]);
                        assert_eq!(narrow.entries[at], integral.sums[plain] as u16);
                        assert_eq!(squares.entries[at], integral.squares[plain]);
                        assert_eq!(tilted.entries[at], integral.tilted[plain]);
                    }
                }
            }
        }
    }
}
