//! How many objects a scene has, checked before any of them is built.

use super::file::{BesideFile, BesideKind, SceneFile};
use crate::limits::{MAX_LANE_MARKINGS, MAX_SCENE_OBJECTS};

impl SceneFile {
    /// Checks what costs memory and time for each object.
    ///
    /// # Errors
    /// The counts, their limit, and the remedy.
    pub(super) fn check_counts(&self) -> Result<(), String> {
        let mut objects = self.objects.len();
        for row in &self.beside {
            objects = objects.saturating_add(row.count());
        }
        if objects > MAX_SCENE_OBJECTS {
            let rows = self.beside.len();
            return Err(format!(
                "{objects} objects, with those of {rows} rows beside the road: a scene has at most \
                 {MAX_SCENE_OBJECTS}; give fewer or shorter rows, or a wider spacing_m"
            ));
        }
        let markings = self.road.solid_m.len() + self.road.dashed_m.len();
        if markings > MAX_LANE_MARKINGS {
            return Err(format!(
                "road.solid_m and dashed_m: {markings} lane markings: a road has at most {MAX_LANE_MARKINGS}"
            ));
        }
        Ok(())
    }
}

impl BesideFile {
    /// Distance from one object to the next, in metres.
    pub fn spacing(&self) -> f64 {
        self.spacing_m.unwrap_or(match self.kind {
            BesideKind::Buildings => 13.0,
            BesideKind::Trees => 9.0,
            BesideKind::Hedge
            | BesideKind::GuardRail
            | BesideKind::Wall
            | BesideKind::StoneWall
            | BesideKind::Fence
            | BesideKind::Barrier
            | BesideKind::Bank => 4.0,
            BesideKind::Poles => 20.0,
            BesideKind::Signs => 60.0,
            BesideKind::Bushes => 6.0,
            BesideKind::Lamps => 25.0,
            BesideKind::ParkedCars => 12.0,
        })
    }

    /// Number of objects; at least one.
    pub fn count(&self) -> usize {
        ((self.to_m - self.from_m) / self.spacing()).ceil().max(1.0) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str) -> String {
        SceneFile::parse(text, "x.toml").unwrap_err().to_string()
    }

    #[test]
    fn counts_beyond_the_limits_are_refused() {
        let start = "title = \"x\"\nseconds = 2\n";
        let row = "[[beside]]\nkind = \"trees\"\nlateral_m = 9\nto_m = 5000\n";
        let object = "[[objects]]\nkind=\"cone\"\nalong_m=9\n";
        let points = |n: usize| (0..n).map(|i| format!("[{i}, 1],")).collect::<String>();
        for (text, expected) in [
            (
                format!("{start}{}", row.repeat(10_000)),
                "x.toml: 5560000 objects, with those of 10000 rows beside the road: a scene has at most 5000; give",
            ),
            (format!("{start}{}", object.repeat(20_000)), "20000 objects, with those of 0 rows"),
            (format!("{start}{}", object.repeat(100_000)), "bytes: a scene has at most 1048576; give a TOML"),
            (format!("{start}{row}spacing_m = 1\n{object}"), "5001 objects"),
            (format!("{start}[ego]\nspeed_m_s = [{}]\n", points(3601)), "x.toml:4: more than 3600 points"),
            (format!("{start}[road]\nsolid_m = [{}]\n", "1,".repeat(31)), "33 lane markings"),
        ] {
            let text = fault(&text);
            assert!(text.contains(expected), "{text}\nexpected {expected}");
        }
        assert!(SceneFile::parse(&format!("{start}{row}spacing_m = 1\n"), "x.toml").is_ok());
        assert!(
            SceneFile::parse(&format!("{start}[ego]\nspeed_m_s = [{}]\n", points(3600)), "x.toml").is_ok()
        );
        let path = points(3601).replace(", 1]", ", 1, 2]");
        let text = fault(&format!("{start}{object}").replace("along_m=9", &format!("path = [{path}]")));
        assert!(text.contains("more than 3600 points"), "{text}");
    }
}
