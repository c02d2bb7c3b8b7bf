//! The Python module with the layout: constants, types of numpy for the records, structures of ctypes for the library.

use super::NOTE;
use super::constants::groups;
use super::declaration::{Structure, Type, name_of};
use messages::header::VERSION;
use std::fmt::Write;

/// The module.
pub fn module(structures: &[Structure]) -> String {
    let mut text = format!(
        "# {NOTE}\n\"\"\"Layout of the library's structures. docs/client-records.md describes the fields.\"\"\"\n\n"
    );
    text.push_str("import ctypes\n\nimport numpy\n\n");
    let records = structures.iter().filter(|structure| !structure.is_of_library());
    let constants = groups().into_iter().flat_map(|group| group.constants);
    let names = constants.map(|(name, ..)| name).chain(records.map(|record| upper(record.name)));
    text.push_str("__all__ = [\n    \"LAYOUT\",\n");
    for name in names {
        let _ = writeln!(text, "    \"{name}\",");
    }
    let _ = write!(text, "]\n\nLAYOUT = {VERSION}\n");
    for group in groups() {
        let _ = write!(text, "\n# {}\n", group.docs);
        for (name, value, _) in group.constants {
            let _ = writeln!(text, "{name} = {value}");
        }
    }
    text.push('\n');
    for structure in structures.iter().filter(|structure| !structure.is_of_library()) {
        let _ = writeln!(text, "{} = numpy.dtype([", upper(structure.name));
        for field in &structure.fields {
            let _ = writeln!(text, "    (\"{}\", {}),", field.name, dtype(&field.of));
        }
        text.push_str("])\n\n");
    }
    for structure in structures.iter().filter(|structure| structure.is_of_library()) {
        let name = structure.rust.trim_start_matches("Lookout");
        let _ = write!(text, "\nclass {name}(ctypes.Structure):\n    _fields_ = [\n");
        for field in &structure.fields {
            let _ = writeln!(text, "        (\"{}\", {}),", field.name, ctype(&field.of));
        }
        text.push_str("    ]\n\n");
    }
    text.trim_end().to_owned() + "\n"
}

/// `lookout_alarm` → `ALARM`.
fn upper(name: &str) -> String {
    name.trim_start_matches("lookout_").to_uppercase()
}

fn dtype(of: &Type) -> String {
    match of {
        Type::Number(rust) => {
            let (kind, bits) = rust.split_at(1);
            let bytes = bits.parse::<usize>().expect("a number's size") / 8;
            format!("\"={kind}{bytes}\"")
        }
        Type::Structure(rust) => upper(name_of(rust)),
        Type::Array(element, length, _) if **element == Type::Number("u8".into()) => format!("\"S{length}\""),
        Type::Array(element, length, _) => format!("{}, ({length},)", dtype(element)),
        Type::Pointer(_) => panic!("records have no pointers"),
    }
}

fn ctype(of: &Type) -> String {
    match of {
        Type::Number(rust) => match &rust[..] {
            "u32" => "ctypes.c_uint32".into(),
            "u64" => "ctypes.c_uint64".into(),
            _ => panic!("{rust}"),
        },
        Type::Pointer(of) if **of == Type::Number("c_char".into()) => "ctypes.c_char_p".into(),
        Type::Pointer(_) => "ctypes.c_void_p".into(),
        Type::Structure(_) | Type::Array(..) => panic!("the library's structures hold numbers and pointers"),
    }
}
