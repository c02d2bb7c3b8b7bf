//! Whether the cameras still stand as they were calibrated: part of `report` and `status`.

use bytemuck::{Pod, Zeroable};
use std::fmt;

/// What the check of the calibration says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum CalibrationState {
    /// It is not checked.
    Off = 0,
    /// Too little was seen.
    Unknown = 1,
    /// Rows of both pictures match within the bound.
    Good = 2,
    /// They do not: distances and obstacles may be wrong.
    Degraded = 3,
}

impl CalibrationState {
    /// All states, by their numbers.
    pub const ALL: [Self; 4] = [Self::Off, Self::Unknown, Self::Good, Self::Degraded];

    /// The word for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Unknown => "unknown",
            Self::Good => "good",
            Self::Degraded => "degraded",
        }
    }
}

/// The calibration's health. Offsets are the row of a point in the right picture less its row in the
/// left one, in pixels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CalibrationRecord {
    /// [`CalibrationState`] as a number.
    pub state: u32,
    /// Offset in the middle of the picture, as it is matched: after any correction.
    pub offset_px: f32,
    /// What is added to that from the middle to the right border.
    pub across_px: f32,
    /// What is added from the middle to the lower border.
    pub down_px: f32,
    /// The largest offset in the picture, without its sign.
    pub worst_px: f32,
    /// Standard deviation of the offset.
    pub sigma_px: f32,
    /// Above this the calibration is degraded.
    pub bound_px: f32,
    /// Rows by which the middle of the right picture is shifted before matching; 0 when it is not.
    pub corrected_px: f32,
}

impl CalibrationRecord {
    /// What the check says; a number that means nothing counts as unknown.
    pub fn state(&self) -> CalibrationState {
        match self.state {
            0 => CalibrationState::Off,
            2 => CalibrationState::Good,
            3 => CalibrationState::Degraded,
            _ => CalibrationState::Unknown,
        }
    }
}

impl fmt::Display for CalibrationRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.state().name())?;
        if matches!(self.state(), CalibrationState::Good | CalibrationState::Degraded) {
            write!(f, ": vertical offset {:.1} px (bound {})", self.worst_px, self.bound_px)?;
        }
        if self.corrected_px != 0.0 {
            write!(f, ", rows shifted by {:.1} px", self.corrected_px)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_told_in_words() {
        let text = |state: u32, corrected_px: f32| {
            let worst_px = 1.43;
            CalibrationRecord { state, worst_px, bound_px: 0.5, corrected_px, ..Default::default() }
                .to_string()
        };
        assert_eq!(text(0, 0.0), "off");
        assert_eq!(text(77, 0.0), "unknown");
        assert_eq!(text(3, 0.0), "degraded: vertical offset 1.4 px (bound 0.5)");
        assert_eq!(text(2, -3.07), "good: vertical offset 1.4 px (bound 0.5), rows shifted by -3.1 px");
    }
}
