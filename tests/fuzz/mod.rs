//! Every parser of external input, on randomly mutated inputs: no input may make it panic, run without end or take
//! memory out of proportion.
//!
//! Two seconds for each reader with every commit; longer with
//! `LOOKOUT_FUZZ_SECONDS=600 cargo test --release -p lookout --test slow fuzz::`.

mod calibrations;
mod caught;
mod frames;
mod harness;
mod messages;
mod mutate;
mod pictures;
mod recordings;

use harness::{files, fuzz};
use std::path::Path;

fn text(input: &[u8]) -> String {
    String::from_utf8_lossy(input).into_owned()
}

#[test]
fn configuration() {
    let mut seeds = files("config/profiles", "toml");
    seeds.push(
        toml::to_string(&config::Config::default()).expect("a configuration can be written").into_bytes(),
    );
    seeds.push(b"profile = \"tk1\"\n[alarm]\ndistance_m = 7\n[source]\npath = 'a\\b'\n".to_vec());
    fuzz("configuration", seeds, 8192, |input, _| match config::parse(&text(input), Path::new("car.toml")) {
        Err(errors) => {
            assert!(!errors.0.is_empty());
            errors.to_string()
        }
        Ok(config) => {
            // What was accepted can be written down and is accepted again.
            let again = toml::to_string(&config).expect("a configuration can be written");
            let same =
                config::parse(&again, Path::new("again")).expect("what was accepted is accepted again");
            assert_eq!(same, config);
            format!("ok {}", again.len())
        }
    });
}

#[test]
fn scene_file() {
    fuzz("scene_file", files("config/scenes", "toml"), 8192, |input, _| {
        match sources::scene::file::SceneFile::parse(&text(input), "my.toml") {
            Err(error) => error.to_string(),
            Ok(scene) => format!("ok {}", scene.objects.len()),
        }
    });
}

/// The shipped cascade, and a small one of each format and kind.
#[test]
fn cascade() {
    let mut seeds = files("perception/tests/parity", "xml");
    let shipped = files("models", "xml").remove(0);
    let picture: Vec<u8> = (0..64 * 48_u32).map(|i| (i * i % 251) as u8).collect();
    seeds.push(shipped);
    fuzz("cascade", seeds, 1 << 20, |input, _| {
        match perception::recognition::xml::read(&text(input)) {
            Err(error) => error.to_string(),
            Ok(cascade) => {
                // What was accepted can be used.
                let view = perception::image::GreyView::new(&picture, 64, 48, 64).expect("a picture");
                let sizes = perception::recognition::Sizes::Range { min_px: 0, max_px: 0, growth: 1.5 };
                let mut detector = perception::recognition::Detector::new(&cascade, 64, 48);
                let found = detector.detect(view, sizes, 2).len();
                format!("ok {} stages, {}", cascade.stages.len().min(9), found.min(1))
            }
        }
    });
}
