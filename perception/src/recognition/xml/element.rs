//! Validated access to XML elements, shared by both formats.

use super::super::cascade::{HaarFeature, WeightedRect};
use crate::excerpt::{VALUE_CHARS, excerpt};
use roxmltree::Node as XmlNode;
use thiserror::Error;

/// Errors of reading a cascade. The line is that of the invalid element.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CascadeError {
    /// Not well-formed XML.
    #[error("not well-formed XML: {0}")]
    Xml(String),
    /// More than a cascade has.
    #[error(
        "line {line}: {count} {what}: a cascade has at most {limit}; give one that OpenCV's trainer wrote"
    )]
    TooLarge {
        /// Line that is beyond the limit.
        line: u32,
        /// What is counted.
        what: &'static str,
        /// How much there is.
        count: usize,
        /// How much there may be.
        limit: usize,
    },
    /// An element is missing.
    #[error("line {line}: <{element}> is missing in <{parent}>; is this an OpenCV cascade?")]
    Missing {
        /// Line of the parent.
        line: u32,
        /// Name of the missing element.
        element: &'static str,
        /// Name of its parent.
        parent: String,
    },
    /// A value is invalid.
    #[error("line {line}: <{element}> is \"{value}\": {expected}")]
    Value {
        /// Line of the element.
        line: u32,
        /// Name of the element.
        element: String,
        /// Text of the element, shortened.
        value: String,
        /// What is expected instead.
        expected: String,
    },
}

/// Maximum side of a window, in pixels.
const MAX_WINDOW: u16 = 512;

/// Checks a window side.
pub(super) fn side(element: XmlNode<'_, '_>, value: Option<u16>, min: u16) -> Result<u16, CascadeError> {
    value
        .filter(|v| (min..=MAX_WINDOW).contains(v))
        .ok_or_else(|| value_error(element, format!("a window has {min} to {MAX_WINDOW} pixels a side")))
}

/// A Haar feature from its `<rects>` and `<tilted>`.
pub(super) fn haar_feature(
    element: XmlNode<'_, '_>,
    width: u16,
    height: u16,
) -> Result<HaarFeature, CascadeError> {
    let tilted = match element.children().find(|c| c.has_tag_name("tilted")) {
        Some(tilted) => number::<i64>(tilted)? != 0,
        None => false,
    };
    let list = child(element, "rects")?;
    let mut rects = [WeightedRect::default(); 3];
    let mut count = 0;
    for rect in items(list) {
        let values = numbers::<f64>(rect)?;
        let whole =
            |v: f64| (v.fract() == 0.0 && (0.0..=f64::from(MAX_WINDOW)).contains(&v)).then_some(v as u16);
        let parts = match values[..] {
            [x, y, w, h, weight] => Some((whole(x), whole(y), whole(w), whole(h), weight as f32)),
            _ => None,
        };
        let Some((Some(x), Some(y), Some(w), Some(h), weight)) = parts else {
            return Err(value_error(rect, "five numbers: x y width height weight".into()));
        };
        if !weight.is_finite() || weight == 0.0 {
            return Err(value_error(rect, "a weight is a finite number and not 0".into()));
        }
        let inside = if tilted {
            h <= x && x + w <= width && y + w + h <= height
        } else {
            x + w <= width && y + h <= height
        };
        if !inside || w == 0 || h == 0 {
            let what = if tilted { "tilted rectangle" } else { "rectangle" };
            return Err(value_error(rect, format!("a {what} must lie within the {width}x{height} window")));
        }
        let Some(place) = rects.get_mut(count) else {
            return Err(value_error(list, "a Haar feature has one to three rectangles".into()));
        };
        *place = WeightedRect { x, y, width: w, height: h, weight };
        count += 1;
    }
    if count == 0 {
        return Err(value_error(list, "a Haar feature has one to three rectangles".into()));
    }
    Ok(HaarFeature { rects, tilted })
}

/// A single-precision number, parsed in double precision like OpenCV does.
pub(super) fn single(element: XmlNode<'_, '_>) -> Result<f32, CascadeError> {
    let value = number::<f64>(element)? as f32;
    if value.is_finite() { Ok(value) } else { Err(value_error(element, "a finite number".into())) }
}

pub(super) fn line(element: XmlNode<'_, '_>) -> u32 {
    element.document().text_pos_at(element.range().start).row
}

pub(super) fn child<'a, 'i>(
    parent: XmlNode<'a, 'i>,
    name: &'static str,
) -> Result<XmlNode<'a, 'i>, CascadeError> {
    parent.children().find(|c| c.has_tag_name(name)).ok_or_else(|| CascadeError::Missing {
        line: line(parent),
        element: name,
        parent: excerpt(parent.tag_name().name(), VALUE_CHARS).into_owned(),
    })
}

/// The `<_>` elements of a list.
pub(super) fn items<'a, 'i>(list: XmlNode<'a, 'i>) -> impl Iterator<Item = XmlNode<'a, 'i>> {
    list.children().filter(|c| c.has_tag_name("_"))
}

pub(super) fn value_error(element: XmlNode<'_, '_>, expected: String) -> CascadeError {
    let text = element.text().unwrap_or("").trim();
    let mut value: String = text.chars().take(40).collect();
    if value.len() < text.len() {
        value.push('…');
    }
    CascadeError::Value {
        line: line(element),
        element: excerpt(element.tag_name().name(), VALUE_CHARS).into_owned(),
        value,
        expected,
    }
}

pub(super) fn numbers<T: std::str::FromStr>(element: XmlNode<'_, '_>) -> Result<Vec<T>, CascadeError> {
    let text = element.text().unwrap_or("");
    text.split_ascii_whitespace()
        .map(|word| {
            word.parse().map_err(|_| {
                let word = excerpt(word, VALUE_CHARS);
                value_error(element, format!("\"{word}\" is not a number that fits"))
            })
        })
        .collect()
}

pub(super) fn number<T: std::str::FromStr + Copy>(element: XmlNode<'_, '_>) -> Result<T, CascadeError> {
    match numbers(element)?[..] {
        [value] => Ok(value),
        _ => Err(value_error(element, "one number".into())),
    }
}
