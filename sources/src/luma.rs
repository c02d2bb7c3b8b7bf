//! Grey levels of colours.

/// Weights of red, green and blue in BT.601 luma, times 2^14.
const LUMA: [u32; 3] = [4899, 9617, 1868];

/// BT.601 luma in integer arithmetic: the result of OpenCV, and identical on every machine.
pub(crate) fn luma(rgb: &[u8]) -> u8 {
    let weighted: u32 = rgb.iter().zip(LUMA).map(|(&v, weight)| u32::from(v) * weight).sum();
    ((weighted + (1 << 13)) >> 14) as u8
}

/// The same of 16-bit values.
pub(crate) fn luma16(rgb: &[u16]) -> u16 {
    let weighted: u32 = rgb.iter().zip(LUMA).map(|(&v, weight)| u32::from(v) * weight).sum();
    ((weighted + (1 << 13)) >> 14) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colour_becomes_grey_by_the_usual_weights() {
        assert_eq!(luma(&[255, 255, 255]), 255);
        assert_eq!((luma(&[255, 0, 0]), luma(&[0, 255, 0]), luma(&[0, 0, 255])), (76, 150, 29));
        assert_eq!(luma16(&[65535; 3]), 65535);
    }
}
