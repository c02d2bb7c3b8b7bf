//! The tables of the paper's section 4.4, compared with measurements.

use super::markdown::table;
use serde::Serialize;

/// Number of cores of the paper's board: CPU usage is compared as a share of four.
pub const CORES: f64 = 4.0;

/// Offered rate, CPU usage in percent of four cores, memory in MB and processed rate, from the paper's table
/// "The Influence of Frame Rate".
const RATES: [(f64, f64, f64, f64); 3] =
    [(10.0, 31.25, 54.0, 9.7), (15.0, 42.75, 54.0, 12.9), (20.0, 48.0, 55.0, 13.1)];

/// GPU clock, frame rate, and times in ms of calibration, stereo matching and obstacle extraction, from the
/// paper's table "System Performance at Different GPU Frequencies".
const CLOCKS: [(&str, f64, [&str; 3]); 5] = [
    ("paper, GPU 324 MHz", 24.0, ["31, 31, 31", "96, 93, 96", "56, 55, 53"]),
    ("paper, GPU 648 MHz", 24.0, ["27, 28, 29", "58, 57, 59", "50, 47, 48"]),
    ("paper, GPU 852 MHz", 24.0, ["27, 26, 28", "55, 50, 52", "50, 46, 43"]),
    ("paper, GPU 324 MHz", 10.0, ["38, 38, 39", "102, 100, 103", "67, 63, 61"]),
    ("paper, GPU automatic", 20.0, ["32, 32, 34", "77, 73, 81", "57, 56, 52"]),
];

/// Samples of the paper's "Obstacle Extraction Module": CPU usage and memory, in percent.
const OBSTACLES: [(f64, [(f64, f64); 5]); 2] = [
    (10.0, [(17.73, 0.1), (18.25, 0.1), (16.78, 0.1), (17.65, 0.3), (17.33, 0.01)]),
    (15.0, [(13.30, 0.1), (17.13, 0.2), (18.05, 0.3), (19.55, 0.1), (16.28, 0.01)]),
];

/// Offered rates that the tables need.
pub const OFFERED_FPS: [f64; 4] = [10.0, 15.0, 20.0, 24.0];

/// Share of the maximum GPU clock (852 MHz; `None` = automatic), and rate, of each run in `CLOCKS`.
pub const OFFERED_CLOCKS: [(Option<f64>, f64); 5] = [
    (Some(324.0 / 852.0), 24.0),
    (Some(648.0 / 852.0), 24.0),
    (Some(1.0), 24.0),
    (Some(324.0 / 852.0), 10.0),
    (None, 20.0),
];

/// Measurements of one run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RateRun {
    /// Offered pairs per second.
    pub fps: f64,
    /// Results per second.
    pub processed_fps: f64,
    /// CPU usage of all processes, in cores.
    pub cpu_cores: f64,
    /// CPU usage of the capture stage, in cores.
    pub capture_cores: f64,
    /// Resident memory of all processes.
    pub memory_bytes: f64,
    /// Median processing time of each stage on the path of a frame, in ms.
    pub work_p50_ms: Vec<f64>,
    /// Road and recognition together, in five parts of the run: percent of one core, and percent of the machine's
    /// memory.
    pub obstacles: Vec<(f64, f64)>,
}

impl RateRun {
    /// Processing time of stereo, the second stage, in ms.
    fn stereo_p50_ms(&self) -> f64 {
        self.work_p50_ms.get(1).copied().unwrap_or(f64::NAN)
    }

    /// Processing time of the stages after stereo, which are the paper's obstacle detection, in ms.
    fn obstacles_p50_ms(&self) -> f64 {
        self.work_p50_ms.iter().skip(2).sum()
    }
}

/// Environment of the runs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Place {
    /// Name of the processor.
    pub processor: String,
    /// Number of cores.
    pub cores: usize,
    /// Source of the pairs.
    pub source: String,
    /// Matcher backend.
    pub backend: String,
    /// Median time to rectify one pair, in ms, measured separately; `None` if not measured.
    pub rectify_ms: Option<f64>,
}

/// Measurements of one run at a GPU clock.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ClockRun {
    /// Requested clock in MHz; `None` for automatic.
    pub set_mhz: Option<f64>,
    /// Minimum and maximum clock read back during the run; `None` if not available.
    pub read_mhz: Option<[f64; 2]>,
    /// Median GPU time per pair in ms; `None` without GPU timestamps.
    pub device_p50_ms: Option<f64>,
    /// Measurements.
    pub run: RateRun,
}

/// The paper's rows of the GPU clock table.
fn paper_clocks() -> Vec<Vec<String>> {
    let row = |(name, fps, times): &(&str, f64, [&str; 3])| {
        let mut row = vec![(*name).to_owned(), format!("{fps:.0}")];
        row.extend(times.map(str::to_owned));
        row
    };
    CLOCKS.iter().map(row).collect()
}

/// The paper's table "System Performance at Different GPU Frequencies" with our measurements, as Markdown.
pub fn clock_table(place: &Place, runs: &[ClockRun]) -> String {
    let none = || "-".to_owned();
    let mut rows = paper_clocks();
    for row in &mut rows {
        row.extend([none(), none()]);
    }
    for run in runs {
        let clock = run.set_mhz.map_or("automatic".into(), |mhz| format!("{mhz:.0} MHz"));
        let read = match run.read_mhz {
            Some([least, greatest]) if least < greatest => format!(" (read {least:.0} to {greatest:.0})"),
            Some([read, _]) if run.set_mhz.is_some_and(|set| (set - read).abs() >= 0.5) => {
                format!(" (read {read:.0})")
            }
            _ => String::new(),
        };
        rows.push(vec![
            format!("here, GPU {clock}{read}"),
            format!("{:.0}", run.run.fps),
            place.rectify_ms.map_or_else(none, |ms| format!("{ms:.2}")),
            one(run.run.stereo_p50_ms()),
            one(run.run.obstacles_p50_ms()),
            run.device_p50_ms.map_or_else(none, one),
            one(run.run.processed_fps),
        ]);
    }
    let heads = [
        "",
        "fps",
        "calibration",
        "stereo matching",
        "obstacle extraction",
        "stereo: GPU time",
        "processed fps",
    ];
    format!(
        "# GPU frequencies\n\nHere: {} ({} cores), {}, {}.\n\n\
         Times in ms; the paper gives three samples, ours are medians. Calibration is rectifying one pair; obstacle \
         extraction is road and recognition. The clocks are the steps of this GPU nearest to the paper's shares \
         of the fastest.\n\n{}",
        place.processor,
        place.cores,
        place.source,
        place.backend,
        table(&heads, &rows)
    )
}

fn one(value: f64) -> String {
    format!("{value:.1}")
}

/// The run at an offered rate.
fn run_at(runs: &[RateRun], fps: f64) -> Option<&RateRun> {
    runs.iter().find(|r| (r.fps - fps).abs() < 1e-6)
}

/// A value of the run at an offered rate; a dash where there is none.
fn ours(runs: &[RateRun], fps: f64, value: &dyn Fn(&RateRun) -> String) -> String {
    run_at(runs, fps).map_or_else(|| "-".into(), value)
}

fn rate_rows(runs: &[RateRun]) -> Vec<Vec<String>> {
    let row = |(fps, cpu, memory, processed): (f64, f64, f64, f64)| {
        vec![
            format!("{fps:.0}"),
            format!("{cpu:.2}"),
            ours(runs, fps, &|r| one(r.cpu_cores / CORES * 100.0)),
            ours(runs, fps, &|r| one((r.cpu_cores - r.capture_cores) / CORES * 100.0)),
            one(memory),
            ours(runs, fps, &|r| one(r.memory_bytes / 1e6)),
            one(processed),
            ours(runs, fps, &|r| one(r.processed_fps)),
        ]
    };
    RATES.into_iter().map(row).collect()
}

fn clock_rows(place: &Place, runs: &[RateRun]) -> Vec<Vec<String>> {
    let mut clocks = paper_clocks();
    for fps in [24.0, 10.0, 20.0] {
        clocks.push(vec![
            format!("here, {}", place.backend),
            format!("{fps:.0}"),
            place.rectify_ms.map_or_else(|| "-".into(), |ms| format!("{ms:.2}")),
            ours(runs, fps, &|r| one(r.stereo_p50_ms())),
            ours(runs, fps, &|r| one(r.obstacles_p50_ms())),
        ]);
    }
    clocks
}

fn obstacle_rows(runs: &[RateRun]) -> Vec<Vec<String>> {
    let mut obstacles: Vec<Vec<String>> = Vec::new();
    let part = |fps: f64, i: usize| run_at(runs, fps).and_then(|r| r.obstacles.get(i).copied());
    let mut row = |name: String, paper: [(f64, f64); 2], ours: [Option<(f64, f64)>; 2]| {
        let mut cells = vec![name];
        for ((cpu, memory), ours) in paper.into_iter().zip(ours) {
            cells.push(format!("{cpu:.2}"));
            cells.push(ours.map_or_else(|| "-".into(), |(cpu, _)| format!("{cpu:.2}")));
            cells.push(format!("{memory:.2}"));
            cells.push(ours.map_or_else(|| "-".into(), |(_, memory)| format!("{memory:.3}")));
        }
        obstacles.push(cells);
    };
    for i in 0..5 {
        row(
            format!("part {}", i + 1),
            OBSTACLES.map(|(_, parts)| parts[i]),
            OBSTACLES.map(|(fps, _)| part(fps, i)),
        );
    }
    let mean = |parts: &[(f64, f64)]| {
        let count = parts.len().max(1) as f64;
        (parts.iter().map(|p| p.0).sum::<f64>() / count, parts.iter().map(|p| p.1).sum::<f64>() / count)
    };
    row(
        "mean".into(),
        OBSTACLES.map(|(_, parts)| mean(&parts)),
        OBSTACLES.map(|(fps, _)| run_at(runs, fps).map(|r| mean(&r.obstacles))),
    );
    obstacles
}

/// The three tables as Markdown.
pub fn tables(place: &Place, runs: &[RateRun]) -> String {
    format!(
        "Here: {} ({} cores), {}, {}.\n\n\
         ## Frame rate\n\n\
         CPU usage in percent of the four cores of the paper's board (here: used cores ÷ 4); \"less \
         capture\" leaves out the capture stage, which renders or decodes what a camera would deliver. Memory in MB: \
         private memory of all processes, shared memory and executable counted once.\n\n{}\n\
         ## GPU frequency\n\n\
         Times in ms; the paper gives three samples, ours are medians. Calibration is rectifying one pair; obstacle \
         extraction is road and recognition.\n\n{}\n\
         ## Obstacle module\n\n\
         Road and recognition: CPU usage in percent of one core, private memory in percent of the machine's, in \
         five parts of the run. The paper prints a mean of 17.85 at 10 fps; its five samples give 17.55, as its text has \
         it.\n\n{}",
        place.processor,
        place.cores,
        place.source,
        place.backend,
        table(
            &[
                "offered fps",
                "CPU, paper",
                "here",
                "less capture",
                "memory, paper",
                "here",
                "fps, paper",
                "here"
            ],
            &rate_rows(runs)
        ),
        table(
            &["", "fps", "calibration", "stereo matching", "obstacle extraction"],
            &clock_rows(place, runs)
        ),
        table(
            &[
                "",
                "10 fps CPU, paper",
                "here",
                "memory, paper",
                "here",
                "15 fps CPU, paper",
                "here",
                "memory, paper",
                "here"
            ],
            &obstacle_rows(runs)
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ours_stand_beside_the_papers() {
        let runs: Vec<RateRun> = OFFERED_FPS
            .into_iter()
            .map(|fps| RateRun {
                fps,
                processed_fps: fps - 0.1,
                cpu_cores: fps / 25.0,
                capture_cores: 0.1,
                memory_bytes: 51.5e6,
                work_p50_ms: vec![3.0, 20.0, 5.0, 2.0],
                obstacles: vec![(fps, 0.02); 5],
            })
            .collect();
        let clocks = [
            ClockRun { set_mhz: Some(306.0), read_mhz: Some([306.2; 2]), ..ClockRun::default() },
            ClockRun { set_mhz: Some(624.75), read_mhz: Some([408.0, 624.75]), ..ClockRun::default() },
            ClockRun { device_p50_ms: Some(7.3), run: runs[2].clone(), ..ClockRun::default() },
        ];
        let text = clock_table(&Place { rectify_ms: Some(1.234), ..Place::default() }, &clocks);
        let row = |start: &str| {
            let line =
                text.lines().find(|l| l.starts_with(start)).unwrap_or_else(|| panic!("{start}: {text}"));
            line.split('|').map(|c| c.trim().to_owned()).filter(|c| !c.is_empty()).collect::<Vec<_>>()
        };
        assert_eq!(row("| paper, GPU 852")[1..], ["24", "27, 26, 28", "55, 50, 52", "50, 46, 43", "-", "-"]);
        assert_eq!(row("| here, GPU 306 MHz")[5..], ["-", "0.0"]);
        assert_eq!(row("| here, GPU 625 MHz")[0], "here, GPU 625 MHz (read 408 to 625)");
        let automatic = ["here, GPU automatic", "20", "1.23", "20.0", "7.0", "7.3", "19.9"];
        assert_eq!(row("| here, GPU automatic"), automatic);
        let text = tables(&Place { backend: "CPU".into(), cores: 2, ..Place::default() }, &runs);
        let line = |start: &str| {
            text.lines().find(|l| l.starts_with(start)).unwrap_or_else(|| panic!("{start}: {text}"))
        };
        let cells = |line: &str| {
            line.split('|').map(|c| c.trim().to_owned()).filter(|c| !c.is_empty()).collect::<Vec<_>>()
        };
        assert_eq!(cells(line("| 15 ")), ["15", "42.75", "15.0", "12.5", "54.0", "51.5", "12.9", "14.9"]);
        assert_eq!(cells(line("| here, CPU")), ["here, CPU", "24", "-", "20.0", "7.0"]);
        assert_eq!(cells(line("| mean"))[1..3], ["17.55", "10.00"]);
        // A missing run leaves a dash.
        let text = tables(&Place::default(), &runs[..1]);
        assert!(
            text.lines().any(|l| cells(l) == ["20", "48.00", "-", "-", "55.0", "-", "13.1", "-"]),
            "{text}"
        );
    }
}
