//! The paper's tables of its section 4.4, beside ours.

use super::markdown::table;
use serde::Serialize;

/// The paper's cores: processor time is compared as a share of four.
pub const CORES: f64 = 4.0;

/// Offered rate, processor time in percent of four cores, memory in MB and processed rate of the
/// paper's table "The Influence of Frame Rate".
const RATES: [(f64, f64, f64, f64); 3] =
    [(10.0, 31.25, 54.0, 9.7), (15.0, 42.75, 54.0, 12.9), (20.0, 48.0, 55.0, 13.1)];

/// The paper's clocks and rates, and its times in ms, of "System Performance at Different GPU
/// Frequencies": calibration, stereo matching, obstacle extraction.
const CLOCKS: [(&str, f64, [&str; 3]); 5] = [
    ("paper, GPU 324 MHz", 24.0, ["31, 31, 31", "96, 93, 96", "56, 55, 53"]),
    ("paper, GPU 648 MHz", 24.0, ["27, 28, 29", "58, 57, 59", "50, 47, 48"]),
    ("paper, GPU 852 MHz", 24.0, ["27, 26, 28", "55, 50, 52", "50, 46, 43"]),
    ("paper, GPU 324 MHz", 10.0, ["38, 38, 39", "102, 100, 103", "67, 63, 61"]),
    ("paper, GPU automatic", 20.0, ["32, 32, 34", "77, 73, 81", "57, 56, 52"]),
];

/// Samples of the paper's "Obstacle Extraction Module": processor time and memory, in percent.
const OBSTACLES: [(f64, [(f64, f64); 5]); 2] = [
    (10.0, [(17.73, 0.1), (18.25, 0.1), (16.78, 0.1), (17.65, 0.3), (17.33, 0.01)]),
    (15.0, [(13.30, 0.1), (17.13, 0.2), (18.05, 0.3), (19.55, 0.1), (16.28, 0.01)]),
];

/// The rates that the tables need.
pub const OFFERED_FPS: [f64; 4] = [10.0, 15.0, 20.0, 24.0];

/// What one of our runs came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RateRun {
    /// Pairs offered a second.
    pub fps: f64,
    /// Results a second.
    pub processed_fps: f64,
    /// Cores' worth of processor time of all processes.
    pub cpu_cores: f64,
    /// That of the capture stage.
    pub capture_cores: f64,
    /// Resident memory of all processes.
    pub memory_bytes: f64,
    /// Work of capture, stereo, road and recognition: median in ms.
    pub work_p50_ms: [f64; 4],
    /// Road and recognition together, in five parts of the run: percent of one core, and of the
    /// machine's memory.
    pub obstacles: Vec<(f64, f64)>,
}

/// Where our runs were made.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Place {
    /// What processor.
    pub processor: String,
    /// How many cores.
    pub cores: usize,
    /// What the pairs are.
    pub source: String,
    /// What computes disparities.
    pub backend: String,
    /// Rectifying one pair, median in ms, measured by itself; `None` where it was not.
    pub rectify_ms: Option<f64>,
}

fn one(value: f64) -> String {
    format!("{value:.1}")
}

/// The three tables as Markdown.
pub fn tables(place: &Place, runs: &[RateRun]) -> String {
    let run = |fps: f64| runs.iter().find(|r| (r.fps - fps).abs() < 1e-6);
    let ours = |fps: f64, value: &dyn Fn(&RateRun) -> String| run(fps).map_or_else(|| "-".into(), value);
    let mut rates: Vec<Vec<String>> = Vec::new();
    for (fps, cpu, memory, processed) in RATES {
        rates.push(vec![
            format!("{fps:.0}"),
            format!("{cpu:.2}"),
            ours(fps, &|r| one(r.cpu_cores / CORES * 100.0)),
            ours(fps, &|r| one((r.cpu_cores - r.capture_cores) / CORES * 100.0)),
            one(memory),
            ours(fps, &|r| one(r.memory_bytes / 1e6)),
            one(processed),
            ours(fps, &|r| one(r.processed_fps)),
        ]);
    }
    let mut clocks: Vec<Vec<String>> = Vec::new();
    for (name, fps, [calibration, stereo, obstacles]) in CLOCKS {
        clocks.push(vec![
            name.to_owned(),
            format!("{fps:.0}"),
            calibration.to_owned(),
            stereo.to_owned(),
            obstacles.to_owned(),
        ]);
    }
    for fps in [24.0, 10.0, 20.0] {
        clocks.push(vec![
            format!("here, {}", place.backend),
            format!("{fps:.0}"),
            place.rectify_ms.map_or_else(|| "-".into(), |ms| format!("{ms:.2}")),
            ours(fps, &|r| one(r.work_p50_ms[1])),
            ours(fps, &|r| one(r.work_p50_ms[2] + r.work_p50_ms[3])),
        ]);
    }
    let mut obstacles: Vec<Vec<String>> = Vec::new();
    let part = |fps: f64, i: usize| run(fps).and_then(|r| r.obstacles.get(i).copied());
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
        OBSTACLES.map(|(fps, _)| run(fps).map(|r| mean(&r.obstacles))),
    );
    format!(
        "Here: {} ({} cores), {}, {}.\n\n\
         ## Frame rate\n\n\
         Processor time in percent of four cores, as the paper's board has (here: cores' worth of time ÷ 4); \"less \
         capture\" leaves out the capture stage, which draws or decodes what a camera would bring. Memory in MB: \
         private memory of all processes, shared memory and program counted once.\n\n{}\n\
         ## GPU frequency\n\n\
         Times in ms; the paper gives three samples, ours are medians. Calibration is rectifying one pair; obstacle \
         extraction is road and recognition.\n\n{}\n\
         ## Obstacle module\n\n\
         Road and recognition: processor time in percent of one core, memory (their own) in percent of the machine's, in \
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
            &rates
        ),
        table(&["", "fps", "calibration", "stereo matching", "obstacle extraction"], &clocks),
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
            &obstacles
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
                work_p50_ms: [3.0, 20.0, 5.0, 2.0],
                obstacles: vec![(fps, 0.02); 5],
            })
            .collect();
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
        // A run that is missing leaves a gap, and no wrong number.
        let text = tables(&Place::default(), &runs[..1]);
        assert!(
            text.lines().any(|l| cells(l) == ["20", "48.00", "-", "-", "55.0", "-", "13.1", "-"]),
            "{text}"
        );
    }
}
