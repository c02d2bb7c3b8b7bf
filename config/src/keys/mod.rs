//! Every key of the configuration: what it is, its unit, its range and what turning it up does.

mod board;
mod camera;
mod daemon;
mod decisions;
mod frames;
mod realtime;
mod soak;

/// What a key holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// true or false.
    Switch,
    /// A whole number in a range.
    Whole(i64, i64),
    /// A number in a range.
    Number(f64, f64),
    /// One of a few words.
    Choice(&'static [&'static str]),
    /// Letters, digits, `-` and `_`, at most this many.
    Name(usize),
    /// A path; may be empty.
    Path,
    /// One line of at most this many characters; may be empty.
    Text(usize),
}

/// One key.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Table and key, with a dot.
    pub name: &'static str,
    /// What it holds.
    pub kind: Kind,
    /// What it is, in which unit, and what turning it up does.
    pub text: &'static str,
}

const fn key(name: &'static str, kind: Kind, text: &'static str) -> Key {
    Key { name, kind, text }
}

/// The tables, in the order of the reference.
const TABLES: &[&[Key]] = &[
    daemon::INSTANCE,
    daemon::LOG,
    frames::SOURCE,
    frames::STEREO,
    frames::CALIBRATION,
    decisions::ROAD,
    decisions::REGIONS,
    decisions::RECOGNITION,
    decisions::TRACKING,
    decisions::ALARM,
    daemon::CORES,
    daemon::SUPERVISION,
    board::HEAT,
    board::CLOCKS,
    board::BOARD,
    soak::SOAK,
    camera::CAMERA,
    realtime::REALTIME,
    realtime::PACING,
];

/// All keys, table by table.
pub fn all() -> impl Iterator<Item = &'static Key> {
    TABLES.iter().copied().flatten()
}
