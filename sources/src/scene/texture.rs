//! Random texture with precomputed filtering (a ripmap), so that both cameras sample consistent values.

/// Side of the finest level, in texels; the texture repeats.
const SIDE: usize = 256;

/// Levels along each axis: 256 texels down to one.
const LEVELS: usize = 9;

/// Texels per pixel footprint when a level is chosen: more than one, so that the two cameras agree although
/// their pixels sample different positions.
const PER_PIXEL: f32 = 1.3;

/// A repeating grey texture, downsampled along each axis independently: a pixel's footprint on the road is
/// much longer than wide.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Level (i, j) has SIDE >> i columns and SIDE >> j rows. A texel is stored with its right, lower and lower
    /// right neighbour: one load each.
    levels: Vec<Vec<[u8; 4]>>,
}

/// A pseudo-random hash, the same on every machine.
pub fn hash(mut v: u64) -> u64 {
    v = (v ^ (v >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    v = (v ^ (v >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    v ^ (v >> 31)
}

/// A number in [0, 1) for a key.
pub fn unit(key: u64) -> f64 {
    (hash(key.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x2545_f491_4f6c_dd1d)) >> 11) as f64
        / (1_u64 << 53) as f64
}

impl Texture {
    /// The texture of a seed: noise at all scales, mean 128.
    pub fn new(seed: u64) -> Self {
        let mut finest = vec![0.0_f32; SIDE * SIDE];
        for octave in 0..5 {
            let cells = SIDE >> octave;
            let gain = [30.0, 34.0, 26.0, 20.0, 14.0][octave];
            let value = |x: usize, y: usize| {
                let key = seed.wrapping_mul(0x9e37_79b9)
                    ^ ((octave as u64) << 40)
                    ^ ((x % cells) << 16 | (y % cells)) as u64;
                (hash(key) & 0xffff) as f32 / 65_535.0 - 0.5
            };
            for y in 0..SIDE {
                for x in 0..SIDE {
                    let (u, v) =
                        ((x as f32 + 0.5) / (1 << octave) as f32, (y as f32 + 0.5) / (1 << octave) as f32);
                    let (i, j) = (u as usize, v as usize);
                    let (a, b) = (u - i as f32, v - j as f32);
                    let top = value(i, j) * (1.0 - a) + value(i + 1, j) * a;
                    let low = value(i, j + 1) * (1.0 - a) + value(i + 1, j + 1) * a;
                    finest[y * SIDE + x] += 2.0 * gain * (top * (1.0 - b) + low * b);
                }
            }
        }
        let mut levels: Vec<Vec<u8>> = Vec::with_capacity(LEVELS * LEVELS);
        for i in 0..LEVELS {
            for j in 0..LEVELS {
                let (columns, rows) = (SIDE >> i, SIDE >> j);
                let level = if i == 0 && j == 0 {
                    finest.iter().map(|v| (v + 128.0).clamp(0.0, 255.0) as u8).collect()
                } else if j == 0 {
                    let finer = &levels[(i - 1) * LEVELS];
                    (0..columns * rows).map(|k| mean(finer[2 * k], finer[2 * k + 1])).collect()
                } else {
                    let finer = &levels[i * LEVELS + j - 1];
                    let at = |k: usize| {
                        let (x, y) = (k % columns, 2 * (k / columns));
                        mean(finer[y * columns + x], finer[(y + 1) * columns + x])
                    };
                    (0..columns * rows).map(at).collect()
                };
                levels.push(level);
            }
        }
        let with_neighbours = |(k, level): (usize, &Vec<u8>)| {
            let (columns, rows) = (SIDE >> (k / LEVELS), SIDE >> (k % LEVELS));
            let at = |x: usize, y: usize| level[y % rows * columns + x % columns];
            let texel = |k: usize| {
                let (x, y) = (k % columns, k / columns);
                [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)]
            };
            (0..columns * rows).map(texel).collect()
        };
        Self { levels: levels.iter().enumerate().map(with_neighbours).collect() }
    }

    /// Grey value minus the mean, about −128 to 127, at (`u`, `v`) in texels of the finest level, for a pixel
    /// footprint of `span_u` × `span_v` texels.
    #[inline(always)]
    pub fn sample(&self, u: f32, v: f32, span_u: f32, span_v: f32) -> f32 {
        // Across, the nearest level suffices: it changes at one distance, and so at the same place in both
        // images. Along, where footprints grow with the square of the distance, two levels are blended.
        let i = nearest_level(span_u);
        let (j, share_j) = level(span_v);
        let fine = self.bilinear(i, j, u, v);
        (if share_j == 0.0 { fine } else { fine + (self.bilinear(i, j + 1, u, v) - fine) * share_j }) - 128.0
    }

    #[inline(always)]
    fn bilinear(&self, i: usize, j: usize, u: f32, v: f32) -> f32 {
        let texels = &self.levels[i * LEVELS + j];
        let (columns, rows) = (SIDE >> i, SIDE >> j);
        // Positions in 1/256 texel; truncation of negative values is not noticeable.
        let (x, y) = ((u * SCALES[i] - 128.0) as i32, (v * SCALES[j] - 128.0) as i32);
        let (a, b) = (x & 255, y & 255);
        let k = ((y >> 8) as usize & (rows - 1)) * columns + ((x >> 8) as usize & (columns - 1));
        let [p, q, r, s] = texels[k].map(i32::from);
        let (top, low) = ((p << 8) + (q - p) * a, (r << 8) + (s - r) * a);
        ((top << 8) + (low - top) * b) as f32 * (1.0 / 65_536.0)
    }
}

/// 1/256 texels of each level per texel of the finest.
const SCALES: [f32; LEVELS] = {
    let mut scales = [1.0; LEVELS];
    let mut k = 0;
    while k < LEVELS {
        scales[k] = 256.0 / (1 << k) as f32;
        k += 1;
    }
    scales
};

/// Floor without a call into the math library.
#[inline]
pub fn floor(v: f32) -> i32 {
    let whole = v as i32;
    whole - i32::from(v < whole as f32)
}

fn mean(a: u8, b: u8) -> u8 {
    (u16::from(a) + u16::from(b)).div_ceil(2) as u8
}

/// The level for a footprint in texels, and the weight of the next coarser one. Half of all footprints need
/// one level only.
#[inline]
fn level(span: f32) -> (usize, f32) {
    let bits = (span * PER_PIXEL).clamp(1.0, 255.0).to_bits();
    // Logarithm: exponent, and a linear approximation between powers of two.
    let (exponent, rest) = ((bits >> 23) as usize - 127, (bits & 0x7f_ffff) as f32 / 8_388_608.0);
    let share = (2.0 * rest - 0.5).clamp(0.0, 1.0);
    if share == 1.0 { (exponent + 1, 0.0) } else { (exponent, share) }
}

/// The level nearest to a footprint.
#[inline]
fn nearest_level(span: f32) -> usize {
    // Adds one half to the logarithm and takes its integer part.
    (((span * PER_PIXEL).clamp(1.0, 255.0).to_bits() + 0x40_0000) >> 23) as usize - 127
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(texture: &Texture, span_u: f32, span_v: f32) -> f32 {
        let values: Vec<f32> =
            (0..1000).map(|i| texture.sample(i as f32 * 1.7, i as f32 * 0.9, span_u, span_v)).collect();
        let mean = values.iter().sum::<f32>() / 1000.0;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / 1000.0).sqrt()
    }

    #[test]
    fn the_pattern_repeats_and_fades_with_distance() {
        let texture = Texture::new(1);
        let a = texture.sample(10.3, -20.7, 1.0, 1.0);
        assert!((a - texture.sample(10.3 + 256.0, -20.7 + 512.0, 1.0, 1.0)).abs() < 0.1);
        assert!(spread(&texture, 0.5, 0.5) > 15.0, "{}", spread(&texture, 0.5, 0.5));
        assert!(spread(&texture, 128.0, 128.0) < 5.0, "{}", spread(&texture, 128.0, 128.0));
        assert_ne!(a, Texture::new(2).sample(10.3, -20.7, 1.0, 1.0));
    }

    #[test]
    fn a_long_pixel_keeps_what_changes_across_it() {
        let texture = Texture::new(1);
        let (long, square) = (spread(&texture, 1.0, 32.0), spread(&texture, 32.0, 32.0));
        assert!(long > 1.3 * square, "{long} {square}");
    }

    #[test]
    fn keys_give_even_numbers() {
        let mean = (0..1000).map(unit).sum::<f64>() / 1000.0;
        assert!((mean - 0.5).abs() < 0.05, "{mean}");
    }
}
