//! The tables of signals in docs/can.md, written from the layout. Only a test uses them: it compares the page.

use super::layout::{
    CLASSES, DAEMON_STATES, EXISTENCE, HEAD, LEVELS, MOVING, OBJECT, OWN, PATH, RULES, SHAPE, SOURCES, STATUS,
};
use super::signal::{Coding, Signal};
use std::fmt::Write;

/// Head of a table.
const COLUMNS: &str = "| signal | bits | step | range | unit | meaning |\n|---|---|---|---|---|---|\n";

/// A table of signals.
fn table<T>(title: &str, signals: &[Signal<T>]) -> String {
    let mut out = format!("### {title}\n\n{COLUMNS}");
    for signal in signals {
        let (min, max) = signal.range();
        let number = |value: f64| {
            let text = format!("{value:.4}");
            let short = text.trim_end_matches('0').trim_end_matches('.');
            if short == "-0" { "0".to_owned() } else { short.replace('-', "−") }
        };
        let (step, range, unit) = match signal.coding {
            Coding::Number { factor, unit, .. } => {
                (number(factor), format!("{} to {}", number(min), number(max)), unit)
            }
            Coding::State(names) => {
                let named: Vec<String> =
                    names.iter().enumerate().map(|(n, name)| format!("{n} {name}")).collect();
                (String::new(), named.join(", "), "")
            }
            Coding::Bit => (String::new(), "0, 1".into(), ""),
            Coding::LowBits => (String::new(), format!("0 to {}", number(max)), ""),
        };
        let absent = signal.not_available().map_or(String::new(), |raw| format!("; {raw} = not available"));
        let _ = writeln!(
            out,
            "| `{}` | {}, {} | {step} | {range}{absent} | {unit} | {} |",
            signal.name,
            signal.start,
            signal.length,
            signal.text.trim()
        );
    }
    out
}

/// All tables, as the page has them.
fn tables() -> String {
    [
        table("Every message", HEAD),
        table("`Status`", STATUS),
        table("`Path`", PATH),
        table("`Own`", OWN),
        table("`Nearest`, `Object1` to `Object8`", OBJECT),
        table("`NearestShape`, `Object1Shape` to `Object8Shape`", SHAPE),
    ]
    .join("\n")
}

#[test]
fn the_page_has_the_tables_of_the_layout() {
    let page = include_str!("../../../docs/can.md");
    let tables = tables();
    if !page.contains(&tables) {
        println!("{tables}");
        panic!("docs/can.md is stale: replace its tables by what this test prints");
    }
    // Nothing of the layout is left out.
    for names in [LEVELS, RULES, DAEMON_STATES, EXISTENCE, CLASSES, MOVING, SOURCES] {
        assert!(
            names.iter().enumerate().all(|(n, name)| tables.contains(&format!("{n} {name}"))),
            "{names:?}"
        );
    }
}
