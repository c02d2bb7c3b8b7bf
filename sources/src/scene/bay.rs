//! Painted bays: lines across the asphalt at intervals.

use super::file::SceneFile;
use super::material::Bays;
use crate::limits::MAX_LANE_MARKINGS;
use serde::Deserialize;

/// Lines across the asphalt at intervals, as between parking bays.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BayFile {
    /// From and to across the road, in metres.
    pub lateral_m: (f64, f64),
    /// Position of one of the lines along the road, in metres.
    pub first_m: f64,
    /// Distance from one line to the next, in metres.
    pub spacing_m: f64,
}

impl BayFile {
    /// As the asphalt is painted.
    pub fn paint(&self) -> Bays {
        Bays {
            from_m: self.lateral_m.0 as f32,
            to_m: self.lateral_m.1 as f32,
            first_m: self.first_m as f32,
            spacing_m: self.spacing_m as f32,
        }
    }
}

impl SceneFile {
    /// Checks the painted bays.
    ///
    /// # Errors
    /// The key, its value, and the remedy.
    pub(super) fn check_bays(&self) -> Result<(), String> {
        let bays = &self.road.bays;
        if bays.len() > MAX_LANE_MARKINGS {
            return Err(format!("road.bays: {} rows: give at most {MAX_LANE_MARKINGS}", bays.len()));
        }
        for BayFile { lateral_m, first_m, spacing_m } in bays {
            let is_valid = (-100.0..lateral_m.1).contains(&lateral_m.0)
                && lateral_m.1 <= 100.0
                && (-1000.0..=20_000.0).contains(first_m)
                && (0.5..=1000.0).contains(spacing_m);
            if !is_valid {
                return Err(format!(
                    "road.bays: lateral_m = {lateral_m:?}, first_m = {first_m}, spacing_m = {spacing_m}: give \
                     [from, to] within 100 m and spacings from 0.5 to 1000 m"
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bays_out_of_range_are_refused() {
        let row = |more: &str| format!("title = \"x\"\nseconds = 2\n[[road.bays]]\nfirst_m = 0\n{more}");
        let fault = |more: &str| SceneFile::parse(&row(more), "x.toml").unwrap_err().to_string();
        assert!(SceneFile::parse(&row("lateral_m = [3, 8]\nspacing_m = 2.8\n"), "x.toml").is_ok());
        assert!(fault("lateral_m = [8, 3]\nspacing_m = 2.8\n").contains("(8.0, 3.0)"));
        assert!(fault("lateral_m = [3, 8]\nspacing_m = 0\n").contains("spacing_m = 0"));
        assert!(fault("lateral_m = [nan, 8]\nspacing_m = 2\n").contains("NaN"));
    }
}
