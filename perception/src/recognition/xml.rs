//! Reads OpenCV's cascade XML (`opencv_storage/cascade`, boosted LBP).
//!
//! Every index is checked here, so that [`Cascade::stages_passed`] needs no checks: features lie
//! within the window, children behind their parents, leaves and features exist.

use super::cascade::{Branch, Cascade, LbpFeature, Node, Stage};
use roxmltree::{Document, Node as XmlNode};
use thiserror::Error;

/// Why a text is not a cascade that can be used. The line is that of the element at fault.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CascadeError {
    /// Not well-formed XML.
    #[error("not well-formed XML: {0}")]
    Xml(String),
    /// An element is missing.
    #[error("line {line}: <{element}> is missing in <{parent}>; is this an OpenCV cascade (new format)?")]
    Missing {
        /// Line of the parent.
        line: u32,
        /// What is missing.
        element: &'static str,
        /// Where it should be.
        parent: String,
    },
    /// A value cannot be used.
    #[error("line {line}: <{element}> is \"{value}\": {expected}")]
    Value {
        /// Line of the element.
        line: u32,
        /// Its name.
        element: String,
        /// Its text, shortened.
        value: String,
        /// What is right.
        expected: String,
    },
}

/// The largest window side that is accepted, in pixels.
const LARGEST_WINDOW: u16 = 512;

/// Reads a cascade from the text of an XML file.
///
/// # Errors
/// Names the line and the element at fault.
pub fn read(text: &str) -> Result<Cascade, CascadeError> {
    let text = without_comments(text);
    let document = Document::parse(&text).map_err(|e| CascadeError::Xml(e.to_string()))?;
    let root = document.root_element();
    let cascade = child(root, "cascade")?;
    expect_text(cascade, "stageType", "BOOST", "only boosted cascades can be read")?;
    expect_text(cascade, "featureType", "LBP", "only LBP cascades can be read")?;
    let side = |name| {
        let element = child(cascade, name)?;
        number::<u16>(element).and_then(|v| {
            let fits = (3..=LARGEST_WINDOW).contains(&v);
            fits.then_some(v)
                .ok_or_else(|| value_error(element, "a window has 3 to 512 pixels a side".into()))
        })
    };
    let (width, height) = (side("width")?, side("height")?);
    let features = items(child(cascade, "features")?)
        .map(|f| feature(f, width, height))
        .collect::<Result<Vec<_>, _>>()?;
    let stages_element = child(cascade, "stages")?;
    let stages = items(stages_element).map(|s| stage(s, features.len())).collect::<Result<Vec<_>, _>>()?;
    if stages.is_empty() {
        return Err(value_error(stages_element, "a cascade has at least one stage".into()));
    }
    Ok(Cascade { width, height, features, stages })
}

/// The text with comments blanked out, lines kept. OpenCV's own files have comments with `--`
/// inside, which XML forbids.
fn without_comments(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find("<!--") {
        let (before, comment) = rest.split_at(start);
        out.push_str(before);
        let end = comment.find("-->").map_or(comment.len(), |at| at + 3);
        out.extend(comment[..end].chars().filter(|&c| c == '\n'));
        rest = &comment[end..];
    }
    out.push_str(rest);
    out
}

fn feature(element: XmlNode<'_, '_>, width: u16, height: u16) -> Result<LbpFeature, CascadeError> {
    let rect = child(element, "rect")?;
    let [x, y, w, h] = numbers::<u16>(rect)?[..] else {
        return Err(value_error(rect, "four numbers: x y width height of the first block".into()));
    };
    let fits = |start: u16, block: u16, side: u16| {
        block > 0 && u32::from(start) + 3 * u32::from(block) <= u32::from(side)
    };
    if !fits(x, w, width) || !fits(y, h, height) {
        return Err(value_error(rect, format!("its 3x3 blocks must lie within the {width}x{height} window")));
    }
    Ok(LbpFeature { x, y, width: w, height: h })
}

fn stage(element: XmlNode<'_, '_>, features: usize) -> Result<Stage, CascadeError> {
    let threshold_element = child(element, "stageThreshold")?;
    let threshold = number::<f32>(threshold_element)?;
    if !threshold.is_finite() {
        return Err(value_error(threshold_element, "a finite number".into()));
    }
    let weak = child(element, "weakClassifiers")?;
    let trees = items(weak).map(|t| tree(t, features)).collect::<Result<Vec<_>, _>>()?;
    if trees.is_empty() {
        return Err(value_error(weak, "a stage has at least one tree".into()));
    }
    Ok(Stage { threshold, trees })
}

fn tree(element: XmlNode<'_, '_>, features: usize) -> Result<Vec<Node>, CascadeError> {
    const ROW: usize = 3 + 8;
    let leaves_element = child(element, "leafValues")?;
    let leaves = numbers::<f32>(leaves_element)?;
    if let Some(bad) = leaves.iter().find(|v| !v.is_finite()) {
        return Err(value_error(leaves_element, format!("{bad} is not a finite number")));
    }
    let nodes_element = child(element, "internalNodes")?;
    let words = numbers::<i64>(nodes_element)?;
    let error = |expected| Err(value_error(nodes_element, expected));
    if words.is_empty() || words.len() % ROW != 0 {
        return error(format!(
            "{} numbers, an LBP node has {ROW}: left right feature and 8 words",
            words.len()
        ));
    }
    let count = words.len() / ROW;
    let mut nodes = Vec::with_capacity(count);
    for (i, row) in words.chunks_exact(ROW).enumerate() {
        let branch = |child: i64| {
            if child > 0 {
                // Behind its parent: a walk always ends.
                let there = child > i as i64 && child < count as i64;
                u16::try_from(child).ok().filter(|_| there).map(Branch::Node)
            } else {
                leaves.get(usize::try_from(child.unsigned_abs()).ok()?).map(|&v| Branch::Leaf(v))
            }
        };
        let (Some(left), Some(right)) = (branch(row[0]), branch(row[1])) else {
            return error(format!("node {i} leads to {} and {}, which are not there", row[0], row[1]));
        };
        let known = |f: &u16| usize::from(*f) < features;
        let Some(feature) = u16::try_from(row[2]).ok().filter(known) else {
            return error(format!("node {i} names feature {} of {features}", row[2]));
        };
        let mut subset = [0; 8];
        for (word, &value) in subset.iter_mut().zip(&row[3..]) {
            // Written as signed, but some writers give unsigned words.
            let Ok(fits) = i32::try_from(value).map(|v| v as u32).or_else(|_| u32::try_from(value)) else {
                return error(format!("{value} is not a 32-bit word"));
            };
            *word = fits;
        }
        nodes.push(Node { feature, subset, left, right });
    }
    Ok(nodes)
}

fn line(element: XmlNode<'_, '_>) -> u32 {
    element.document().text_pos_at(element.range().start).row
}

fn child<'a, 'i>(parent: XmlNode<'a, 'i>, name: &'static str) -> Result<XmlNode<'a, 'i>, CascadeError> {
    parent.children().find(|c| c.has_tag_name(name)).ok_or_else(|| CascadeError::Missing {
        line: line(parent),
        element: name,
        parent: parent.tag_name().name().to_owned(),
    })
}

/// The `<_>` elements of a list.
fn items<'a, 'i>(list: XmlNode<'a, 'i>) -> impl Iterator<Item = XmlNode<'a, 'i>> {
    list.children().filter(|c| c.has_tag_name("_"))
}

fn value_error(element: XmlNode<'_, '_>, expected: String) -> CascadeError {
    let text = element.text().unwrap_or("").trim();
    let mut value: String = text.chars().take(40).collect();
    if value.len() < text.len() {
        value.push('…');
    }
    CascadeError::Value {
        line: line(element),
        element: element.tag_name().name().to_owned(),
        value,
        expected,
    }
}

fn numbers<T: std::str::FromStr>(element: XmlNode<'_, '_>) -> Result<Vec<T>, CascadeError> {
    let text = element.text().unwrap_or("");
    text.split_ascii_whitespace()
        .map(|word| {
            word.parse().map_err(|_| value_error(element, format!("\"{word}\" is not a number that fits")))
        })
        .collect()
}

fn number<T: std::str::FromStr + Copy>(element: XmlNode<'_, '_>) -> Result<T, CascadeError> {
    match numbers(element)?[..] {
        [value] => Ok(value),
        _ => Err(value_error(element, "one number".into())),
    }
}

fn expect_text(
    parent: XmlNode<'_, '_>,
    name: &'static str,
    expected: &str,
    remedy: &str,
) -> Result<(), CascadeError> {
    let element = child(parent, name)?;
    if element.text().map(str::trim) == Some(expected) {
        return Ok(());
    }
    Err(value_error(element, format!("{remedy}: give one with {expected}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "<?xml version=\"1.0\"?>
<opencv_storage>
<cascade>
  <stageType>BOOST</stageType>
  <featureType>LBP</featureType>
  <height>24</height>
  <width>20</width>
  <stages>
    <_>
      <maxWeakCount>1</maxWeakCount>
      <stageThreshold>-5.0e-1</stageThreshold>
      <weakClassifiers>
        <_>
          <internalNodes>1 0 0 -1 -2 3 4 5 6 7 8 -1 -2 0 1 1 1 1 1 1 1 4294967295</internalNodes>
          <leafValues>-7.5e-01 0.5 1.</leafValues></_></weakClassifiers></_></stages>
  <features>
    <_><rect>1 2 5 7</rect></_></features></cascade>
</opencv_storage>";

    #[test]
    fn a_cascade_is_read_as_written() {
        let cascade = read(GOOD).unwrap();
        assert_eq!((cascade.width, cascade.height), (20, 24));
        assert_eq!(cascade.features, [LbpFeature { x: 1, y: 2, width: 5, height: 7 }]);
        let tree = &cascade.stages[0].trees[0];
        assert_eq!(cascade.stages[0].threshold, -0.5);
        assert_eq!((tree[0].left, tree[0].right), (Branch::Node(1), Branch::Leaf(-0.75)));
        assert_eq!(tree[0].subset[..3], [u32::MAX, u32::MAX - 1, 3]);
        assert_eq!((tree[1].left, tree[1].right), (Branch::Leaf(0.5), Branch::Leaf(1.0)));
        // Leaf 1 is written as −1, leaf 2 as −2.
    }

    #[test]
    fn comments_that_xml_forbids_are_passed_over_and_lines_still_count() {
        let comment = "<cascade>\n<!-- by\n--==-- someone -->\n<!-- unfinished";
        let commented = GOOD.replace("<cascade>", &comment[..comment.len() - 16]);
        assert_eq!(read(&commented).unwrap(), read(GOOD).unwrap());
        let error = read(&commented.replace("<height>24", "<height>2")).unwrap_err().to_string();
        assert!(error.contains("line 8"), "{error}");
        assert!(read(&GOOD.replace("<cascade>", comment)).is_err());
    }

    #[test]
    fn every_fault_is_named_with_its_line() {
        for (from, to, expected) in [
            ("</opencv_storage>", "", "not well-formed"),
            ("<featureType>LBP", "<featureType>HAAR", "line 5: <featureType> is \"HAAR\": only LBP"),
            ("<stageType>BOOST</stageType>", "", "line 3: <stageType> is missing in <cascade>"),
            ("<height>24", "<height>2", "line 6"),
            ("<width>20", "<width>twenty", "\"twenty\" is not a number"),
            ("1 2 5 7", "1 2 7 7", "within the 20x24 window"),
            ("1 2 5 7", "1 2 5", "four numbers"),
            ("1 2 5 7", "65535 2 21845 7", "within the 20x24 window"),
            ("1 0 0 -1", "0 0 1 -1", "names feature 1 of 1"),
            ("1 0 0 -1", "2 0 0 -1", "leads to 2 and 0"),
            ("8 -1 -2 0", "8 1 -2 0", "node 1 leads to 1 and -2"),
            ("8 -1 -2 0", "8 -9 -2 0", "node 1 leads to -9"),
            ("8 -1 -2 0", "8 -9223372036854775808 -2 0", "node 1 leads to -9223372036854775808"),
            ("8 -1 -2 0", "8 65536 -2 0", "node 1 leads to 65536"),
            ("4294967295", "4294967296", "32-bit word"),
            ("4294967295", "", "21 numbers"),
            ("-5.0e-1", "nan", "finite"),
            ("0.5 1.", "0.5 inf", "finite"),
            ("cascade>", "other>", "<cascade> is missing"),
        ] {
            assert!(GOOD.contains(from), "{from}");
            let error = read(&GOOD.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(expected), "{from} -> {to}: {error}");
        }
    }

    #[test]
    fn no_truncation_panics() {
        for end in (0..GOOD.len()).filter(|&i| GOOD.is_char_boundary(i)) {
            assert!(read(&GOOD[..end]).is_err());
        }
    }
}
