//! The board: its temperature sensors, the thermal ladder, its clocks, and power-off.

use super::clocks::{self, ClockError, ClockSettings, Clocks, Hertz};
use super::heat::{Celsius, Heat, HeatAction, HeatParameters, Rung};
use super::sysfs::{Sensors, Sysfs};
use config::Config;
use messages::heat::HeatRecord;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use thiserror::Error;

/// The file that triggers the unit `lookout-poweroff.path`.
const REQUEST: &str = "power-off";

/// Time after which power-off is requested again if the board is still on, in nanoseconds.
const REPEAT_NS: u64 = 60_000_000_000;

/// Why the daemon does not start on this board.
#[derive(Debug, Error)]
pub enum BoardError {
    /// Too hot.
    #[error(
        "{zone} is at {at}, the daemon starts below {limit}: let the board cool down, or raise heat.start_below_c"
    )]
    Hot {
        /// The zone.
        zone: String,
        /// Its temperature.
        at: Celsius,
        /// The limit.
        limit: Celsius,
    },
    /// No sensor, and heat.watch is not "off".
    #[error(
        "no thermal zone below {} matches \"{zones}\" and can be read: correct heat.zones (the types are in \
         class/thermal/*/type), or set heat.watch = \"{instead}\"",
        root.display()
    )]
    NoSensor {
        /// The root that was searched.
        root: PathBuf,
        /// The patterns.
        zones: String,
        /// The value of heat.watch that does without: another than the one that is set.
        instead: &'static str,
    },
    /// The clocks.
    #[error(transparent)]
    Clock(#[from] ClockError),
}

/// Method of switching the board off.
#[derive(Clone, Debug, PartialEq, Eq)]
enum PowerOff {
    None,
    Systemctl,
    Request(PathBuf),
    Command(PathBuf),
}

/// The board.
#[derive(Debug)]
pub struct Board {
    sysfs: Sysfs,
    /// Folder of the instance.
    directory: PathBuf,
    sensors: Sensors,
    readings: Vec<Option<Celsius>>,
    heat: Option<Heat>,
    clocks: Option<Clocks>,
    /// Why preferred clocks could not be set.
    clock_refused: Option<String>,
    power_off: PowerOff,
    sample_ns: u64,
    sample_due_ns: u64,
    check_ns: u64,
    check_due_ns: u64,
    requested_ns: Option<u64>,
    child: Option<Child>,
    config: BoardConfig,
}

/// The tables of the configuration that this module reads.
type BoardConfig = (config::Heat, config::Clocks, config::Board);

impl Board {
    /// Reads the sensors and sets the clocks. `directory` is the folder of the instance.
    ///
    /// # Errors
    /// If the board is too hot, or a required sensor or clock is missing.
    pub fn start(config: &Config, directory: &Path, now_ns: u64) -> Result<Self, BoardError> {
        let mut board = Self {
            sysfs: Sysfs::new(&config.board.sysfs),
            directory: directory.to_owned(),
            sensors: Sensors::find(&Sysfs::new(&config.board.sysfs), ""),
            readings: Vec::new(),
            heat: None,
            clocks: None,
            clock_refused: None,
            power_off: PowerOff::None,
            sample_ns: 0,
            sample_due_ns: now_ns,
            check_ns: 0,
            check_due_ns: now_ns,
            requested_ns: None,
            child: None,
            config: (config.heat.clone(), config.clocks.clone(), config.board.clone()),
        };
        board.configure(config);
        board.watch_heat(config)?;
        let parameters = heat_parameters(config);
        if board.heat.is_some()
            && let Some((zone, at)) = parameters.too_hot_to_start(board.sensors.names(), &board.readings)
        {
            return Err(BoardError::Hot { zone: zone.into(), at, limit: parameters.start_below });
        }
        board.set_clocks(config)?;
        Ok(board)
    }

    fn configure(&mut self, config: &Config) {
        let ms = |v: i64| v.unsigned_abs() * 1_000_000;
        self.sample_ns = ms(config.heat.period_ms);
        self.check_ns = ms(config.clocks.check_ms);
        self.power_off = match config.board.power_off.as_str() {
            "systemctl" => PowerOff::Systemctl,
            "request" => {
                let base = self.directory.parent().unwrap_or(&self.directory);
                PowerOff::Request(base.join(REQUEST))
            }
            "command" => PowerOff::Command(config.board.power_off_command.clone()),
            _ => PowerOff::None,
        };
    }

    fn watch_heat(&mut self, config: &Config) -> Result<(), BoardError> {
        self.heat = None;
        if config.heat.watch == "off" {
            return Ok(());
        }
        self.sensors = Sensors::find(&self.sysfs, &config.heat.zones);
        self.sensors.read(&mut self.readings);
        if self.readings.iter().all(Option::is_none) {
            let error = self.no_sensor(config);
            if config.heat.watch == "require" {
                return Err(error);
            }
            tracing::warn!("temperatures are not monitored: {error}");
            return Ok(());
        }
        for (name, _) in self.sensors.names().iter().zip(&self.readings).filter(|(_, r)| r.is_none()) {
            tracing::warn!(zone = name, "thermal zone cannot be read; it counts as soon as it can");
        }
        self.heat = Some(Heat::new(heat_parameters(config), self.sensors.names()));
        Ok(())
    }

    fn no_sensor(&self, config: &Config) -> BoardError {
        // Only what is not set already is advised.
        let instead = if config.heat.watch == "require" { "prefer" } else { "off" };
        BoardError::NoSensor { root: self.sysfs.path(""), zones: config.heat.zones.clone(), instead }
    }

    fn set_clocks(&mut self, config: &Config) -> Result<(), BoardError> {
        // Dropped first, so that the original values are restored before they are read.
        self.clocks = None;
        self.clock_refused = None;
        let c = &config.clocks;
        let frequency = |mhz: f64| (mhz > 0.0).then(|| Hertz::from_mhz(mhz));
        let settings = ClockSettings {
            cpu: frequency(c.cpu_mhz),
            gpu: frequency(c.gpu_mhz),
            gpu_by_override: config.board.gpu == "tk1",
            gpu_device: config.board.gpu_device.clone(),
            needs_all: c.set == "require",
        };
        if c.set == "off" || (settings.cpu.is_none() && settings.gpu.is_none()) {
            return Ok(());
        }
        match Clocks::take(&self.sysfs, &settings, &clocks::state_file(&self.directory)) {
            Ok(clocks) => {
                for (name, target, read) in clocks.readings() {
                    let read = read.map_or("unknown".into(), |r| r.to_string());
                    tracing::info!(clock = name, set = %target, read, "clock is set");
                }
                let clocks = self.clocks.insert(clocks);
                if let Some(fault) = clocks.fault() {
                    tracing::warn!("{fault}");
                }
                if let Some(heat) = self.heat.as_ref().filter(|heat| heat.rung() >= Rung::Clocks) {
                    clocks.set(heat.action().clocks_share)?;
                }
            }
            Err(error) if c.set == "require" => return Err(error.into()),
            Err(error) => {
                tracing::warn!("clocks are not set: {error}");
                self.clock_refused = Some(format!("clocks are not set: {error}"));
            }
        }
        Ok(())
    }

    /// Applies the tables `[heat]`, `[clocks]` and `[board]` of a new configuration.
    ///
    /// # Errors
    /// If a required sensor or clock is missing. Without a required sensor nothing is changed.
    pub fn reload(&mut self, config: &Config) -> Result<(), BoardError> {
        let (heat, clocks, board) = &self.config;
        let new_clocks = *clocks != config.clocks || *board != config.board;
        let new_sensors = heat.zones != config.heat.zones
            || heat.watch != config.heat.watch
            || board.sysfs != config.board.sysfs;
        let before = (self.sysfs.clone(), self.sensors.clone(), self.heat.clone());
        self.sysfs = Sysfs::new(&config.board.sysfs);
        if new_sensors && let Err(error) = self.watch_heat(config) {
            (self.sysfs, self.sensors, self.heat) = before;
            return Err(error);
        }
        if let Some(heat) = &mut self.heat {
            heat.set_parameters(heat_parameters(config));
        }
        self.configure(config);
        self.config = (config.heat.clone(), config.clocks.clone(), config.board.clone());
        if new_clocks {
            self.set_clocks(config)?;
        }
        Ok(())
    }

    /// Samples temperatures, updates the thermal ladder and reads clocks back, when due; has to be called often. Returns
    /// the new limits if the rung has changed.
    pub fn tick(&mut self, now_ns: u64) -> Option<HeatAction> {
        if now_ns >= self.check_due_ns {
            self.check_due_ns = now_ns + self.check_ns;
            if let Some(clocks) = &mut self.clocks {
                let before = clocks.fault();
                clocks.check();
                if let Some(fault) = clocks.fault().filter(|fault| before.as_ref() != Some(fault)) {
                    tracing::warn!("{fault}");
                }
            }
        }
        self.reap();
        if now_ns < self.sample_due_ns {
            return None;
        }
        self.sample_due_ns = now_ns + self.sample_ns;
        let heat = self.heat.as_mut()?;
        self.sensors.read(&mut self.readings);
        let changed = heat.update(now_ns, &self.readings);
        let action = heat.action();
        if changed {
            if heat.rung() == Rung::Normal {
                tracing::info!("{}", heat.reason());
            } else {
                tracing::warn!("{}", heat.reason());
            }
            if let Some(clocks) = &mut self.clocks
                && let Err(error) = clocks.set(action.clocks_share)
            {
                tracing::warn!(%error, "clocks cannot be lowered");
            }
        }
        if action.power_off && self.requested_ns.is_none_or(|at| now_ns - at >= REPEAT_NS) {
            self.requested_ns = Some(now_ns);
            self.switch_off();
        }
        changed.then_some(action)
    }

    fn switch_off(&mut self) {
        let reason = self.heat.as_ref().map_or("", |heat| heat.reason());
        tracing::error!(reason, "the board is switched off");
        let program = match &self.power_off {
            PowerOff::None => return,
            PowerOff::Request(file) => {
                if let Err(error) = std::fs::write(file, format!("{reason}\n")) {
                    tracing::error!(file = %file.display(), %error, "power-off cannot be requested");
                }
                return;
            }
            PowerOff::Systemctl => Path::new("systemctl"),
            PowerOff::Command(program) => program,
        };
        let mut command = Command::new(program);
        if self.power_off == PowerOff::Systemctl {
            command.args(["--no-ask-password", "poweroff"]);
        }
        match command.stdin(Stdio::null()).stdout(Stdio::null()).spawn() {
            Ok(child) => self.child = Some(child),
            Err(error) => tracing::error!(program = %program.display(), %error, "power-off cannot be run"),
        }
    }

    fn reap(&mut self) {
        let Some(child) = &mut self.child else { return };
        match child.try_wait() {
            Ok(None) => return,
            Ok(Some(status)) if status.success() => {}
            Ok(Some(status)) => tracing::error!(%status, "power-off failed"),
            Err(error) => tracing::error!(%error, "power-off cannot be waited for"),
        }
        self.child = None;
    }

    /// Why the board does not run at full performance; `None` if it does.
    pub fn fault(&self) -> Option<String> {
        let hot = self.heat.as_ref().filter(|heat| heat.rung() > Rung::Normal);
        let fault = || self.clocks.as_ref().and_then(Clocks::fault);
        hot.map(|heat| heat.reason().to_owned()).or_else(fault).or_else(|| self.clock_refused.clone())
    }

    /// The hottest zone, for status lines.
    pub fn hottest(&self) -> Option<Celsius> {
        let zones = self.heat.iter().flat_map(Heat::zones);
        zones.map(|zone| zone.1).max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Temperatures, ladder and clocks for a status message.
    pub fn record(&self) -> HeatRecord {
        let mut record = HeatRecord::empty();
        if let Some(heat) = &self.heat {
            let action = heat.action();
            record.watched = 1;
            record.rung = heat.rung() as u32;
            record.frame_rate_share = if action.run { action.frame_rate_share as f32 } else { 0.0 };
            record.clocks_share = action.clocks_share as f32;
            record.set_reason(heat.reason());
            for (name, at, is_projected) in heat.zones() {
                record.add_zone(name, at.0, is_projected);
            }
        }
        for (name, target, read) in self.clocks.iter().flat_map(Clocks::readings) {
            record.add_clock(name, target.mhz(), read.map_or(0.0, Hertz::mhz));
        }
        record
    }
}

fn heat_parameters(config: &Config) -> HeatParameters {
    let (h, b) = (&config.heat, &config.board);
    let ns = |seconds: f64| (seconds * 1e9) as u64;
    HeatParameters {
        limits: [
            h.frame_rate_above_c,
            h.clocks_above_c,
            h.recognition_above_c,
            h.stop_above_c,
            h.power_off_above_c,
        ]
        .map(Celsius),
        hysteresis_k: h.hysteresis_c,
        dwell_ns: ns(h.dwell_s),
        filter_ns: ns(h.filter_s),
        slew_c_per_s: h.slew_c_per_s,
        start_below: Celsius(h.start_below_c),
        powers_off: b.power_off != "none",
        missing_powers_off: h.missing == "power_off",
        frame_rate_share: h.frame_rate_share,
        clocks_share: h.clocks_share,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scheduler::sysfs::tests::Tree;

    const S: u64 = 1_000_000_000;
    const TEMP: &str = "class/thermal/thermal_zone0/temp";
    const POLICY: &str = "devices/system/cpu/cpufreq/policy0";

    fn tree(celsius: f64) -> Tree {
        let tree = Tree::new(&[("class/thermal/thermal_zone0/type", "cpu-thermal")]);
        heat(&tree, celsius);
        for (file, value) in
            [("scaling_min_freq", 600_000), ("scaling_max_freq", 2_400_000), ("scaling_cur_freq", 2_400_000)]
        {
            tree.set(&format!("{POLICY}/{file}"), &value.to_string());
        }
        tree
    }

    fn heat(tree: &Tree, celsius: f64) {
        tree.set(TEMP, &format!("{:.0}", celsius * 1000.0));
    }

    fn config(tree: &Tree, more: &str) -> Config {
        let text = format!(
            "[board]\nsysfs = \"{}\"\npower_off = \"request\"\n[clocks]\nset = \"require\"\ncpu_mhz = 2400\n\
             [heat]\nwatch = \"require\"\nzones = \"cpu*\"\n{more}",
            tree.0.path().display()
        );
        config::parse(&text, Path::new("board.toml")).unwrap()
    }

    #[test]
    fn a_simulated_board_climbs_from_normal_to_power_off() {
        let (tree, run) = (tree(60.0), tempfile::tempdir().unwrap());
        let instance = run.path().join("lookout");
        std::fs::create_dir(&instance).unwrap();
        let mut board = Board::start(&config(&tree, ""), &instance, 0).unwrap();
        assert_eq!(board.tick(0), None);
        assert_eq!((board.fault(), board.record().rung_name()), (None, "normal"));
        heat(&tree, 92.5);
        let mut now = 0;
        let mut next = |board: &mut Board| loop {
            now += S / 2;
            if let Some(action) = board.tick(now) {
                return action;
            }
        };
        // The filter passes 90 °C first, 92 °C when the dwell time is over.
        let action = next(&mut board);
        assert_eq!((action.frame_rate_share, action.clocks_share), (0.5, 1.0));
        assert!(board.fault().is_some_and(|f| f.starts_with("lower frame rate: cpu-thermal at 9")));
        let action = next(&mut board);
        assert_eq!((action.frame_rate_share, action.clocks_share), (0.5, 0.6));
        assert_eq!(tree.get(&format!("{POLICY}/scaling_max_freq")), "1440000");
        // The sensor is lost: the temperature is projected, and the stages stop.
        tree.remove(TEMP);
        assert!(!next(&mut board).run);
        assert_eq!((board.record().zones()[0].projected, board.record().rung), (1, 4));
        heat(&tree, 97.0);
        assert!(!run.path().join(REQUEST).exists());
        assert!(next(&mut board).power_off);
        let request = std::fs::read_to_string(run.path().join(REQUEST)).unwrap();
        assert!(request.contains("cpu-thermal at 97.0 °C is above 95.0 °C"), "{request}");
        drop(board);
        assert_eq!(tree.get(&format!("{POLICY}/scaling_max_freq")), "2400000");
        assert_eq!(tree.get(&format!("{POLICY}/scaling_min_freq")), "600000");
        assert_eq!(std::fs::read_dir(&instance).unwrap().count(), 0, "left in the instance's folder");
    }

    #[test]
    fn a_start_when_hot_or_without_sensors_is_refused_before_any_change() {
        let (tree, run) = (tree(91.0), tempfile::tempdir().unwrap());
        let error = Board::start(&config(&tree, ""), run.path(), 0).unwrap_err().to_string();
        assert!(error.contains("cpu-thermal is at 91.0 °C, the daemon starts below 85.0 °C"), "{error}");
        assert_eq!(tree.get(&format!("{POLICY}/scaling_min_freq")), "600000");
        tree.remove(TEMP);
        let error = Board::start(&config(&tree, ""), run.path(), 0).unwrap_err().to_string();
        assert!(
            error.contains("no thermal zone") && error.contains("set heat.watch = \"prefer\""),
            "{error}"
        );
        let preferred = config(&tree, "").heat;
        let mut config = config(&tree, "");
        config.heat = config::Heat { watch: "prefer".into(), ..preferred };
        let mut board = Board::start(&config, run.path(), 0).unwrap();
        assert_eq!((board.tick(S), board.record().watched), (None, 0));
        let told = board.no_sensor(&config).to_string();
        assert!(told.contains("set heat.watch = \"off\"") && !told.contains("prefer"), "{told}");
    }

    #[test]
    fn a_reload_changes_limits_and_clocks() {
        let (tree, run) = (tree(70.0), tempfile::tempdir().unwrap());
        let mut board = Board::start(&config(&tree, ""), run.path(), 0).unwrap();
        assert_eq!(board.tick(S), None);
        let lower = config(&tree, "start_below_c = 50\nframe_rate_above_c = 60");
        board.reload(&lower).unwrap();
        assert_eq!(board.tick(2 * S).map(|a| a.frame_rate_share), Some(0.5));
        let mut slower = lower.clone();
        slower.clocks.cpu_mhz = 1200.0;
        board.reload(&slower).unwrap();
        assert_eq!(tree.get(&format!("{POLICY}/scaling_min_freq")), "1200000");
        let mut blind = slower.clone();
        blind.heat.zones = "gpu*".into();
        assert!(board.reload(&blind).is_err());
        assert_eq!(board.record().zones().len(), 1, "the old zones are still monitored");
        drop(board);
        assert_eq!(tree.get(&format!("{POLICY}/scaling_min_freq")), "600000");
    }

    #[test]
    fn a_preferred_clock_that_is_missing_is_a_fault_and_the_others_are_set() {
        let (tree, run) = (tree(60.0), tempfile::tempdir().unwrap());
        let mut config = config(&tree, "");
        config.clocks.gpu_mhz = 852.0;
        assert!(Board::start(&config, run.path(), 0).is_err());
        config.clocks.set = "prefer".into();
        let board = Board::start(&config, run.path(), 0).unwrap();
        assert!(board.fault().is_some_and(|fault| fault.contains("no gpu clock")));
        assert_ne!(tree.get(&format!("{POLICY}/scaling_min_freq")), "600000");
        drop(board);
        assert_eq!(tree.get(&format!("{POLICY}/scaling_min_freq")), "600000");
    }
}
