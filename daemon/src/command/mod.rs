//! What the words of the command line do.

mod attach;
mod calibrate;
mod calibrate_live;
mod check_config;
mod compare;
mod dashboard;
mod demo;
mod detect;
mod disparity;
mod evaluate;
mod evaluate_detection;
mod evaluate_distance;
mod evaluate_lidar;
mod evaluate_recognition;
mod evaluate_weather;
mod manual;
mod obstacles;
mod one_pair;
mod point_cloud;
mod record;
mod rectify;
mod replay;
mod restore_clocks;
mod run;
mod scene_run;
mod soak;
mod soak_gpu;
mod soak_tables;
pub mod status;
mod status_heat;
mod train;
mod view;

pub use status::StatusJson;

use crate::cli::{Cli, Command, ConfigArgs, Evaluate};
use crate::host::HostError;
use crate::launch::Launch;
use config::Config;
use messages::pipeline::Role;
use std::fmt;
use std::io::{self, Read, Write};
use thiserror::Error;

/// Why a command failed; one line (or one per fault) for the user.
#[derive(Debug, Error)]
pub enum CommandError {
    /// The configuration.
    #[error("the configuration cannot be used\n{0}")]
    Config(#[from] config::ConfigErrors),
    /// The daemon.
    #[error(transparent)]
    Run(#[from] crate::scheduler::RunError),
    /// The rooms in one process.
    #[error(transparent)]
    Pipeline(#[from] crate::in_process::PipelineError),
    /// A stage.
    #[error(transparent)]
    Stage(#[from] HostError),
    /// An image.
    #[error(transparent)]
    Source(#[from] sources::SourceError),
    /// A scene.
    #[error(transparent)]
    Scene(#[from] sources::scene::file::SceneError),
    /// A data set with truth.
    #[error(transparent)]
    Truth(#[from] sources::truth::TruthError),
    /// A matcher.
    #[error("{0}")]
    Matcher(#[from] perception::stereo::MatcherError),
    /// Matching.
    #[error(transparent)]
    Match(#[from] perception::stereo::MatchError),
    /// Pixels.
    #[error(transparent)]
    Image(#[from] perception::image::ImageError),
    /// A picture.
    #[error(transparent)]
    Picture(#[from] tools::reporting::picture::PictureError),
    /// A calibration's report.
    #[error(transparent)]
    Report(#[from] tools::calibration::report::ReportError),
    /// Training.
    #[error(transparent)]
    Train(#[from] tools::training::TrainError),
    /// Results.
    #[error(transparent)]
    Output(#[from] tools::reporting::output::OutputError),
    /// A recording.
    #[error(transparent)]
    Record(#[from] tools::recording::RecordError),
    /// Two runs that cannot be compared.
    #[error(transparent)]
    Compare(#[from] tools::evaluation::compare::CompareError),
    /// Shared memory.
    #[error(transparent)]
    Ipc(#[from] messages::bus::IpcError),
    /// An instance.
    #[error(transparent)]
    Instance(#[from] messages::instance::InstanceError),
    /// A room.
    #[error(transparent)]
    Setup(#[from] crate::stages::stage::SetupError),
    /// A soak.
    #[error(transparent)]
    Soak(#[from] crate::soak::SoakError),
    /// JSON.
    #[error("the result cannot be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// Clocks.
    #[error(transparent)]
    Clock(#[from] crate::scheduler::clocks::ClockError),
    /// Anything else, in words.
    #[error("{0}")]
    Other(String),
}

/// Runs a command.
///
/// # Errors
/// What the user should read.
pub fn run(cli: Cli) -> Result<(), CommandError> {
    let log = cli.log.as_deref();
    match cli.command {
        Command::Demo(args) => demo::run(&args, log),
        Command::Run(args) => run::run(&args, log),
        Command::Replay(args) => replay::run(&args, log),
        Command::Train(args) => train::run(&args, log),
        Command::Status(args) => status::run(&args, log),
        Command::View(args) => view::run(&args, log),
        Command::PointCloud(args) => point_cloud::run(&args, log),
        Command::Record(args) => record::run(&args, log),
        Command::Compare(args) => compare::run(&args),
        Command::Disparity(args) => disparity::run(&args, log),
        Command::Obstacles(args) => obstacles::run(&args, log),
        Command::Calibrate(args) => calibrate::run(&args, log),
        Command::Rectify(args) => rectify::run(&args),
        Command::Rig(args) => rectify::convert(&args),
        Command::Evaluate { what: Evaluate::Stereo(args) } => evaluate::run(&args, log),
        Command::Evaluate { what: Evaluate::Detection(args) } => evaluate_detection::run(&args, log),
        Command::Evaluate { what: Evaluate::Recognition(args) } => evaluate_recognition::run(&args, log),
        Command::Evaluate { what: Evaluate::Lidar(args) } => evaluate_lidar::run(&args, log),
        Command::Evaluate { what: Evaluate::Weather(args) } => evaluate_weather::run(&args, log),
        Command::Evaluate { what: Evaluate::Distance(args) } => evaluate_distance::run(&args, log),
        Command::Detect(args) => detect::run(&args, log),
        Command::Soak(args) => soak::run(&args, log),
        Command::CheckConfig(args) => check_config::run(&args),
        Command::RestoreClocks(args) => restore_clocks::run(&args, log),
        Command::Completions(args) => manual::completions(&args),
        Command::Man(args) => manual::pages(&args),
        Command::Stage { role } => stage(&role),
    }
}

/// Prints a line to standard output. A reader that has seen enough (`| head`) is no error.
fn say(text: impl fmt::Display) -> Result<(), CommandError> {
    match writeln!(io::stdout().lock(), "{text}") {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => result.map_err(|e| CommandError::Other(format!("standard output: {e}"))),
    }
}

/// Loads the configuration that the arguments name, and starts logging. `default_level` replaces
/// the configuration's level when no file was named.
fn load(
    args: &ConfigArgs,
    log: Option<&str>,
    process: &'static str,
    default_level: Option<&str>,
) -> Result<Config, CommandError> {
    let config = read(args, log, default_level)?;
    crate::logging::start(process, &config.log.level);
    Ok(config)
}

/// Reads the configuration that the arguments name.
fn read(args: &ConfigArgs, log: Option<&str>, default_level: Option<&str>) -> Result<Config, CommandError> {
    let mut config = with_set(config::load(args.config.as_deref())?, &args.set)?;
    if let Some(name) = &args.instance {
        // The same check as for instance.name.
        let text = format!("[instance]\nname = {}", toml::Value::String(name.clone()));
        config::parse(&text, std::path::Path::new("--instance"))?;
        config.instance.name.clone_from(name);
    }
    let level = match (log, default_level, &args.config) {
        (Some(level), ..) => level,
        (None, Some(level), None) => level,
        _ => &config.log.level,
    };
    config.log.level = level.to_owned();
    Ok(config)
}

/// The configuration with each KEY=VALUE of `--set` put in.
fn with_set(config: Config, settings: &[String]) -> Result<Config, CommandError> {
    if settings.is_empty() {
        return Ok(config);
    }
    let wrong = |setting: &str| {
        CommandError::Other(format!("--set {setting}: give TABLE.KEY=VALUE, as in stereo.lambda_vertical=8"))
    };
    let mut document =
        toml::Table::try_from(&config).map_err(|error| CommandError::Other(error.to_string()))?;
    for setting in settings {
        let (key, value) = setting.split_once('=').ok_or_else(|| wrong(setting))?;
        let (table, key) = key.trim().split_once('.').ok_or_else(|| wrong(setting))?;
        // What is no TOML value is a text without its quotes.
        let value = format!("value = {value}")
            .parse::<toml::Table>()
            .ok()
            .and_then(|mut t| t.remove("value"))
            .unwrap_or_else(|| toml::Value::String(value.to_owned()));
        let entry = document.entry(table).or_insert_with(|| toml::Table::new().into());
        let table = entry.as_table_mut().ok_or_else(|| wrong(setting))?;
        table.insert(key.to_owned(), value);
    }
    Ok(config::parse(&document.to_string(), std::path::Path::new("--set"))?)
}

fn stage(role: &str) -> Result<(), CommandError> {
    let role: Role = role.parse().map_err(CommandError::Other)?;
    let mut document = Vec::new();
    let launch = |error: String| CommandError::Stage(HostError::Launch(error));
    std::io::stdin().read_to_end(&mut document).map_err(|e| launch(e.to_string()))?;
    let document: Launch = serde_json::from_slice(&document).map_err(|e| launch(e.to_string()))?;
    crate::logging::start(role.name(), &document.config.log.level);
    crate::stages::run(role, document).map_err(|error| {
        tracing::error!(%error, "stage failed");
        error.into()
    })
}
