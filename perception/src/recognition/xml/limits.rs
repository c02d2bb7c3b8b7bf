//! What the reader of cascades takes at most, checked on the text before it is parsed: the XML parser compares all
//! attributes of an element with each other, and copies the namespaces of its parents.

use super::element::CascadeError;

/// Bytes of a file. OpenCV's `haarcascade_frontalface_default.xml` has 0.9 MB.
pub const MAX_BYTES: u64 = 16 << 20;

/// Bytes of a tag. The longest of OpenCV's cascades has 45. Within 1024 fit at most some hundred attributes.
pub const MAX_TAG_BYTES: usize = 1024;

/// Nesting of elements. OpenCV's cascades have 7 levels, the older format has 9.
pub const MAX_DEPTH: usize = 32;

/// Elements of a file. OpenCV's `haarcascade_frontalface_default.xml` has 21,061.
pub const MAX_ELEMENTS: usize = 500_000;

/// Nodes of the parsed document: elements and the texts between them.
pub const MAX_NODES: u32 = 3 * MAX_ELEMENTS as u32;

/// Checks a text without comments.
pub(super) fn check(text: &str) -> Result<(), CascadeError> {
    let (mut depth, mut elements) = (0_usize, 0);
    let mut at = 0;
    while let Some(start) = text[at..].find('<').map(|i| at + i) {
        let rest = &text[start..];
        let beyond = |what, count, limit| {
            let line = 1 + text.as_bytes()[..start].iter().filter(|&&b| b == b'\n').count();
            CascadeError::TooLarge { line: line as u32, what, count, limit }
        };
        let skip = |end: &str| rest.find(end).map_or(rest.len(), |i| i + end.len());
        at = start
            + if rest.starts_with("<![CDATA[") {
                skip("]]>")
            } else if rest.starts_with("<?") {
                skip("?>")
            } else {
                let length = tag_length(rest.as_bytes());
                if length > MAX_TAG_BYTES {
                    return Err(beyond("bytes in a tag", length, MAX_TAG_BYTES));
                }
                let tag = &rest[..length];
                if tag.starts_with("</") {
                    depth = depth.saturating_sub(1);
                } else {
                    elements += 1;
                    depth += usize::from(!tag.ends_with("/>"));
                }
                length
            };
        if depth > MAX_DEPTH {
            return Err(beyond("nested elements", depth, MAX_DEPTH));
        }
        if elements > MAX_ELEMENTS {
            return Err(beyond("elements", elements, MAX_ELEMENTS));
        }
    }
    Ok(())
}

/// Bytes of the tag at the start of a text, to its `>` outside of quotation marks.
fn tag_length(text: &[u8]) -> usize {
    let mut quote = None;
    for (i, &b) in text.iter().enumerate() {
        match (quote, b) {
            (None, b'>') => return i + 1,
            (None, b'"' | b'\'') => quote = Some(b),
            (Some(open), _) if b == open => quote = None,
            _ => {}
        }
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::super::{read, tests::GOOD};

    fn fault(text: &str) -> String {
        read(text).unwrap_err().to_string()
    }

    #[test]
    fn texts_beyond_the_limits_are_refused_before_they_are_parsed() {
        let attributes: String = (0..300_000).map(|i| format!(" a{i}=\"\"")).collect();
        let text = fault(&GOOD.replace("<cascade>", &format!("<cascade{attributes}>")));
        assert!(
            text.starts_with("line 3: ") && text.contains(" bytes in a tag: a cascade has at most 1024"),
            "{text}"
        );
        let deep = "<a xmlns:n=\"x\">".repeat(100_000);
        assert!(fault(&deep).contains("33 nested elements: a cascade has at most 32"), "{}", fault(&deep));
        let many = format!("<opencv_storage>{}", "<_/>".repeat(600_000));
        assert!(fault(&many).contains("500001 elements: a cascade has at most 500000"), "{}", fault(&many));
        let large = " ".repeat(17 << 20);
        assert!(
            fault(&large).contains("17825792 bytes: a cascade has at most 16777216"),
            "{}",
            fault(&large)
        );
        // A `>` in quotation marks ends no tag.
        let hidden = format!("<a b=\">\" c='{}'/>", ">".repeat(2000));
        assert!(fault(&hidden).contains("bytes in a tag"), "{}", fault(&hidden));
    }

    #[test]
    fn errors_repeat_no_more_than_an_excerpt() {
        let long = "x".repeat(1 << 20);
        for text in [
            GOOD.replace("1 2 5 7", &long),
            GOOD.replace("<featureType>LBP", &format!("<featureType>{long}")),
            GOOD.replace("</opencv_storage>", &format!("</opencv_storage>{long}")),
            format!("<{}/>", &long[..1000]),
        ] {
            assert!(fault(&text).len() < 1300, "{}", fault(&text).len());
        }
        let numbers = GOOD.replace("1 2 5 7", &"1 ".repeat(1 << 20));
        assert!(fault(&numbers).contains("four numbers"), "{}", fault(&numbers));
    }
}
