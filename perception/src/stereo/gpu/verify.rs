//! Whether a device computes what the CPU does: asked once, before it is trusted.

use super::super::matcher::{MatchError, MatchOutput, Matcher};
use super::GpuMpv;
use super::adapter::GpuError;
use crate::image::GreyImage;
use core::time::Duration;

/// How long the first pair may take.
const FIRST_PATIENCE: Duration = Duration::from_secs(30);

/// A texture of cells of 4 × 4 pixels, smooth in between.
fn texture(x: usize, y: usize) -> u8 {
    let corner = |dx: usize, dy: usize| {
        let cell = (x / 4 + dx) as u32 | ((y / 4 + dy) as u32) << 16;
        // Any mixing will do: what counts is that both see the same.
        (cell.wrapping_mul(0x9e37_79b1) ^ cell.rotate_left(7).wrapping_mul(0x85eb_ca6b)) >> 24
    };
    let (a, b) = (x as u32 % 4, y as u32 % 4);
    let row = |dy| corner(0, dy) * (4 - a) + corner(1, dy) * a;
    ((row(0) * (4 - b) + row(1) * b) / 16) as u8
}

/// A drawn pair: ground that comes nearer downwards, a wall before it.
fn drawn(width: usize, height: usize) -> (GreyImage, GreyImage) {
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
    /// Matches a drawn pair on the device and by `reference`, made with the same parameters for the same size. It
    /// also warms the device up.
    ///
    /// # Errors
    /// When the maps differ anywhere, or the device is lost.
    pub fn verify(&mut self, reference: &mut dyn Matcher) -> Result<(), GpuError> {
        let (width, height) = (self.width, self.height);
        let pair = drawn(width, height);
        let adapter = self.adapter.clone();
        let refused = |error: MatchError| match error {
            MatchError::Lost(loss) => GpuError::Lost { adapter: adapter.clone(), loss },
            other => GpuError::Device { adapter: adapter.clone(), reason: other.to_string() },
        };
        // The first pair takes longer: drivers finish their kernels with it.
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
