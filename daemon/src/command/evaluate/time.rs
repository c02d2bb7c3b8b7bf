//! `lookout evaluate time`.

use super::distance;
use super::scene_run::SceneRun;
use crate::command::config_args::{ConfigArgs, load};
use crate::command::console::{progress, say};
use crate::command::error::CommandError;
use crate::command::number::number;
use crate::in_process::FrameResult;
use crate::stages::recognition::parameters::alarm_parameters;
use crate::stages::stereo::matcher::Method;
use clap::Args;
use clap::builder::PossibleValuesParser;
use config::Config;
use indicatif::ProgressBar;
use perception::alarm::AlarmParameters;
use sources::PairSource;
use sources::scene::file::Weather;
use sources::scene::{Scene, library};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use tools::evaluation::time_faults::{FaultyClock, ShownFrame};
use tools::evaluation::time_score::{FrameDuty, Showing, TimeReport, TimedResult, Undisturbed};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate time
  lookout evaluate time --duration 3600 --seed 7 --threads 2 --json
  lookout evaluate time stopped-car next-lane --weather sunny --duration 120 --check

Scenes follow each other on one clock with random faults: gaps of 0.2 to 60 s in which the scene
moves on, jumps of the stamp forward and back while it does not, repeated and frozen frames, repeated
stamps, and now and then stamps of 0, of the largest number, and jumps by 10^9 s. The same stages as
in the daemon process them, in one process. Each alarm is compared with the truth of the scene and
with the same scene without faults.

seconds: time that passes on the source's clock, with all gaps; --duration limits it. true alarms:
in each of their frames, or at most the hold time (alarm.hold_ms) and 0.5 s before it, or 0.24 s after
it, an obstacle in the path is nearer than the limits of the alarm (with 15 % or 1 m of tolerance).
false alarms: all others, unless the same scene has one at that place without faults. due: stretches of
more than 16 normal frames with an obstacle nearer than alarm.distance_m for which the same scene raises
the alarm without faults; missed: those whose alarm was not on from the 17th frame to the last.

--regular-stamps hides the faults from the stages: each frame is stamped one period after the one
before, as by a source without a clock. The evaluation then shows what goes wrong when a gap is not known.

--check ends with 1 if an alarm is false or missed, or a number means nothing.";

#[derive(Args, Debug)]
pub struct EvaluateTime {
    /// Scenes [default: the built-in approaches and silent scenes, and three with traffic]
    #[arg(value_name = "SCENE")]
    pub scenes: Vec<String>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Time that passes on the source's clock, with all gaps, in seconds
    #[arg(long, default_value_t = 600.0, value_name = "SECONDS", value_parser = |text: &str| number(text, 1.0, 1e6))]
    pub duration: f64,
    /// Seed of the faults; the same seed gives the same faults
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub seed: u64,
    /// Weather conditions
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "sunny,light_rain,night",
        value_parser = PossibleValuesParser::new(Weather::ALL.map(Weather::name)))]
    pub weather: Vec<String>,
    /// Hide the faults from the stages: stamp each frame one period after the one before
    #[arg(long)]
    pub regular_stamps: bool,
    /// Number of threads
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=64))]
    pub threads: u64,
    /// End with 1 if an alarm is false or missed, or a number means nothing
    #[arg(long)]
    pub check: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Default scenes with traffic; those of `evaluate distance` follow.
const TRAFFIC: [&str; 3] = ["street", "crest-traffic", "dip-traffic"];

fn default_scenes() -> Vec<String> {
    TRAFFIC.into_iter().chain(distance::SCENES).map(String::from).collect()
}

/// Time of a session, in seconds: sessions have a clock of their own, and run beside each other with several threads.
const SESSION_S: f64 = 300.0;

/// Longest part of an endless scene, in frames.
const MAX_FRAMES: u64 = 250;

/// A scene in one weather.
struct Condition {
    name: String,
    /// Text for [`library::load`], without the weather.
    scene: String,
    weather: Weather,
    frames: u64,
    period_ns: u64,
}

impl Condition {
    fn open(&self) -> Result<Scene, CommandError> {
        let mut file = library::load(&self.scene)?;
        file.weather = self.weather;
        Ok(Scene::new(file)?)
    }
}

/// A scene of a session, as it is shown.
struct Visit {
    condition: usize,
    shown: Vec<ShownFrame>,
    passed_ns: u64,
}

fn conditions(args: &EvaluateTime) -> Result<Vec<Condition>, CommandError> {
    let names: Vec<String> = if args.scenes.is_empty() { default_scenes() } else { args.scenes.clone() };
    let mut all = Vec::new();
    let mut first = None;
    for scene in names {
        for weather in args.weather.iter().filter_map(|name| Weather::named(name)) {
            let name = format!("{scene} {}", weather.name());
            let mut condition = Condition { name, scene: scene.clone(), weather, frames: 0, period_ns: 1 };
            let opened = condition.open()?;
            condition.frames = opened.count().unwrap_or(MAX_FRAMES).min(MAX_FRAMES);
            condition.period_ns = opened.period_ns();
            let form = (opened.size(), opened.rig());
            if *first.get_or_insert(form) != form {
                let text = format!("{scene}: other cameras than the first scene: all scenes need the same");
                return Err(CommandError::Other(text));
            }
            all.push(condition);
        }
    }
    Ok(all)
}

/// The scenes of a session of `seconds`.
fn session(seed: u64, seconds: f64, conditions: &[Condition]) -> Vec<Visit> {
    let mut clock = FaultyClock::new(seed);
    let (mut visits, mut passed_ns) = (Vec::new(), 0);
    while (passed_ns as f64) < 1e9 * seconds {
        let condition = clock.choose(conditions.len());
        let (shown, ns) = clock.scene(conditions[condition].frames, conditions[condition].period_ns);
        passed_ns += ns;
        visits.push(Visit { condition, shown, passed_ns: ns });
    }
    visits
}

/// Plays a scene from its start to its end without faults.
fn undisturbed(
    config: &Config,
    condition: &Condition,
    bar: &ProgressBar,
) -> Result<Undisturbed, CommandError> {
    let rules = alarm_parameters(config);
    let mut run = SceneRun::new(config, condition.open()?, condition.frames)?;
    let mut scene = Undisturbed { period_s: run.period_s, ..Undisturbed::default() };
    for index in 0..run.frames {
        let (truth, result) = run.frame(index)?;
        scene.duties.push(FrameDuty::of(&truth, &rules));
        scene.alarms.push(result.record.alarm.level == "alarm");
        bar.inc(1);
    }
    Ok(scene)
}

/// What all sessions share.
struct Run<'a> {
    config: &'a Config,
    conditions: &'a [Condition],
    /// The conditions without faults.
    scenes: &'a [Undisturbed],
    rules: AlarmParameters,
    /// See [`EvaluateTime::regular_stamps`].
    regular_stamps: bool,
    bar: &'a ProgressBar,
}

/// Plays a session, and compares it with its scenes without faults.
fn play(of: &Run<'_>, number: usize, visits: &[Visit]) -> Result<TimeReport, CommandError> {
    let Run { conditions, bar, .. } = of;
    let mut report = TimeReport::default();
    let Some(first) = visits.first() else { return Ok(report) };
    let mut run = SceneRun::new(of.config, conditions[first.condition].open()?, u64::MAX)?;
    let mut sequence = 0;
    for visit in visits {
        let condition = &conditions[visit.condition];
        bar.set_message(condition.name.clone());
        run.change(condition.open()?);
        let mut results = Vec::with_capacity(visit.shown.len());
        for frame in &visit.shown {
            let regular_ns = sequence * condition.period_ns;
            let source_ns = if of.regular_stamps { regular_ns } else { frame.source_ns };
            results.push(timed(&run.frame_at(sequence, frame.index, source_ns)?));
            sequence += 1;
            bar.inc(1);
        }
        let scene = &of.scenes[visit.condition];
        let showing =
            Showing { scene: &condition.name, session: number, shown: &visit.shown, results: &results };
        report.add(showing, scene, of.rules.hold_ns as f64 * 1e-9);
        report.source_s += visit.passed_ns as f64 * 1e-9;
    }
    for (name, count) in run.source_time().counts() {
        report.counted.insert(name.into(), count);
    }
    Ok(report)
}

/// Bounds of what can be measured, in metres and m/s: beyond the cameras' range, and any vehicle's speed.
const MAX_MEASURE: f64 = 1_000.0;

fn timed(result: &FrameResult<'_>) -> TimedResult {
    let alarm = &result.record.alarm;
    let is_meaningless = result.record.obstacles.iter().any(|o| {
        let speeds = [o.closing_m_s, o.across_m_s].map(|v| v.unwrap_or(0.0));
        let lengths = [o.distance_m, o.lateral_m, o.width_m, o.height_m];
        o.distance_m <= 0.0 || lengths.into_iter().chain(speeds).any(|v| v.abs() > MAX_MEASURE)
    });
    TimedResult {
        alarm: alarm.level == "alarm",
        off: alarm.level == "off",
        nearest_m: alarm.nearest_m,
        is_meaningless,
    }
}

/// Calls `work` for 0 to below `count` on several threads. Returns the results in order.
fn each<T: Send>(
    threads: u64,
    count: usize,
    work: impl Fn(usize) -> Result<T, CommandError> + Sync,
) -> Result<Vec<T>, CommandError> {
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<(usize, Result<T, CommandError>)>> = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= count {
                        break;
                    }
                    let result = work(number);
                    if result.is_err() {
                        // Nothing more is begun.
                        next.store(count, Ordering::Relaxed);
                    }
                    done.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push((number, result));
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    done.sort_by_key(|(number, _)| *number);
    done.into_iter().map(|(_, result)| result).collect()
}

pub fn run(args: &EvaluateTime, log: Option<&str>) -> Result<(), CommandError> {
    // Each fault would be logged.
    let config = load(&args.config, log, "evaluate", Some("error"))?;
    let rules = alarm_parameters(&config);
    let conditions = conditions(args)?;
    let count = (args.duration / SESSION_S).ceil().max(1.0) as usize;
    let sessions: Vec<Vec<Visit>> = (0..count)
        .map(|k| {
            // Far apart, so that another seed gives other sessions.
            let seed = args.seed.wrapping_mul(1_000_000).wrapping_add(k as u64);
            session(seed, SESSION_S.min(args.duration - SESSION_S * k as f64), &conditions)
        })
        .collect();
    let mut used: Vec<usize> = sessions.iter().flatten().map(|visit| visit.condition).collect();
    used.sort_unstable();
    used.dedup();
    let frames = used.iter().map(|&k| conditions[k].frames).sum::<u64>()
        + sessions.iter().flatten().map(|visit| visit.shown.len() as u64).sum::<u64>();
    let bar = progress(Some(frames), "frames");
    bar.set_message("without faults");
    let played = each(args.threads, used.len(), |k| undisturbed(&config, &conditions[used[k]], &bar))?;
    let hold_s = rules.hold_ns as f64 * 1e-9;
    let mut report = TimeReport {
        method: Method::configured(&config).name().into(),
        seed: args.seed,
        ..TimeReport::default()
    };
    let mut scenes = vec![Undisturbed::default(); conditions.len()];
    for (&k, scene) in used.iter().zip(played) {
        report.add_undisturbed(&scene, hold_s);
        scenes[k] = scene;
    }
    let (config, conditions, scenes) = (&config, &conditions[..], &scenes[..]);
    let of = Run { config, conditions, scenes, rules, regular_stamps: args.regular_stamps, bar: &bar };
    let parts = each(args.threads, sessions.len(), |k| play(&of, k, &sessions[k]))?;
    for part in parts {
        report.join(part);
    }
    bar.finish_and_clear();
    let is_good = report.is_good();
    if args.json { say(serde_json::to_string_pretty(&report)?) } else { say(&report) }?;
    if args.check && !is_good {
        return Err(CommandError::Other(format!(
            "{} false alarms, {} missed ones, {} frames with meaningless numbers",
            report.false_alarms, report.missed, report.meaningless
        )));
    }
    Ok(())
}
