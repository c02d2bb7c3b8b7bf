//! Self-test of a device: compares its map of a synthetic pair with the CPU's before it is used.

use super::super::matcher::{MatchError, MatchOutput, Matcher};
use super::GpuMpv;
use super::adapter::GpuError;
use crate::image::GreyImage;
use core::time::Duration;

/// Time limit of the first pair.
const FIRST_PATIENCE: Duration = Duration::from_secs(30);

/// A random texture of 4 × 4 pixel cells, interpolated bilinearly.
fn texture(x: usize, y: usize) -> u8 {
    let corner = |dx: usize, dy: usize| {
        let cell = (x / 4 + dx) as u32 | ((y / 4 + dy) as u32) << 16;
        // Any hash is suitable: both views only need the same texture.
        (cell.wrapping_mul(0x9e37_79b1) ^ cell.rotate_left(7).wrapping_mul(0x85eb_ca6b)) >> 24
    };
    let (a, b) = (x as u32 % 4, y as u32 % 4);
    let row = |dy| corner(0, dy) * (4 - a) + corner(1, dy) * a;
    ((row(0) * (4 - b) + row(1) * b) / 16) as u8
}

/// A synthetic pair: ground that comes nearer downwards, with a wall in front of it.
fn synthetic_pair(width: usize, height: usize) -> (GreyImage, GreyImage) {
    let mut pair = (GreyImage::new(width, height), GreyImage::new(width, height));
    for y in 0..height {
        for x in 0..width {
            let wall = (width / 3..width / 2).contains(&x) && y < height / 2;
            let shift = if wall { 14 } else { 2 + 12 * y / height };
            pair.0.as_mut_slice()[y * width + x] = texture(x, y);
            pair.1.as_mut_slice()[y * width + x] = texture(x + shift, y);
        }
    }
    pair
}

fn map_of(
    matcher: &mut dyn Matcher,
    pair: &(GreyImage, GreyImage),
) -> Result<(Vec<u16>, Vec<u8>), MatchError> {
    let pixels = pair.0.width() * pair.0.height();
    let (mut disparity, mut confidence) = (vec![0; pixels], vec![0; pixels]);
    let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
    matcher.compute(pair.0.view(), pair.1.view(), output)?;
    Ok((disparity, confidence))
}

impl GpuMpv {
    /// Matches a synthetic pair on the device and with `reference`, a matcher with the same parameters and size.
    /// This also warms the device up.
    ///
    /// # Errors
    /// If the maps differ in any pixel, or the device is lost.
    pub fn verify(&mut self, reference: &mut dyn Matcher) -> Result<(), GpuError> {
        let (width, height) = (self.width, self.height);
        let pair = synthetic_pair(width, height);
        let adapter = self.adapter.clone();
        let refused = |error: MatchError| match error {
            MatchError::Lost(loss) => GpuError::Lost { adapter: adapter.clone(), loss },
            other => GpuError::Device { adapter: adapter.clone(), reason: other.to_string() },
        };
        // The first pair takes longer: drivers finish compiling their kernels with it.
        let usual = self.patience;
        self.patience = usual.max(FIRST_PATIENCE);
        let got = map_of(self, &pair);
        self.patience = usual;
        let (got, expected) = (got.map_err(refused)?, map_of(reference, &pair).map_err(refused)?);
        let pixels =
            (0..width * height).filter(|&i| (got.0[i], got.1[i]) != (expected.0[i], expected.1[i])).count();
        if pixels > 0 { Err(GpuError::Wrong { adapter, pixels }) } else { Ok(()) }
    }
}
