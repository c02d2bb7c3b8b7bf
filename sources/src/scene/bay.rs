//! Painted bays: lines across the asphalt at intervals.

use super::material::Bays;
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
