//! Reads and writes OpenCV's cascade XML: boosted LBP and Haar cascades in the format of OpenCV's trainer
//! (`opencv_storage/cascade`), and Haar cascades in the older format.
//!
//! All indices are validated here, so that the evaluation needs no checks: features lie within the window,
//! children follow their parents, leaves and features exist.

mod current;
mod element;
mod limits;
mod old;
mod write;

use super::cascade::Cascade;
use crate::excerpt::{REASON_CHARS, VALUE_CHARS, excerpt};
pub use element::CascadeError;
use element::line;
pub use limits::{MAX_BYTES, MAX_DEPTH, MAX_ELEMENTS, MAX_NODES, MAX_TAG_BYTES};
use roxmltree::{Document, Node as XmlNode, ParsingOptions};
pub use write::{TrainedWith, write};

/// Reads a cascade from the text of an XML file, in either format.
///
/// # Errors
/// If the text is not a supported cascade; the error names line and element.
pub fn read(text: &str) -> Result<Cascade, CascadeError> {
    if text.len() as u64 > MAX_BYTES {
        let (count, limit) = (text.len(), MAX_BYTES as usize);
        return Err(CascadeError::TooLarge { line: 1, what: "bytes", count, limit });
    }
    let text = without_comments(text);
    limits::check(&text)?;
    let options = ParsingOptions { nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(&text, options)
        .map_err(|e| CascadeError::Xml(excerpt(&e.to_string(), REASON_CHARS).into_owned()))?;
    let root = document.root_element();
    // The older format is identified by an attribute; the element's name is arbitrary.
    let elements = || root.children().filter(XmlNode::is_element);
    if let Some(cascade) = elements().find(|e| e.attribute("type_id") == Some("opencv-haar-classifier")) {
        return old::read(cascade);
    }
    let cascade = elements().find(|e| e.has_tag_name("cascade")).ok_or_else(|| CascadeError::Missing {
        line: line(root),
        element: "cascade",
        parent: excerpt(root.tag_name().name(), VALUE_CHARS).into_owned(),
    })?;
    current::read(cascade)
}

/// The text without comments, with line breaks kept. OpenCV's own files have comments that contain `--`, which
/// XML forbids.
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

#[cfg(test)]
mod tests {
    use super::super::cascade::{Branch, Features, LbpFeature, Split};
    use super::*;

    pub(super) const GOOD: &str = "<?xml version=\"1.0\"?>
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
        assert_eq!(cascade.features, Features::Lbp(vec![LbpFeature { x: 1, y: 2, width: 5, height: 7 }]));
        let tree = &cascade.stages[0].trees[0];
        assert_eq!(cascade.stages[0].threshold, -0.5);
        assert_eq!((tree[0].left, tree[0].right), (Branch::Node(1), Branch::Leaf(-0.75)));
        let Split::Subset(subset) = tree[0].split else { panic!("{:?}", tree[0].split) };
        assert_eq!(subset[..3], [u32::MAX, u32::MAX - 1, 3]);
        assert_eq!((tree[1].left, tree[1].right), (Branch::Leaf(0.5), Branch::Leaf(1.0)));
        // Leaf 1 is written as −1, leaf 2 as −2.
    }

    #[test]
    fn comments_that_xml_forbids_are_skipped_and_lines_still_count() {
        let comment = "<cascade>\n<!-- by\n--==-- someone -->\n<!-- unfinished";
        let commented = GOOD.replace("<cascade>", &comment[..comment.len() - 16]);
        assert_eq!(read(&commented).unwrap(), read(GOOD).unwrap());
        let error = read(&commented.replace("<height>24", "<height>2")).unwrap_err().to_string();
        assert!(error.contains("line 8"), "{error}");
        assert!(read(&GOOD.replace("<cascade>", comment)).is_err());
    }

    #[test]
    fn errors_name_the_line() {
        for (from, to, expected) in [
            ("</opencv_storage>", "", "not well-formed"),
            ("<featureType>LBP", "<featureType>HOG", "line 5: <featureType> is \"HOG\": only LBP and HAAR"),
            ("<stageType>BOOST</stageType>", "", "line 3: <stageType> is missing in <cascade>"),
            ("<height>24", "<height>2", "line 6"),
            ("<width>20", "<width>twenty", "\"twenty\" is not a number"),
            ("1 2 5 7", "1 2 7 7", "within the 20x24 window"),
            ("1 2 5 7", "1 2 5", "four numbers"),
            ("1 2 5 7", "65535 2 21845 7", "within the 20x24 window"),
            ("1 0 0 -1", "0 0 1 -1", "refers to feature 1 of 1"),
            ("1 0 0 -1", "2 0 0 -1", "leads to 2 and 0"),
            ("8 -1 -2 0", "8 1 -2 0", "node 1 leads to 1 and -2"),
            ("8 -1 -2 0", "8 -9 -2 0", "node 1 leads to -9"),
            ("8 -1 -2 0", "8 -9223372036854775808 -2 0", "node 1 leads to -9223372036854776000"),
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
