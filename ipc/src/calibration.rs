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
    /// The vertical offset costs few matches.
    Good = 2,
    /// The vertical offset costs more matches than permitted, or cannot be corrected: distances and obstacles may be
    /// wrong.
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

/// Why a calibration is degraded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum CalibrationCause {
    /// It is not.
    None = 0,
    /// The rows differ so much, after any correction, that too many matches are lost.
    Rows = 1,
    /// The rows differ by more than may be corrected.
    Limit = 2,
    /// The rows are so far apart that points are not found any more.
    Apart = 3,
    /// The left and the right picture are exchanged.
    Swapped = 4,
    /// Both pictures are the same.
    Identical = 5,
}

impl CalibrationCause {
    /// All causes, indexed by their numbers.
    pub const ALL: [Self; 6] =
        [Self::None, Self::Rows, Self::Limit, Self::Apart, Self::Swapped, Self::Identical];

    /// Its name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Rows => "rows_differ",
            Self::Limit => "beyond_correction",
            Self::Apart => "rows_apart",
            Self::Swapped => "swapped",
            Self::Identical => "identical",
        }
    }

    /// Whether the pictures are no usable pair at all.
    pub fn is_pairing(self) -> bool {
        matches!(self, Self::Apart | Self::Swapped | Self::Identical)
    }
}

/// Distance for which [`CalibrationRecord::distance_error`] is given, in metres: where an alarm has to know whether
/// something stands in the way.
pub const ERROR_DISTANCE_M: f64 = 30.0;

/// Result of monitoring the epipolar alignment. A vertical offset is the row of a point in the right image less its row
/// in the left image, in pixels. Offsets are 0 until the state is known.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CalibrationRecord {
    /// [`CalibrationState`] as a number.
    pub state: u32,
    /// [`CalibrationCause`] as a number.
    pub cause: u32,
    /// Vertical offset in the middle of the image, in px, after any correction.
    pub offset_px: f32,
    /// Change of the offset from the middle to the right border, in px.
    pub across_px: f32,
    /// Change of the offset from the middle to the lower border, in px.
    pub down_px: f32,
    /// Typical (root mean square) magnitude of the offset after any correction where the image is matched, in px.
    pub typical_px: f32,
    /// The same without any correction.
    pub total_px: f32,
    /// Standard deviation of `offset_px`, in px.
    pub sigma_px: f32,
    /// Share of matches that the offset loses after any correction, 0 to 1.
    pub lost: f32,
    /// Largest share that is permitted, 0 to 1.
    pub lost_max: f32,
    /// Relative error of distances at [`ERROR_DISTANCE_M`] that the offset, and the movement since the start, can cause.
    pub distance_error: f32,
    /// Offset by which the rows of the right image are shifted before matching, in px, at the middle of the image;
    /// 0 = no correction.
    pub corrected_px: f32,
    /// Typical change of the offset since the start of the stage, in px.
    pub moved_px: f32,
    /// 1 if the cameras have moved against each other since the start of the stage, else 0.
    pub moved: u32,
}

/// Maximum magnitude of offsets, in px: the size of the largest image.
const MAX_OFFSET_PX: f32 = MAX_SIDE as f32;

/// Offsets with a sign, and magnitudes.
const OFFSET_PX: Within<f32> = within(-MAX_OFFSET_PX, MAX_OFFSET_PX);
const MAGNITUDE_PX: Within<f32> = within(0.0, MAX_OFFSET_PX);
/// Largest relative error that is stated: ten times the distance. What is that wrong is not known at all.
pub const MAX_DISTANCE_ERROR: f32 = 10.0;

ranges! {
    CalibrationRecord as "calibration" {
        state: within(0, CalibrationState::ALL.len() as u32 - 1),
        cause: within(0, CalibrationCause::ALL.len() as u32 - 1),
        offset_px: OFFSET_PX,
        across_px: OFFSET_PX,
        down_px: OFFSET_PX,
        typical_px: MAGNITUDE_PX,
        total_px: MAGNITUDE_PX,
        sigma_px: MAGNITUDE_PX,
        lost: within(0.0, 1.0),
        lost_max: within(0.0, 1.0),
        distance_error: within(0.0, MAX_DISTANCE_ERROR),
        corrected_px: OFFSET_PX,
        moved_px: MAGNITUDE_PX,
        moved: within(0, 1),
    }
}

/// Error of distances from which on it is mentioned.
const MENTIONED_ERROR: f32 = 0.02;

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

    /// The cause of a degraded state.
    pub fn cause(&self) -> CalibrationCause {
        CalibrationCause::ALL.get(self.cause as usize).copied().unwrap_or(CalibrationCause::None)
    }

    /// Whether the cameras have moved against each other since the start of the stage.
    pub fn has_moved(&self) -> bool {
        self.moved != 0
    }

    /// What to do about it; empty if nothing is.
    pub fn remedy(&self) -> &'static str {
        match self.cause() {
            CalibrationCause::Swapped => "exchange left and right: the cameras, folders or pictures",
            CalibrationCause::Identical => "give each camera its own device, folder or picture",
            CalibrationCause::Apart => "check that the rig belongs to these cameras, or calibrate again",
            CalibrationCause::Rows | CalibrationCause::Limit => "calibrate again",
            CalibrationCause::None if self.has_moved() => "calibrate again soon",
            CalibrationCause::None => "",
        }
    }
}

impl fmt::Display for CalibrationRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = self.state();
        f.write_str(state.name())?;
        match self.cause() {
            CalibrationCause::Swapped => f.write_str(": the left and the right picture are swapped")?,
            CalibrationCause::Identical => f.write_str(": both pictures are the same")?,
            CalibrationCause::Apart => write!(f, ": the rows are about {:.0} px apart", self.total_px)?,
            CalibrationCause::Limit => {
                write!(f, ": rows differ by {:.1} px, more than calibration.correct_px", self.total_px)?;
            }
            CalibrationCause::None | CalibrationCause::Rows => {
                if matches!(state, CalibrationState::Good | CalibrationState::Degraded) {
                    write!(f, ": rows differ by {:.1} px", self.typical_px)?;
                }
            }
        }
        if matches!(state, CalibrationState::Good | CalibrationState::Degraded) && !self.cause().is_pairing()
        {
            let [lost, most] = [self.lost, self.lost_max].map(|share| 100.0 * share);
            write!(f, ", {lost:.1} % of the matches lost (at most {most:.0} %)")?;
        }
        if self.corrected_px != 0.0 {
            write!(f, ", rows shifted by {:.1} px", self.corrected_px)?;
        }
        if self.has_moved() {
            write!(f, ", cameras moved by {:.1} px since the start", self.moved_px)?;
        }
        if self.distance_error >= MENTIONED_ERROR {
            let percent = 100.0 * self.distance_error;
            write!(f, ", distances at {ERROR_DISTANCE_M} m uncertain by {percent:.0} %")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_gives_state_harm_and_correction() {
        let text = |state: u32, cause: u32, corrected_px: f32, moved: u32| {
            CalibrationRecord {
                state,
                cause,
                typical_px: 1.43,
                total_px: 2.96,
                lost: 0.312,
                lost_max: 0.1,
                corrected_px,
                moved_px: 1.53,
                moved,
                distance_error: if moved == 1 { 0.12 } else { 0.01 },
                ..Default::default()
            }
            .to_string()
        };
        assert_eq!(text(0, 0, 0.0, 0), "off");
        assert_eq!(text(77, 0, 0.0, 0), "unknown");
        assert_eq!(
            text(3, 1, 0.0, 0),
            "degraded: rows differ by 1.4 px, 31.2 % of the matches lost (at most 10 %)"
        );
        assert_eq!(
            text(2, 0, -3.07, 1),
            "good: rows differ by 1.4 px, 31.2 % of the matches lost (at most 10 %), rows shifted by -3.1 px, \
             cameras moved by 1.5 px since the start, distances at 30 m uncertain by 12 %"
        );
        assert!(
            text(3, 2, 2.0, 0)
                .starts_with("degraded: rows differ by 3.0 px, more than calibration.correct_px")
        );
        assert_eq!(text(3, 3, 0.0, 0), "degraded: the rows are about 3 px apart");
        assert_eq!(text(3, 4, 0.0, 0), "degraded: the left and the right picture are swapped");
        assert_eq!(text(3, 5, 0.0, 0), "degraded: both pictures are the same");
    }

    #[test]
    fn each_cause_has_its_number_and_a_remedy() {
        for (number, cause) in CalibrationCause::ALL.into_iter().enumerate() {
            let record = CalibrationRecord { cause: number as u32, ..Default::default() };
            assert_eq!((record.cause(), cause as usize), (cause, number));
            assert_eq!(record.remedy().is_empty(), cause == CalibrationCause::None, "{cause:?}");
        }
        let moved = CalibrationRecord { moved: 1, ..Default::default() };
        assert_eq!(moved.remedy(), "calibrate again soon");
    }
}
