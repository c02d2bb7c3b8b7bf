//! Bilinear scaling in fixed point, bit-identical to OpenCV's `INTER_LINEAR_EXACT`.

use crate::image::GreyView;

/// Scales images into memory that is allocated once.
#[derive(Debug)]
pub struct Resizer {
    columns: Vec<(u32, u16)>,
    /// A source row interpolated vertically, its last pixel duplicated.
    blend: Vec<u16>,
    pixels: Vec<u8>,
}

/// Source index of a target pixel, and the weight in 1/256 of the next source pixel.
fn source_position(target: usize, source_len: usize, target_len: usize) -> (u32, u16) {
    let scale = source_len as f64 / target_len as f64;
    let at = scale * (target as f64 + 0.5) - 0.5;
    let whole = at.floor();
    if whole < 0.0 || source_len == 1 {
        (0, 0)
    } else if whole as usize >= source_len - 1 {
        (source_len as u32 - 1, 0)
    } else {
        (whole as u32, ((at - whole) * 256.0).round_ties_even() as u16)
    }
}

impl Resizer {
    /// Memory for images and results of up to `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { columns: vec![(0, 0); width], blend: vec![0; width + 1], pixels: vec![0; width * height] }
    }

    /// `image` scaled to `width` × `height` pixels, rows without padding. Rounding happens only at the end, so
    /// the order of interpolation does not matter: vertically first, where memory access is contiguous.
    ///
    /// # Panics
    /// If the result is larger than the memory, or empty.
    pub fn scale(&mut self, image: GreyView<'_>, width: usize, height: usize) -> &[u8] {
        let columns = &mut self.columns[..width];
        for (x, column) in columns.iter_mut().enumerate() {
            *column = source_position(x, image.width(), width);
        }
        let source = image.width();
        if self.blend.len() <= source {
            self.blend.resize(source + 1, 0);
        }
        let blend = &mut self.blend[..=source];
        for y in 0..height {
            let (first, weight) = source_position(y, image.height(), height);
            let first = first as usize;
            let upper = image.row(first);
            let lower = image.row((first + 1).min(image.height() - 1));
            for ((blend, &a), &b) in blend.iter_mut().zip(upper).zip(lower) {
                *blend = u16::from(a) * (256 - weight) + u16::from(b) * weight;
            }
            blend[source] = blend[source - 1];
            let target = &mut self.pixels[y * width..(y + 1) * width];
            for (target, &(x, weight)) in target.iter_mut().zip(columns.iter()) {
                let pair = &blend[x as usize..][..2];
                let sum =
                    u32::from(pair[0]) * u32::from(256 - weight) + u32::from(pair[1]) * u32::from(weight);
                *target = ((sum + (1 << 15)) >> 16) as u8;
            }
        }
        &self.pixels[..width * height]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_size_is_the_same_image() {
        let data: Vec<u8> = (0..35).map(|i| i * 7).collect();
        let image = GreyView::new(&data, 7, 5, 7).unwrap();
        assert_eq!(Resizer::new(7, 5).scale(image, 7, 5), &data[..]);
    }

    #[test]
    fn halving_takes_the_mean_of_four() {
        let data = [10, 20, 30, 40, 50, 60, 70, 80];
        let image = GreyView::new(&data, 4, 2, 4).unwrap();
        assert_eq!(Resizer::new(4, 2).scale(image, 2, 1), &[35, 55]);
        assert_eq!(Resizer::new(4, 2).scale(image, 1, 1), &[45]);
    }

    #[test]
    fn a_fractional_scale_weighs_its_neighbours() {
        // 4 → 3 columns at −1/6+… = 1/6, 3/2, 17/6: weights 43, 128, 213 of 256.
        let data = [0, 100, 200, 60];
        let image = GreyView::new(&data, 4, 1, 4).unwrap();
        let exact = |a: u32, b: u32, w: u32| ((a * (256 - w) + b * w) * 256 + 32_768) >> 16;
        let expected = [exact(0, 100, 43), exact(100, 200, 128), exact(200, 60, 213)];
        let got: Vec<u32> = Resizer::new(4, 1).scale(image, 3, 1).iter().map(|&v| u32::from(v)).collect();
        assert_eq!(got, expected);
    }
}
