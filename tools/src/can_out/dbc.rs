//! The layout as a DBC file, for the tools of vehicle networks.

use super::layout::{Content, HEAD, Identifiers, MESSAGE_PREFIX, OWN, PATH, STATUS, messages};
use super::signal::{Coding, Signal};
use std::fmt::Write;

/// Bit that DBC files set in extended identifiers.
const EXTENDED_BIT: u32 = 1 << 31;

/// Name of the sender.
const NODE: &str = "Lookout";

/// Maximum period that the attribute allows, in ms.
const MAX_PERIOD_MS: u64 = 10_000;

/// Comment of the whole file.
const COMMENT: &str = "Frames of lookout, a stereo camera that watches the road ahead. Information only: nothing here \
                       is a request to the vehicle, and nothing may be used as one; lookout is not a safety element. \
                       All ones in a signal of more than one bit, where its value table says so, mean that the value is \
                       not available. A receiver tests checksum (AUTOSAR E2E profile 1A; data id 0x4C00 + offset of the \
                       identifier from that of the status), alive counter, timeout and age. Generated: see docs/can.md.";

/// What the lines of a signal have in common.
struct Written {
    /// `SG_` line.
    signal: String,
    /// `CM_` line.
    comment: String,
    /// `VAL_` line; may be empty.
    values: String,
}

/// The DBC file of messages that are sent each `period_ms`.
pub fn dbc(identifiers: Identifiers, period_ms: u64) -> String {
    let (mut bodies, mut comments, mut periods, mut values) =
        (String::new(), String::new(), String::new(), String::new());
    for message in messages(identifiers.objects) {
        let id = identifiers.base + message.offset | if identifiers.is_extended { EXTENDED_BIT } else { 0 };
        let _ = writeln!(bodies, "\nBO_ {id} {MESSAGE_PREFIX}{}: 8 {NODE}", message.name);
        let _ = writeln!(comments, "CM_ BO_ {id} \"{} Data id 0x{:04X}.\";", message.text, message.data_id());
        let _ = writeln!(periods, "BA_ \"GenMsgCycleTime\" BO_ {id} {period_ms};");
        let mut signals = table(HEAD, id, &message.name);
        signals.extend(match message.content {
            Content::Status => table(STATUS, id, &message.name),
            Content::Path => table(PATH, id, &message.name),
            Content::Own => table(OWN, id, &message.name),
            Content::Nearest(signals) | Content::Object(_, signals) => table(signals, id, &message.name),
        });
        for Written { signal, comment, values: of } in signals {
            bodies.push_str(&signal);
            comments.push_str(&comment);
            values.push_str(&of);
        }
    }
    format!(
        "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: {NODE}\n{bodies}\nCM_ \"{COMMENT}\";\nCM_ BU_ {NODE} \"Sender of all \
         messages.\";\n{comments}BA_DEF_ BO_ \"GenMsgCycleTime\" INT 0 {MAX_PERIOD_MS};\n\
         BA_DEF_DEF_ \"GenMsgCycleTime\" 0;\n{periods}{values}"
    )
}

/// The lines of a table of signals.
fn table<T>(signals: &[Signal<T>], id: u32, message: &str) -> Vec<Written> {
    signals.iter().map(|signal| written(signal, id, message)).collect()
}

fn written<T>(signal: &Signal<T>, id: u32, message: &str) -> Written {
    let (factor, offset, unit) = match signal.coding {
        Coding::Number { factor, offset, unit } => (factor, offset, unit),
        _ => (1.0, 0.0, ""),
    };
    let (min, max) = signal.range();
    let name = format!("{message}_{}", signal.name);
    let states: &[&str] = match signal.coding {
        Coding::State(states) => states,
        Coding::Bit => &["no", "yes"],
        Coding::Number { .. } | Coding::LowBits => &[],
    };
    let mut named: Vec<String> = states.iter().enumerate().map(|(raw, s)| format!("{raw} \"{s}\"")).collect();
    named.extend(signal.not_available().map(|raw| format!("{raw} \"not available\"")));
    Written {
        signal: format!(
            " SG_ {name} : {}|{}@1+ ({},{}) [{}|{}] \"{unit}\" Vector__XXX\n",
            signal.start,
            signal.length,
            decimal(factor),
            decimal(offset),
            decimal(min),
            decimal(max)
        ),
        comment: format!("CM_ SG_ {id} {name} \"{}\";\n", signal.text.trim()),
        values: if named.is_empty() {
            String::new()
        } else {
            format!("VAL_ {id} {name} {} ;\n", named.join(" "))
        },
    }
}

/// A number with at most six decimals: factors such as 0.05 are not exact, and neither are their multiples.
fn decimal(value: f64) -> String {
    let text = format!("{value:.6}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".into() } else { short.into() }
}

#[cfg(test)]
mod tests {
    use super::super::layout::{DEFAULT_BASE_ID, MAX_OBJECTS};
    use super::super::values::Values;
    use super::super::{DaemonState, Encoder, Object, ResultValues};
    use super::*;
    use sources::vehicle::Dbc;

    const DEFAULT: Identifiers =
        Identifiers { base: DEFAULT_BASE_ID, is_extended: false, objects: MAX_OBJECTS };

    /// The file that ships, and the default period of the configuration.
    const SHIPPED: &str = include_str!("../../../config/can/lookout.dbc");

    #[test]
    fn the_shipped_file_is_that_of_the_layout() {
        assert!(
            SHIPPED == dbc(DEFAULT, 50),
            "config/can/lookout.dbc is stale: run `lookout can --dbc > config/can/lookout.dbc`"
        );
        assert!(SHIPPED.is_ascii());
    }

    #[test]
    fn identifiers_objects_and_period_are_those_of_the_configuration() {
        let text = dbc(Identifiers { base: 0x1800_0000, is_extended: true, objects: 1 }, 20);
        assert!(text.contains(&format!("BO_ {} LookoutInfo_Object1: 8 Lookout", 0x9800_0008_u32)), "{text}");
        assert!(!text.contains("Object2") && text.contains("\"GenMsgCycleTime\" BO_ 2550136832 20;"));
    }

    /// Frames decoded by the reader of DBC files that the vehicle's bus uses, which shares no code with this side.
    #[test]
    fn frames_decode_with_the_file_to_what_was_encoded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lookout.dbc");
        std::fs::write(&path, SHIPPED).unwrap();
        let file = Dbc::read(&path).unwrap();
        let object =
            Object { distance_m: Some(33.35), lateral_m: Some(-2.45), track: 9, ..Object::default() };
        let values = Values {
            daemon: Some(DaemonState::Running),
            source: None,
            result: Some(ResultValues { objects: vec![object], ..ResultValues::default() }),
            withdrawn: 0,
        };
        let mut frames = Vec::new();
        Encoder::new(DEFAULT).encode(&values.cycle(77_000_000, 500_000_000), &mut frames);
        for (name, expected, is_valid) in [
            ("Status.Status_Age", 77.0, true),
            ("Status.Status_DaemonState", 1.0, true),
            ("Object1.Object1_Distance", 33.35, true),
            ("Object1.Object1_Lateral", -2.45, true),
            ("Object1Shape.Object1Shape_Track", 9.0, true),
            ("Object2.Object2_Distance", 204.75, false),
            ("Nearest.Nearest_Lateral", 51.2, false),
        ] {
            let signal = file.signal(&format!("{MESSAGE_PREFIX}{name}")).unwrap();
            let frame = frames.iter().find(|f| f.id == signal.id.number).unwrap();
            let value = signal.decode(&frame.data).unwrap();
            assert!((value - expected).abs() < 1e-9, "{name}: {value}");
            assert_eq!(signal.is_valid(value), is_valid, "{name}: not available is out of range");
        }
    }

    #[test]
    fn numbers_are_written_without_noise() {
        let texts = [0.05, -51.15, 0.1 + 0.2, 204.7, 50.0, -0.0, 0.0005].map(decimal);
        assert_eq!(texts, ["0.05", "-51.15", "0.3", "204.7", "50", "0", "0.0005"]);
    }
}
