//! A simulated board whose temperature the soak sets: a sysfs tree with one thermal zone.

use super::error::SoakError;
use config::{Config, Heat};
use std::path::{Path, PathBuf};
use tools::soak::report::Setting;

/// Normal temperature, and one above `heat.stop_above_c`, at which the stages are stopped.
const COOL_C: f64 = 50.0;
const HOT_C: f64 = 94.5;

/// Temperature file below the tree.
const TEMPERATURE: &str = "class/thermal/thermal_zone0/temp";

/// A simulated board with one thermal zone.
#[derive(Debug)]
pub struct HotBoard {
    temperature: PathBuf,
}

impl HotBoard {
    /// Creates the tree below a folder, and configures the daemon to monitor it with short time constants.
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
        // Absolute, because the daemon may have another working directory.
        config.board.sysfs = std::path::absolute(&tree).map_err(SoakError::io(&tree))?;
        config.board.power_off = "none".into();
        config.clocks.set = "off".into();
        let mut set = |key, value: String, why| settings.push(Setting { key, value, why });
        set(
            "board.sysfs",
            config.board.sysfs.display().to_string(),
            "a simulated board that the soak heats up",
        );
        set("board.power_off", "none".into(), "the temperatures of this run are simulated");
        set("heat.watch", "require".into(), "the ladder is part of the run");
        set("heat.dwell_s", "0.2".into(), "temperatures change quickly in this run");
        set("heat.filter_s", "0".into(), "temperatures change quickly in this run");
        set("clocks.set", "off".into(), "the simulated board has no clocks");
        Ok(board)
    }

    /// The existing board below a tree.
    pub fn of(tree: &Path) -> Self {
        Self { temperature: tree.join(TEMPERATURE) }
    }

    /// Sets the temperature to hot or normal.
    pub fn set(&self, hot: bool) -> Result<(), SoakError> {
        let celsius = if hot { HOT_C } else { COOL_C };
        // Renamed into place, so that a reader never sees a partial number.
        let fresh = self.temperature.with_extension("new");
        std::fs::write(&fresh, format!("{:.0}\n", celsius * 1000.0)).map_err(SoakError::io(&fresh))?;
        std::fs::rename(&fresh, &self.temperature).map_err(SoakError::io(&self.temperature))
    }
}
