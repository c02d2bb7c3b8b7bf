//! The paper's table "The Effect of ambient temperature": temperature of the chip and power of the board at several ambient
//! temperatures, at full load and in standby.

use super::markdown::table;
use crate::reporting::record::tidy;
use serde::{Deserialize, Serialize};

/// The paper's columns: ambient temperature in °C, least and greatest temperature of the chip in °C. The power is 10 W at full load
/// and 3 W in standby at each.
const PAPER: [(f64, [f64; 2]); 4] =
    [(20.0, [45.0, 50.0]), (55.0, [70.0, 80.0]), (60.0, [80.0, 85.0]), (65.0, [85.0, 90.0])];
const PAPER_FULL_LOAD_W: f64 = 10.0;
const PAPER_STANDBY_W: f64 = 3.0;

/// A reading of the board.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Temperature of the hottest zone in °C; `None` without a plausible reading.
    pub chip_c: Option<f64>,
    /// Power of each rail in W, in the order of the sensor's rails; `None` where it cannot be read.
    pub rails_w: Vec<Option<f64>>,
}

/// What the board did in one phase, standby or full load, after it had settled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Phase {
    /// Least and greatest temperature of the hottest zone, in °C.
    pub chip_c: [f64; 2],
    /// Mean power of the rail that feeds the board, in W; `None` without a sensor.
    pub power_w: Option<f64>,
}

/// Both phases at one ambient temperature.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AmbientRun {
    /// Ambient temperature as the user measured it, in °C.
    pub ambient_c: f64,
    /// Minutes of each phase.
    pub minutes: f64,
    /// Pairs per second that were offered, and results per second.
    pub fps: [f64; 2],
    /// The rail that feeds the board.
    pub rail: Option<String>,
    /// With no daemon.
    pub standby: Phase,
    /// With the daemon at the full rate.
    pub full_load: Phase,
}

/// The rail that feeds the board: the one with the greatest mean power, because it carries all others. `None` without readings.
pub fn feeding_rail(readings: &[Reading]) -> Option<usize> {
    let rails = readings.iter().map(|reading| reading.rails_w.len()).max().unwrap_or(0);
    let means = (0..rails).filter_map(|rail| Some((rail, mean_w(readings, rail)?)));
    means.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(rail, _)| rail)
}

fn mean_w(readings: &[Reading], rail: usize) -> Option<f64> {
    let powers = || readings.iter().filter_map(|reading| *reading.rails_w.get(rail)?);
    let count = powers().count();
    (count > 0).then(|| powers().sum::<f64>() / count as f64)
}

impl Phase {
    /// Summary of the second half of the readings of a phase: in the first, temperatures still change.
    ///
    /// `None` without a plausible temperature in it.
    pub fn of(readings: &[Reading], rail: Option<usize>) -> Option<Self> {
        let settled = &readings[readings.len() / 2..];
        let chip_c = settled.iter().filter_map(|reading| reading.chip_c);
        let range = chip_c.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], c| [a.min(c), b.max(c)]);
        let power_w = rail.and_then(|rail| mean_w(settled, rail)).map(tidy);
        (range[0] <= range[1]).then_some(Self { chip_c: range, power_w })
    }
}

/// Adds a run to those of other ambient temperatures; one of the same is replaced.
pub fn add(runs: &mut Vec<AmbientRun>, run: AmbientRun) {
    runs.retain(|other| (other.ambient_c - run.ambient_c).abs() > 0.05);
    runs.push(run);
    runs.sort_by(|a, b| a.ambient_c.total_cmp(&b.ambient_c));
}

/// The paper's table with our runs, as Markdown. `processor` and `source` name the board and the pairs.
pub fn ambient_table(processor: &str, source: &str, runs: &[AmbientRun]) -> String {
    let range = |[low, high]: [f64; 2]| format!("{low:.0} to {high:.0}");
    let watts = |power: Option<f64>| power.map_or("-".into(), |power| format!("{power:.1}"));
    let mut rows: Vec<Vec<String>> = PAPER
        .iter()
        .map(|(ambient, chip)| {
            let powers = [PAPER_FULL_LOAD_W, PAPER_STANDBY_W].map(|power| format!("{power:.0}"));
            let [full, standby] = powers;
            vec!["paper".into(), format!("{ambient:.0}"), range(*chip), full, "-".into(), standby, "-".into()]
        })
        .collect();
    rows.extend(runs.iter().map(|run| {
        vec![
            "here".into(),
            format!("{:.1}", run.ambient_c),
            range(run.full_load.chip_c),
            watts(run.full_load.power_w),
            range(run.standby.chip_c),
            watts(run.standby.power_w),
            format!("{:.1} of {:.1}", run.fps[1], run.fps[0]),
        ]
    }));
    let heads = [
        "",
        "ambient, °C",
        "chip at full load, °C",
        "power at full load, W",
        "chip in standby, °C",
        "power in standby, W",
        "results of pairs a second",
    ];
    let rail = runs.iter().rev().find_map(|run| run.rail.as_deref());
    format!(
        "# Ambient temperature\n\nHere: {processor}, {source}. Temperatures are of the hottest zone, in the second half of each phase; \
         power: {}.\n\n{}",
        rail.map_or("no sensor".into(), |rail| format!("mean of the rail {rail}")),
        table(&heads, &rows)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(chip_c: f64, rails_w: &[Option<f64>]) -> Reading {
        Reading { chip_c: Some(chip_c), rails_w: rails_w.to_vec() }
    }

    #[test]
    fn the_rail_that_feeds_the_board_carries_the_others() {
        let readings = [
            reading(40.0, &[Some(1.0), Some(6.0), None]),
            reading(41.0, &[Some(1.5), None, None]),
            reading(41.0, &[Some(9.0), Some(6.5), None]),
        ];
        assert_eq!(feeding_rail(&readings), Some(1));
        assert_eq!(feeding_rail(&readings[..0]), None);
        assert_eq!(feeding_rail(&[reading(40.0, &[None])]), None);
    }

    #[test]
    fn a_phase_is_its_second_half() {
        let warming: Vec<Reading> =
            (0..10).map(|i| reading(40.0 + f64::from(i), &[Some(f64::from(i))])).collect();
        let phase = Phase::of(&warming, Some(0)).unwrap();
        assert_eq!(phase, Phase { chip_c: [45.0, 49.0], power_w: Some(7.0) });
        assert_eq!(Phase::of(&warming, None).unwrap().power_w, None);
        assert_eq!(Phase::of(&[Reading::default()], None), None, "no temperature");
        assert_eq!(Phase::of(&[], None), None);
    }

    #[test]
    fn runs_of_several_ambient_temperatures_make_one_table() {
        let run = |ambient_c, high| AmbientRun {
            ambient_c,
            fps: [24.0, 23.9],
            rail: Some("VDD_IN".into()),
            full_load: Phase { chip_c: [high - 4.0, high], power_w: Some(9.24) },
            standby: Phase { chip_c: [40.0, 41.0], power_w: None },
            ..AmbientRun::default()
        };
        let mut runs = Vec::new();
        for (ambient, high) in [(55.0, 80.0), (20.0, 50.0), (55.0, 79.0)] {
            add(&mut runs, run(ambient, high));
        }
        assert_eq!(runs.iter().map(|r| r.full_load.chip_c[1]).collect::<Vec<_>>(), [50.0, 79.0]);
        let text = ambient_table("a board", "scene:drive", &runs);
        let rows: Vec<Vec<&str>> = text
            .lines()
            .filter(|line| line.starts_with("| here") || line.starts_with("| paper"))
            .map(|line| line.split('|').map(str::trim).filter(|cell| !cell.is_empty()).collect())
            .collect();
        assert_eq!(rows.len(), 6, "{text}");
        assert_eq!(rows[3], ["paper", "65", "85 to 90", "10", "-", "3", "-"]);
        assert_eq!(rows[5], ["here", "55.0", "75 to 79", "9.2", "40 to 41", "-", "23.9 of 24.0"]);
        assert!(text.contains("mean of the rail VDD_IN"), "{text}");
    }
}
