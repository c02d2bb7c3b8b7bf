//! Random texture with mip levels, so that both cameras see the same picture of a surface.

/// Side of the finest level, in texels; the pattern repeats.
const SIDE: usize = 256;

/// A repeating grey pattern at falling resolutions.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Level k has SIDE >> k texels a side.
    levels: Vec<Vec<u8>>,
}

/// A hash that looks random: the same everywhere, for ever.
pub fn hash(mut v: u64) -> u64 {
    v = (v ^ (v >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    v = (v ^ (v >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    v ^ (v >> 31)
}

impl Texture {
    /// A pattern of its own for each seed: noise of all sizes, mean 128.
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
        let mut levels = vec![finest.iter().map(|v| (v + 128.0).clamp(0.0, 255.0) as u8).collect::<Vec<_>>()];
        let mut side = SIDE;
        while side > 1 {
            let finer = &levels[levels.len() - 1];
            let half = side / 2;
            let coarser = (0..half * half)
                .map(|i| {
                    let (x, y) = (2 * (i % half), 2 * (i / half));
                    let sum = [(0, 0), (1, 0), (0, 1), (1, 1)]
                        .iter()
                        .map(|(dx, dy)| u32::from(finer[(y + dy) * side + x + dx]))
                        .sum::<u32>();
                    ((sum + 2) / 4) as u8
                })
                .collect();
            levels.push(coarser);
            side = half;
        }
        Self { levels }
    }

    /// Grey value, 0 to 255, at (`u`, `v`) in texels of the finest level, for a pixel that covers
    /// `footprint` texels.
    pub fn sample(&self, u: f32, v: f32, footprint: f32) -> f32 {
        let level = footprint.max(1.0).log2().min((self.levels.len() - 1) as f32);
        let lower = level as usize;
        let share = level - lower as f32;
        let fine = self.bilinear(lower, u, v);
        if share < 0.01 || lower + 1 == self.levels.len() {
            return fine;
        }
        fine * (1.0 - share) + self.bilinear(lower + 1, u, v) * share
    }

    fn bilinear(&self, level: usize, u: f32, v: f32) -> f32 {
        let texels = &self.levels[level];
        let mask = (SIDE >> level) - 1;
        let scale = 1.0 / (1_usize << level) as f32;
        let (u, v) = (u * scale - 0.5, v * scale - 0.5);
        let (i, j) = (u.floor(), v.floor());
        let (a, b) = (u - i, v - j);
        let (i, j) = (i as i64 as usize & mask, j as i64 as usize & mask);
        let (i1, j1) = ((i + 1) & mask, (j + 1) & mask);
        let at = |x: usize, y: usize| f32::from(texels[y * (mask + 1) + x]);
        let top = at(i, j) * (1.0 - a) + at(i1, j) * a;
        let low = at(i, j1) * (1.0 - a) + at(i1, j1) * a;
        top * (1.0 - b) + low * b
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pattern_repeats_and_fades_with_distance() {
        let texture = Texture::new(1);
        let a = texture.sample(10.3, -20.7, 1.0);
        assert!((a - texture.sample(10.3 + 256.0, -20.7 + 512.0, 1.0)).abs() < 0.1);
        let spread = |footprint: f32| {
            let values: Vec<f32> =
                (0..1000).map(|i| texture.sample(i as f32 * 1.7, i as f32 * 0.9, footprint)).collect();
            let mean = values.iter().sum::<f32>() / 1000.0;
            (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / 1000.0).sqrt()
        };
        assert!(spread(1.0) > 15.0, "{}", spread(1.0));
        assert!(spread(128.0) < 5.0, "{}", spread(128.0));
        assert_ne!(a, Texture::new(2).sample(10.3, -20.7, 1.0));
    }
}
