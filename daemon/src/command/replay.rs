//! `lookout replay`.

use super::{CommandError, load, say};
use crate::cli::Replay;
use crate::in_process::Pipeline;
use crate::scheduler::{self, Ends, RunOptions};
use config::Config;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::path::Path;
use std::time::Instant;
use tools::reporting::output::{FrameWriter, prepare, write_summary};
use tools::reporting::summary::RunSummary;

/// A path that starts so names a scene.
const SCENE: &str = "scene:";

pub fn run(args: &Replay, log: Option<&str>) -> Result<(), CommandError> {
    let mut config = load(&args.config, log, "scheduler", Some("warn"))?;
    set_source(&mut config, &args.path);
    config.source.repeat = args.repeat;
    if let Some(fps) = args.fps {
        config.source.fps = fps;
    }
    if let Some(rig) = &args.rig {
        config.source.rig.clone_from(rig);
    }
    if args.in_process {
        return in_process(args, &config);
    }
    let options = RunOptions {
        lockstep: args.lockstep,
        limit: args.limit,
        out: args.out.clone(),
        record: args.record.clone(),
        ends: Ends::WithSource,
    };
    let bar = progress(args.limit, "frames");
    let outcome = scheduler::run(&config, &options, &mut |status| {
        bar.set_position(status.frames);
        bar.set_message(format!("{:.0} ms end to end", status.latency_p50_ms));
    })?;
    bar.finish_and_clear();
    finish(args, &outcome.summary)?;
    match outcome.failure {
        Some(failure) => Err(CommandError::Other(failure)),
        None if outcome.was_stopped => {
            let frames = outcome.summary.frames;
            Err(CommandError::Other(format!(
                "stopped by a signal after {frames} frames: the results end there"
            )))
        }
        None => Ok(()),
    }
}

/// Takes pairs from a folder, or from `scene:NAME`.
pub fn set_source(config: &mut Config, path: &Path) {
    match path.to_str().and_then(|path| path.strip_prefix(SCENE)) {
        Some(scene) => {
            config.source.kind = "scene".into();
            config.source.path = scene.into();
        }
        None => {
            let is_file = tools::evaluation::compare::is_recording(path);
            config.source.kind = if is_file { "recording" } else { "folder" }.into();
            config.source.path = path.to_owned();
        }
    }
}

fn finish(args: &Replay, summary: &RunSummary) -> Result<(), CommandError> {
    if let Some(out) = &args.out {
        write_summary(out, summary)?;
    }
    if args.json {
        return say(serde_json::to_string_pretty(summary)?);
    }
    say(summary)?;
    match &args.out {
        Some(out) => say(format_args!("results in {}", out.display())),
        None => Ok(()),
    }
}

/// A bar on a terminal, nothing elsewhere.
pub fn progress(count: Option<u64>, what: &str) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let (bar, template) = match count {
        Some(count) => (ProgressBar::new(count), format!("{{wide_bar}} {{pos}}/{{len}} {what}, {{msg}}")),
        None => (ProgressBar::no_length(), format!("{{spinner}} {{pos}} {what}, {{msg}}")),
    };
    match ProgressStyle::with_template(&template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// The same frames through the same rooms, one after the other.
fn in_process(args: &Replay, config: &Config) -> Result<(), CommandError> {
    let mut pipeline = Pipeline::open(config)?;
    let count = pipeline.count().unwrap_or(u64::MAX);
    let frames = match args.limit {
        Some(limit) if args.repeat => limit,
        Some(limit) => limit.min(count),
        None => count,
    };
    if let Some(out) = &args.out {
        prepare(out)?;
    }
    let mut writer = args.out.as_deref().map(FrameWriter::open).transpose()?;
    let bar = progress(Some(frames), "frames");
    let start = Instant::now();
    for sequence in 0..frames {
        let result = pipeline.frame(sequence, sequence % count.max(1))?;
        if let Some(writer) = &mut writer {
            writer.write(&result.record, Some(result.images))?;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    let rate_hz = frames as f64 / seconds;
    let summary = RunSummary { seconds, rate_hz, offered: frames, frames, ..RunSummary::default() };
    if let Some(out) = &args.out {
        write_summary(out, &summary)?;
    }
    if args.json {
        return say(serde_json::to_string_pretty(&summary)?);
    }
    match &args.out {
        Some(out) => say(format_args!("{frames} frames, results in {}", out.display())),
        None => say(format_args!("{frames} frames")),
    }
}
