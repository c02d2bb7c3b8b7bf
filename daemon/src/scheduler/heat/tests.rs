//! Tests of the ladder with simulated temperatures: ramps, waves, lost sensors, random walks, the paper's table.

use super::*;

const S: u64 = 1_000_000_000;
/// Twice a second, as configured.
const STEP: u64 = S / 2;

/// The defaults of the configuration.
const PARAMETERS: HeatParameters = HeatParameters {
    limits: [Celsius(90.0), Celsius(92.0), Celsius(93.0), Celsius(94.0), Celsius(95.0)],
    hysteresis_k: 5.0,
    dwell_ns: 30 * S,
    filter_ns: 5 * S,
    slew_c_per_s: 1.0,
    start_below: Celsius(85.0),
    powers_off: true,
    missing_powers_off: false,
    frame_rate_share: 0.5,
    clocks_share: 0.6,
};

fn ladder() -> Heat {
    Heat::new(PARAMETERS, &["cpu".into(), "gpu".into()])
}

/// Samples both zones twice a second for `seconds`; `celsius` gives their temperatures at a time. Returns the changes:
/// time in seconds and rung.
fn drive(
    heat: &mut Heat,
    from_s: f64,
    seconds: f64,
    mut celsius: impl FnMut(f64) -> [Option<f64>; 2],
) -> Vec<(f64, Rung)> {
    let mut changes = Vec::new();
    for step in 0..(seconds * 2.0) as u64 {
        let at = from_s + step as f64 / 2.0;
        if heat.update((at * 1e9) as u64, &celsius(at).map(|v| v.map(Celsius))) {
            assert!(heat.reason().starts_with(heat.rung().name()), "{}", heat.reason());
            changes.push((at, heat.rung()));
        }
    }
    changes
}

fn both(celsius: f64) -> [Option<f64>; 2] {
    [Some(celsius - 3.0), Some(celsius)]
}

/// A triangle wave between `low` and `high` with a period of `period` seconds.
fn wave(low: f64, high: f64, period: f64) -> impl Fn(f64) -> f64 {
    move |at| {
        let phase = (at / period).fract() * 2.0;
        low + (high - low) * if phase < 1.0 { phase } else { 2.0 - phase }
    }
}

#[test]
fn there_are_no_limits_at_the_ambient_temperatures_of_the_paper() {
    // The paper's table: ambient temperature, and the range of the chip at full load.
    for (ambient, low, high) in
        [(20.0, 45.0, 50.0), (55.0, 70.0, 80.0), (60.0, 80.0, 85.0), (65.0, 85.0, 90.0)]
    {
        for period in [7.0, 60.0, 600.0] {
            let mut heat = ladder();
            let swing = wave(low, high, period);
            let changes = drive(&mut heat, 0.0, 3600.0, |at| both(swing(at)));
            assert_eq!(changes, [], "{ambient} °C, waves of {period} s");
            assert_eq!(heat.action().frame_rate_share, 1.0);
        }
    }
}

#[test]
fn a_slow_ramp_climbs_rung_by_rung_and_powers_off_above_95() {
    let mut heat = ladder();
    // One degree a minute from 80 to 97.
    let mut actions = Vec::new();
    let changes = drive(&mut heat, 0.0, 17.0 * 60.0, |at| both(80.0 + at / 60.0));
    assert_eq!(changes.iter().map(|c| c.1).collect::<Vec<_>>(), Rung::LADDER);
    for (at, rung) in &changes {
        let shown = 80.0 + at / 60.0;
        let limit = PARAMETERS.limit(*rung).0;
        assert!(shown > limit && shown < limit + 0.2, "{} at {shown}", rung.name());
    }
    assert!(heat.reason().starts_with("power off: gpu at 95.0 °C is above 95.0 °C"), "{}", heat.reason());
    for rung in [&[Rung::Normal], &Rung::LADDER[..]].concat() {
        heat.rung = rung;
        let HeatAction { frame_rate_share, clocks_share, recognition, run, power_off } = heat.action();
        actions.push((frame_rate_share, clocks_share, recognition, run, power_off));
    }
    assert_eq!(
        actions,
        [
            (1.0, 1.0, true, true, false),
            (0.5, 1.0, true, true, false),
            (0.5, 0.6, true, true, false),
            (0.5, 0.6, false, true, false),
            (0.5, 0.6, false, false, false),
            (0.5, 0.6, false, false, true),
        ]
    );
}

#[test]
fn a_fast_ramp_to_96_powers_off_without_waiting() {
    let mut heat = ladder();
    // Two degrees a second: the first rung, and then the last without waiting for 30 s.
    let changes = drive(&mut heat, 0.0, 60.0, |at| both((80.0 + 2.0 * at).min(96.0)));
    assert_eq!(changes.last().map(|c| c.1), Some(Rung::PowerOff));
    assert!(changes.last().is_some_and(|c| c.0 <= 8.0 + 1.5), "{changes:?}");
    // The last rung is never left, even if the sensors cool down.
    assert_eq!(drive(&mut heat, 60.0, 600.0, |_| both(20.0)), []);
    assert_eq!(heat.rung(), Rung::PowerOff);
}

#[test]
fn one_outlier_does_not_switch_the_board_off() {
    let mut heat = ladder();
    let changes = drive(&mut heat, 0.0, 60.0, |at| both(if at == 20.0 || at == 20.5 { 120.0 } else { 60.0 }));
    assert_eq!(changes, []);
    // Three samples in a row count.
    let changes = drive(&mut heat, 60.0, 60.0, |at| both(if at < 61.5 { 96.0 } else { 60.0 }));
    assert_eq!(changes, [(61.0, Rung::PowerOff)]);
}

#[test]
fn without_power_off_the_ladder_ends_at_stopped_and_descends_again() {
    let mut heat =
        Heat::new(HeatParameters { powers_off: false, ..PARAMETERS }, &["cpu".into(), "gpu".into()]);
    let changes = drive(&mut heat, 0.0, 30.0, |_| both(97.0));
    assert_eq!(changes, [(0.0, Rung::Stopped)]);
    assert!(!heat.action().run && !heat.action().power_off);
    let changes = drive(&mut heat, 30.0, 300.0, |_| both(60.0));
    let rungs: Vec<Rung> = changes.iter().map(|c| c.1).collect();
    assert_eq!(rungs, [Rung::Recognition, Rung::Clocks, Rung::FrameRate, Rung::Normal]);
    assert!(changes.windows(2).all(|w| w[1].0 - w[0].0 >= 30.0), "{changes:?}");
}

#[test]
fn changes_are_limited_by_dwell_time_and_hysteresis() {
    // A wave across the first limit that stays within the hysteresis: a single change.
    let mut heat = ladder();
    let swing = wave(85.5, 91.5, 40.0);
    let changes = drive(&mut heat, 0.0, 3600.0, |at| both(swing(at)));
    assert_eq!(changes.iter().map(|c| c.1).collect::<Vec<_>>(), [Rung::FrameRate]);
    // A wave across all limits but the last.
    let mut heat = ladder();
    let swing = wave(60.0, 94.8, 200.0);
    let changes = drive(&mut heat, 0.0, 3600.0, |at| both(swing(at)));
    assert!(changes.len() > 10, "{changes:?}");
    assert!(changes.windows(2).all(|w| w[1].0 - w[0].0 >= 30.0), "{changes:?}");
}

#[test]
fn the_first_sample_seeds_the_filter() {
    let mut heat = ladder();
    heat.update(77 * S, &[Some(Celsius(62.0)), Some(Celsius(70.0))]);
    let shown: Vec<_> = heat.zones().map(|z| (z.0.to_owned(), z.1.0)).collect();
    assert_eq!(shown, [("cpu".to_owned(), 62.0), ("gpu".to_owned(), 70.0)]);
    // After one time constant, 63 % of a step.
    for step in 1..=10 {
        heat.update(77 * S + step * STEP, &[Some(Celsius(72.0)), Some(Celsius(70.0))]);
    }
    let cpu = heat.zones().next().map_or(0.0, |z| z.1.0);
    assert!((cpu - (72.0 - 10.0 * (-1.0_f64).exp())).abs() < 1e-6, "{cpu}");
}

#[test]
fn a_sensor_that_vanishes_is_projected_and_then_too_hot() {
    let mut heat = ladder();
    let run = |at: f64| [Some(60.0), (at < 10.0).then_some(70.0)];
    let changes = drive(&mut heat, 0.0, 400.0, run);
    // 70 °C and a degree a second: 90 °C after 20 s, all limits but the last within 30 s more.
    assert_eq!(changes.iter().map(|c| c.1).collect::<Vec<_>>(), [Rung::FrameRate, Rung::Stopped]);
    assert!((changes[0].0 - 30.0).abs() <= 1.0, "{changes:?}");
    assert!(
        heat.reason().contains("gpu cannot be read for 50 s (last 70.0 °C); 120.5 °C"),
        "{}",
        heat.reason()
    );
    let gpu = heat.zones().nth(1).map(|z| z.2);
    assert_eq!(gpu, Some(true));
    // When it can be read again, its sample counts at once, and the ladder descends.
    let changes = drive(&mut heat, 400.0, 200.0, |_| [Some(60.0), Some(71.0)]);
    assert_eq!(changes[0], (400.0, Rung::Recognition));
    assert_eq!(heat.rung(), Rung::Normal);
    // Short gaps have no effect: one sample in ten is lost.
    let mut heat = ladder();
    assert_eq!(drive(&mut heat, 0.0, 3600.0, |at| [Some(80.0), (at % 5.0 != 0.0).then_some(88.0)]), []);
    // A zone that has never been read is ignored.
    let mut heat = ladder();
    assert_eq!(drive(&mut heat, 0.0, 3600.0, |_| [Some(60.0), None]), []);
    assert_eq!(heat.zones().count(), 1);
    // With `missing_powers_off`, a lost sensor switches the board off.
    let strict = HeatParameters { missing_powers_off: true, ..PARAMETERS };
    let mut heat = Heat::new(strict, &["cpu".into(), "gpu".into()]);
    let changes = drive(&mut heat, 0.0, 400.0, run);
    assert_eq!(changes.last().map(|c| c.1), Some(Rung::PowerOff));
}

#[test]
fn a_hot_board_is_not_started() {
    let names = ["cpu".to_owned(), "gpu".to_owned()];
    let hot = |cpu, gpu| PARAMETERS.too_hot_to_start(&names, &[cpu, gpu]);
    assert_eq!(hot(Some(Celsius(84.9)), None), None);
    assert_eq!(hot(Some(Celsius(85.0)), Some(Celsius(91.0))), Some(("gpu", Celsius(91.0))));
}

/// A board as a heat capacity with a path to the air: 2.5 K a watt (the paper's 20 °C row at 10 W), a
/// minute to warm up; 3 W at rest, 10 W at full load.
struct Board {
    celsius: f64,
    ambient: f64,
}

impl Board {
    fn step(&mut self, action: &HeatAction, seconds: f64) {
        let load = if action.run { action.frame_rate_share * action.clocks_share } else { 0.0 };
        let watts = 3.0 + 7.0 * load * if action.recognition { 1.0 } else { 0.8 };
        let rest = self.ambient + 2.5 * watts;
        self.celsius += (rest - self.celsius) * (1.0 - (-seconds / 60.0_f64).exp());
    }
}

#[test]
fn the_ladder_keeps_a_board_running_in_more_heat_than_the_paper_without_oscillating() {
    for (ambient, expected) in [
        (20.0, Rung::Normal),
        (55.0, Rung::Normal),
        (60.0, Rung::Normal),
        (64.0, Rung::Normal),
        (72.0, Rung::FrameRate),
        (83.0, Rung::Stopped),
        (96.0, Rung::PowerOff),
    ] {
        let mut heat = ladder();
        let mut board = Board { celsius: ambient + 7.5, ambient };
        let mut changes = Vec::new();
        let mut highest = Rung::Normal;
        for step in 0..7200_u64 {
            if heat.update(step * STEP, &[Some(Celsius(board.celsius)), Some(Celsius(board.celsius))]) {
                changes.push((step / 2, heat.rung()));
                highest = highest.max(heat.rung());
            }
            board.step(&heat.action(), 0.5);
        }
        println!("{ambient} °C: {highest:?}, at the end {:.1} °C, {changes:?}", board.celsius);
        assert_eq!(highest, expected, "{ambient} °C: {changes:?}");
        // In an hour, at most one change in three minutes.
        assert!(changes.len() <= 20, "{ambient} °C: {changes:?}");
    }
}

#[test]
fn random_walks_keep_the_rules() {
    for seed in 0..200 {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut heat = ladder();
        let mut celsius = [random.f64() * 80.0 + 20.0, random.f64() * 80.0 + 20.0];
        let mut last: Option<(u64, Rung)> = None;
        let (mut now, mut over) = (0, [0; 2]);
        for _ in 0..4000 {
            now += random.u64(1..2 * STEP);
            let mut readings = [None; 2];
            for zone in 0..2 {
                celsius[zone] = (celsius[zone] + random.f64() * 4.0 - 2.0).clamp(10.0, 110.0);
                readings[zone] = (random.u32(0..10) > 0).then_some(Celsius(celsius[zone]));
                over[zone] = match readings[zone] {
                    Some(at) if at.0 > 95.0 => over[zone] + 1,
                    _ => 0,
                };
            }
            let before = heat.rung();
            let changed = heat.update(now, &readings);
            assert_eq!(changed, heat.rung() != before, "seed {seed}");
            let must = over.iter().any(|&n| n >= 3);
            assert!(!must || heat.rung() == Rung::PowerOff, "seed {seed}: 95 °C and still running");
            if before == Rung::PowerOff {
                assert!(!changed, "seed {seed}: came back from the last rung");
                break;
            }
            if changed && heat.rung() != Rung::PowerOff {
                if let Some((at, rung)) = last {
                    assert!(now - at >= 30 * S, "seed {seed}: two changes in {} ns", now - at);
                    assert!(heat.rung() > rung || heat.rung() == rung.below(), "seed {seed}");
                }
                last = Some((now, heat.rung()));
            }
        }
    }
}
