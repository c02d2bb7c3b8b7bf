//! `lookout soak --gpu-table`: reproduces the paper's table of GPU frequencies.

use super::arguments::Soak;
use super::session::{at_rate, line, save, time};
use super::tables::rectify_ms;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::scheduler::clocks::{Hertz, gpu_steps};
use crate::soak::{self, Plan, processor};
use config::Config;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tools::soak::budget::Kind;
use tools::soak::paper::{ClockRun, OFFERED_CLOCKS, Place, clock_table};
use tools::soak::report::Setting;

/// The GPU clock: its name in the status, and its frequency steps in ascending order.
pub struct GpuClock {
    name: String,
    steps: Vec<Hertz>,
}

impl GpuClock {
    /// The step nearest to a share of the fastest.
    fn step(&self, share: f64) -> Option<Hertz> {
        let wanted = self.steps.last()?.mhz() * share;
        let distance = |step: &Hertz| (step.mhz() - wanted).abs();
        self.steps.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }
}

/// The GPU clock of the board.
///
/// # Errors
/// If the board has none that can be set.
pub fn clock(config: &Config) -> Result<GpuClock, CommandError> {
    let (name, steps) = gpu_steps(&config.board).ok_or_else(|| {
        let file = match config.board.gpu.as_str() {
            "tk1" => "kernel/debug/clock/gbus/possible_rates".to_owned(),
            _ => format!("class/devfreq/*/available_frequencies of a device like \"{}\"", config.board.gpu_device),
        };
        CommandError::Other(format!(
            "--gpu-table: no GPU below {} has a clock with frequency steps ({file}): run this on the board, or correct \
             board.gpu and board.gpu_device; --tables needs no GPU clock",
            config.board.sysfs.display()
        ))
    })?;
    Ok(GpuClock { name, steps })
}

pub fn run(
    args: &Soak,
    config: &Config,
    settings: &[Setting],
    source: &str,
    clock: &GpuClock,
    stop: &Arc<AtomicBool>,
) -> Result<(), CommandError> {
    let mut runs: Vec<ClockRun> = Vec::new();
    let mut adapter = String::new();
    for (share, fps) in OFFERED_CLOCKS {
        let set = share.and_then(|share| clock.step(share));
        let (mut config, mut settings) = at_rate(config, settings, fps, "a run of the paper's table");
        let mut put = |key, value: String, why| settings.push(Setting { key, value, why });
        config.stereo.backend = "gpu".into();
        put("stereo.backend", "gpu".into(), "the table is about its clock");
        config.clocks.gpu_mhz = set.map_or(0.0, Hertz::mhz);
        put(
            "clocks.gpu_mhz",
            config.clocks.gpu_mhz.to_string(),
            "a step of the GPU clock; 0 leaves it to the governor",
        );
        config.clocks.set = "require".into();
        put("clocks.set", "require".into(), "a row is valid only if its clock was set");
        let name = set.map_or("automatic".into(), |set| format!("{:.0}-MHz", set.mhz()));
        let plan = Plan {
            kind: Kind::Steady,
            time: Some(time(args.minutes.unwrap_or(1.0))),
            faults: None,
            settings,
            source: source.to_owned(),
            out: args.out.join(format!("{name}-{fps:.0}-fps")),
        };
        eprintln!("GPU {name}, {fps:.0} pairs per second");
        let soaked = soak::run(&config, &plan, stop, &mut |p| eprintln!("{}", line(p)))?;
        if stop.load(Ordering::Relaxed) {
            return Err(CommandError::Other("stopped by a signal: no table".into()));
        }
        if soaked.report.frames == 0 {
            return Err(CommandError::Other(format!("no results with the GPU at {name}")));
        }
        let read_mhz = soaked.clocks_mhz.get(&clock.name).copied();
        adapter = soaked.device;
        runs.push(ClockRun {
            set_mhz: set.map(Hertz::mhz),
            read_mhz,
            device_p50_ms: soaked.device_p50_ms,
            run: soaked.rate,
        });
    }
    let place = Place {
        processor: processor(),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        source: source.to_owned(),
        backend: adapter,
        rectify_ms: Some(rectify_ms()?),
    };
    let text = clock_table(&place, &runs);
    save(&args.out.join("gpu-table.md"), &text)?;
    let json = serde_json::to_string_pretty(&serde_json::json!({ "place": place, "runs": runs }))?;
    save(&args.out.join("gpu-table.json"), &(json.clone() + "\n"))?;
    say(if args.json { json } else { text })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_shares_become_steps_of_this_board() {
        let steps = [306.0, 408.0, 510.0, 624.75].map(Hertz::from_mhz).to_vec();
        let clock = GpuClock { name: "gpu".into(), steps };
        let shares = OFFERED_CLOCKS.map(|(share, _)| share.and_then(|s| clock.step(s)).map(Hertz::mhz));
        assert_eq!(shares, [Some(306.0), Some(510.0), Some(624.75), Some(306.0), None]);
    }

    #[test]
    fn a_board_without_the_clock_is_an_error_before_anything_runs() {
        let mut config = config::load(None).unwrap();
        config.board.sysfs = "/no/such/tree".into();
        let error = clock(&config).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(
            error.contains("no GPU below /no/such/tree") && error.contains("board.gpu_device"),
            "{error}"
        );
    }
}
