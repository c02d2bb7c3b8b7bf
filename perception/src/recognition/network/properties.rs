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

/// How wide things of a class are at least up to a height.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SizeStep {
    max_height_m: f64,
    /// Smallest width, as a share of the height.
    min_width_share: f64,
}

/// The sizes that things of a class have: steps of growing height; higher than the last one is nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClassSize {
    steps: Vec<SizeStep>,
}

impl ClassSize {
    /// Whether something of this width and height may be of the class; without steps anything may.
    pub fn fits(&self, width_m: f64, height_m: f64) -> bool {
        let step = self.steps.iter().find(|step| height_m <= step.max_height_m);
        step.map_or(self.steps.is_empty(), |step| width_m >= step.min_width_share * height_m)
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
/// If one names no class, or is not followed by pairs of numbers in order.
pub fn sizes(properties: &[Property], labels: &[String]) -> Result<Vec<ClassSize>, NetworkError> {
    let mut sizes = vec![ClassSize::default(); labels.len()];
    let text = property(properties, "sizes").unwrap_or_default();
    for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
        let Some((label, size)) = class_size(part, labels) else {
            return Err(NetworkError::Property {
                name: "sizes",
                value: excerpt(part, VALUE_CHARS).into_owned(),
                expected: "a label, a height in metres, and the smallest width up to there as a share of the height; \
                           if need be more such pairs of growing height"
                    .into(),
            });
        };
        sizes[label] = size;
    }
    Ok(sizes)
}

/// The index of the label with which a text begins, and the steps after it. A label may have spaces, and end in a number.
fn class_size(text: &str, labels: &[String]) -> Option<(usize, ClassSize)> {
    let of = |(label, name): (usize, &String)| {
        let rest = text.strip_prefix(&name[..]).filter(|rest| rest.starts_with(char::is_whitespace))?;
        Some((label, ClassSize { steps: size_steps(rest)? }))
    };
    labels.iter().enumerate().find_map(of)
}

/// Pairs of a height and a width as a share of it, in order of heights.
fn size_steps(text: &str) -> Option<Vec<SizeStep>> {
    let number = |word: &str| word.parse::<f64>().ok().filter(|v| (0.0..=100.0).contains(v));
    let numbers: Vec<f64> = text.split_whitespace().map(number).collect::<Option<_>>()?;
    let (pairs, []) = numbers.as_chunks::<2>() else { return None };
    let step = |&[max_height_m, min_width_share]: &[f64; 2]| SizeStep { max_height_m, min_width_share };
    let steps: Vec<SizeStep> = pairs.iter().map(step).collect();
    let is_in_order = steps.is_sorted_by(|a, b| a.max_height_m < b.max_height_m);
    (is_in_order && !steps.is_empty()).then_some(steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Option<(usize, ClassSize)> {
        class_size(text, &["car", "car 2", "fire engine"].map(String::from))
    }

    #[test]
    fn a_label_may_have_spaces_and_end_in_a_number() {
        let label = |text: &str| read(text).map(|(label, size)| (label, size.steps.len()));
        assert_eq!(label("car 2 0.5"), Some((0, 1)));
        assert_eq!(label("car 2 2 0.5"), Some((1, 1)));
        assert_eq!(label("car 2 0.5 3 0.6"), Some((0, 2)));
        assert_eq!(label("fire engine\t3.5  0.4"), Some((2, 1)));
    }

    #[test]
    fn what_is_no_list_of_sizes_is_refused() {
        for text in ["", "car", "car ", "car 1 2 3 x", "cart 2 1", "fire engine 2", "fire engine 3 1 2 1"] {
            assert_eq!(read(text), None, "{text}");
        }
    }
}
