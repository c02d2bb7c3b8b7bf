//! `lookout soak --ambient-table`: reproduces the paper's table of ambient temperatures.

use super::arguments::Soak;
use super::session::{at_rate, line, save, time};
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::scheduler::sysfs::{Sensors, Sysfs};
use crate::soak::power::Power;
use crate::soak::{self, Plan, processor};
use config::Config;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tools::reporting::record::tidy;
use tools::soak::ambient::{AmbientRun, Phase, Reading, add, ambient_table, feeding_rail};
use tools::soak::budget::Kind;
use tools::soak::report::Setting;

/// The paper's full load, in pairs per second.
const FULL_LOAD_FPS: f64 = 24.0;
/// Minutes of each phase: a board in its housing needs some of them to settle.
const MINUTES: f64 = 10.0;
const SAMPLE_PERIOD: Duration = Duration::from_millis(500);
const FILE: &str = "ambient-table.json";

/// The sensors of the board.
pub struct BoardSensors {
    chip: Sensors,
    power: Power,
}

impl BoardSensors {
    fn read(&self) -> Reading {
        let mut zones = Vec::new();
        self.chip.read(&mut zones);
        let hottest = zones.into_iter().flatten().map(|celsius| celsius.0);
        Reading { chip_c: hottest.max_by(f64::total_cmp), rails_w: self.power.read_w() }
    }

    /// Reads twice a second until `ended`, at least once.
    fn watch(&self, ended: impl Fn() -> bool) -> Vec<Reading> {
        let mut readings = vec![self.read()];
        while !ended() {
            std::thread::sleep(SAMPLE_PERIOD);
            readings.push(self.read());
        }
        readings
    }
}

/// The sensors of the board.
///
/// # Errors
/// If no zone has a temperature.
pub fn sensors(config: &Config) -> Result<BoardSensors, CommandError> {
    let sysfs = Sysfs::new(&config.board.sysfs);
    let sensors =
        BoardSensors { chip: Sensors::find(&sysfs, &config.heat.zones), power: Power::find(&sysfs) };
    if sensors.read().chip_c.is_none() {
        return Err(CommandError::Other(format!(
            "--ambient-table: no thermal zone of heat.zones (\"{}\") below {} has a temperature \
             (class/thermal/thermal_zone*/temp): run this on the board; lookout doctor lists its zones",
            config.heat.zones,
            config.board.sysfs.display()
        )));
    }
    Ok(sensors)
}

pub fn run(
    args: &Soak,
    ambient_c: f64,
    config: &Config,
    settings: &[Setting],
    source: &str,
    sensors: &BoardSensors,
    stop: &Arc<AtomicBool>,
) -> Result<(), CommandError> {
    let file = args.out.join(FILE);
    // Before minutes are spent.
    let mut runs = runs_so_far(&file)?;
    let minutes = args.minutes.unwrap_or(MINUTES);
    let stopped = || CommandError::Other("stopped by a signal: no table".into());
    eprintln!("standby, {minutes} min");
    let start = Instant::now();
    let standby = sensors.watch(|| start.elapsed() >= time(minutes) || stop.load(Ordering::Relaxed));
    if stop.load(Ordering::Relaxed) {
        return Err(stopped());
    }
    eprintln!("full load, {FULL_LOAD_FPS:.0} pairs per second, {minutes} min");
    let (config, settings) = at_rate(config, settings, FULL_LOAD_FPS, "the paper's full load");
    let plan = Plan {
        kind: Kind::Steady,
        time: Some(time(minutes)),
        faults: None,
        settings,
        source: source.to_owned(),
        out: args.out.join(format!("{ambient_c}-C")),
    };
    let ended = AtomicBool::new(false);
    let (soaked, loaded) = std::thread::scope(|scope| {
        let watch = scope.spawn(|| sensors.watch(|| ended.load(Ordering::Relaxed)));
        let soaked = soak::run(&config, &plan, stop, &mut |p| eprintln!("{}", line(p)));
        ended.store(true, Ordering::Relaxed);
        (soaked, watch.join().unwrap_or_default())
    });
    let soaked = soaked?;
    if stop.load(Ordering::Relaxed) {
        return Err(stopped());
    }
    if soaked.report.frames == 0 {
        return Err(CommandError::Other("no results at full load: see daemon.log".into()));
    }
    let rail = feeding_rail(&loaded);
    let phase = |readings: &[Reading], name| {
        let lost = || CommandError::Other(format!("no temperature could be read any more in {name}"));
        Phase::of(readings, rail).ok_or_else(lost)
    };
    let run = AmbientRun {
        ambient_c,
        minutes,
        fps: [FULL_LOAD_FPS, tidy(soaked.report.rate_hz)],
        rail: rail.and_then(|rail| sensors.power.name(rail)).map(str::to_owned),
        standby: phase(&standby, "standby")?,
        full_load: phase(&loaded, "full load")?,
    };
    add(&mut runs, run);
    let json = serde_json::to_string_pretty(&runs)?;
    save(&file, &(json.clone() + "\n"))?;
    let text = ambient_table(&processor(), source, &runs);
    save(&args.out.join("ambient-table.md"), &text)?;
    say(if args.json { json } else { text })
}

/// The runs at other ambient temperatures in the same folder; none without a file.
fn runs_so_far(file: &Path) -> Result<Vec<AmbientRun>, CommandError> {
    let text = match std::fs::read_to_string(file) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(CommandError::Other(format!("{}: {error}", file.display()))),
    };
    serde_json::from_str(&text).map_err(|error| {
        let remedy = "it has the runs so far: mend or move it, or give another folder with --out";
        CommandError::Other(format!("{}: {error}: {remedy}", file.display()))
    })
}
