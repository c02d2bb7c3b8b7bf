//! Texts of this project: configurations, scenes, cascades, HOG models and their calibrations, labels.

use super::harness::{Format, files, fuzz_format, written};
use super::{structure, text};
use fastrand::Rng;
use perception::recognition::hog::{self, HogModel};
use perception::recognition::xml::{self, TrainedWith};
use perception::recognition::{Calibration, Cascade, Detector, Sizes};
use std::fmt::Write;
use std::path::Path;

/// One of the given values.
fn one<T: Copy, const N: usize>(random: &mut Rng, of: [T; N]) -> T {
    of[random.usize(0..N)]
}

/// Some keys of a valid configuration, with values near the defaults.
fn some_configuration(random: &mut Rng, full: &toml::Table) -> Vec<u8> {
    let mut out = String::new();
    if random.bool() {
        let _ =
            writeln!(out, "profile = \"{}\"", one(random, ["replay", "tk1", "orin-nano", "rpi5", "rk3588"]));
    }
    for (name, table) in full {
        let Some(table) = table.as_table().filter(|_| random.u8(0..3) == 0) else { continue };
        let _ = writeln!(out, "[{name}]");
        for (key, value) in table {
            let new = match value {
                _ if random.bool() => continue,
                toml::Value::Float(v) => toml::Value::Float(v * (0.98 + 0.04 * random.f64())),
                toml::Value::Integer(v) if *v > 8 => toml::Value::Integer(v + random.i64(-1..2)),
                other => other.clone(),
            };
            let _ = writeln!(out, "{key} = {new}");
        }
    }
    out.into_bytes()
}

#[test]
fn configuration() {
    let full = toml::Table::try_from(config::Config::default()).expect("a configuration can be written");
    let profiles = files("config/profiles", "toml");
    let mut generate = |random: &mut Rng| match random.u8(0..8) {
        0 => profiles[random.usize(0..profiles.len())].clone(),
        _ => some_configuration(random, &full),
    };
    let format = Format {
        name: "texts::configuration",
        longest: 8192,
        generate: &mut generate,
        change: structure::lines,
    };
    fuzz_format(format, |input, _| match config::parse(&text(input), Path::new("car.toml")) {
        Err(errors) => {
            assert!(!errors.0.is_empty());
            Err(errors.to_string())
        }
        Ok(config) => {
            // What was accepted can be written down and is accepted again.
            let again = toml::to_string(&config).expect("a configuration can be written");
            let same =
                config::parse(&again, Path::new("again")).expect("what was accepted is accepted again");
            assert_eq!(same, config);
            Ok(format!("ok {}", again.len() / 64))
        }
    });
}

/// A scene with random objects, rows and motions.
fn some_scene(random: &mut Rng) -> Vec<u8> {
    let mut out = format!("title = \"some\"\nseconds = {:.1}\n", 1.0 + 9.0 * random.f64());
    let weather =
        one(random, ["sunny", "light_rain", "heavy_rain", "night", "snow", "backlight", "overcast"]);
    let _ = writeln!(out, "weather = \"{weather}\"\nseed = {}\nrepeats = {}", random.u8(..), random.bool());
    if random.bool() {
        let _ = writeln!(out, "[camera]\nrig = \"{}\"", one(random, ["paper", "kitti"]));
        let _ = writeln!(out, "pitch_deg = [[0, {:.2}], [1, {:.2}]]", random.f64(), -random.f64());
    }
    if random.bool() {
        let _ =
            writeln!(out, "[ego]\nspeed_m_s = {:.2}\nlateral_m = [[0, 0], [2, 1.5]]", 20.0 * random.f64());
    }
    if random.bool() {
        let _ = writeln!(out, "[road]\nwet = {:.2}\nbend_per_km = {:.2}", random.f64(), 9.0 * random.f64());
        let _ = writeln!(out, "grade_percent = [[0, 0], [{}, {:.1}]]", random.u8(9..), 5.0 * random.f64());
    }
    for _ in 0..random.usize(0..4) {
        let kind = one(
            random,
            ["buildings", "trees", "hedge", "guard_rail", "wall", "poles", "lamps", "parked_cars"],
        );
        let _ = writeln!(out, "[[beside]]\nkind = \"{kind}\"\nlateral_m = {:.1}", 20.0 * random.f64() - 10.0);
        let _ = writeln!(out, "from_m = {}\nto_m = {}", random.u8(..9), random.u8(10..));
    }
    for _ in 0..random.usize(0..5) {
        let kind = one(
            random,
            ["car", "van", "bus", "pedestrian", "cone", "debris", "pole", "hedge", "bridge", "block"],
        );
        let _ = writeln!(out, "[[objects]]\nkind = \"{kind}\"");
        let _ = match random.u8(0..3) {
            0 => writeln!(out, "along_m = {}\nspeed_m_s = {:.1}", random.u8(..), 30.0 * random.f64()),
            1 => writeln!(out, "path = [[0, {}, 0], [2, 30, 1.5]]", random.u8(..)),
            _ => writeln!(out, "ahead = [[0, 40, 0], [3, {}, {:.1}]]", random.u8(2..), random.f64()),
        };
    }
    out.into_bytes()
}

#[test]
fn scene_file() {
    let shipped = files("config/scenes", "toml");
    let mut generate = |random: &mut Rng| match random.u8(0..4) {
        0 => shipped[random.usize(0..shipped.len())].clone(),
        _ => some_scene(random),
    };
    let format = Format {
        name: "texts::scene_file",
        longest: 8192,
        generate: &mut generate,
        change: structure::lines,
    };
    let mut opened = 0_u32;
    fuzz_format(format, |input, path| {
        let scene =
            sources::scene::file::SceneFile::parse(&text(input), "my.toml").map_err(|e| e.to_string())?;
        let answer = format!("ok {} objects, {} rows", scene.objects.len().min(9), scene.beside.len().min(9));
        // What was accepted can be built, which takes long, and drawn, which takes longer.
        opened += 1;
        if !opened.is_multiple_of(4) {
            return Ok(answer);
        }
        let path = written(path, "toml", input);
        let mut built =
            sources::scene::Scene::open(&path.display().to_string()).map_err(|e| e.to_string())?;
        let (width, height) = sources::PairSource::size(&built);
        if opened.is_multiple_of(64) && width * height <= 640 * 480 {
            let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
            sources::PairSource::read(&mut built, 0, &mut left, &mut right).map_err(|e| e.to_string())?;
        }
        Ok(answer)
    });
}

/// A cascade with fewer stages, trees in another order, and other thresholds than one of the given.
fn some_cascade(random: &mut Rng, from: &[Cascade]) -> Vec<u8> {
    let mut cascade = from[random.usize(0..from.len())].clone();
    cascade.stages.truncate(1 + random.usize(0..3));
    for stage in &mut cascade.stages {
        random.shuffle(&mut stage.trees);
        stage.trees.truncate(1 + random.usize(0..4));
        stage.threshold *= 0.5 + random.f32();
    }
    let with = TrainedWith { hit_rate: 0.995, false_alarm_rate: 0.5, max_depth: 3, max_trees: 100 };
    xml::write(&cascade, &with).into_bytes()
}

/// The shipped cascade, a small one of each format and kind, and parts of them.
#[test]
fn cascade() {
    let small = files("perception/tests/parity", "xml");
    let shipped = files("models", "xml").remove(0);
    let cascades: Vec<Cascade> = small
        .iter()
        .chain([&shipped])
        .map(|file| xml::read(&text(file)).expect("a cascade of the project"))
        .collect();
    let picture: Vec<u8> = (0..64 * 48_u32).map(|i| (i * i % 251) as u8).collect();
    let mut generate = |random: &mut Rng| match random.u8(0..16) {
        0 => shipped.clone(),
        1..=4 => small[random.usize(0..small.len())].clone(),
        _ => some_cascade(random, &cascades),
    };
    let format =
        Format { name: "texts::cascade", longest: 1 << 20, generate: &mut generate, change: structure::xml };
    fuzz_format(format, |input, _| {
        let cascade = xml::read(&text(input)).map_err(|e| e.to_string())?;
        // What was accepted can be used.
        let view = perception::image::GreyView::new(&picture, 64, 48, 64).expect("a picture");
        let sizes = Sizes::Range { min_px: 0, max_px: 0, growth: 1.5 };
        let found = Detector::new(&cascade, 64, 48).detect(view, sizes, 2).len();
        Ok(format!("ok {} stages, {}", cascade.stages.len().min(9), found.min(1)))
    });
}

/// A HOG model with a small window and some weights.
fn some_hog(random: &mut Rng) -> Vec<u8> {
    let (width, height) = (8 * random.usize(2..5), 8 * random.usize(2..7));
    let count = hog::model::weight_count(width, height);
    let mut out = format!("# one\nlookout-hog 1\nwindow {width} {height}\n");
    let _ = writeln!(out, "bias {:.3}\nweights {count}", random.f32() - 0.5);
    for _ in 0..count {
        let _ = writeln!(out, "{:.3}", random.f32() - 0.5);
    }
    out.into_bytes()
}

/// The shipped HOG model and small ones.
#[test]
fn hog_model() {
    let shipped = files("models", "hog").remove(0);
    let picture: Vec<u8> = (0..64 * 48_u32).map(|i| (i * i % 251) as u8).collect();
    let mut generate = |random: &mut Rng| match random.u8(0..8) {
        0 => shipped.clone(),
        _ => some_hog(random),
    };
    let format = Format {
        name: "texts::hog_model",
        longest: 1 << 17,
        generate: &mut generate,
        change: structure::lines,
    };
    fuzz_format(format, |input, _| {
        let model = HogModel::read(&text(input)).map_err(|e| e.to_string())?;
        // What was accepted can be used.
        let (width, height) = model.window();
        let view = perception::image::GreyView::new(&picture, 64, 48, 64).expect("a picture");
        let sizes = Sizes::Range { min_px: 0, max_px: 0, growth: 1.5 };
        let hits = hog::HogScanner::new(model, 64, 48, 16, 100).scan(view, sizes, 0.0).len();
        Ok(format!("ok {}x{}, {}", width / 8, height / 8, hits.min(1)))
    });
}

/// What the scores of a detector say.
#[test]
fn score_calibration() {
    let mut generate = |random: &mut Rng| {
        let mut number = || 6.0 * random.f64() - 3.0;
        let (prior, miss, offset, slope) = (number(), number(), number(), number());
        Calibration { prior, miss, offset, slope }.to_string().into_bytes()
    };
    let format = Format {
        name: "texts::score_calibration",
        longest: 4096,
        generate: &mut generate,
        change: structure::lines,
    };
    fuzz_format(format, |input, _| {
        let calibration = Calibration::read(&text(input)).map_err(|e| e.to_string())?;
        let evidence = calibration.evidence(None);
        assert!(evidence.is_finite());
        Ok(format!("ok {}", evidence > 0.0))
    });
}

/// Labels of some objects.
fn some_labels(random: &mut Rng) -> Vec<u8> {
    let mut out = String::new();
    for _ in 0..random.usize(0..6) {
        let class = one(random, ["Car", "Van", "Truck", "Pedestrian", "Cyclist", "DontCare"]);
        let _ = write!(out, "{class} {:.2} {}", random.f64(), random.u8(0..4));
        for _ in 0..12 + usize::from(random.u8(0..4) == 0) {
            let _ = write!(out, " {:.2}", 400.0 * random.f64() - 40.0);
        }
        out.push('\n');
    }
    out.into_bytes()
}

#[test]
fn labels() {
    let mut generate = some_labels;
    let format =
        Format { name: "texts::labels", longest: 8192, generate: &mut generate, change: structure::lines };
    fuzz_format(format, |input, path| {
        let labels = sources::truth::label::read(&written(path, "txt", input)).map_err(|e| e.to_string())?;
        assert!(labels.iter().all(|l| l.distance_m.is_finite() && l.occluded <= 3));
        Ok(format!("ok {}", labels.len().min(9)))
    });
}
