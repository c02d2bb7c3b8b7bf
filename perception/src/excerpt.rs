//! Text from outside in error messages: shortened, on one line. A damaged file may hold megabytes where a word belongs,
//! and a line break in a value must not look like a new line of a log.

use std::borrow::Cow;

/// Characters of a value or a name that an error repeats: enough to find it in the file.
pub const VALUE_CHARS: usize = 60;

/// Characters of a parser's own message, which may list all known names.
pub const REASON_CHARS: usize = 1000;

/// The first `most` characters of a text, with `…` where it goes on. Control characters are escaped.
///
/// ```
/// use lookout_perception::excerpt::excerpt;
/// assert_eq!(excerpt("abcdef", 3), "abc…");
/// assert_eq!(excerpt("a\nb", 3), "a\\nb");
/// ```
pub fn excerpt(text: &str, most: usize) -> Cow<'_, str> {
    let end = text.char_indices().nth(most).map_or(text.len(), |(at, _)| at);
    let kept = &text[..end];
    if end == text.len() && !kept.contains(char::is_control) {
        return Cow::Borrowed(kept);
    }
    let mut out = String::with_capacity(kept.len() + 8);
    for c in kept.chars() {
        if c.is_control() { out.extend(c.escape_default()) } else { out.push(c) }
    }
    if end < text.len() {
        out.push('…');
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_are_cut_between_characters_and_control_characters_are_escaped() {
        assert!(matches!(excerpt("short", 5), Cow::Borrowed("short")));
        assert_eq!(excerpt("äöü", 2), "äö…");
        assert_eq!(excerpt("a\u{1b}[31m", 60), "a\\u{1b}[31m");
        assert_eq!(excerpt(&"x".repeat(1 << 20), VALUE_CHARS).chars().count(), VALUE_CHARS + 1);
        assert_eq!(excerpt("", 0), "");
    }
}
