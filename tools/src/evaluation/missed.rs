//! Objects of synthetic scenes that were missed, each with what is needed to look at it.

use super::scene_match::FrameMatch;
use crate::reporting::record::tidy;
use serde::Serialize;
use sources::scene::ObjectTruth;
use std::collections::BTreeMap;
use std::fmt;

/// Number of objects that are listed in the text.
const MAX_LISTED: usize = 12;

/// An evaluable object without a matching region in some frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MissedObject {
    /// The scene, as in `lookout replay scene:NAME`, without the weather.
    pub scene: String,
    /// Its weather.
    pub weather: String,
    /// Number of the object in the scene.
    pub object: u16,
    /// Class.
    pub class: &'static str,
    /// Number of frames in which it was missed.
    pub frames: usize,
    /// Number of frames in which it was evaluable.
    #[serde(rename = "due")]
    pub evaluable: usize,
    /// First frame in which it was missed, from 0.
    pub frame: u64,
    /// Distance then, in metres.
    pub distance_m: f64,
    /// Centre then, in metres right of the camera's axis.
    pub lateral_m: f64,
    /// Width, in metres.
    pub width_m: f64,
    /// Height, in metres.
    pub height_m: f64,
}

/// One line.
impl fmt::Display for MissedObject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, weather, class, frames, evaluable, frame, distance_m, width_m, height_m, .. } =
            self;
        let side = if self.lateral_m < 0.0 { "left" } else { "right" };
        write!(
            f,
            "{scene} {weather}: {class}, {frames} of {evaluable} frames, from frame {frame}: {distance_m:.1} m ahead, \
             {:.1} m {side}, {width_m:.1} m wide, {height_m:.1} m high",
            self.lateral_m.abs()
        )
    }
}

/// The missed objects of one or more scenes.
#[derive(Clone, Debug, Default)]
pub struct MissedObjects {
    ended: Vec<MissedObject>,
    /// Of the scene that is evaluated: frames in which an object was evaluable, and what was missed of it.
    current: BTreeMap<u16, (usize, Option<MissedObject>)>,
}

impl MissedObjects {
    /// Adds a frame of the scene that is evaluated.
    pub fn add(&mut self, (scene, weather): (&str, &str), frame: u64, matched: &FrameMatch) {
        for evaluable in &matched.evaluable {
            let object = &evaluable.object;
            let (count, missed) = self.current.entry(object.id).or_default();
            *count += 1;
            if evaluable.detection.is_none() {
                missed.get_or_insert_with(|| first_missed((scene, weather), frame, object)).frames += 1;
            }
        }
    }

    /// Adds those of another scene.
    pub fn merge(&mut self, other: &Self) {
        other.list().into_iter().for_each(|missed| put(&mut self.ended, missed));
    }

    /// All of them, those that were missed most often first.
    pub fn list(&self) -> Vec<MissedObject> {
        let mut all = self.ended.clone();
        for (count, missed) in self.current.values() {
            if let Some(missed) = missed {
                put(&mut all, MissedObject { evaluable: *count, ..missed.clone() });
            }
        }
        all
    }
}

/// Adds an object behind those that were missed as often.
fn put(list: &mut Vec<MissedObject>, missed: MissedObject) {
    let place = list.partition_point(|other| other.frames >= missed.frames);
    list.insert(place, missed);
}

fn first_missed((scene, weather): (&str, &str), frame: u64, object: &ObjectTruth) -> MissedObject {
    MissedObject {
        scene: scene.into(),
        weather: weather.into(),
        object: object.id,
        class: object.class.name(),
        frame,
        distance_m: tidy(object.distance_m),
        lateral_m: tidy(object.lateral_m),
        width_m: tidy(object.width_m),
        height_m: tidy(object.height_m),
        ..MissedObject::default()
    }
}

/// Frames in which objects were missed, by class.
pub fn by_class(missed: &[MissedObject]) -> BTreeMap<&'static str, usize> {
    let mut counts = BTreeMap::new();
    missed.iter().for_each(|object| *counts.entry(object.class).or_default() += object.frames);
    counts
}

/// One line of numbers by class for a row of a table, then the objects that were missed most often.
pub fn write_missed(f: &mut fmt::Formatter<'_>, row: &str, missed: &[MissedObject]) -> fmt::Result {
    let classes: Vec<String> = by_class(missed).iter().map(|(class, n)| format!("{n} {class}")).collect();
    writeln!(f, "{row}: {}", classes.join(", "))?;
    missed.iter().take(MAX_LISTED).try_for_each(|object| writeln!(f, "  {object}"))?;
    match missed.len().saturating_sub(MAX_LISTED) {
        0 => Ok(()),
        others => writeln!(f, "  others, each in at most {} frames: {others}", missed[MAX_LISTED].frames),
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene_match::{Detection, Evaluable};
    use super::*;
    use perception::region::PixelBox;
    use sources::scene::ObjectClass;

    /// A frame with an object that is missed, or detected.
    fn frame(id: u16, distance_m: f64, is_detected: bool) -> FrameMatch {
        let bounds = PixelBox { x: 1, y: 1, width: 9, height: 9 };
        let object = ObjectTruth {
            id,
            class: ObjectClass::Cone,
            subject: true,
            distance_m,
            lateral_m: -1.28,
            width_m: 0.4,
            height_m: 0.7,
            along_m: 10.0,
            closing_m_s: 0.0,
            bounds,
            pixels: 81,
            visible: 1.0,
            seen_by_both: 1.0,
            in_path: true,
            on_road: true,
        };
        let detection = is_detected.then_some(Detection { bounds, distance_m, sigma_m: 0.1 });
        FrameMatch { evaluable: vec![Evaluable { object, detection }], ..FrameMatch::default() }
    }

    /// An object of each of these scenes, which is missed in as many frames as the seed says and detected in one before.
    fn scenes(seeds: std::ops::Range<u64>) -> MissedObjects {
        let mut sum: Option<MissedObjects> = None;
        for seed in seeds {
            let mut missed = MissedObjects::default();
            let name = format!("random?seed={seed}");
            missed.add((&name, "night"), 99, &frame(7, 13.0, true));
            for k in 0..seed {
                missed.add((&name, "night"), 100 + k, &frame(7, 12.0 - k as f64, false));
            }
            match &mut sum {
                Some(sum) => sum.merge(&missed),
                None => sum = Some(missed),
            }
        }
        sum.unwrap_or_default()
    }

    #[test]
    fn an_object_is_listed_once_with_the_frame_in_which_it_was_missed_first() {
        let list = scenes(3..5).list();
        assert_eq!(
            list.iter().map(|o| (o.frames, o.evaluable, o.frame, o.distance_m)).collect::<Vec<_>>(),
            [(4, 5, 100, 12.0), (3, 4, 100, 12.0)]
        );
        assert_eq!(
            list[0].to_string(),
            "random?seed=4 night: cone, 4 of 5 frames, from frame 100: 12.0 m ahead, 1.3 m left, 0.4 m wide, 0.7 m high"
        );
        assert_eq!(by_class(&list)["cone"], 7);
        assert_eq!(scenes(0..1).list(), [], "nothing is missed");
    }

    #[test]
    fn the_text_names_those_that_were_missed_most_often() {
        struct Text(Vec<MissedObject>);
        impl fmt::Display for Text {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write_missed(f, "random 1-14", &self.0)
            }
        }
        let text = Text(scenes(1..15).list()).to_string();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 14, "{text}");
        assert_eq!(lines[0], "random 1-14: 105 cone");
        assert!(
            lines[1].starts_with("  random?seed=14 ") && lines[12].starts_with("  random?seed=3 "),
            "{text}"
        );
        assert_eq!(lines[13], "  others, each in at most 2 frames: 2");
    }
}
