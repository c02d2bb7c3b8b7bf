//! Classes that detectors tell of KITTI's labels, by distance.

use serde::Serialize;
use std::fmt;

/// A class with its probability.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Told {
    /// Name of the class.
    pub class: String,
    /// Its probability after one look.
    pub probability: f64,
}

/// The class of a KITTI label; `None` for what no detector knows.
pub fn right_class(label: &str) -> Option<&'static str> {
    match label {
        "Car" | "Van" | "Truck" | "Tram" => Some("vehicle"),
        "Pedestrian" | "Person_sitting" => Some("pedestrian"),
        "Cyclist" => Some("rider"),
        _ => None,
    }
}

/// Labels of a class, by distance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClassRow {
    /// Name of the class.
    pub class: String,
    /// Farthest distance, in metres; of the last row there is none.
    pub to_m: Option<f64>,
    /// Labels in sight: at most partly occluded, at most half of them cut by the border.
    pub due: usize,
    /// Those that are told their class.
    pub right: usize,
    /// Those that are told another class.
    pub wrong: usize,
}

/// Ends of the rows of distances, in metres.
const CLASS_ROWS_M: [Option<f64>; 3] = [Some(15.0), Some(30.0), None];

/// The classes of labels in sight by distance, without rows of which there are none: for each label KITTI's class, its distance
/// in metres, and what was told.
pub fn classes(labels: &[(&str, f64, Option<&Told>)]) -> Vec<ClassRow> {
    let mut rows = Vec::new();
    for class in ["vehicle", "pedestrian", "rider"] {
        let mut from_m = 0.0;
        for to_m in CLASS_ROWS_M {
            let within = from_m..to_m.unwrap_or(f64::INFINITY);
            let of =
                labels.iter().filter(|(label, m, _)| right_class(label) == Some(class) && within.contains(m));
            let told: Vec<Option<&Told>> = of.map(|(_, _, told)| *told).collect();
            let right = told.iter().flatten().filter(|told| told.class == class).count();
            let wrong = told.iter().flatten().count() - right;
            if !told.is_empty() {
                rows.push(ClassRow { class: class.to_owned(), to_m, due: told.len(), right, wrong });
            }
            from_m = within.end;
        }
    }
    rows
}

impl fmt::Display for ClassRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { class, to_m, due, right, wrong } = self;
        let to = to_m.map_or("beyond".into(), |m| format!("up to {m} m"));
        write!(f, "class {class} {to}: {right} of {due} told, {wrong} told another class")
    }
}
