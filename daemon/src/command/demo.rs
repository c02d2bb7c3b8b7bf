//! `lookout demo`: the whole daemon on the built-in drive, and pictures of its results.

use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::number::number;
use crate::command::status::table::table;
use crate::scheduler::collector::FrameTrace;
use crate::scheduler::{self, Ends, RunOptions};
use crate::stages::road::parameters::scene_parameters;
use crate::{input, scheduler::RunOutcome};
use clap::Args;
use config::Config;
use config::automatic::Automatic;
use messages::pipeline::PATH;
use perception::depth::DepthView;
use perception::scene::SceneDetector;
use perception::stereo::DisparityView;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tools::reporting::output::write_summary;
use tools::reporting::plot::{self, Series};
use tools::reporting::record::{FrameRecord, level_words};
use tools::reporting::{colour, v_disparity};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout demo
  lookout demo --seconds 30 --out /tmp/demo";

#[derive(Args, Debug)]
pub struct Demo {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Seconds to drive
    #[arg(long, default_value_t = 10.0, value_name = "N", value_parser = seconds)]
    pub seconds: f64,
    /// Folder for pictures, plots, summary
    #[arg(long, default_value = "out/demo", value_name = "DIR")]
    pub out: PathBuf,
}

fn seconds(text: &str) -> Result<f64, String> {
    number(text, 0.5, 86_400.0)
}

/// Enough for the built-in drive: 64 disparities reach down to 1.65 m with the paper's rig.
const DISPARITIES: i64 = 64;

pub fn run(args: &Demo, log: Option<&str>) -> Result<(), CommandError> {
    let mut config = load(&args.config, log, "scheduler", Some("warn"))?;
    config.source.kind = "scene".into();
    config.source.path = PathBuf::new();
    // The scene defines its own rig.
    config.source.rig = PathBuf::new();
    config.source.rectify = Automatic::Off;
    if args.config.config.is_none() {
        config.stereo.disparities = DISPARITIES;
    }
    let options = RunOptions {
        lockstep: false,
        limit: None,
        out: Some(args.out.clone()),
        record: None,
        ends: Ends::After(Duration::from_secs_f64(args.seconds)),
    };
    let live = std::io::stdout().is_terminal();
    say(format_args!(
        "Driving {:.0} s along a synthetic street; Ctrl-C ends the drive early.",
        args.seconds
    ))?;
    let name = config.instance.name.clone();
    let outcome = scheduler::run(&config, &options, &mut |record| {
        if live {
            drop(say(format_args!("\x1b[H\x1b[2J{}", table(&name, record))));
        } else if record.frames > 0 {
            // A closed standard output does not end the drive.
            drop(say(format_args!(
                "{:>3} frames, {}, {} obstacles",
                record.frames,
                level_words(messages::alarm::level_name(record.alarm.level)),
                record.obstacles
            )));
        }
    })?;
    if let Some(failure) = outcome.failure {
        return Err(CommandError::Other(failure));
    }
    say(format_args!("\n{}\n", outcome.summary))?;
    write_summary(&args.out, &outcome.summary)?;
    pictures(&config, &args.out, &outcome)
}

/// Writes pictures of the most interesting frame, and a plot of the latencies of all frames.
fn pictures(config: &Config, out: &Path, outcome: &RunOutcome) -> Result<(), CommandError> {
    let other =
        |path: &Path, e: &dyn std::fmt::Display| CommandError::Other(format!("{}: {e}", path.display()));
    let lines_path = out.join("obstacles.jsonl");
    let text = std::fs::read_to_string(&lines_path).map_err(|e| other(&lines_path, &e))?;
    let records: Vec<FrameRecord> = text
        .lines()
        .map(serde_json::from_str)
        .collect::<Result<_, _>>()
        .map_err(|e| other(&lines_path, &e))?;
    latency_plot(&outcome.traces).save(&out.join("latency.png"))?;
    let drawn = records.iter().filter(|r| out.join(format!("overlay/{:06}.png", r.sequence)).is_file());
    // Prefers a frame with an alarm, then the one with most confirmed obstacles.
    let Some(best) = drawn.max_by_key(|r| {
        let confirmed = r.obstacles.iter().filter(|o| o.confirmed).count();
        (r.alarm.level == "alarm" && r.alarm.nearest_m.is_some(), confirmed)
    }) else {
        return Err(CommandError::Other("no frame was written with its pictures: try --seconds 30".into()));
    };
    let name = format!("{:06}.png", best.sequence);
    let (from, to) = (out.join("overlay").join(&name), out.join("left.png"));
    std::fs::copy(&from, &to).map_err(|e| other(&to, &e))?;
    let path = out.join("disparity").join(&name);
    let map = sources::picture::read(&path).map_err(|e| CommandError::Other(e.to_string()))?.into_luma16();
    let (width, height) = (map.width() as usize, map.height() as usize);
    let disparities = usize::try_from(config.stereo.disparities).unwrap_or(0);
    let mut colours = colour::disparity(&map, width, height, disparities as f32);
    colours.append_below(&colour::scale(width, disparities as f32));
    colours.save(&out.join("disparity.png"))?;
    let source = input::open(config).map_err(scheduler::RunError::from)?;
    let rig = input::rig(config, source.as_ref()).map_err(scheduler::RunError::from)?;
    let mut detector = SceneDetector::new(scene_parameters(config, &rig), rig, width, height, disparities);
    // The written disparity map has no confidence.
    let certain = vec![u8::MAX; width * height];
    let view = DisparityView::new(&map, width, height).and_then(|map| DepthView::new(map, &certain));
    if let Some(view) = view {
        let profile = detector.detect(view).profile_px.to_vec();
        v_disparity::draw(detector.v_disparity(), &profile).save(&out.join("v-disparity.png"))?;
    }
    say(format_args!("Written to {}:", out.display()))?;
    for (file, what) in [
        (
            "left.png",
            format!("frame {}: road in green, obstacles in light blue, alarm on top", best.sequence),
        ),
        ("disparity.png", "its disparity in px: red is near, blue is far, black is unknown".into()),
        ("v-disparity.png", "its v-disparity with the road profile".into()),
        ("latency.png", "processing time of each stage by frame".into()),
        ("overlay/, disparity/", format!("all {} frames", records.len())),
        ("obstacles.jsonl", "results of all frames, one JSON document per line".into()),
        ("summary.json", "the table above as JSON".into()),
    ] {
        say(format_args!("  {file:<22} {what}"))?;
    }
    Ok(())
}

fn latency_plot(traces: &[FrameTrace]) -> tools::reporting::picture::Picture {
    let points = |value: &dyn Fn(&FrameTrace) -> f64| -> Vec<(f64, f64)> {
        traces.iter().map(|t| (t.sequence as f64, value(t))).collect()
    };
    let mut series = vec![Series { name: "end to end".into(), points: points(&|t| t.latency_ms) }];
    for (i, role) in PATH.iter().enumerate() {
        series.push(Series { name: role.name().into(), points: points(&|t| t.work_ms[i]) });
    }
    plot::lines("Time per frame", "frame", "ms", &series)
}
