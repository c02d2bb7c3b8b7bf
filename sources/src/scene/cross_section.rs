//! Checks of the road's strips of ground and painted bays.

use super::bay::BayFile;
use super::file::SceneFile;
use super::strip::{Side, StripFile};
use crate::limits::{MAX_LANE_MARKINGS, MAX_STRIPS};

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
        for StripFile { width_m, step_m, rise_m, grey, .. } in strips {
            if let Some(grey) = grey.filter(|grey| !(5.0..=250.0).contains(grey)) {
                return Err(format!("road.strip: grey = {grey}: give a grey value from 5 to 250"));
            }
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
    fn strips_out_of_range_are_refused() {
        let start = "title = \"x\"\nseconds = 2\n";
        let strip = |more: &str| format!("[[road.strip]]\nside = \"left\"\ncover = \"lawn\"\n{more}");
        let fault =
            |text: &str| SceneFile::parse(&format!("{start}{text}"), "x.toml").unwrap_err().to_string();
        assert!(fault(&strip("width_m = 200\n")).contains("width_m = 200"));
        assert!(fault(&strip("width_m = 2\ngrey = 300\n")).contains("grey = 300"));
        assert!(fault(&strip("width_m = 2\nrise_m = nan\n")).contains("rise_m = NaN"));
        assert!(fault(&strip("width_m = 2\n").repeat(33)).contains("33 strips: give at most 32"));
        let bent = format!("[road]\nbend_per_km = 50\n{}", strip("width_m = 30\n"));
        assert!(fault(&bent).contains("a radius of 20.0 m"), "{}", fault(&bent));
        let branch = "[road]\nkerb_m = 0\n[[road.branch]]\nat_m = 20\nfrom_m = 0\nto_m = 30\n";
        assert!(fault(&format!("{branch}{}", strip("width_m = 3\n"))).contains("branches has no strips"));
        assert!(fault(&strip("width_m = 2\ncover = \"sand\"\n")).contains("cover"));
    }

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
