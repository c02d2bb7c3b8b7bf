//! The reference of the records.

use super::constants::groups;
use super::declaration::{Structure, Type, name_of};
use messages::header::VERSION;
use std::fmt::Write;

const HEAD: &str = "# Records of the clients

<!-- Generated from the Rust declarations by: cargo run -p lookout-client-c --example generate -->

This page lists what a client in Rust, C or Python reads from shared memory; [clients.md](clients.md) says how. All numbers are in the byte
order of the machine, and there is no padding. Every number is checked against its range before a client gets it; `infinite` is positive infinity, and there are no NaN. Camera axes: x to the right, y down, z forward.
Speeds are positive forwards, yaw and curvature to the left, lateral positions to the right
([outputs.md](outputs.md#coordinate-frames)).

Texts (`text`) are UTF-8, padded with zeros; one of full length has no zero at its end. In C the field `class` is called
`class_name`.

";

/// The page.
pub fn page(structures: &[Structure]) -> String {
    let mut text = format!("{HEAD}Layout {VERSION}.\n");
    for structure in structures.iter().filter(|structure| !structure.is_of_library()) {
        let bytes = structure.bytes(structures);
        let (name, docs) = (structure.name, &structure.docs);
        let _ = write!(text, "\n## {name}\n\nIn Rust `{}`, {bytes} bytes. {docs}\n\n", structure.rust);
        text.push_str("| offset | field | type | range | meaning |\n|---|---|---|---|---|\n");
        let mut offset = 0;
        for field in &structure.fields {
            let range = field.range.as_deref().unwrap_or("");
            let _ = writeln!(
                text,
                "| {offset} | `{}` | {} | {range} | {} |",
                field.name,
                type_name(&field.of),
                field.docs
            );
            offset += field.of.bytes(structures);
        }
    }
    text.push_str("\n## Constants\n\nIn C with `LOOKOUT_` before the name.\n");
    for group in groups() {
        let _ = write!(text, "\n{}\n\n| name | value | meaning |\n|---|---|---|\n", group.docs);
        for (name, value, docs) in group.constants {
            let _ = writeln!(text, "| `{name}` | {value} | {docs} |");
        }
    }
    text
}

fn type_name(of: &Type) -> String {
    match of {
        Type::Number(rust) => rust.clone(),
        Type::Structure(rust) => format!("`{}`", name_of(rust)),
        Type::Array(element, length, _) if **element == Type::Number("u8".into()) => {
            format!("text of {length}")
        }
        Type::Array(element, length, _) => format!("{length} × {}", type_name(element)),
        Type::Pointer(of) => type_name(of),
    }
}
