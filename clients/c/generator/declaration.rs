//! The declarations in the source: structures with `repr(C)`, their fields and documentation.

use super::constants::{self, size_of_name};
use super::source;

/// A type of a field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Type {
    /// A number, by its name in Rust.
    Number(String),
    /// Another structure, by its name in Rust.
    Structure(String),
    /// An array: element, length, and the name of the length if it has one.
    Array(Box<Type>, usize, Option<String>),
    /// A pointer to what must not be written.
    Pointer(Box<Type>),
}

/// A field.
#[derive(Clone, Debug)]
pub struct Field {
    pub name: String,
    pub of: Type,
    /// What it is: unit, sign, when it is absent.
    pub docs: String,
    /// Its valid values; `None` where every value is valid.
    pub range: Option<String>,
}

/// A structure.
#[derive(Clone, Debug)]
pub struct Structure {
    /// Name in Rust.
    pub rust: &'static str,
    /// Name in C and Python.
    pub name: &'static str,
    pub docs: String,
    pub fields: Vec<Field>,
}

/// The structures: name in Rust, in C, and the file with the declaration; each after those that it contains.
const STRUCTURES: [(&str, &str, &str); 11] = [
    ("SectorRecord", "lookout_sector", "ipc/src/space.rs"),
    ("BoundaryPointRecord", "lookout_boundary_point", "ipc/src/space.rs"),
    ("BoundaryRecord", "lookout_boundary", "ipc/src/space.rs"),
    ("SpaceRecord", "lookout_space", "ipc/src/space.rs"),
    ("AlarmRecord", "lookout_alarm", "ipc/src/message/obstacles.rs"),
    ("ObstacleRecord", "lookout_obstacle", "ipc/src/message/obstacles.rs"),
    ("MotionRecord", "lookout_motion", "ipc/src/motion.rs"),
    ("VehicleRecord", "lookout_vehicle", "ipc/src/motion.rs"),
    ("RigRecord", "lookout_rig", "ipc/src/rig.rs"),
    ("LookoutOptions", "lookout_options", "clients/c/src/frame.rs"),
    ("LookoutFrame", "lookout_frame", "clients/c/src/frame.rs"),
];

/// Name in C of a structure.
pub fn name_of(rust: &str) -> &'static str {
    STRUCTURES.iter().find(|(name, ..)| *name == rust).unwrap_or_else(|| panic!("{rust} is not rendered")).1
}

/// All structures.
pub fn structures() -> Vec<Structure> {
    let ranges = messages::layout::records();
    STRUCTURES
        .iter()
        .map(|&(rust, name, file)| {
            let text = source(file);
            let start =
                text.find(&format!("pub struct {rust} {{")).unwrap_or_else(|| panic!("{file}: {rust}"));
            let body = &text[start..];
            let body = &body[..body.find("\n}").expect("its end")];
            let mut fields = fields(body);
            for (field, range) in ranges.iter().filter(|r| r.name == rust).flat_map(|r| &r.fields) {
                let of_name = fields.iter_mut().find(|of| of.name == *field);
                of_name.unwrap_or_else(|| panic!("{rust} has no {field}")).range.clone_from(range);
            }
            Structure { rust, name, docs: docs_before(&text[..start]), fields }
        })
        .collect()
}

/// The documentation that ends a text, before attributes.
pub fn docs_before(text: &str) -> String {
    let lines: Vec<&str> = text.trim_end().lines().rev().collect();
    let docs = lines.iter().skip_while(|line| line.starts_with("#["));
    let mut docs: Vec<&str> = docs.map_while(|line| line.trim().strip_prefix("///")).map(str::trim).collect();
    docs.reverse();
    plain(&docs.join(" "))
}

fn fields(body: &str) -> Vec<Field> {
    let (mut fields, mut docs) = (Vec::new(), Vec::new());
    for line in body.lines().skip(1).map(str::trim) {
        if let Some(doc) = line.strip_prefix("///") {
            docs.push(doc.trim());
        } else if let Some((name, of)) = line.strip_prefix("pub ").and_then(|field| field.split_once(": ")) {
            let of = type_of(of.trim_end_matches(','));
            fields.push(Field { name: name.into(), of, docs: plain(&docs.join(" ")), range: None });
            docs.clear();
        }
    }
    fields
}

fn type_of(text: &str) -> Type {
    if let Some(of) = text.strip_prefix("*const ") {
        return Type::Pointer(Box::new(type_of(of)));
    }
    if let Some((element, length)) =
        text.strip_prefix('[').and_then(|t| t.strip_suffix(']')?.rsplit_once("; "))
    {
        let (length, name) = match length.parse() {
            Ok(length) => (length, None),
            Err(_) => (size_of_name(length), Some(constants::c_name(length))),
        };
        return Type::Array(Box::new(type_of(element)), length, name);
    }
    match text {
        "u8" | "u16" | "u32" | "u64" | "i32" | "f32" | "f64" | "c_char" => Type::Number(text.into()),
        _ => Type::Structure(text.into()),
    }
}

/// Documentation without the links of rustdoc: constants by their names in C.
fn plain(docs: &str) -> String {
    let mut text = docs.to_owned();
    while let Some((before, rest)) = text.split_once("[`") {
        let (link, after) = rest.split_once("`]").unwrap_or((rest, ""));
        text = format!("{before}{}{after}", constants::linked(link));
    }
    text
}

impl Type {
    /// Size in bytes. There is no padding: the records are plain data, and the compiler would refuse it.
    pub fn bytes(&self, structures: &[Structure]) -> usize {
        match self {
            Self::Number(name) => match &name[..] {
                "u8" | "c_char" => 1,
                "u16" => 2,
                "u64" | "f64" => 8,
                _ => 4,
            },
            Self::Structure(rust) => {
                let of = structures.iter().find(|structure| structure.rust == rust);
                of.unwrap_or_else(|| panic!("{rust}")).bytes(structures)
            }
            Self::Array(element, length, _) => element.bytes(structures) * length,
            Self::Pointer(_) => size_of::<*const u8>(),
        }
    }
}

impl Structure {
    /// Size in bytes.
    pub fn bytes(&self, structures: &[Self]) -> usize {
        self.fields.iter().map(|field| field.of.bytes(structures)).sum()
    }

    /// Whether it is one of the library, and not a record of a message.
    pub fn is_of_library(&self) -> bool {
        self.rust.starts_with("Lookout")
    }
}
