//! What an ONNX file says of its classes beside the graph: names, sizes, and the margin around a region.

use super::error::NetworkError;
use super::onnx::Property;
use crate::excerpt::{VALUE_CHARS, excerpt};
use crate::recognition::MAX_CLASSES;

/// Bytes of a label.
const MAX_LABEL: usize = 15;

/// Label of what belongs to no class.
pub const OTHER: &str = "other";

/// Margin where the file names none.
const DEFAULT_MARGIN: f32 = 0.1;

/// The sizes that things of a class have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassSize {
    /// Largest height, in metres.
    pub max_height_m: f64,
    /// Smallest width, as a share of the height.
    pub min_width_share: f64,
}

impl ClassSize {
    /// Any size.
    pub const ANY: Self = Self { max_height_m: f64::INFINITY, min_width_share: 0.0 };

    /// Whether something of this width and height may be of the class.
    pub fn fits(&self, width_m: f64, height_m: f64) -> bool {
        height_m <= self.max_height_m && width_m >= self.min_width_share * height_m
    }
}

fn property<'m>(properties: &'m [Property], name: &str) -> Option<&'m str> {
    properties.iter().find(|p| p.key == name).map(|p| &p.value[..])
}

/// The names of `count` classes.
///
/// # Errors
/// If there are not as many, or one is no name.
pub fn labels(properties: &[Property], count: usize) -> Result<Vec<String>, NetworkError> {
    let text = property(properties, "labels").unwrap_or_default();
    let labels: Vec<String> = text.split(',').map(|label| label.trim().to_owned()).collect();
    let is_name = |label: &String| {
        (1..=MAX_LABEL).contains(&label.len()) && label.bytes().all(|b| b.is_ascii_graphic() || b == b' ')
    };
    let classes = labels.iter().filter(|label| *label != OTHER).count();
    let is_twice = |i: usize| labels[..i].contains(&labels[i]);
    if labels.len() != count
        || count < 2
        || !(1..=MAX_CLASSES).contains(&classes)
        || !labels.iter().all(is_name)
        || (0..count).any(is_twice)
    {
        return Err(NetworkError::Property {
            name: "labels",
            value: excerpt(text, VALUE_CHARS).into_owned(),
            expected: format!(
                "a name for each number of the output, separated by commas, at most {MAX_CLASSES} besides {OTHER:?}, each of at \
                 most {MAX_LABEL} characters"
            )
            .into(),
        });
    }
    Ok(labels)
}

/// The margin on each side, as a share of that side.
///
/// # Errors
/// If it is no number from 0 to 1.
pub fn margin(properties: &[Property]) -> Result<f32, NetworkError> {
    let Some(text) = property(properties, "margin") else { return Ok(DEFAULT_MARGIN) };
    let value = text.parse::<f32>().ok().filter(|v| (0.0..=1.0).contains(v));
    value.ok_or_else(|| NetworkError::Property {
        name: "margin",
        value: excerpt(text, VALUE_CHARS).into_owned(),
        expected: "a number from 0 to 1".into(),
    })
}

/// The sizes of the classes.
///
/// # Errors
/// If one names no class, or has no two numbers.
pub fn sizes(properties: &[Property], labels: &[String]) -> Result<Vec<ClassSize>, NetworkError> {
    let mut sizes = vec![ClassSize::ANY; labels.len()];
    let text = property(properties, "sizes").unwrap_or_default();
    for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
        // A label may have spaces.
        let mut words = part.rsplitn(3, ' ');
        let mut number = || words.next()?.parse::<f64>().ok().filter(|v| (0.0..=100.0).contains(v));
        let read = number().zip(number());
        let label = words.next().and_then(|name| labels.iter().position(|label| label == name));
        let Some(((min_width_share, max_height_m), label)) = read.zip(label) else {
            return Err(NetworkError::Property {
                name: "sizes",
                value: excerpt(part, VALUE_CHARS).into_owned(),
                expected:
                    "a label, its largest height in metres, and its smallest width as a share of its height"
                        .into(),
            });
        };
        sizes[label] = ClassSize { max_height_m, min_width_share };
    }
    Ok(sizes)
}
