//! `lookout soak`.

mod ambient;
mod arguments;
mod gpu;
mod session;
mod tables;

pub use arguments::{HELP, Soak};

use crate::command::config_args::load;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::replay::set_source;

use crate::soak::hot_board::HotBoard;
use crate::soak::pairs::{COUNT, DrawnPairs};
use crate::soak::{self, Plan, Soaked};
use config::Config;
use session::{at_rate, line, save, time};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use tools::soak::budget::Kind;
use tools::soak::director::DirectorParameters;
use tools::soak::fault::Mix;
use tools::soak::report::Setting;

/// The paper's rate.
const PAPER_FPS: f64 = 12.5;

/// Enough for the built-in drive and the paper's rig.
const DISPARITIES: i64 = 64;

/// A recovery that takes longer counts as failed.
const RECOVERY_LIMIT_NS: u64 = 30_000_000_000;

/// Rate at which pairs are offered to measure the rate that the daemon sustains.
const FLOOD_FPS: f64 = 500.0;

pub fn run(args: &Soak, log: Option<&str>) -> Result<(), CommandError> {
    let (mut config, mut settings) = prepare(args, log)?;
    // Checked first, before minutes are spent.
    let clock = args.gpu_table.then(|| gpu::clock(&config)).transpose()?;
    let sensors = args.ambient_table.map(|_| ambient::sensors(&config)).transpose()?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|e| CommandError::Other(format!("cannot catch signals: {e}")))?;
    }
    let source = source_name(&config);
    // The drawn files are removed when this is dropped.
    let _pairs = draw(args, &mut config, &mut settings)?;
    if let Some(clock) = clock {
        return gpu::run(args, &config, &settings, &source, &clock, &stop);
    }
    if let (Some(ambient_c), Some(sensors)) = (args.ambient_table, sensors) {
        return ambient::run(args, ambient_c, &config, &settings, &source, &sensors, &stop);
    }
    if args.tables {
        return tables::run(args, &config, &settings, &source, &stop);
    }
    let (config, plan) = if args.overload {
        overload(args, config, settings, source, &stop)?
    } else {
        plan(args, config, settings, source)?
    };
    eprintln!(
        "soak of {} at {:.4} pairs per second, {}; report in {}",
        plan.source,
        config.source.fps,
        plan.time.map_or("until all kills are done".into(), |t| format!("{:.1} min", t.as_secs_f64() / 60.0)),
        plan.out.display()
    );
    if let Some(faults) = &plan.faults {
        eprintln!("faults drawn with seed {}", faults.seed);
    }
    let soaked = soak::run(&config, &plan, &stop, &mut |p| eprintln!("{}", line(p)))?;
    let text = write(&soaked, &plan.out)?;
    if args.json {
        say(serde_json::to_string_pretty(&soaked.report)?)?;
    } else {
        say(text)?;
    }
    if soaked.report.has_failed() {
        let reasons = soaked.report.reasons.join("\n  ");
        return Err(CommandError::Lines(format!("the soak failed:\n  {reasons}")));
    }
    Ok(())
}

/// The configuration of the daemon under test, and the settings that the soak changed in it.
fn prepare(args: &Soak, log: Option<&str>) -> Result<(Config, Vec<Setting>), CommandError> {
    let mut config = load(&args.config, log, "soak", Some("warn"))?;
    let mut settings = Vec::new();
    if let Some(source) = &args.source {
        set_source(&mut config, source);
        settings.push(Setting {
            key: "source.path",
            value: source.display().to_string(),
            why: "as requested",
        });
    }
    if args.config.instance.is_none() {
        config.instance.name = format!("soak-{}", std::process::id());
        let value = config.instance.name.clone();
        settings.push(Setting { key: "instance.name", value, why: "a separate daemon" });
    }
    if args.config.config.is_none() && !args.config.set.iter().any(|s| s.starts_with("stereo.disparities")) {
        config.stereo.disparities = DISPARITIES;
        let value = DISPARITIES.to_string();
        settings.push(Setting { key: "stereo.disparities", value, why: "what the paper's rig needs" });
    }
    if !config.source.repeat {
        config.source.repeat = true;
        settings.push(Setting { key: "source.repeat", value: "true".into(), why: "the source is looped" });
    }
    Ok((config, settings))
}

/// Draws the pairs of a scene to files, and configures the daemon to read them.
fn draw(
    args: &Soak,
    config: &mut Config,
    settings: &mut Vec<Setting>,
) -> Result<Option<DrawnPairs>, CommandError> {
    if config.source.kind != "scene" {
        return Ok(None);
    }
    let mut wanted = config.clone();
    wanted.source.fps = if args.tables || args.gpu_table { PAPER_FPS } else { rate(args, config).0 };
    eprintln!("drawing {COUNT} pairs of {}", source_name(config));
    let pairs = DrawnPairs::draw(&wanted, args.out.join(format!("pairs-{}", std::process::id())))?;
    config.source.kind = "folder".into();
    config.source.path.clone_from(&pairs.folder);
    let value = pairs.folder.display().to_string();
    settings.push(Setting { key: "source.path", value, why: "the pairs of the scene, drawn in advance" });
    Ok(Some(pairs))
}

/// Pairs per second, and the reason for this rate.
fn rate(args: &Soak, config: &Config) -> (f64, &'static str) {
    match args.fps {
        Some(fps) => (fps, "as requested"),
        None if config.source.fps > 0.0 => (config.source.fps, "as configured"),
        None => (PAPER_FPS, "the paper's rate"),
    }
}

/// Description of the source.
fn source_name(config: &Config) -> String {
    let path = config.source.path.display();
    match (config.source.kind.as_str(), config.source.path.as_os_str().is_empty()) {
        ("scene", true) => "the built-in drive".into(),
        ("scene", false) => format!("the scene {path}"),
        _ => path.to_string(),
    }
}

fn plan(
    args: &Soak,
    config: Config,
    settings: Vec<Setting>,
    source: String,
) -> Result<(Config, Plan), CommandError> {
    let (fps, why) = rate(args, &config);
    let (mut config, mut settings) = at_rate(&config, &settings, fps, why);
    let with_faults = args.faults || args.kills.is_some();
    if with_faults {
        let c = &mut config.supervision;
        c.restart_first_ms = c.restart_first_ms.min(100);
        c.restart_longest_ms = c.restart_longest_ms.min(1000);
        c.restart_window_s = 1;
        c.restart_count = 1000;
        c.liveness_deadline_ms = c.liveness_deadline_ms.min(1000);
        c.heartbeat_ms = c.heartbeat_ms.min(200);
        let half_ms = c.liveness_deadline_ms as f64 / 2.0;
        config.stereo.gpu_timeout_ms = config.stereo.gpu_timeout_ms.min(half_ms);
        let gpu_timeout_ms = config.stereo.gpu_timeout_ms;
        let mut set = |key, value: i64, why| settings.push(Setting { key, value: value.to_string(), why });
        set("supervision.restart_first_ms", c.restart_first_ms, "faults follow each other quickly");
        set("supervision.restart_longest_ms", c.restart_longest_ms, "faults follow each other quickly");
        set("supervision.restart_window_s", c.restart_window_s, "injected faults are not a crash loop");
        set("supervision.restart_count", c.restart_count, "no stage is given up because of injected faults");
        set(
            "supervision.liveness_deadline_ms",
            c.liveness_deadline_ms,
            "the time to detect a hang is part of the recovery time",
        );
        set("supervision.heartbeat_ms", c.heartbeat_ms, "follows from the liveness deadline");
        let value = gpu_timeout_ms.to_string();
        settings.push(Setting {
            key: "stereo.gpu_timeout_ms",
            value,
            why: "follows from the liveness deadline",
        });
    }
    if args.faults {
        HotBoard::create(&args.out, &mut config, &mut settings)?;
    }
    let ms = |v: i64| v.unsigned_abs() * 1_000_000;
    let faults = with_faults.then(|| DirectorParameters {
        stages: &messages::pipeline::Role::STAGE_NAMES,
        mix: if args.faults { Mix::All } else { Mix::Kills },
        seed: args.seed.unwrap_or_else(|| messages::clock::monotonic_ns() % 1_000_000_007),
        pause_ns: ms(match args.kills {
            Some(_) => config.soak.fault_pause_ms.min(200),
            None => config.soak.fault_pause_ms,
        }),
        liveness_ns: ms(config.supervision.liveness_deadline_ms),
        patience_ns: RECOVERY_LIMIT_NS,
        kills: args.kills,
    });
    let minutes = match (args.minutes, args.kills) {
        (None, Some(_)) => None,
        (minutes, _) => Some(minutes.unwrap_or(5.0)),
    };
    let plan = Plan {
        kind: if with_faults { Kind::Faults } else { Kind::Steady },
        time: minutes.map(time),
        faults,
        settings,
        source,
        out: args.out.clone(),
    };
    Ok((config, plan))
}

/// Measures the rate that the daemon sustains, and plans a run at twice that rate.
fn overload(
    args: &Soak,
    config: Config,
    settings: Vec<Setting>,
    source: String,
    stop: &Arc<AtomicBool>,
) -> Result<(Config, Plan), CommandError> {
    eprintln!("measuring the rate that the daemon sustains: {FLOOD_FPS} pairs per second for 10 s");
    // With pacing the source slows down to the rate of the stages and never overloads them.
    let (mut config, mut settings) = (config, settings);
    if config.pacing.follow {
        config.pacing.follow = false;
        settings.push(Setting {
            key: "pacing.follow",
            value: "false".into(),
            why: "the source must not slow down",
        });
    }
    let (mut flood, _) = at_rate(&config, &settings, FLOOD_FPS, "");
    flood.soak.warm_up_s = 3.0;
    let plan = Plan {
        kind: Kind::Overload,
        time: Some(Duration::from_secs(10)),
        faults: None,
        settings: Vec::new(),
        source: source.clone(),
        out: args.out.join("capacity"),
    };
    let soaked = soak::run(&flood, &plan, stop, &mut |_| {})?;
    let capacity_fps = soaked.report.rate_hz;
    if soaked.report.dropped == 0 {
        return Err(CommandError::Other(format!(
            "the source delivers {capacity_fps:.1} pairs per second, and the stages keep up: it cannot overload \
             them; try --set stereo.method=full"
        )));
    }
    eprintln!("it sustains {capacity_fps:.1} pairs per second");
    let (config, settings) = at_rate(
        &config,
        &settings,
        capacity_fps * 2.0,
        "twice the rate that the daemon was measured to sustain",
    );
    let time = Some(time(args.minutes.unwrap_or(5.0)));
    let plan = Plan { kind: Kind::Overload, time, faults: None, settings, source, out: args.out.clone() };
    Ok((config, plan))
}

/// Writes the report and its plots; returns the text.
fn write(soaked: &Soaked, out: &Path) -> Result<String, CommandError> {
    let names: Vec<(String, String)> =
        soaked.plots.iter().map(|(file, title, _)| (file.clone(), title.clone())).collect();
    let text = soaked.report.markdown(&names);
    for (file, _, plot) in &soaked.plots {
        save(&out.join(file), &plot.to_svg())?;
    }
    save(&out.join("soak.md"), &text)?;
    save(&out.join("soak.json"), &(serde_json::to_string_pretty(&soaked.report)? + "\n"))?;
    Ok(text)
}
