//! Text from outside, such as names of files, in lines for people: one line stays one line, and nothing in it commands
//! the terminal or reverses the order of what is read.

use std::fmt::{self, Display, Write};

/// Shows text with escaped control characters: a line break as `\n`, others as `\u{1b}`.
pub struct Printable<T>(pub T);

impl<T: Display> Display for Printable<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(Escaping(f), "{}", self.0)
    }
}

/// Shows text of several lines, each as [`Printable`] does.
pub struct PrintableLines<T>(pub T);

impl<T: Display> Display for PrintableLines<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = self.0.to_string();
        for (i, line) in text.split('\n').enumerate() {
            if i > 0 {
                f.write_char('\n')?;
            }
            write!(Escaping(&mut *f), "{line}")?;
        }
        Ok(())
    }
}

/// Writes text with escaped control characters.
pub struct Escaping<W>(pub W);

/// Whether a character is escaped: a control character, a separator of lines, or one that changes the direction of text.
fn is_control(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{2028}' | '\u{2029}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

impl<W: Write> Write for Escaping<W> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let mut rest = text;
        while let Some(at) = rest.find(is_control) {
            let (before, from) = rest.split_at(at);
            self.0.write_str(before)?;
            let mut characters = from.chars();
            if let Some(control) = characters.next() {
                write!(self.0, "{}", control.escape_debug())?;
            }
            rest = characters.as_str();
        }
        self.0.write_str(rest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_line_stays_one_line() {
        let forged = "a\nERROR scheduler: forged\r\t\u{1b}[2J\u{9b}31m\u{7f}\0\u{2028}\u{202e}ü\\n";
        let text = Printable(forged).to_string();
        assert_eq!(
            text,
            "a\\nERROR scheduler: forged\\r\\t\\u{1b}[2J\\u{9b}31m\\u{7f}\\0\\u{2028}\\u{202e}ü\\n"
        );
        assert_eq!(PrintableLines("a\nb\r\u{1b}").to_string(), "a\nb\\r\\u{1b}");
        assert_eq!(Printable("").to_string(), "");
    }
}
