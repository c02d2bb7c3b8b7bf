//! Epipolar alignment of the cameras, as the stereo stage monitors it: part of `report` and `status`.

use crate::header::MAX_SIDE;
use crate::range::{Within, ranges, within};
use bytemuck::{Pod, Zeroable};
use std::fmt;

/// State of the calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum CalibrationState {
    /// The epipolar alignment is not monitored.
    Off = 0,
    /// Too few points have been matched so far.
    Unknown = 1,
    /// The vertical offset is within the bound.
    Good = 2,
    /// The vertical offset exceeds the bound: distances and obstacles may be wrong.
    Degraded = 3,
}

impl CalibrationState {
    /// All states, indexed by their numbers.
    pub const ALL: [Self; 4] = [Self::Off, Self::Unknown, Self::Good, Self::Degraded];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Unknown => "unknown",
            Self::Good => "good",
            Self::Degraded => "degraded",
        }
    }
}

/// Result of monitoring the epipolar alignment. A vertical offset is the row of a point in the right image less its row
/// in the left image, in pixels. Offsets are 0 until the state is known.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CalibrationRecord {
    /// [`CalibrationState`] as a number.
    pub state: u32,
    /// Vertical offset in the middle of the image, in px, after any correction.
    pub offset_px: f32,
    /// Change of the offset from the middle to the right border, in px.
    pub across_px: f32,
    /// Change of the offset from the middle to the lower border, in px.
    pub down_px: f32,
    /// Largest magnitude of the offset in the image, in px, not negative.
    pub worst_px: f32,
    /// Standard deviation of `offset_px`, in px.
    pub sigma_px: f32,
    /// Bound of `worst_px`, in px: above it the calibration is degraded (`calibration.bound_px`).
    pub bound_px: f32,
    /// Offset by which the rows of the right image are shifted before matching, in px, at the middle of the image;
    /// 0 = no correction.
    pub corrected_px: f32,
}

/// Maximum magnitude of offsets, in px: the size of the largest image.
const MAX_OFFSET_PX: f32 = MAX_SIDE as f32;

/// Offsets with a sign, and magnitudes.
const OFFSET_PX: Within<f32> = within(-MAX_OFFSET_PX, MAX_OFFSET_PX);
const MAGNITUDE_PX: Within<f32> = within(0.0, MAX_OFFSET_PX);

ranges! {
    CalibrationRecord as "calibration" {
        state: within(0, CalibrationState::ALL.len() as u32 - 1),
        offset_px: OFFSET_PX,
        across_px: OFFSET_PX,
        down_px: OFFSET_PX,
        worst_px: MAGNITUDE_PX,
        sigma_px: MAGNITUDE_PX,
        bound_px: MAGNITUDE_PX,
        corrected_px: OFFSET_PX,
    }
}

impl CalibrationRecord {
    /// The state; an unknown number counts as [`CalibrationState::Unknown`].
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
    fn the_text_gives_state_offset_and_correction() {
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
