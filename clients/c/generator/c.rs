//! The C header.

use super::constants::groups;
use super::declaration::{Structure, Type, docs_before, name_of};
use super::{NOTE, source};
use messages::header::VERSION;
use std::fmt::Write;

/// Maximum length of a line.
const WIDTH: usize = 118;

const HEAD: &str = "
 * Reads the results of a running lookout daemon from its shared memory.
 *
 *     lookout_options options = LOOKOUT_OPTIONS;
 *     lookout_client *client = lookout_open(&options, NULL, 0);
 *     lookout_frame frame;
 *     while (lookout_next(client, 1000, &frame) >= 0)
 *         ...
 *     lookout_close(client);
 *
 * Camera axes: x to the right, y down, z forward along the optical axis of the left camera. Speeds are positive
 * forwards, yaw and curvature to the left (counter-clockwise from above), lateral positions to the right. Names end in
 * their units. Client and daemon must be of one release. docs/clients.md says more.
 */
#ifndef LOOKOUT_H
#define LOOKOUT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern \"C\" {
#endif

";

/// The header.
pub fn header(structures: &[Structure]) -> String {
    let mut text = format!("/* {NOTE}\n *{HEAD}");
    let _ = write!(
        text,
        "/* Layout of the structures: that of the daemon's messages. */\n#define LOOKOUT_LAYOUT {VERSION}\n"
    );
    for group in groups() {
        let _ = write!(text, "\n/* {} */\n", group.docs);
        for (name, value, docs) in group.constants {
            let docs = docs.replace('`', "");
            let _ = writeln!(text, "#define LOOKOUT_{name} {value} /* {docs} */");
        }
    }
    text.push('\n');
    for structure in structures {
        text.push_str(&comment(&structure.docs, ""));
        let _ = writeln!(text, "typedef struct {} {{", structure.name);
        for field in &structure.fields {
            let range = field.range.as_ref().map(|range| format!(" Range: {range}.")).unwrap_or_default();
            text.push_str(&comment(&format!("{}{range}", field.docs), "    "));
            let _ = writeln!(text, "    {};", declaration(&field.of, &c_field(&field.name)));
        }
        let _ = writeln!(text, "}} {};\n", structure.name);
    }
    text.push_str("/* Initial options: the daemon \"lookout\", without pictures. */\n");
    text.push_str("#define LOOKOUT_OPTIONS { LOOKOUT_LAYOUT, 0, NULL, NULL }\n\n");
    text.push_str("/* A client. Calls with the same client must not overlap. */\n");
    text.push_str("typedef struct lookout_client lookout_client;\n\n");
    text.push_str(&functions());
    text.push_str("#ifdef __cplusplus\n}\n#endif\n\n");
    text.push_str("/* That this compiler lays the structures out as the library does. */\n");
    text.push_str("#if defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L\n");
    for structure in structures.iter().filter(|structure| !structure.is_of_library()) {
        let bytes = structure.bytes(structures);
        let _ = writeln!(text, "_Static_assert(sizeof({}) == {bytes}, \"layout\");", structure.name);
    }
    text.push_str("#endif\n\n#endif\n");
    text
}

/// A comment before what it describes.
fn comment(docs: &str, indent: &str) -> String {
    let mut lines = vec![String::new()];
    for word in docs.replace("*/", "* /").replace('`', "").split_whitespace() {
        let last = lines.last_mut().expect("one");
        if last.chars().count() + word.chars().count() + indent.len() + 8 > WIDTH {
            lines.push(word.into());
        } else {
            if !last.is_empty() {
                last.push(' ');
            }
            last.push_str(word);
        }
    }
    format!("{indent}/* {} */\n", lines.join(&format!("\n{indent} * ")))
}

/// `class` is a word of C++.
fn c_field(name: &str) -> String {
    if name == "class" { "class_name".into() } else { name.into() }
}

fn number(rust: &str) -> &'static str {
    match rust {
        "u8" => "uint8_t",
        "u16" => "uint16_t",
        "u32" => "uint32_t",
        "u64" => "uint64_t",
        "i32" => "int32_t",
        "f32" => "float",
        "f64" => "double",
        "c_char" => "char",
        "c_int" => "int",
        "usize" => "size_t",
        _ => panic!("a type that C does not know: {rust}"),
    }
}

fn declaration(of: &Type, name: &str) -> String {
    match of {
        // Arrays of bytes in records are texts.
        Type::Array(element, length, _) if **element == Type::Number("u8".into()) => {
            format!("char {name}[{length}]")
        }
        Type::Array(element, length, length_name) => {
            let length = length_name.clone().unwrap_or_else(|| length.to_string());
            declaration(element, &format!("{name}[{length}]"))
        }
        Type::Number(rust) => format!("{} {name}", number(rust)),
        Type::Structure(rust) => format!("{} {name}", name_of(rust)),
        Type::Pointer(of) => format!("const {}", declaration(of, &format!("*{name}"))),
    }
}

/// The prototypes of the functions, with their documentation but for what concerns Rust alone.
fn functions() -> String {
    const HEAD: &str = "extern \"C\" fn ";
    let source = source("clients/c/src/lib.rs");
    let mut text = String::new();
    for (at, _) in source.match_indices(HEAD) {
        let line = source[..at].rfind('\n').map_or(0, |end| end + 1);
        if !source[line..at].starts_with("pub ") {
            continue;
        }
        let signature = &source[at + HEAD.len()..];
        let signature = &signature[..signature.find(" {\n").expect("a body")];
        let (name, rest) = signature.split_once('(').expect("arguments");
        let (arguments, result) = rest.rsplit_once(')').expect("their end");
        let arguments: Vec<String> = arguments
            .split(',')
            .filter_map(|argument| argument.trim().split_once(": "))
            .map(|(name, of)| argument(of, name))
            .collect();
        let arguments = if arguments.is_empty() { "void".into() } else { arguments.join(", ") };
        let result = result.trim().strip_prefix("-> ").map_or("void ".into(), |of| argument(of, ""));
        let docs = docs_before(&source[..line]);
        let docs = docs.split_once("# Safety").map_or(&docs[..], |(docs, _)| docs.trim());
        let separator = if result.ends_with('*') || result.ends_with(' ') { "" } else { " " };
        let _ = write!(text, "{}{result}{separator}{name}({arguments});\n\n", comment(docs, ""));
    }
    text
}

/// An argument or a result.
fn argument(of: &str, name: &str) -> String {
    let base = |rust: &str| match rust {
        "LookoutClient" => "lookout_client".to_owned(),
        _ if rust.starts_with("Lookout") => name_of(rust).to_owned(),
        _ => number(rust).to_owned(),
    };
    if let Some(of) = of.strip_prefix("*const ") {
        format!("const {} *{name}", base(of))
    } else if let Some(of) = of.strip_prefix("*mut ") {
        format!("{} *{name}", base(of))
    } else {
        format!("{} {name}", base(of))
    }
}
