//! The part of a DBC file that is needed: messages (`BO_`) and their signals (`SG_`). Everything else is skipped.

use super::error::VehicleError;
use super::signal::{Signal, frame_id};
use crate::bounded_file::read;
use crate::limits::DBC;
use perception::excerpt::{VALUE_CHARS, excerpt};
use std::path::{Path, PathBuf};

/// Names that an error lists.
const MAX_LISTED: usize = 12;

/// A DBC file.
#[derive(Clone, Debug)]
pub struct Dbc {
    path: PathBuf,
    text: String,
}

/// A line `BO_ id name: bytes sender`.
struct Message<'a> {
    line: usize,
    id: &'a str,
    name: &'a str,
    bytes: &'a str,
}

/// A line `SG_ name multiplexing : layout`.
struct SignalLine<'a> {
    line: usize,
    name: &'a str,
    multiplexing: &'a str,
    layout: &'a str,
}

enum Line<'a> {
    Message(Message<'a>),
    Signal(SignalLine<'a>),
    /// `SIG_VALTYPE_ id name : type`: a floating-point number.
    Float {
        id: &'a str,
        name: &'a str,
    },
}

impl Dbc {
    /// Reads a file. The text may be UTF-8 or, as most of these files are, Latin-1.
    ///
    /// # Errors
    /// When it cannot be read, or is too large.
    pub fn read(path: &Path) -> Result<Self, VehicleError> {
        let bytes = read(path, &DBC).map_err(|source| VehicleError::Io { path: path.to_owned(), source })?;
        let text = String::from_utf8(bytes)
            .unwrap_or_else(|error| error.into_bytes().into_iter().map(char::from).collect());
        Ok(Self { path: path.to_owned(), text })
    }

    /// The signal `Message.Signal`.
    ///
    /// # Errors
    /// Names the file, the line where there is one, and the remedy.
    pub fn signal(&self, name: &str) -> Result<Signal, String> {
        let Some((message_name, signal_name)) = name.split_once('.') else {
            return Err("no dot: give Message.Signal".into());
        };
        let (message_name, signal_name) = (message_name.trim(), signal_name.trim());
        let at = |line: usize, reason: String| format!("{}: line {line}: {reason}", self.path.display());
        let mut message: Option<Message<'_>> = None;
        let mut found: Option<(SignalLine<'_>, Message<'_>)> = None;
        let (mut messages, mut signals) = (Vec::new(), Vec::new());
        let mut floats = Vec::new();
        for line in lines(&self.text) {
            match line {
                Line::Message(next) => {
                    messages.push(next.name);
                    message = Some(next);
                }
                Line::Signal(signal) => {
                    let Some(of) = message.as_ref().filter(|m| m.name == message_name) else { continue };
                    signals.push(signal.name);
                    if signal.name == signal_name && found.is_none() {
                        found = Some((signal, Message { ..*of }));
                    }
                }
                Line::Float { id, name } => floats.push((id, name)),
            }
        }
        let path = self.path.display();
        let Some((signal, message)) = found else {
            return Err(if messages.contains(&message_name) {
                format!(
                    "{path}: message {message_name} has no signal {signal_name}; it has {}",
                    listed(&signals)
                )
            } else {
                format!("{path}: no message {message_name}; the file has {}", listed(&messages))
            });
        };
        if signal.multiplexing.starts_with('m') {
            return Err(at(
                signal.line,
                format!("signal {signal_name} is multiplexed, which is not supported: name another signal"),
            ));
        }
        if floats.contains(&(message.id, signal.name)) {
            return Err(at(
                signal.line,
                format!(
                    "signal {signal_name} is a floating-point number, which is not supported: name another signal"
                ),
            ));
        }
        let bytes: usize = message
            .bytes
            .parse()
            .map_err(|_| at(message.line, format!("the length of message {message_name} is not a number")))?;
        let id = message.id.parse().map_err(|_| {
            at(message.line, format!("the identifier of message {message_name} is not a number"))
        });
        let id = frame_id(id?).map_err(|reason| at(message.line, reason))?;
        let read = Signal::of_layout(id, signal.layout).map_err(|reason| at(signal.line, reason))?;
        if read.bytes().is_none_or(|needed| needed > bytes) {
            return Err(at(
                signal.line,
                format!("signal {signal_name} ends beyond the {bytes} bytes of its message"),
            ));
        }
        Ok(read)
    }
}

/// The first names, for an error.
fn listed(names: &[&str]) -> String {
    if names.is_empty() {
        return "none".into();
    }
    let shown: Vec<_> = names.iter().take(MAX_LISTED).map(|name| excerpt(name, VALUE_CHARS)).collect();
    let more = names.len().saturating_sub(MAX_LISTED);
    if more > 0 { format!("{} and {more} more", shown.join(", ")) } else { shown.join(", ") }
}

/// The lines that are needed. A comment of several lines may hold anything, so lines inside of quotes are skipped.
fn lines(text: &str) -> impl Iterator<Item = Line<'_>> {
    let mut is_quoted = false;
    text.lines().zip(1..).filter_map(move |(line, at)| {
        let was_quoted = is_quoted;
        is_quoted ^= quotes(line) % 2 == 1;
        if was_quoted { None } else { parse(line.trim(), at) }
    })
}

/// Number of quotes in a line, without those that a backslash precedes.
fn quotes(line: &str) -> usize {
    let bytes = line.as_bytes();
    (0..bytes.len()).filter(|&i| bytes[i] == b'"' && (i == 0 || bytes[i - 1] != b'\\')).count()
}

fn parse(line: &str, at: usize) -> Option<Line<'_>> {
    let (keyword, rest) = line.split_once([' ', '\t'])?;
    let (head, tail) = rest.split_once(':')?;
    let mut words = head.split_ascii_whitespace();
    match keyword {
        "BO_" => {
            let (id, name) = (words.next()?, words.next()?);
            Some(Line::Message(Message { line: at, id, name, bytes: tail.split_ascii_whitespace().next()? }))
        }
        "SG_" => {
            let (name, multiplexing) = (words.next()?, words.next().unwrap_or(""));
            Some(Line::Signal(SignalLine { line: at, name, multiplexing, layout: tail }))
        }
        "SIG_VALTYPE_" if !tail.trim_start().starts_with('0') => {
            Some(Line::Float { id: words.next()?, name: words.next()? })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAR: &str = "VERSION \"\"\r
BU_: ESP Gateway\r
BO_ 291 Motion: 8 ESP\r
 SG_ Speed : 8|16@1+ (0.01,0) [0|300] \"km/h\"  Gateway\r
 SG_ YawRate : 31|16@0- (0.005,0) [-100|100] \"\u{b0}/s\" Display\r
 SG_ Mode M : 0|4@1+ (1,0) [0|0] \"\" Display\r
 SG_ Part m3 : 40|8@1+ (1,0) [0|0] \"\" Display\r
 SG_ Ratio : 32|32@1- (1,0) [0|0] \"\" Display\r
BO_ 2566844672 Wide: 3 ESP\r
 SG_ Angle : 0|16@1- (0.1,0) [0|0] \"deg\" Gateway\r
 SG_ Long : 8|24@1+ (1,0) [0|0] \"\" Gateway\r
CM_ SG_ 291 Speed \"a comment \\\" of two lines\r
BO_ 1 Speed: 8 ESP\r
 end\";\r
SIG_VALTYPE_ 291 Ratio : 1;\r
";

    fn dbc(text: &[u8]) -> Dbc {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("car.dbc");
        std::fs::write(&path, text).unwrap();
        Dbc::read(&path).unwrap()
    }

    #[test]
    fn signals_are_found_in_both_encodings() {
        let latin: Vec<u8> = CAR.chars().map(|c| c as u8).collect();
        for text in [CAR.as_bytes(), &latin] {
            let dbc = dbc(text);
            let speed = dbc.signal("Motion.Speed").unwrap();
            assert_eq!(
                (speed.id.number, speed.start, speed.length, speed.range),
                (291, 8, 16, Some((0.0, 300.0)))
            );
            assert_eq!(dbc.signal("Motion.YawRate").unwrap().unit, "\u{b0}/s");
            assert!(dbc.signal("Motion.Mode").is_ok());
            let wide = dbc.signal("Wide.Angle").unwrap();
            assert_eq!((wide.id.number, wide.id.is_extended, wide.range), (0x18fe_f100, true, None));
        }
    }

    #[test]
    fn faults_name_file_line_and_remedy() {
        let car = dbc(CAR.as_bytes());
        for (name, expected) in [
            ("Speed", "no dot: give Message.Signal"),
            ("Motoin.Speed", "car.dbc: no message Motoin; the file has Motion, Wide"),
            ("Speed.Speed", "no message Speed;"),
            (
                "Motion.Sped",
                "car.dbc: message Motion has no signal Sped; it has Speed, YawRate, Mode, Part, Ratio",
            ),
            ("Motion.Part", "car.dbc: line 7: signal Part is multiplexed"),
            ("Motion.Ratio", "car.dbc: line 8: signal Ratio is a floating-point number"),
            ("Wide.Long", "car.dbc: line 11: signal Long ends beyond the 3 bytes of its message"),
        ] {
            let error = car.signal(name).unwrap_err();
            assert!(error.contains(expected), "{name}: {error}");
        }
        let broken = dbc(b"BO_ x A: 8 Y\n SG_ S : 0|8@1+ (1,0) \"\"\nBO_ 3 B: 8 Y\n SG_ S : 0|8@3+ (1,0)\n");
        assert!(broken.signal("A.S").unwrap_err().contains("line 1: the identifier of message A"));
        assert!(broken.signal("B.S").unwrap_err().contains("line 4: after @"));
        let folder = tempfile::tempdir().unwrap();
        let error = Dbc::read(&folder.path().join("no.dbc")).unwrap_err().to_string();
        assert!(error.starts_with("vehicle.dbc: ") && error.contains("no.dbc"), "{error}");
        let many: String = (0..40).map(|i| format!("BO_ {i} M{i}: 8 Y\n")).collect();
        assert!(dbc(many.as_bytes()).signal("X.Y").unwrap_err().contains("M11 and 28 more"));
    }
}
