//! The arguments of `lookout soak`.

use crate::command::config_args::ConfigArgs;
use crate::command::number::whole;
use crate::command::number::{fps, number};
use clap::Args;
use std::path::PathBuf;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout soak                                        five minutes of the built-in drive at 12.5 fps
  lookout soak --minutes 20 --out out/soak-20
  lookout soak RECORDING --fps 10 --minutes 600 -c car.toml
  lookout soak --minutes 20 --faults --seed 7         random kills, exits, hangs, stalls and heat
  lookout soak --kills 1000                           a thousand SIGKILLs, about 20 minutes
  lookout soak --overload --minutes 10                twice the rate that the daemon sustains
  lookout soak --tables                               reproduce the paper's tables
  lookout soak --gpu-table -c orin-nano               its table of GPU clocks, on a suitable board
  lookout soak --ambient-table 22.5 --out out/heat    a row of its table of ambient temperatures

Starts the daemon as a separate instance, loops the source, and measures from outside. Budgets are
in [soak] of the configuration; the exit code is 1 if one is exceeded. Without -c, 64 disparities
are searched, enough for the paper's rig.

--out receives soak.md, soak.json, plots as SVG, daemon.toml (the configuration of the run) and
daemon.log; docs/soak.md explains them. With faults, supervision is configured to restart stages at
once and never to give up; the report lists these settings.";

/// Qualifies a board.
#[derive(Args, Debug)]
pub struct Soak {
    /// Folder of a recording, or scene:NAME, as for lookout replay [default: the source of the
    /// configuration]
    pub source: Option<PathBuf>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Minutes to measure, after the warm-up [default: 5; with --kills until all are done; with
    /// --tables 1 for each rate, with --gpu-table 1 for each clock, with --ambient-table 10 of standby and
    /// 10 of full load]
    #[arg(long, value_name = "N", value_parser = minutes)]
    pub minutes: Option<f64>,
    /// Pairs per second [default: source.fps, or 12.5]
    #[arg(long, value_name = "N", value_parser = fps)]
    pub fps: Option<f64>,
    /// Inject random faults of all kinds
    #[arg(long)]
    pub faults: bool,
    /// Inject this many SIGKILLs, each right after the recovery from the previous one
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1, u64::MAX))]
    pub kills: Option<u64>,
    /// Seed of the faults [default: from the clock; it is printed]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Offer pairs at twice the rate that the daemon sustains
    #[arg(long, conflicts_with_all = ["fps", "faults", "kills", "tables"])]
    pub overload: bool,
    /// Run at 10, 15, 20 and 24 fps and print the results beside the paper's tables
    #[arg(long, conflicts_with_all = ["fps", "faults", "kills", "seed"])]
    pub tables: bool,
    /// Match on the GPU at three steps of its clock and with the governor, and print the results beside the
    /// paper's table of GPU frequencies; needs a board whose GPU clock can be set
    #[arg(long, conflicts_with_all = ["fps", "faults", "kills", "seed", "overload", "tables"])]
    pub gpu_table: bool,
    /// Measure the temperature of the chip and the power of the board at this ambient temperature, in standby and at
    /// 24 fps, and print them beside the paper's table, with the runs at other temperatures in the same
    /// folder; needs a board with a temperature sensor
    #[arg(long, value_name = "CELSIUS", value_parser = celsius, allow_hyphen_values = true,
          conflicts_with_all = ["fps", "faults", "kills", "seed", "overload", "tables", "gpu_table"])]
    pub ambient_table: Option<f64>,
    /// Folder for the report
    #[arg(long, default_value = "out/soak", value_name = "DIR")]
    pub out: PathBuf,
    /// Print the report as JSON
    #[arg(long)]
    pub json: bool,
}

fn celsius(text: &str) -> Result<f64, String> {
    number(text, -60.0, 150.0)
}

fn minutes(text: &str) -> Result<f64, String> {
    number(text, 0.05, 100_000.0)
}
