//! A board whose temperature the soak sets: a sysfs tree of its own with one thermal zone.

use super::error::SoakError;
use config::{Config, Heat};
use std::path::{Path, PathBuf};
use tools::soak::report::Setting;

/// How warm it is while nothing is wrong, and when the stages must wait.
const COOL_C: f64 = 50.0;
const HOT_C: f64 = 94.5;

/// Where the temperature is, below the tree.
const TEMPERATURE: &str = "class/thermal/thermal_zone0/temp";

/// See the module.
#[derive(Debug)]
pub struct HotBoard {
    temperature: PathBuf,
}

impl HotBoard {
    /// Makes the tree below a folder, and has the daemon watch it and answer fast.
    pub fn create(
        folder: &Path,
        config: &mut Config,
        settings: &mut Vec<Setting>,
    ) -> Result<Self, SoakError> {
        let tree = folder.join("board");
        let board = Self::of(&tree);
        let zone = board.temperature.parent().unwrap_or(&tree);
        std::fs::create_dir_all(zone).map_err(SoakError::io(zone))?;
        let name = zone.join("type");
        std::fs::write(&name, "soak\n").map_err(SoakError::io(&name))?;
        board.set(false)?;
        let heat = Heat {
            watch: "require".into(),
            zones: "soak".into(),
            period_ms: 100,
            filter_s: 0.0,
            start_below_c: 85.0,
            frame_rate_above_c: 90.0,
            clocks_above_c: 92.0,
            recognition_above_c: 93.0,
            stop_above_c: 94.0,
            power_off_above_c: 95.0,
            dwell_s: 0.2,
            ..config.heat.clone()
        };
        config.heat = heat;
        // Read by the daemon, which may have another working directory.
        config.board.sysfs = std::path::absolute(&tree).map_err(SoakError::io(&tree))?;
        config.board.power_off = "none".into();
        config.clocks.set = "off".into();
        let mut set = |key, value: String, why| settings.push(Setting { key, value, why });
        set("board.sysfs", config.board.sysfs.display().to_string(), "a board that the soak heats up");
        set("board.power_off", "none".into(), "no heat of this run is real");
        set("heat.watch", "require".into(), "the ladder is part of the run");
        set("heat.dwell_s", "0.2".into(), "heat comes and goes quickly");
        set("heat.filter_s", "0".into(), "heat comes and goes quickly");
        set("clocks.set", "off".into(), "the made-up board has none");
        Ok(board)
    }

    /// The board below a tree.
    pub fn of(tree: &Path) -> Self {
        Self { temperature: tree.join(TEMPERATURE) }
    }

    /// Heats it up, or lets it cool.
    pub fn set(&self, hot: bool) -> Result<(), SoakError> {
        let celsius = if hot { HOT_C } else { COOL_C };
        // A reader never sees half a number.
        let fresh = self.temperature.with_extension("new");
        std::fs::write(&fresh, format!("{:.0}\n", celsius * 1000.0)).map_err(SoakError::io(&fresh))?;
        std::fs::rename(&fresh, &self.temperature).map_err(SoakError::io(&self.temperature))
    }
}
