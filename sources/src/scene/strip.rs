//! Strips of ground beside the asphalt: kerbs, lawns, verges, ditches.

use super::file::SceneFile;
use super::material::{Look, Material};
use super::truth::{ROAD, VERGE};
use crate::limits::MAX_STRIPS;
use serde::Deserialize;

/// Side of the road.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// Left of the asphalt.
    Left,
    /// Right of the asphalt.
    Right,
}

impl Side {
    /// -1 for left, 1 for right: the sign of lateral positions there.
    pub fn sign(self) -> f64 {
        if self == Self::Left { -1.0 } else { 1.0 }
    }
}

/// What a strip is covered with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cover {
    /// A lawn.
    Lawn,
    /// Rough grass.
    Grass,
    /// Paving slabs.
    Pavement,
    /// Gravel.
    Gravel,
    /// Bare earth or a field.
    Earth,
    /// Asphalt, with the road's lane markings: a cycle track, or another carriageway.
    Asphalt,
    /// Kerb stones.
    Stone,
}

impl Cover {
    /// Its material, and [`ROAD`] or [`VERGE`].
    pub fn surface(self) -> (Material, u16) {
        match self {
            Self::Lawn => (Material::new(Look::Grass, 88.0, 0.5, 0.015), VERGE),
            Self::Grass => (Material::new(Look::Grass, 80.0, 0.75, 0.025), VERGE),
            Self::Pavement => (Material::new(Look::Paving, 138.0, 0.6, 0.015), VERGE),
            Self::Gravel => (Material::new(Look::Grass, 124.0, 0.7, 0.012), VERGE),
            Self::Earth => (Material::new(Look::Grass, 98.0, 0.8, 0.03), VERGE),
            Self::Asphalt => (Material::new(Look::Road, 96.0, 1.0, 0.012), ROAD),
            Self::Stone => (Material::new(Look::Plain, 158.0, 0.5, 0.02), VERGE),
        }
    }
}

/// A strip of ground beside the asphalt.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StripFile {
    /// Side of the road.
    pub side: Side,
    /// Width, in metres.
    pub width_m: f64,
    /// Step at its near edge, in metres, up positive: a kerb.
    #[serde(default)]
    pub step_m: f64,
    /// Rise across it, away from the road, in metres; negative falls.
    #[serde(default)]
    pub rise_m: f64,
    /// What it is covered with.
    pub cover: Cover,
}

/// Greatest width of a strip, step and rise, in metres.
const MAX_M: (f64, f64, f64) = (100.0, 1.0, 5.0);

impl SceneFile {
    /// Checks the strips of the road.
    ///
    /// # Errors
    /// The key, its value, and the remedy.
    pub(super) fn check_strips(&self) -> Result<(), String> {
        let strips = &self.road.strip;
        if strips.len() > MAX_STRIPS {
            return Err(format!("road.strip: {} strips: give at most {MAX_STRIPS}", strips.len()));
        }
        if !strips.is_empty() && !self.road.branch.is_empty() {
            return Err("road.strip: a road with branches has no strips; leave one of both out".into());
        }
        for StripFile { width_m, step_m, rise_m, .. } in strips {
            let is_small = (-MAX_M.1..=MAX_M.1).contains(step_m) && (-MAX_M.2..=MAX_M.2).contains(rise_m);
            if !(0.02..=MAX_M.0).contains(width_m) || !is_small {
                return Err(format!(
                    "road.strip: width_m = {width_m}, step_m = {step_m}, rise_m = {rise_m}: give widths from 0.02 to {} m, \
                     steps up to {} m and rises up to {} m",
                    MAX_M.0, MAX_M.1, MAX_M.2
                ));
            }
        }
        let reach_m = |side: Side, edge: f64| {
            let own = strips.iter().filter(|strip| strip.side == side);
            edge.abs() + own.map(|strip| strip.width_m).sum::<f64>()
        };
        let (left, right) = self.road.edges_m;
        let half_m = reach_m(Side::Left, left).max(reach_m(Side::Right, right));
        let bend = self.road.bend_per_km.max_abs();
        if !strips.is_empty() && bend * half_m > 1000.0 {
            return Err(format!(
                "road.strip: the strips reach {half_m} m, and road.bend_per_km = {bend} is a radius of {:.1} m: give \
                 narrower strips or a wider bend",
                1000.0 / bend
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_out_of_range_are_refused() {
        let start = "title = \"x\"\nseconds = 2\n";
        let strip = |more: &str| format!("[[road.strip]]\nside = \"left\"\ncover = \"lawn\"\n{more}");
        let fault =
            |text: &str| SceneFile::parse(&format!("{start}{text}"), "x.toml").unwrap_err().to_string();
        assert!(fault(&strip("width_m = 200\n")).contains("width_m = 200"));
        assert!(fault(&strip("width_m = 2\nrise_m = nan\n")).contains("rise_m = NaN"));
        assert!(fault(&strip("width_m = 2\n").repeat(33)).contains("33 strips: give at most 32"));
        let bent = format!("[road]\nbend_per_km = 50\n{}", strip("width_m = 30\n"));
        assert!(fault(&bent).contains("a radius of 20.0 m"), "{}", fault(&bent));
        let branch = "[road]\nkerb_m = 0\n[[road.branch]]\nat_m = 20\nfrom_m = 0\nto_m = 30\n";
        assert!(fault(&format!("{branch}{}", strip("width_m = 3\n"))).contains("branches has no strips"));
        assert!(fault(&strip("width_m = 2\ncover = \"sand\"\n")).contains("cover"));
    }
}
