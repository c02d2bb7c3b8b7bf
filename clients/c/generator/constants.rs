//! Numbers with names: limits, values of enumerations, bits.

use super::declaration::docs_before;
use super::source;
use messages::space::{MAX_BOUNDARIES, MAX_POINTS, MAX_SECTORS};
use messages::{alarm, header, obstacles, space};

/// A constant: name without prefix, value, documentation.
pub type Constant = (String, u64, String);

/// Constants that belong together, with what they are.
pub struct Group {
    pub docs: &'static str,
    pub constants: Vec<Constant>,
}

/// Names of the lengths of arrays and of links in documentation, and what they are called in C.
const LINKS: [(&str, &str); 13] = [
    ("MAX_COUNT", "LOOKOUT_MAX_OBSTACLES"),
    ("MAX_SECTORS", "LOOKOUT_MAX_SECTORS"),
    ("MAX_BOUNDARIES", "LOOKOUT_MAX_BOUNDARIES"),
    ("MAX_POINTS", "LOOKOUT_MAX_POINTS"),
    ("crate::alarm::LEVELS", "LOOKOUT_LEVEL_…"),
    ("crate::alarm::RULES", "LOOKOUT_RULE_…"),
    ("crate::alarm::MOVING", "LOOKOUT_MOVING_…"),
    ("crate::alarm::Faults", "LOOKOUT_FAULT_…"),
    ("ENDS", "LOOKOUT_END_…"),
    ("SIDES", "LOOKOUT_SIDE_…"),
    ("health", "LOOKOUT_HEALTH_…"),
    ("present", "LOOKOUT_PRESENT_…"),
    ("vehicle_faults", "LOOKOUT_VEHICLE_FAULT_…"),
];

/// What a link in the documentation is called in C.
pub fn linked(link: &str) -> String {
    let known = LINKS.iter().find(|(name, _)| *name == link).map(|(_, c)| (*c).to_owned());
    match link {
        "crate::modes" => "`LOOKOUT_MODE_…`".into(),
        _ => format!("`{}`", known.unwrap_or_else(|| panic!("a link that C does not know: {link}"))),
    }
}

/// Name in C of the length of an array.
pub fn c_name(length: &str) -> String {
    linked(length).trim_matches('`').into()
}

/// Value of the length of an array.
pub fn size_of_name(length: &str) -> usize {
    match length {
        "MAX_SECTORS" => MAX_SECTORS,
        "MAX_BOUNDARIES" => MAX_BOUNDARIES,
        "MAX_POINTS" => MAX_POINTS,
        _ => panic!("a length that is not rendered: {length}"),
    }
}

/// All groups.
pub fn groups() -> Vec<Group> {
    let limit = |name: &str, value: usize, docs: &str| (name.to_owned(), value as u64, docs.to_owned());
    let group = |docs, constants| Group { docs, constants };
    let bits = |file, region, prefix: &str| bits(&source(file), region, prefix);
    vec![
        group(
            "Limits.",
            vec![
                limit("MAX_OBSTACLES", obstacles::MAX_COUNT, "Maximum number of obstacles of a frame."),
                limit("MAX_SECTORS", MAX_SECTORS, "Maximum number of sectors of the free space."),
                limit("MAX_BOUNDARIES", MAX_BOUNDARIES, "Maximum number of boundaries."),
                limit("MAX_POINTS", MAX_POINTS, "Maximum number of points of a boundary."),
                limit(
                    "MAX_SIDE",
                    header::MAX_SIDE as usize,
                    "Maximum width and height of a picture, in pixels.",
                ),
            ],
        ),
        group("Level of the alarm.", names("LEVEL", &alarm::LEVELS)),
        group("The rule that raised the level.", names("RULE", &alarm::RULES)),
        group("Self-checks that failed, as bits.", bits("ipc/src/alarm.rs", "impl Faults {", "FAULT")),
        group("Whether an obstacle moves over ground.", names("MOVING", &alarm::MOVING)),
        group("Why free space ends.", names("END", &space::ENDS)),
        group("Where a boundary stands.", names("SIDE", &space::SIDES)),
        group(
            "What the own motion is known from, as bits.",
            bits("ipc/src/motion.rs", "mod health {", "HEALTH"),
        ),
        group(
            "Which values of the bus there are, as bits.",
            bits("ipc/src/motion.rs", "mod present {", "PRESENT"),
        ),
        group(
            "What is wrong with the bus, as bits.",
            bits("ipc/src/motion.rs", "mod vehicle_faults {", "VEHICLE_FAULT"),
        ),
        group("How stages treat a frame, as bits.", bits("ipc/src/header.rs", "mod modes {", "MODE")),
    ]
}

/// Constants from a table of names.
fn names(prefix: &str, names: &[&str]) -> Vec<Constant> {
    let name = |name: &str| format!("{prefix}_{}", name.to_uppercase());
    names.iter().enumerate().map(|(value, text)| (name(text), value as u64, format!("`{text}`."))).collect()
}

/// Bits that are declared between `region` and its closing brace. `ALL` and `NONE` are for the daemon alone.
fn bits(text: &str, region: &str, prefix: &str) -> Vec<Constant> {
    let start = text.find(region).unwrap_or_else(|| panic!("no {region}"));
    let body = &text[start..];
    let body = &body[..body.find("\n}").expect("its end")];
    let declared = body.match_indices("pub const ").filter_map(|(at, _)| {
        let (name, rest) = body[at + "pub const ".len()..].split_once(": ")?;
        let value = rest.split_once(" = ")?.1.split_once(';')?.0;
        let value = value.strip_prefix("Self(").and_then(|v| v.strip_suffix(')')).unwrap_or(value);
        let bit = match value.strip_prefix("1 << ") {
            Some(shift) => 1 << shift.parse::<u32>().ok()?,
            None => value.parse().ok()?,
        };
        let is_bit = name != "ALL" && name != "NONE";
        is_bit.then(|| (format!("{prefix}_{name}"), bit, docs_before(&body[..at])))
    });
    declared.collect()
}
