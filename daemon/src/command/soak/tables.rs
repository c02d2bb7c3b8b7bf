//! `lookout soak --tables`: reproduces the tables of the paper's section 4.4.

use super::arguments::Soak;
use super::session::{at_rate, line, save, time};
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::soak::{self, Plan, processor};
use config::Config;
use perception::image::GreyView;
use perception::rectify::Remap;
use perception::simd::Level;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use tools::soak::budget::Kind;
use tools::soak::paper::{OFFERED_FPS, Place, RateRun, tables};
use tools::soak::report::Setting;

/// Size of the paper's images.
const SIZE: (usize, usize) = (640, 480);

/// Focal length of the paper's cameras, in px, and a typical radial distortion (k1) of such lenses.
const FOCAL_PX: f64 = 879.0;
const RADIAL: f64 = -0.12;

pub fn run(
    args: &Soak,
    config: &Config,
    settings: &[Setting],
    source: &str,
    stop: &Arc<AtomicBool>,
) -> Result<(), CommandError> {
    let mut runs: Vec<RateRun> = Vec::new();
    for fps in OFFERED_FPS {
        let (config, settings) = at_rate(config, settings, fps, "a rate of the paper's tables");
        let plan = Plan {
            kind: Kind::Steady,
            time: Some(time(args.minutes.unwrap_or(1.0))),
            faults: None,
            settings,
            source: source.to_owned(),
            out: args.out.join(format!("{fps:.0}-fps")),
        };
        eprintln!("{fps:.0} pairs per second");
        let soaked = soak::run(&config, &plan, stop, &mut |p| eprintln!("{}", line(p)))?;
        if stop.load(Ordering::Relaxed) {
            return Err(CommandError::Other("stopped by a signal: no tables".into()));
        }
        if soaked.report.frames == 0 {
            return Err(CommandError::Other(format!("no results at {fps:.0} pairs per second")));
        }
        runs.push(soaked.rate);
    }
    let place = Place {
        processor: processor(),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        source: source.to_owned(),
        // These tables are measured on the CPU.
        backend: format!("CPU {} (no GPU clock here)", Level::best().name()),
        rectify_ms: Some(rectify_ms()?),
    };
    let text = format!("# The paper's tables\n\n{}", tables(&place, &runs));
    save(&args.out.join("tables.md"), &text)?;
    let json = serde_json::to_string_pretty(&serde_json::json!({ "place": place, "runs": runs }))?;
    save(&args.out.join("tables.json"), &(json.clone() + "\n"))?;
    say(if args.json { json } else { text })
}

/// Median time to rectify a pair of the paper's size, in ms.
pub fn rectify_ms() -> Result<f64, CommandError> {
    let (width, height) = SIZE;
    let centre = (width as f64 / 2.0, height as f64 / 2.0);
    let map = Remap::new(Level::best(), width, height, |x, y| {
        let (dx, dy) = ((x as f64 - centre.0) / FOCAL_PX, (y as f64 - centre.1) / FOCAL_PX);
        let bent = 1.0 + RADIAL * (dx * dx + dy * dy);
        Some((centre.0 + dx * bent * FOCAL_PX, centre.1 + dy * bent * FOCAL_PX))
    });
    let picture: Vec<u8> = (0..width * height).map(|i| (i * 31 % 251) as u8).collect();
    let view = GreyView::new(&picture, width, height, width)?;
    let mut out = vec![0; width * height];
    let mut times = Vec::new();
    for _ in 0..101 {
        let start = Instant::now();
        for _ in 0..2 {
            map.apply(view, &mut out).map_err(|e| CommandError::Other(e.to_string()))?;
        }
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}
