//! Disparity map files: PNG and PGM with a scale, PFM.

use super::error::TruthError;
use super::pfm;
use crate::{SourceError, picture};
use image::DynamicImage;
use std::path::Path;

/// A map of `width` × `height` values, row-major; −1 = unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct DisparityMap {
    /// Values, above 0 or −1.
    pub px: Vec<f32>,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

impl DisparityMap {
    /// Mask of the known values.
    pub fn known(&self) -> Vec<bool> {
        self.px.iter().map(|&d| d > 0.0).collect()
    }
}

fn decode(path: &Path) -> Result<DynamicImage, TruthError> {
    picture::read(path).map_err(|error| match error {
        SourceError::Io { path, source } => TruthError::Io { path, source },
        other => other.into(),
    })
}

/// Reads a map whose stored values are pixels × `scale` (a PFM contains pixels). Values that are not finite or
/// not positive are unknown.
///
/// # Errors
/// When the file cannot be read, or is a colour image.
pub fn read(path: &Path, scale: f64) -> Result<DisparityMap, TruthError> {
    if path.extension().is_some_and(|e| e == "pfm") {
        let pfm = pfm::read(path)?;
        let px = pfm.values.into_iter().map(|v| if v.is_finite() && v > 0.0 { v } else { -1.0 }).collect();
        return Ok(DisparityMap { px, width: pfm.width, height: pfm.height });
    }
    let image = decode(path)?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let steps = |v: u16| if v > 0 { (f64::from(v) / scale) as f32 } else { -1.0 };
    let px = match &image {
        DynamicImage::ImageLuma8(map) => map.as_raw().iter().map(|&v| steps(v.into())).collect(),
        DynamicImage::ImageLuma16(map) => map.as_raw().iter().map(|&v| steps(v)).collect(),
        // A grey palette decodes to three equal channels.
        DynamicImage::ImageRgb8(map) if map.pixels().all(|p| p[0] == p[1] && p[1] == p[2]) => {
            map.pixels().map(|p| steps(p[0].into())).collect()
        }
        other => {
            let reason = format!("{:?} pixels: a map is a grey PNG or PGM, or a PFM", other.color());
            return Err(TruthError::Map { path: path.to_owned(), reason });
        }
    };
    Ok(DisparityMap { px, width, height })
}

/// Reads an estimate in the format of `lookout disparity` and KITTI: 16-bit PNG, disparity × 256, 0 = unknown.
/// Returns the stored values, width and height.
///
/// # Errors
/// When the file cannot be read, or does not have 16 bits.
pub fn read_estimate(path: &Path) -> Result<(Vec<u16>, usize, usize), TruthError> {
    match decode(path)? {
        DynamicImage::ImageLuma16(map) => {
            let (width, height) = (map.width() as usize, map.height() as usize);
            Ok((map.into_raw(), width, height))
        }
        other => {
            let reason =
                format!("{:?} pixels: give a grey 16-bit PNG, disparity x 256, 0 = unknown", other.color());
            Err(TruthError::Map { path: path.to_owned(), reason })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_map_is_refused_with_a_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("d.png");
        image::GrayImage::from_pixel(2, 1, [9].into()).save(&path).unwrap();
        assert_eq!(read(&path, 2.0).unwrap().px, [4.5, 4.5]);
        let error = read_estimate(&path).unwrap_err().to_string();
        assert!(error.contains("d.png: L8 pixels") && error.contains("16-bit"), "{error}");
        image::RgbImage::from_pixel(2, 1, [9, 9, 9].into()).save(&path).unwrap();
        assert_eq!(read(&path, 1.0).unwrap().px, [9.0, 9.0]);
        image::RgbImage::from_pixel(2, 1, [9, 9, 8].into()).save(&path).unwrap();
        let error = read(&path, 1.0).unwrap_err().to_string();
        assert!(error.contains("d.png: Rgb8 pixels: a map is a grey"), "{error}");
        std::fs::write(&path, "text").unwrap();
        assert!(read(&path, 1.0).unwrap_err().to_string().contains("d.png: cannot be decoded"));
    }
}
