//! The parts of a line, by the names that a user gives.

use std::collections::BTreeSet;
use tools::reporting::fields::field_names;
use tools::reporting::record::FrameRecord;

/// Fields of every line of a frame, in this order.
pub const HEAD: [&str; 6] = ["run", "sequence", "time_s", "withdrawn", "capture_ns", "latency_ms"];

/// The daemon's state, once a second.
pub const STATUS: &str = "status";

/// The vehicle's pose, in frames that have one.
pub const POSE: &str = "pose";

/// Every topic.
pub const ALL: &str = "all";

/// The topics: the fields of a frame's record that are not in every line, [`POSE`] and [`STATUS`].
pub fn names() -> impl Iterator<Item = &'static str> {
    let of_frame = field_names::<FrameRecord>().iter().copied().filter(|name| !HEAD.contains(name));
    of_frame.chain([POSE, STATUS])
}

/// The topics that a line has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topics {
    /// Topics of a frame; `None` = all, also those that only another version knows.
    of_frame: Option<BTreeSet<String>>,
    /// Whether the daemon's state is one of them.
    status: bool,
}

impl Topics {
    /// All topics.
    pub fn all() -> Self {
        Self { of_frame: None, status: true }
    }

    /// The named topics; all but the state if none is named.
    pub fn of(names: &[String]) -> Self {
        let is_named = |name: &str| names.iter().any(|n| n == name);
        if names.is_empty() {
            return Self { of_frame: None, status: false };
        }
        if is_named(ALL) {
            return Self::all();
        }
        let of_frame = names.iter().filter(|name| *name != STATUS).cloned().collect();
        Self { of_frame: Some(of_frame), status: is_named(STATUS) }
    }

    /// Whether a line of a frame has the field.
    pub fn has(&self, field: &str) -> bool {
        field != STATUS && self.of_frame.as_ref().is_none_or(|names| names.contains(field))
    }

    /// Whether there are lines of frames.
    pub fn has_frames(&self) -> bool {
        self.of_frame.as_ref().is_none_or(|names| !names.is_empty())
    }

    /// Whether lines have the daemon's state.
    pub fn has_status(&self) -> bool {
        self.status
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_are_the_fields_of_the_record() {
        let names: Vec<_> = names().collect();
        for name in ["alarm", "obstacles", "motion", "path", "road", STATUS] {
            assert!(names.contains(&name), "{names:?}");
        }
        assert!(!names.contains(&"sequence"));
        let of = |names: &[&str]| Topics::of(&names.iter().map(ToString::to_string).collect::<Vec<_>>());
        let some = of(&["alarm", STATUS]);
        assert!(some.has("alarm") && !some.has("path") && some.has_status() && some.has_frames());
        let state = of(&[STATUS]);
        assert!(state.has_status() && !state.has_frames());
        let default = of(&[]);
        assert!(default.has("new") && !default.has(STATUS) && !default.has_status() && default.has_frames());
        assert_eq!(of(&["path", ALL]), Topics::all());
    }
}
