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
    let origin = match place {
        RANDOM => format!("scene {name}"),
        known if SCENES.iter().any(|(own, _)| *own == known) => format!("scene {known}"),
        path => path.to_owned(),
    };
    let scene = SceneFile::parse(&text_of(place, settings)?, &origin)?;
    set(scene, name, settings)
}

/// The text of a scene as a file: a built-in `NAME`, `random?seed=N`, or a path. Other settings are not in the text.
///
/// # Errors
/// When there is no such scene, or it or its settings are invalid.
pub fn text(name: &str) -> Result<String, SceneError> {
    load(name)?;
    let (place, settings) = split(name);
    let other = settings.split('&').find(|setting| !setting.is_empty() && !setting.starts_with("seed="));
    if let Some(setting) = other.or((place != RANDOM && !settings.is_empty()).then_some(settings)) {
        return Err(SceneError::InText { name: name.to_owned(), setting: setting.to_owned() });
    }
    text_of(place, settings)
}

fn text_of(place: &str, settings: &str) -> Result<String, SceneError> {
    if place == RANDOM {
        return Ok(random::text(seed(settings)));
    }
    if let Some((_, text)) = SCENES.iter().find(|(known, _)| *known == place) {
        return Ok((*text).to_owned());
    }
    let path = Path::new(place);
    if place.ends_with(".toml") || place.contains('/') || path.is_file() {
        let fault = |source| SceneError::Io { path: path.to_owned(), source };
        return bounded_file::read_text(path, &SCENE).map_err(fault);
    }
    let known = format!("{}, {RANDOM}?seed=N", SCENES.map(|(known, _)| known).join(", "));
    Err(SceneError::Unknown { name: place.to_owned(), known })
}

/// The seed among the settings of a generated scene; 1 where none is given or it is no number.
fn seed(settings: &str) -> u64 {
    let mut given = settings.split('&').filter_map(|setting| setting.strip_prefix("seed="));
    given.next_back().and_then(|value| value.parse().ok()).unwrap_or(1)
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
        let fault = |name: &str| super::text(name).unwrap_err().to_string();
        assert!(fault("sreet").contains("no such scene"));
        assert!(fault("random?seed=3&weather=night").contains("weather=night is not part of the text"));
        assert!(fault("street?seed=3").contains("seed=3 is not part"));
        assert!(super::text("street").unwrap().contains("[[beside]]"));
        assert!(super::text("random?seed=3").unwrap().contains("seed = 3"));
    }
}
