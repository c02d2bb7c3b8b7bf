//! Bilinear scaling in exact fixed point, the same numbers as OpenCV's `INTER_LINEAR_EXACT`.

use crate::image::GreyView;

/// Scales images into memory that is allocated once.
#[derive(Debug)]
pub struct Resizer {
    columns: Vec<(u32, u16)>,
    rows: [Vec<u16>; 2],
    pixels: Vec<u8>,
}

/// Source index and the weight (of 256) of the pixel behind it.
fn place(target: usize, source_len: usize, target_len: usize) -> (u32, u16) {
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
    /// Memory for results of up to `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            columns: vec![(0, 0); width],
            rows: [vec![0; width], vec![0; width]],
            pixels: vec![0; width * height],
        }
    }

    /// `image` scaled to `width` × `height` pixels, rows without gaps.
    ///
    /// # Panics
    /// When the result is larger than the memory, or empty.
    pub fn scale(&mut self, image: GreyView<'_>, width: usize, height: usize) -> &[u8] {
        let columns = &mut self.columns[..width];
        for (x, column) in columns.iter_mut().enumerate() {
            *column = place(x, image.width(), width);
        }
        // Which source row each of the two scaled rows holds.
        let mut held = [usize::MAX; 2];
        for y in 0..height {
            let (first, weight) = place(y, image.height(), height);
            let first = first as usize;
            let second = (first + 1).min(image.height() - 1);
            for source in [first, second] {
                let slot = source % 2;
                if held[slot] != source {
                    let row = image.row(source);
                    for (target, &(x, weight)) in self.rows[slot].iter_mut().zip(columns.iter()) {
                        let x = x as usize;
                        let next = row[(x + 1).min(row.len() - 1)];
                        *target = u16::from(row[x]) * (256 - weight) + u16::from(next) * weight;
                    }
                    held[slot] = source;
                }
            }
            let (upper, lower) = (&self.rows[first % 2], &self.rows[second % 2]);
            let target = &mut self.pixels[y * width..(y + 1) * width];
            for ((target, &a), &b) in target.iter_mut().zip(upper).zip(lower) {
                let sum = u32::from(a) * u32::from(256 - weight) + u32::from(b) * u32::from(weight);
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
