//! Evaluation of disparity maps by the rules of the KITTI devkit, with diagnostics (error images, pixel-locking
//! bias, confidence ranking, disturbances), and of the whole pipeline on synthetic scenes and LiDAR data.

pub mod approach;
pub mod bias;
pub mod box_score;
pub mod classes;
pub mod compare;
pub mod detection;
pub mod disturb;
pub mod drive;
pub mod error_picture;
pub mod false_alarm;
pub mod files;
pub mod fill;
pub mod free_ground;
pub mod label_classes;
pub mod lidar;
pub mod missed;
pub mod ncap;
pub mod odometry;
pub mod odometry_report;
pub mod reliability;
pub mod report;
pub mod roc;
pub mod running_time;
pub mod scene_match;
pub mod score;
pub mod subpixel;
pub mod time_faults;
pub mod time_score;
pub mod weather;

/// Converts a map (1/256 px, 0 = unknown) to px, −1 = unknown.
pub fn pixels(disparity: &[u16]) -> Vec<f32> {
    disparity.iter().map(|&d| if d > 0 { f32::from(d) / 256.0 } else { -1.0 }).collect()
}

/// A share in percent; NaN when `whole` is zero.
fn percent(part: u64, whole: u64) -> f64 {
    100.0 * part as f64 / whole as f64
}

/// The quantile `share` (0 to 1; 0.5 is the median) of the values, which are sorted. `None` for no values.
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values.get((values.len().saturating_sub(1) as f64 * share).round() as usize).copied()
}
