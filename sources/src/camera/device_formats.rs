//! The formats and sizes of a Video4Linux device.

use super::v4l2::FORMATS;
use moq_v4l::FourCC;
use moq_v4l::device::Device;
use moq_v4l::framesize::FrameSizeEnum;
use moq_v4l::video::Capture;
use std::io;
use std::path::Path;

/// Sizes of one format that are listed; some drivers offer any size.
const MAX_SIZES: usize = 32;

/// A pixel format of a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceFormat {
    /// Its FourCC, such as `YUYV`.
    pub name: String,
    /// Whether [`super::v4l2`] can read it.
    pub is_supported: bool,
    /// Sizes of an image, such as `640x480`, or a range of them.
    pub sizes: Vec<String>,
}

/// What a device can capture; empty for a device that captures no pictures, such as that of a camera's metadata.
///
/// # Errors
/// If it cannot be opened or asked.
pub fn device_formats(path: &Path) -> io::Result<Vec<DeviceFormat>> {
    let device = Device::with_path(path)?;
    // A device of another kind refuses the question.
    let Ok(formats) = device.enum_formats() else { return Ok(Vec::new()) };
    let describe = |fourcc: FourCC| {
        let sizes = device.enum_framesizes(fourcc).unwrap_or_default();
        DeviceFormat {
            name: fourcc.to_string(),
            is_supported: FORMATS.iter().any(|(code, _)| FourCC::new(code) == fourcc),
            sizes: sizes.into_iter().take(MAX_SIZES).map(|size| size_text(&size.size)).collect(),
        }
    };
    Ok(formats.into_iter().map(|format| describe(format.fourcc)).collect())
}

fn size_text(size: &FrameSizeEnum) -> String {
    match size {
        FrameSizeEnum::Discrete(one) => format!("{}x{}", one.width, one.height),
        FrameSizeEnum::Stepwise(range) => {
            format!("{}x{} to {}x{}", range.min_width, range.min_height, range.max_width, range.max_height)
        }
    }
}
