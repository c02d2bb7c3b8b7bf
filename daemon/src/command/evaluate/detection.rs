//! `lookout evaluate detection`.

use crate::command::console::say;
use crate::command::detect::read_cascade;
use crate::command::error::CommandError;
use clap::Args;
use std::path::PathBuf;
use tools::evaluation::detection::{judge_all, report};
use tools::training::pictures::{self, SourcePicture};
use tools::training::report::roc_plot;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate detection vehicle.xml --positives vehicles --negatives others
  lookout evaluate detection vehicle.xml --positives vehicles --negatives others --roc roc.png --json

Every picture in the folders, searched recursively, is resized to the cascade's window by area
averaging and classified. Use pictures that the cascade was not trained on. The ROC shifts the
thresholds of all stages together.";

#[derive(Args, Debug)]
pub struct EvaluateDetection {
    /// OpenCV cascade XML
    pub cascade: PathBuf,
    /// Pictures of one object each
    #[arg(long, value_name = "DIR")]
    pub positives: PathBuf,
    /// Pictures without objects
    #[arg(long, value_name = "DIR")]
    pub negatives: PathBuf,
    /// Threads
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub threads: u16,
    /// Write a plot of the ROC
    #[arg(long, value_name = "FILE.png")]
    pub roc: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &EvaluateDetection, log: Option<&str>) -> Result<(), CommandError> {
    crate::logging::start("evaluate", log.unwrap_or("info"));
    let cascade = read_cascade(&args.cascade)?;
    let threads = usize::from(args.threads);
    let read = |folder| -> Result<Vec<SourcePicture>, CommandError> {
        Ok(pictures::read(folder)?.into_iter().flatten().collect())
    };
    let positives = judge_all(&cascade, &read(&args.positives)?, threads);
    let negatives = judge_all(&cascade, &read(&args.negatives)?, threads);
    let report = report(&positives, &negatives, cascade.stages.len())?;
    if let Some(path) = &args.roc {
        roc_plot("ROC", &report).save(path)?;
    }
    if args.json {
        return say(serde_json::to_string_pretty(&report)?);
    }
    say("stages  hits %  false alarms %")?;
    for (i, p) in report.stages.iter().enumerate() {
        say(format_args!("{:>6} {:>7.2} {:>15.2}", i + 1, 100.0 * p.hit_rate, 100.0 * p.false_alarm_rate))?;
    }
    say(format_args!(
        "\n{} of {} objects detected: {:.2} %; {} false alarms in {}: {:.2} %; balanced accuracy {:.2} %",
        report.hits,
        report.positives,
        100.0 * report.hit_rate,
        report.false_alarms,
        report.negatives,
        100.0 * report.false_alarm_rate,
        100.0 * report.balanced_accuracy
    ))?;
    say(format_args!(
        "thresholds shifted: {:.2} % detected at 1 % false alarms, {:.2} % at 2 %; area under the ROC {:.4}",
        100.0 * report.hit_rate_at_1_percent,
        100.0 * report.hit_rate_at_2_percent,
        report.area
    ))
}
