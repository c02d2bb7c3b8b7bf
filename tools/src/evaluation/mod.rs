//! Scores of disparity maps against truth, by the rules of the KITTI devkit, and what shows where
//! a matcher fails: error pictures, the sub-pixel histogram, errors by confidence, disturbances; and
//! what the whole system makes of synthetic scenes.

pub mod approach;
pub mod compare;
pub mod detection;
pub mod disturb;
pub mod error_picture;
pub mod files;
pub mod fill;
pub mod lidar;
pub mod report;
pub mod roc;
pub mod running_time;
pub mod scene_match;
pub mod score;
pub mod subpixel;
pub mod weather;

/// Disparities of a map (1/256 px, 0 = unknown) in px, −1 = unknown.
pub fn pixels(disparity: &[u16]) -> Vec<f32> {
    disparity.iter().map(|&d| if d > 0 { f32::from(d) / 256.0 } else { -1.0 }).collect()
}

/// A share in percent; not a number where there is nothing to share.
fn percent(part: u64, whole: u64) -> f64 {
    100.0 * part as f64 / whole as f64
}

/// The value below which a share (0 to 1) of the values lies, 0.5 for the middle one; sorts them. `None` of none.
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values.get((values.len().saturating_sub(1) as f64 * share).round() as usize).copied()
}
