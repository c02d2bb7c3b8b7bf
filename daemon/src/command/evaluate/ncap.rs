//! `lookout evaluate ncap`.

use super::in_parallel::in_parallel;
use super::ncap_run::{Played, play};
use super::seed_range::seed_range;
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::error::CommandError;
use clap::Args;
use clap::builder::PossibleValuesParser;
use sources::scene::file::{NamedRig, Weather};
use sources::scene::ncap::case::{Case, Selection, names};
use sources::scene::ncap::text;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tools::evaluation::files::{prepare, write_report};
use tools::evaluation::ncap::page::{Still, to_html};
use tools::evaluation::ncap::report::{NcapReport, Run, Setup};
use tools::reporting::output::OutputError;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate ncap --nominal                            one place of impact a test
  lookout evaluate ncap --rows CCRs,CPNA --speeds 20,40
  lookout evaluate ncap --rig board --seeds 100-102 --threads 8 --out report    then open report/index.html
  lookout evaluate ncap --year 2023 --weather overcast,heavy_rain --json
  lookout replay scene:report/scenes/ID.toml --video run.mp4   one of the runs, to look at

The tests of forward-collision systems by Euro NCAP, as synthetic scenes with exact truth: cars,
motorcycles, bicycles, adults and children that stand, drive ahead, brake, cross, come from behind
parked cars, come towards us; own turns. Numbers are those of the public descriptions of the tests,
scenes are our own. No certified result: docs/ncap.md says what is quoted and what is ours. Every
row is also driven as near misses, shifted so that nothing is hit.

TTC: time until the impact that happens if we drive on. The rules are printed with the table; the
columns have medians of the TTC of warning and alarm, the worst speed at the impact if the vehicle
brakes from the alarm on, and without braking. Failed runs are listed with the reason, and with the
TTC at which the target was visible, could be known (it moves as it will), was detected, was tracked.

Rows, 2026: CCRs, CCRs-FCW, CCRm, CCRb, CCFhos, CCFtap, CCCscp (cars), CPNA, CPFA, CPNCO, CPLA,
CPLA-FCW, CPTA (people), CBNA, CBFA, CBNAO, CBLA, CBLA-FCW (bicycles), CMRs, CMRs-FCW, CMRb, CMFtap,
CMCscp (motorcycles). Without --weather rows with people are driven sunny and at night, others sunny.

--out writes index.html, one file with the tables in colours and pictures of the first 40 runs that
failed, evaluation.json, and scenes/ID.toml for every run.";

#[derive(Args, Debug)]
pub struct EvaluateNcap {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Protocol
    #[arg(long, default_value_t = 2026, value_name = "YEAR", value_parser = year)]
    pub year: u16,
    /// Tests, by the names of the rows of the table, such as CCRs,CPNA (all names are below) [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub rows: Vec<String>,
    /// Own speeds in km/h, of those of the tests, such as 20,40 [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub speeds: Vec<f64>,
    /// Only the nominal place of impact of each row
    #[arg(long)]
    pub nominal: bool,
    /// With the extended range: faster, and beyond the edges of the vehicle
    #[arg(long)]
    pub extended: bool,
    /// Cameras: paper (640x480 px, baseline 0.12 m), kitti (1242x375, 0.54 m), board (1280x720, 0.30 m)
    #[arg(long, default_value = "paper", value_name = "NAME",
        value_parser = PossibleValuesParser::new(NamedRig::ALL.map(NamedRig::name)))]
    pub rig: String,
    /// Pairs per second
    #[arg(long, default_value_t = 12.5, value_name = "HZ", value_parser = rate)]
    pub fps: f64,
    /// Weather conditions, instead of those of the rows
    #[arg(long, value_name = "LIST", value_delimiter = ',',
        value_parser = PossibleValuesParser::new(Weather::ALL.map(Weather::name)))]
    pub weather: Vec<String>,
    /// Seeds of what the tests leave open: one, or from and to, as 100-102
    #[arg(long, default_value = "1", value_name = "A-B", value_parser = seed_range)]
    pub seeds: (u64, u64),
    /// Which runs: impacts, near misses, or both
    #[arg(long, default_value = "both", value_name = "WHAT",
        value_parser = PossibleValuesParser::new(["both", "impacts", "near-misses"]))]
    pub only: String,
    /// Runs that are processed at the same time
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=64))]
    pub threads: u64,
    /// Folder for the page, the scenes, evaluation.json, and runs.jsonl, which has each run as soon as it has ended; what it had
    /// before is replaced
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Runs whose pictures are in the page: each takes about a quarter of a megabyte.
const MAX_FILMED: usize = 40;

/// Range of `--fps`: slower, nothing is tracked; faster, no camera of the rigs is.
const FPS: std::ops::RangeInclusive<f64> = 5.0..=60.0;

fn year(text: &str) -> Result<u16, String> {
    match text {
        "2023" => Ok(2023),
        "2026" => Ok(2026),
        _ => Err("give 2023 or 2026".into()),
    }
}

fn rate(text: &str) -> Result<f64, String> {
    let wrong = || format!("give pairs per second from {} to {}", FPS.start(), FPS.end());
    text.parse().ok().filter(|rate| FPS.contains(rate)).ok_or_else(wrong)
}

/// The runs that the arguments choose.
fn cases(args: &EvaluateNcap) -> Result<Vec<Case>, CommandError> {
    let known = names(args.year);
    if let Some(row) = args.rows.iter().find(|row| !known.iter().any(|name| row.eq_ignore_ascii_case(name))) {
        let text = format!("--rows {row}: no such row in {}; rows are {}", args.year, known.join(", "));
        return Err(CommandError::Other(text));
    }
    let selection = Selection {
        year: args.year,
        rows: args.rows.clone(),
        speeds_km_h: args.speeds.clone(),
        is_nominal: args.nominal,
        is_extended: args.extended,
        weathers: args.weather.iter().filter_map(|name| Weather::named(name)).collect(),
        rig: NamedRig::named(&args.rig).unwrap_or_default(),
        fps: args.fps,
        seeds: args.seeds,
    };
    let is_wanted = |case: &Case| match &args.only[..] {
        "impacts" => case.miss.is_none(),
        "near-misses" => case.miss.is_some(),
        _ => true,
    };
    let cases: Vec<Case> = selection.cases().into_iter().filter(is_wanted).collect();
    if cases.is_empty() {
        let all = Selection { speeds_km_h: Vec::new(), ..selection };
        let mut speeds: Vec<f64> = all.cases().iter().map(|case| case.own_km_h).collect();
        speeds.sort_by(f64::total_cmp);
        speeds.dedup();
        let speeds: Vec<String> = speeds.iter().map(f64::to_string).collect();
        return Err(CommandError::Other(format!(
            "--speeds: none of the tests has any of these speeds: give some of {} km/h",
            speeds.join(", ")
        )));
    }
    Ok(cases)
}

pub fn run(args: &EvaluateNcap, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "evaluate", Some("warn"))?;
    let cases = cases(args)?;
    if let Some(out) = &args.out {
        prepare(out, &[])?;
        write_scenes(out, &cases)?;
    }
    let ended = args.out.as_ref().map(|out| EndedRuns::new(&out.join("runs.jsonl"))).transpose()?;
    let bar = progress(Some(cases.len() as u64), "runs");
    let played = in_parallel(&cases, args.threads, |case| {
        bar.set_message(case.id());
        let played = play(case, &config, args.out.is_some())?;
        if let Some(ended) = &ended {
            ended.add(&played.run)?;
        }
        bar.inc(1);
        Ok(played)
    })?;
    bar.finish_and_clear();
    let (mut runs, mut films): (Vec<_>, Vec<(usize, Vec<Still>)>) = (Vec::new(), Vec::new());
    for (index, Played { run, film }) in played.into_iter().enumerate() {
        if films.len() < MAX_FILMED && !film.is_empty() {
            films.push((index, film));
        }
        runs.push(run);
    }
    let setup = Setup { year: args.year, rig: args.rig.clone(), fps: args.fps, seeds: args.seeds };
    let report = NcapReport::new(setup, runs);
    if let Some(out) = &args.out {
        write_report(out, &report)?;
        let path = out.join("index.html");
        std::fs::write(&path, to_html(&report, &films)).map_err(|source| OutputError::Io { path, source })?;
    }
    if args.json { say(serde_json::to_string_pretty(&report)?) } else { say(report.to_string().trim_end()) }
}

/// Writes the scene of each run, so that it can be played alone.
fn write_scenes(out: &Path, cases: &[Case]) -> Result<(), CommandError> {
    let folder = out.join("scenes");
    std::fs::create_dir_all(&folder).map_err(|source| OutputError::Io { path: folder.clone(), source })?;
    for case in cases {
        let path = folder.join(format!("{}.toml", case.id()));
        std::fs::write(&path, text::text(case)).map_err(|source| OutputError::Io { path, source })?;
    }
    Ok(())
}

/// The file of the runs that have ended, a JSON document a line: an evaluation that is stopped loses none.
struct EndedRuns {
    path: PathBuf,
    file: Mutex<File>,
}

impl EndedRuns {
    fn new(path: &Path) -> Result<Self, CommandError> {
        let file = File::create(path).map_err(|source| OutputError::Io { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), file: Mutex::new(file) })
    }

    fn add(&self, run: &Run) -> Result<(), CommandError> {
        let line = serde_json::to_string(run)? + "\n";
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(line.as_bytes())
            .map_err(|source| OutputError::Io { path: self.path.clone(), source })?;
        Ok(())
    }
}
