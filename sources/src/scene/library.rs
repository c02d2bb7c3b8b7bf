//! Built-in scenes and scene names.

use super::file::{NamedRig, SceneError, SceneFile, Weather};
use super::random;
use crate::bounded_file;
use crate::limits::SCENE;
use std::path::Path;

macro_rules! scenes {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!("../../../config/scenes/", $name, ".toml")))),*]
    };
}

/// Name of the scenes that a seed generates.
pub const RANDOM: &str = "random";

/// Built-in scenes: name and TOML text.
pub const SCENES: [(&str, &str); 30] = scenes![
    "drive",
    "street",
    "crest",
    "dip",
    "slope",
    "bend",
    "roll",
    "overtaken",
    "bridge",
    "lamps",
    "wet",
    "textureless",
    "bus",
    "car-body",
    "car-rear",
    "green-belt",
    "cone",
    "debris",
    "stopped-car",
    "next-lane",
    "crest-traffic",
    "dip-traffic",
    "motion",
    "junction-parked",
    "bend-parked",
    "bend-parked-left",
    "bend-stopped",
    "bend-overtaking",
    "bend-overtaken",
    "bend-oncoming",
];

/// Splits a scene name at its question mark.
fn split(name: &str) -> (&str, &str) {
    name.split_once('?').unwrap_or((name, ""))
}

/// Loads a scene: a built-in `NAME`, `random`, or a path, optionally followed by `?weather=night&seed=7&rig=kitti`.
///
/// # Errors
/// When there is no such scene, or it is invalid.
pub fn load(name: &str) -> Result<SceneFile, SceneError> {
    let (place, settings) = split(name);
    if place == RANDOM {
        let text = random::text(seed(settings));
        return set(SceneFile::parse(&text, &format!("scene {name}"))?, name, settings);
    }
    let scene = match SCENES.iter().find(|(known, _)| *known == place) {
        Some((known, text)) => SceneFile::parse(text, &format!("scene {known}"))?,
        None if place.ends_with(".toml") || place.contains('/') || Path::new(place).is_file() => {
            let path = Path::new(place);
            let text = bounded_file::read_text(path, &SCENE)
                .map_err(|source| SceneError::Io { path: path.to_owned(), source })?;
            SceneFile::parse(&text, place)?
        }
        None => {
            let known = format!("{}, {RANDOM}?seed=N", SCENES.map(|(known, _)| known).join(", "));
            return Err(SceneError::Unknown { name: place.to_owned(), known });
        }
    };
    set(scene, name, settings)
}

/// The seed among the settings of a generated scene; 1 where none is given or it is no number.
fn seed(settings: &str) -> u64 {
    let given = settings.split('&').filter_map(|setting| setting.strip_prefix("seed="));
    given.last().and_then(|value| value.parse().ok()).unwrap_or(1)
}

/// Applies the settings of a scene name.
fn set(mut scene: SceneFile, name: &str, settings: &str) -> Result<SceneFile, SceneError> {
    for setting in settings.split('&').filter(|setting| !setting.is_empty()) {
        let wrong = || SceneError::Setting {
            name: name.to_owned(),
            setting: setting.to_owned(),
            weathers: Weather::ALL.map(Weather::name).join(", "),
        };
        match setting.split_once('=').ok_or_else(wrong)? {
            ("weather", value) => scene.weather = Weather::named(value).ok_or_else(wrong)?,
            ("seed", value) => scene.seed = value.parse().map_err(|_| wrong())?,
            ("rig", "paper") => scene.camera.rig = NamedRig::Paper,
            ("rig", "kitti") => scene.camera.rig = NamedRig::Kitti,
            _ => return Err(wrong()),
        }
    }
    Ok(scene)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_sound_and_settings_are_taken() {
        for (name, _) in SCENES {
            let scene = load(name).unwrap_or_else(|error| panic!("{error}"));
            assert!(scene.title.len() > 10, "{name} needs a title");
        }
        let scene = load("street?weather=night&seed=7&rig=kitti").unwrap();
        assert_eq!((scene.weather, scene.seed, scene.camera.rig), (Weather::Night, 7, NamedRig::Kitti));
    }

    #[test]
    fn what_is_no_scene_is_told_with_the_remedy() {
        let fault = |name: &str| load(name).unwrap_err().to_string();
        assert!(fault("sreet").contains("no such scene") && fault("sreet").contains("street"));
        assert!(fault("./no/such.toml").contains("no/such.toml"));
        let text = fault("street?weather=hail");
        assert!(text.contains("weather=hail") && text.contains("heavy_rain"), "{text}");
        assert!(fault("street?sun").contains("give weather=NAME"));
    }
}
