//! Checks of the road's bends and branches.

use super::file::{BranchFile, SceneFile};
use crate::limits::{MAX_BENDING_ROAD_M, MAX_BRANCHES};

/// Sharpest bend, in 1/km: a radius of 7.7 m. A passenger car turns no tighter.
const MAX_BEND_PER_KM: f64 = 130.0;

/// Greatest length of a branch to either side, in metres.
const MAX_BRANCH_M: f64 = 1000.0;

impl SceneFile {
    /// Checks bends and branches.
    ///
    /// # Errors
    /// The key, its value, and the remedy.
    pub(super) fn check_course(&self) -> Result<(), String> {
        let road = &self.road;
        let bend = road.bend_per_km.max_abs();
        if bend > MAX_BEND_PER_KM {
            return Err(format!(
                "road.bend_per_km: give bends from -{MAX_BEND_PER_KM} to {MAX_BEND_PER_KM} (a radius of 7.7 m)"
            ));
        }
        let way_m = self.ego.speed_m_s.max_abs() * self.seconds;
        if bend > 0.0 && way_m > MAX_BENDING_ROAD_M {
            return Err(format!(
                "road.bend_per_km: the drive may be {way_m:.0} m long: give at most {MAX_BENDING_ROAD_M} m on a road with bends"
            ));
        }
        let half_m = road.edges_m.1.max(-road.edges_m.0);
        if bend * half_m > 1000.0 {
            return Err(format!(
                "road.bend_per_km: {bend} is a radius of {:.1} m, and road.edges_m reach {half_m} m: give a wider bend or \
                 a narrower road",
                1000.0 / bend
            ));
        }
        self.check_branches()
    }

    fn check_branches(&self) -> Result<(), String> {
        let branches = &self.road.branch;
        if branches.len() > MAX_BRANCHES {
            return Err(format!("road.branch: {} branches: give at most {MAX_BRANCHES}", branches.len()));
        }
        for branch in branches {
            let BranchFile { at_m, angle_deg, from_m, to_m } = *branch;
            let is_near = (-MAX_BRANCH_M..=MAX_BRANCH_M).contains(&from_m) && to_m <= MAX_BRANCH_M;
            if !(at_m.abs() <= MAX_BENDING_ROAD_M && angle_deg.abs() <= 360.0 && is_near && from_m < to_m) {
                return Err(format!(
                    "road.branch: at_m = {at_m}, angle_deg = {angle_deg}, from_m = {from_m}, to_m = {to_m}: give at_m up to \
                     {MAX_BENDING_ROAD_M}, angles up to 360 degrees, and from_m less than to_m, both up to {MAX_BRANCH_M} m"
                ));
            }
        }
        if !branches.is_empty() && self.road.kerb_m != 0.0 {
            return Err(format!(
                "road.kerb_m = {}: a road with branches has no kerbs; give 0",
                self.road.kerb_m
            ));
        }
        if !branches.is_empty() && !self.road.grade_percent.is_always(0.0) {
            return Err("road.grade_percent: a road with branches is level; give 0".into());
        }
        let numbers = self.objects.iter().map(|o| o.branch).chain(self.beside.iter().map(|row| row.branch));
        match numbers.flatten().find(|n| !(1..=branches.len()).contains(n)) {
            Some(n) => {
                Err(format!("branch = {n}: the road has {} branches, numbered from 1", branches.len()))
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bends_and_branches_out_of_range_are_refused() {
        let start = "title = \"x\"\nseconds = 2\n";
        let branch = "[[road.branch]]\nat_m = 20\nfrom_m = 0\nto_m = 30\n";
        let fault =
            |text: &str| SceneFile::parse(&format!("{start}{text}"), "x.toml").unwrap_err().to_string();
        for (text, expected) in [
            ("[road]\nbend_per_km = 200\n", "give bends from -130 to 130"),
            (
                "[road]\nbend_per_km = 130\nedges_m = [-9, 9]\n",
                "a radius of 7.7 m, and road.edges_m reach 9 m",
            ),
            ("[ego]\nspeed_m_s = [[0, 1], [1, 70]]\n[road]\nbend_per_km = 1\n", ""),
            (
                &format!("[road]\nkerb_m = 0.1\n{branch}"),
                "road.kerb_m = 0.1: a road with branches has no kerbs",
            ),
            (&format!("[road]\nkerb_m = 0\ngrade_percent = 2\n{branch}"), "is level; give 0"),
            (
                "[road]\nkerb_m = 0\n[[road.branch]]\nat_m = 20\nfrom_m = 5\nto_m = 5\n",
                "from_m less than to_m",
            ),
            (&format!("[road]\nkerb_m = 0\n{}", branch.repeat(17)), "17 branches: give at most 16"),
            (
                &format!(
                    "[road]\nkerb_m = 0\n{branch}[[objects]]\nkind = \"car\"\nalong_m = 3\nbranch = 2\n"
                ),
                "branch = 2: the road has 1 branches",
            ),
        ] {
            if expected.is_empty() {
                assert!(SceneFile::parse(&format!("{start}{text}"), "x.toml").is_ok(), "{text}");
            } else {
                let told = fault(text);
                assert!(told.contains(expected), "{text}\n{told}\nexpected {expected}");
            }
        }
        let long = "title = \"x\"\nseconds = 3600\n[ego]\nspeed_m_s = 20\n[road]\nbend_per_km = 1\n";
        let told = SceneFile::parse(long, "x.toml").unwrap_err().to_string();
        assert!(told.contains("72000 m long"), "{told}");
    }
}
